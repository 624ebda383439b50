"""Entry of the page's process."""

from __future__ import annotations

import sys

from rig.page.process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
