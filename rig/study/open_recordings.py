"""Open recordings that the user downloaded: found, compared with their checksums, split into fitted and unseen."""

from __future__ import annotations

import hashlib
import os
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rig.errors import FileProblem, some
from rig.identification import Measurement, identify
from rig.identification.cross_validation import pairs_of
from rig.identification.models.coil import needs_lag, with_lag
from rig.identification.points.preparation import prepare_all
from rig.identification.points.whole_record import cut_in_time, last_share
from rig.recording.importing import import_tests
from rig.recording.run import Run
from rig.study.benchmark_file import BenchmarkFile, Recordings


@dataclass(frozen=True)
class Found:
    """Where the files of some recordings are.

    Attributes:
        recordings: which.
        folder: where they were looked for.
        missing: names of files that are not there.
        changed: names of files with other bytes than the benchmark's.
    """

    recordings: Recordings
    folder: Path
    missing: tuple[str, ...]
    changed: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether all files are there, byte by byte."""
        return not (self.missing or self.changed)

    @property
    def missing_message(self) -> str:
        """What is wrong, and where the files come from: one line."""
        one, parts = self.recordings, []
        if self.missing:
            parts.append(f"{len(self.missing)} of {len(one.files)} files missing ({some(self.missing)})")
        if self.changed:
            parts.append(f"SHA-256 differs from the benchmark's for {some(self.changed)}")
        variable = f", or set {one.variable} to the folder that contains them" if one.variable else ""
        prepare = f" {one.prepare}" if one.prepare else ""
        return (
            f"{one.name} in {self.folder}: {' and '.join(parts)}. The recordings are not included; download them from "
            f"{one.source} (licence: {one.licence}).{prepare} Copy them to that folder{variable}"
        )


@dataclass(frozen=True)
class Fold:
    """One split: what is fitted, and what no fit has seen."""

    fitted: list[Measurement]
    unseen: list[Measurement]


def find_all(benchmark: BenchmarkFile, base: Path) -> list[Found]:
    """Look for the files of every recordings.

    Args:
        benchmark: the benchmark.
        base: folder that its folders are relative to.

    Raises:
        FileProblem: none of the recordings is complete; one line for each, with its source.
    """
    sets = [_found(one, base) for one in benchmark.recordings]
    if not any(one.complete for one in sets):
        raise FileProblem("open recordings", [one.missing_message for one in sets])
    return sets


def _found(one: Recordings, base: Path) -> Found:
    named = os.environ.get(one.variable, "") if one.variable else ""
    folder = Path(named) if named else base / one.folder
    there = {name: folder / name for name in one.files if (folder / name).is_file()}
    changed = [name for name, path in there.items() if hashlib.sha256(path.read_bytes()).hexdigest() != one.files[name]]
    return Found(one, folder, tuple(name for name in one.files if name not in there), tuple(changed))


def folds_of(found: Found) -> list[Fold]:
    """The recordings prepared and split as the benchmark says; a coil's lag found on what is fitted.

    Raises:
        FileProblem: a file cannot be read.
        IdentificationFailed: nothing in it can be used.
    """
    one = found.recordings
    with tempfile.TemporaryDirectory() as place:
        files = sorted(found.folder / name for name in one.files)
        run = import_tests(
            files, columns=dict(one.columns), current_from_name=one.current_from_name, waveform=one.waveform,
            out=Path(place),
        )  # fmt: skip
        tests = prepare_all(Run.open(run).valid)[0]
    share = last_share(one.split)
    if share is not None:
        folds = [Fold(*cut_in_time(tests, share))]
    else:
        groups = [[tests[number] for number in numbers] for _, numbers in pairs_of(tests)]
        folds = [
            Fold([test for other in groups if other is not group for test in other], group) for group in groups
        ]
    return [_lagged(fold) for fold in folds]


def _lagged(fold: Fold) -> Fold:
    """The fold with the coil's own current, where only its command was recorded: the same for all entries."""
    if not needs_lag(fold.fitted):
        return fold
    eta_1_s = identify(fold.fitted, model="asymmetric", diagnose=False).coil_eta_1_s
    if eta_1_s is None:
        return fold
    sides = (
        [replace(with_lag(test, eta_1_s), commanded_A=None, commanded_before_A=None) for test in side]
        for side in (fold.fitted, fold.unseen)
    )
    return Fold(*sides)


def variance_percent(test: Measurement, nrmse_percent: float) -> float:
    """Share of a test's force variance (%) that an error (% of its peak) leaves explained."""
    rmse_N = 0.01 * nrmse_percent * test.peak_force_N
    return 100.0 * (1.0 - rmse_N**2 / float(np.var(test.force_N[test.scored])))
