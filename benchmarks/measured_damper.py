"""Models on a real damper: each amplitude and frequency left out and predicted from the others.

    RIG_MEASURED_DATA=DIR python benchmarks/measured_damper.py [MODEL ...] [--weight 1]

DIR holds the UTFSM tests as CSV files (`t_s,x_m,force_N`, the current in the name). Prints, for each model, the error
(% of peak) of every unseen test, their mean, the mean where it is fitted to all tests, and CPU time.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np

from rig.identification import Measurement, Method, identify
from rig.identification.points.preparation import prepare_all
from rig.recording.importing import import_tests
from rig.recording.run import Run

COLUMNS = {"time": "t_s", "displacement": "x_m", "force": "force_N"}


def measured(folder: Path) -> list[Measurement]:
    """The prepared tests of a folder of CSV files."""
    pattern = r"_(?P<current>[0-9.]+)A"
    with tempfile.TemporaryDirectory() as place:
        files = sorted(folder.glob("*.csv"))
        run = import_tests(files, columns=COLUMNS, current_from_name=pattern, out=Path(place) / "measured")
        return prepare_all(Run.open(run).valid)[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    shown = ["asymmetric", "thinning_bouc_wen", "lost_motion", "sprung_bouc_wen"]
    parser.add_argument("models", nargs="*", default=shown)
    parser.add_argument("--weight")
    arguments = parser.parse_args()
    tests = measured(Path(os.environ["RIG_MEASURED_DATA"]))
    motions = sorted({(round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) for each in tests})
    for name in arguments.models:
        began, unseen = time.process_time(), []
        print(name)
        for motion in motions:
            out = [each for each in tests if (round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) == motion]
            kept = [each for each in tests if not any(each is other for other in out)]
            fit = identify(kept, model=name, holdout=out, method=Method(weight=arguments.weight))
            assert fit.holdout is not None
            errors = [each.nrmse_percent_of_peak for each in fit.holdout.per_test]
            unseen += errors
            shown = " ".join(f"{error:5.1f}" for error in errors)
            print(f"  {1e3 * motion[0]:4.1f} mm {motion[1]:4.2f} Hz: {shown}   mean {np.mean(errors):.2f}")
        fit = identify(tests, model=name, method=Method(weight=arguments.weight))
        cpu_s = time.process_time() - began
        print(f"  unseen {np.mean(unseen):.2f}, fitted {fit.error.nrmse_percent_of_peak:.2f}, {cpu_s:.1f} s of CPU")


if __name__ == "__main__":
    main()
