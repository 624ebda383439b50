"""Entry of the station process."""

from __future__ import annotations

import sys

from rig.station.process import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
