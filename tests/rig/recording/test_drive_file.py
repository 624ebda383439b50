"""Stored drives: read back as the start of another iteration, only on the same machine with the same specimen; and as
excerpts for the page."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.errors import EXIT_DONE, EXIT_USAGE
from rig.recording.drive_excerpt import MOST_SHOWN, drive_excerpt, main
from rig.recording.drive_file import DriveOwner, kept_drives, write_drive
from rig.recording.point_attributes import NOT_STATED, attributes_of, point_fields
from rig.signals.drive_iteration import KEPT, FrequencyResponse, SignalDrive, Trial, command_record
from rig.signals.force_target import ForceTarget, SpeedOfForce
from rig.signals.record import SweepMotion, sweep_record
from rig.test_point import TestPoint

TARGET = sweep_record(SweepMotion(5.0, 1.0, 4.0, 0.01, 0.004), 1.0)
POINT = TestPoint("p001", "sweep", TARGET.amplitude_m, 2.0, 1.5, 1, 0.0, 0.0, kind="signal", record=TARGET)
OWNER = DriveOwner("MR-001", "abc")


def drive() -> SignalDrive:
    lines_Hz = np.arange(0.5, 8.0, 0.5)
    response = FrequencyResponse(0.02, 0.8, lines_Hz, 0.8 * np.exp(-0.1j * lines_Hz), np.full(len(lines_Hz), 0.98))
    better = command_record(TARGET, 1.2 * TARGET.amplitude_m * TARGET.shape)
    measured = TARGET.amplitude_m * TARGET.shape
    trials = tuple(
        Trial(number, error, 0.001, 0.0, command, measured)
        for number, (error, command) in enumerate(((0.2, TARGET), (0.01, better), (0.05, TARGET)))
    )
    return SignalDrive(TARGET.mark, TARGET.amplitude_m, 1.5, 0.8, better, response, trials=trials, outcome="converged")


def test_the_best_command_and_the_response_are_read_back(tmp_path: Path) -> None:
    written = drive()
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, written)
    (kept,), problems = kept_drives(tmp_path / "drives", OWNER, (POINT,), 0.7)
    assert problems == ()
    assert kept.is_for(TARGET, 1.5)
    assert (kept.trials, kept.outcome, kept.start, kept.gain) == ((), "", KEPT, 0.7)
    assert kept.command is not None
    assert written.command is not None
    assert kept.command.amplitude_m * kept.command.shape == pytest.approx(
        written.command.amplitude_m * written.command.shape, abs=1e-8
    )
    assert kept.response is not None
    assert written.response is not None
    assert kept.response.response == pytest.approx(written.response.response)
    with h5py.File(tmp_path / "drives" / "p001.h5") as file:
        assert file["error"][:].tolist() == [0.2, 0.01, 0.05]
        assert file["command"].shape == file["measured"].shape == (3, len(TARGET.shape))
        assert file["command"].attrs["units"] == "m"


def test_of_a_force_target_the_forces_are_stored_too(tmp_path: Path) -> None:
    force_N = 500.0 * TARGET.shape
    target = replace(TARGET, of_force=True, force=ForceTarget("mark", 0.3, None, 12.0, force_N, SpeedOfForce(
        np.array([-1e3, 1e3]), np.array([-0.5, 0.5])
    )))
    written = drive()
    trials = tuple(trial._replace(force_N=force_N + 10.0) for trial in written.trials)
    point = replace(POINT, record=target)
    write_drive(tmp_path / "drives", "p001", OWNER, point, replace(written, trials=trials, of_force=True))
    with h5py.File(tmp_path / "drives" / "p001.h5") as file:
        assert file.attrs["follows"] == "force"
        assert file["force"].shape == (3, len(force_N))
        assert file["force"].attrs["units"] == "N"
        assert file["target_force"][:] == pytest.approx(force_N)
    (kept,), problems = kept_drives(tmp_path / "drives", OWNER, (point,), 0.7)
    assert problems == ()
    assert kept.of_force
    assert kept.command is not None
    assert kept.command.force is target.force, "the station records it beside the command"


def test_whether_a_force_is_followed_is_read_back_from_the_attributes_of_a_point() -> None:
    for of_force in (False, True):
        point = replace(POINT, record=replace(TARGET, of_force=of_force))
        attributes = attributes_of(point, NOT_STATED)
        assert ("record_of_force" in attributes) is of_force, "files of displacements stay as they are"
        assert point_fields(attributes)["record"].of_force is of_force


@pytest.mark.parametrize(
    ("owner", "point", "problem"),
    [
        (replace(OWNER, specimen="MR-002"), POINT, "specimen differs (serial number 'MR-001', here 'MR-002')"),
        (replace(OWNER, bench="other"), POINT, "bench differs"),
        (OWNER, replace(POINT, record=sweep_record(SweepMotion(5.0, 1.0, 3.0, 0.01, 0.004), 1.0)), ""),
    ],
)
def test_a_drive_of_another_specimen_bench_or_signal_is_not_used(
    tmp_path: Path, owner: DriveOwner, point: TestPoint, problem: str
) -> None:
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, drive())
    kept, problems = kept_drives(tmp_path / "drives", owner, (point,), 0.8)
    assert kept == ()
    assert problem in "".join(problems)
    assert bool(problems) == bool(problem)


def test_a_damaged_file_is_named_and_costs_nothing_else(tmp_path: Path) -> None:
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, drive())
    whole = (tmp_path / "drives" / "p001.h5").read_bytes()
    (tmp_path / "drives" / "p000.h5").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "drives" / "p002.h5").write_bytes(b"no drive")
    kept, problems = kept_drives(tmp_path / "drives", OWNER, (POINT,), 0.8)
    assert len(kept) == 1
    assert [problem.partition(":")[0] for problem in problems] == ["p000.h5", "p002.h5"]


def test_without_a_folder_there_is_nothing_to_start_from(tmp_path: Path) -> None:
    assert kept_drives(tmp_path / "drives", OWNER, (POINT,), 0.8) == ((), ())


@pytest.mark.parametrize(
    ("column", "value", "problem"),
    [("gain", math.nan, "not finite"), ("coherence", math.inf, "not finite"), ("frequency", -1.0, "must be above 0")],
)
def test_a_response_that_makes_no_command_is_refused(
    tmp_path: Path, column: str, value: float, problem: str
) -> None:
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, drive())
    with h5py.File(tmp_path / "drives" / "p001.h5", "r+") as file:
        file["response"][column][3] = value
    kept, problems = kept_drives(tmp_path / "drives", OWNER, (POINT,), 0.8)
    assert kept == ()
    assert problem in "".join(problems)


def test_an_excerpt_contains_errors_coherence_and_the_middle_of_the_last_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, drive(), 0.02)
    path = tmp_path / "drives" / "p001.h5"
    trials = drive_excerpt(path)
    assert (trials["point"], trials["errors"], trials["tolerance"]) == ("p001", [0.2, 0.01, 0.05], 0.02)
    assert trials["coherence"] == [0.98] * len(trials["frequency_Hz"])
    assert len(trials["time_s"]) == len(trials["target"]) == len(trials["measured"]) <= MOST_SHOWN
    first = round(trials["time_s"][0] / 1e-3)
    assert trials["target"][0] == pytest.approx(TARGET.amplitude_m * TARGET.shape[first], rel=1e-4)
    assert trials["measured"] == pytest.approx(trials["target"], abs=1e-8)
    assert main([str(path)]) == EXIT_DONE
    assert json.loads(capsys.readouterr().out) == trials


def test_values_that_are_not_known_are_null(tmp_path: Path) -> None:
    broken = drive()
    broken.trials[-1].measured[:] = math.nan
    write_drive(tmp_path / "drives", "p001", OWNER, POINT, broken)
    trials = drive_excerpt(tmp_path / "drives" / "p001.h5")
    assert trials["tolerance"] is None
    assert set(trials["measured"]) == {None}


@pytest.mark.parametrize("content", [b"", b"no HDF5"])
def test_another_file_is_a_line_and_an_exit_code(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "p001.h5").write_bytes(content)
    assert main([str(tmp_path / "p001.h5")]) == EXIT_USAGE
    assert capsys.readouterr().err.count("\n") == 1
