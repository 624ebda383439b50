"""A campaign's doubt about its instruments enters every point's file, and nothing else in it changes."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from rig.recording.conversion.delay_correction import judge_together
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.quality.cross_checks import doubts
from rig.recording.quality.point_quality import Tolerances
from rig.recording.quality.verdict import Verdict, suspect
from rig.recording.recorded_point import RecordedPoint


def record(folder: Path, number: int, gain: float, gain_std: float = 0.01, **quality: object) -> Path:
    """A finished point whose load cell shows `gain` against the controller's force input."""
    time_s = np.arange(500) / 250.0
    wave = np.sin(2 * np.pi * time_s)
    path = folder / f"p{number:03d}.h5"
    write_file(path, PointFile(
        time_s, 250.0,
        [AlignedChannel("displacement", 0.02 * wave, "m", "Damper extension"),
         AlignedChannel("force", 500.0 * wave, "N", "Force")],
        test={"id": path.stem, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0, "current_A": 0.5,
              "controller_clock_at_zero_s": 10.0 * number},
        quality={"verdict": "valid", "force_reference_gain": gain, "force_reference_gain_std": gain_std,
                 "force_reference_offset_N": 0.3, "force_reference_offset_std_N": 0.5,
                 **Tolerances().attributes, **quality},
        provenance={"bench_hash": "b"},
    ))
    return path


def values_of(path: Path) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, item: found.update({name: item[...].tobytes()}) if isinstance(item, h5py.Dataset) else None
        )
    return found


def test_what_all_points_prove_is_written_into_each_of_them_and_no_sample_is_touched(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    kept = suspect("skew", "tied together to 4 ms only")
    paths = [record(tmp_path, number, 1.05 + 0.01 * random.standard_normal()) for number in range(10)]
    paths.append(record(tmp_path, 10, 1.05, **Verdict.of([kept]).attributes))
    before = [values_of(path) for path in paths]
    corrected = list(judge_together(tmp_path))
    assert [point.id for point in corrected] == [path.stem for path in paths]
    for path, point in zip(paths, corrected, strict=True):
        read = RecordedPoint.open(path)
        assert (read.verdict, read.reasons) == (point.verdict, point.reasons)
        assert read.verdict == "suspect"
        assert read.quality.verdict.blamed == ("bench",) * len(read.reasons)
        assert any("load cell" in line and "controller's force input" in line for line in read.reasons)
        assert read.quality.judged_again_utc is not None
        assert read.quality.force.reference_offset == 0.3
    assert "skew" in corrected[-1].reasons[0] + corrected[-1].reasons[1]
    assert [values_of(path) for path in paths] == before
    assert not list(tmp_path.glob("*.tmp"))
    assert len(doubts(RecordedPoint.open(path, whole=False) for path in paths)) == 1
    assert list(judge_together(tmp_path)) == []


def test_agreeing_instruments_leave_every_file_as_it_is(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    paths = [record(tmp_path, number, 1.0 + 0.01 * random.standard_normal()) for number in range(8)]
    before = [path.read_bytes() for path in paths]
    assert list(judge_together(tmp_path)) == []
    assert [path.read_bytes() for path in paths] == before


def test_a_doubt_of_one_point_that_the_campaign_takes_back_is_taken_back(tmp_path: Path) -> None:
    reason = suspect("zero-drift", "said by an earlier judgement")
    for number in range(6):
        record(tmp_path, number, 1.0, 0.002, **(Verdict.of([reason]).attributes if number == 3 else {}))
    corrected = list(judge_together(tmp_path))
    assert [(point.id, point.verdict, point.reasons) for point in corrected] == [("p003", "valid", ())]


def test_a_stopped_point_neither_says_anything_nor_is_evaluated_again(tmp_path: Path) -> None:
    for number in range(6):
        record(tmp_path, number, 1.0, 0.002)
    stopped = record(tmp_path, 6, 1.5, 0.002, verdict="invalid", reasons=("estop: held",), reason_kinds=("invalid",))
    before = stopped.read_bytes()
    assert list(judge_together(tmp_path)) == []
    assert stopped.read_bytes() == before
