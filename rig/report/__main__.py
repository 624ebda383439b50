"""`python -m rig.report RUN`: write the report of a run and print its path."""

from __future__ import annotations

import sys
from pathlib import Path

from rig.errors import EXIT_USAGE, RigError
from rig.report.document import write_report


def main(arguments: list[str]) -> int:
    """Write the report of each run named; return the exit code."""
    if not arguments:
        sys.stderr.write("usage: python -m rig.report RUN...\n")
        return EXIT_USAGE
    for run in arguments:
        try:
            sys.stdout.write(f"{write_report(Path(run)).resolve()}\n")
        except RigError as error:
            sys.stderr.write(f"{error}\n")
            return error.exit_code
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
