"""The UTFSM tests as CSV files: raw volts of the data logger, five tests in each file, to seconds, metres and newtons.

    python examples/utfsm_to_csv.py ME25mm0x25Hz.txt ME25mm0x5Hz.txt ME2mm5Hz.txt ME5mm3Hz.txt --out FOLDER

Factors of the authors' own `sincronize.m`: force 980.665 N/V, displacement 10 mm/V. Sampled every 5 ms the first
channel is the force, every 1 ms the second. The five tests of a file, at 0, 0.25, 0.5, 0.75 and 1 A, are parted by
pauses of the logger. Nothing is filtered; offsets, ramps and rests are kept.
"""

from __future__ import annotations

import argparse
from pathlib import Path

FORCE_N_V, DISPLACEMENT_M_V = 980.665, 0.01
CURRENTS_A = ("0.00", "0.25", "0.50", "0.75", "1.00")
FORCE_FIRST_S = 0.005
HEADER = 7


def tests_of(text: str) -> tuple[float, list[list[tuple[float, float]]]]:
    """Sampling interval (s), and both channels (V) of every test."""
    lines = text.splitlines()
    interval_s = float(next(line for line in lines if line.startswith("Sampling Interval")).split(":")[1])
    tests: list[list[tuple[float, float]]] = []
    for line in lines[HEADER:]:
        cells = [cell.strip() for cell in line.split(",")]
        if len(cells) > 4 and cells[4] in {"DAQ Start", "DAQ Resume"}:
            tests.append([])
        tests[-1].append((float(cells[2]), float(cells[3])))
    return interval_s, tests


def main() -> None:
    """Convert the files named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--out", required=True, type=Path)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for file in arguments.files:
        interval_s, tests = tests_of(file.read_text(encoding="latin-1"))
        force = 0 if interval_s == FORCE_FIRST_S else 1
        for current, test in zip(CURRENTS_A, tests, strict=True):
            rows = (
                f"{k * interval_s:.6f},{volts[1 - force] * DISPLACEMENT_M_V:.6f},{volts[force] * FORCE_N_V:.6f}\n"
                for k, volts in enumerate(test)
            )
            out = arguments.out / f"{file.stem.removeprefix('ME')}_{current}A.csv"
            out.write_text("t_s,x_m,force_N\n" + "".join(rows), encoding="ascii")


if __name__ == "__main__":
    main()
