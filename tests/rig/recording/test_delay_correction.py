"""Points of one rig that lags by 2 ms, each of which sees too little of it alone: what they say once taken together."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from synthetic_rig import SyntheticRig, with_controller_record

from drivers.ring import Channel
from rig.recording.conversion.conversion import build
from rig.recording.conversion.delay_correction import retime
from rig.recording.hdf5 import hdf5_image
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.hdf5.read_back import ReadBackDiffers
from rig.recording.hdf5.reading import read_events
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import Event, SensorContext
from rig.recording.recorded_point import RecordedPoint

LAG_S = 2e-3
KEPT_POLLS = 3
"""Every third status, so that one point knows the lag to a few tenths of a millisecond."""


def write_points(
    folder: Path, lag_s: float, count: int = 5, frequency_Hz: float = 2.0, delay_s: float | None = 0.0,
    first: int = 1,
) -> dict[str, SyntheticRig]:
    rigs = {}
    for number in range(first, first + count):
        amplitude_m = 0.03 if number < first + 2 else 0.003
        rig = SyntheticRig(frequency_Hz=frequency_Hz, cycles=10, amplitude_m=amplitude_m, seed=number, noise_N=5.0)
        records = with_controller_record(rig, lag_s)
        polls = np.isin(records["channel"], (Channel.POSITION, Channel.CONTROLLER_FORCE))
        keep = ~polls | (np.cumsum(polls) % (2 * KEPT_POLLS) < 2)
        sensors = {
            name: SensorContext(sensor, 250.0, delay_s, unit)
            for name, sensor, unit in (("force", "load_cell", 10_000.0), ("displacement", "lvdt", 0.1))
        }
        context = rig.context(controller_delay_s=0.0, sensors=sensors, provenance={"bench_hash": "one bench"})
        context = replace(context, point=replace(context.point, id=f"p{number:03}"))
        noted = (Event(int(records["host_ns"][900]), "note", "halfway, über alles"),)
        content = JournalContent("", records[keep], noted, end={"stopped_by": None, "lost_records": 0})
        file, _ = build(content, context)
        write_file(folder / f"p{number:03}.h5", file)
        rigs[f"p{number:03}"] = rig
    return rigs


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, SyntheticRig]]:
    """Five points of the lagging rig as they were recorded, not to be changed."""
    folder = tmp_path_factory.mktemp("lagging")
    return folder, write_points(folder, LAG_S)


@dataclass(frozen=True)
class Retimed:
    """The same before and after all points were brought to one skew."""

    before: Path
    after: Path
    rigs: dict[str, SyntheticRig]
    written: frozenset[str]

    def changed(self) -> list[RecordedPoint]:
        """The points that were written again."""
        assert self.written
        return [point for point in opened(self.after) if point.id in self.written]

    def as_recorded(self) -> dict[str, RecordedPoint]:
        return {point.id: point for point in opened(self.before)}


@pytest.fixture(scope="module")
def retimed(lagging: tuple[Path, dict[str, SyntheticRig]], tmp_path_factory: pytest.TempPathFactory) -> Retimed:
    before, rigs = lagging
    after = tmp_path_factory.mktemp("retimed")
    shutil.copytree(before, after, dirs_exist_ok=True)
    return Retimed(before, after, rigs, frozenset(point.id for point in retime(after)))


def opened(folder: Path) -> list[RecordedPoint]:
    return [RecordedPoint.open(file) for file in sorted(folder.glob("*.h5"))]


def force_error_N(point: RecordedPoint, rig: SyntheticRig) -> float:
    """Root mean square of what the aligned force misses of the true force at the aligned times, full cycles."""
    clock_s = point.time_s + float(point.test["controller_clock_at_zero_s"])
    inside = (clock_s > rig.start_s + 1.0) & (clock_s < rig.start_s + 5.0)
    return float(np.sqrt(np.mean((point.force_N[inside] - rig.force(clock_s[inside])) ** 2)))


def test_points_that_saw_too_little_take_over_what_all_of_them_know(retimed: Retimed) -> None:
    recorded, rigs = retimed.as_recorded().values(), retimed.rigs
    before = {point.id: force_error_N(point, rigs[point.id]) for point in recorded}
    assert any(abs(point.skew_s - LAG_S) > 1e-3 for point in recorded), "the weak ones keep the declaration"
    assert retimed.written
    points = opened(retimed.after)
    for point in points:
        assert abs(point.skew_s - LAG_S) < 3.0 * point.skew_std_s, point.id
    for name in retimed.written:
        point = next(point for point in points if point.id == name)
        assert point.skew_std_s < 0.5e-3, point.id
        assert point.skew_s == pytest.approx(next(iter(points)).skew_s, abs=0.5e-3)
        assert force_error_N(point, rigs[name]) < max(6.0, before[name])
    assert list(retime(retimed.after)) == [], "what was brought to one skew stays as it is"


def test_a_point_that_was_suspect_for_its_skew_alone_is_valid_once_all_points_know_it(tmp_path: Path) -> None:
    write_points(tmp_path, LAG_S, frequency_Hz=3.0, delay_s=None)
    suspects = {point.id for point in opened(tmp_path) if point.verdict == "suspect"}
    assert suspects
    verdicts = {finished.id: (finished.verdict, finished.reasons) for finished in retime(tmp_path)}
    assert {verdicts[name] for name in suspects} == {("valid", ())}
    for point in opened(tmp_path):
        assert (point.verdict, tuple(point.reasons)) == ("valid", ()), point.id


def test_nothing_that_was_received_is_touched(retimed: Retimed) -> None:
    received = ("value", "sequence", "device_us", "host_ns", "flags")

    def raw(file: Path) -> list[bytes]:
        with h5py.File(file) as content:
            return [content[f"entry/raw/{name}/{key}"][:].tobytes()
                    for name in content["entry/raw"] for key in received]  # fmt: skip

    before = {file.name: raw(file) for file in sorted(retimed.before.glob("*.h5"))}
    assert {file.name: raw(file) for file in sorted(retimed.after.glob("*.h5"))} == before
    assert list(retimed.after.glob("*.tmp")) == []


def test_points_that_agree_with_the_declaration_are_not_written_again(tmp_path: Path) -> None:
    write_points(tmp_path, 0.0, count=3)
    before = {file.name: file.stat().st_mtime_ns for file in tmp_path.glob("*.h5")}
    assert list(retime(tmp_path)) == []
    assert {file.name: file.stat().st_mtime_ns for file in tmp_path.glob("*.h5")} == before


def test_points_that_contradict_each_other_are_not_as_sure_as_each_of_them_alone(tmp_path: Path) -> None:
    write_points(tmp_path, 0.0, count=2)
    write_points(tmp_path, LAG_S, count=2, first=3)
    alone = [point.skew_s for point in opened(tmp_path)]
    assert max(alone) - min(alone) > 0.8 * LAG_S
    list(retime(tmp_path))
    for point in opened(tmp_path):
        for delay_s in (0.0, LAG_S):
            assert abs(point.skew_s - delay_s) < 3.0 * point.skew_std_s, point.id
    assert list(retime(tmp_path)) == []


@pytest.mark.parametrize("lost", ["force/value", "velocity"])
def test_a_value_that_was_not_written_as_meant_is_noticed_and_the_file_kept(
    lagging: tuple[Path, dict[str, SyntheticRig]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lost: str
) -> None:
    shutil.copytree(lagging[0], tmp_path, dirs_exist_ok=True)
    before = {file.name: file.read_bytes() for file in sorted(tmp_path.glob("*.h5"))}
    write = hdf5_image.write_values

    def forgetful(dataset: h5py.h5d.DatasetID, start: int, values: np.ndarray) -> None:
        if not h5py.h5i.get_name(dataset).endswith(lost.encode()):
            write(dataset, start, values)

    monkeypatch.setattr(hdf5_image, "write_values", forgetful)
    with pytest.raises(ReadBackDiffers, match=lost):
        list(retime(tmp_path))
    assert {file.name: file.read_bytes() for file in sorted(tmp_path.glob("*.h5"))} == before


def test_velocity_of_a_file_made_again_is_the_derivative_of_its_displacement(retimed: Retimed) -> None:
    for point in retimed.changed():
        velocity, derivative = point.velocity_m_s, np.gradient(point.displacement_m, point.time_s)
        peak = np.nanmax(np.abs(derivative))
        assert np.nanmax(np.abs(velocity - derivative)) < 0.03 * peak, point.id
        assert np.array_equal(np.isnan(velocity), np.isnan(point.displacement_m))


def test_a_file_made_again_is_the_file_that_would_have_been_made_with_these_delays(retimed: Retimed) -> None:
    before = retimed.as_recorded()
    for point in retimed.changed():
        old, rig = before[point.id], retimed.rigs[point.id]
        late_s = float(point.quality.displacement.undeclared_delay_s or 0.0)
        assert float(point.test["controller_clock_at_zero_s"]) == pytest.approx(
            float(old.test["controller_clock_at_zero_s"]) - late_s, abs=1e-5
        )
        expected = rig.damping * point.velocity_m_s + rig.stiffness * point.displacement_m
        inside = (point.time_s > 1.0) & (point.time_s < 4.5)
        assert np.sqrt(np.nanmean((point.force_N - expected)[inside] ** 2)) < 0.05 * np.ptp(expected[inside]), point.id
        assert set(point.quality.attributes) >= set(old.quality.attributes) - {"reasons", "blamed"}
        for name in ("force_noise_N", "force_scatter_N", "phase_deg", "measured_amplitude_m", "free_play_m"):
            assert (name in point.quality.attributes) == (name in old.quality.attributes)


def test_a_file_made_again_says_when_and_why_and_from_which_delays(retimed: Retimed) -> None:
    before = retimed.as_recorded()
    for point in retimed.changed():
        provenance = point.provenance
        assert provenance["rewritten"].startswith("20")
        assert "all points combined" in provenance["rewritten_why"]
        assert provenance["rewritten_from_force_delay_s"] == before[point.id].quality.force.undeclared_delay_s
        assert provenance["rewritten_to_force_delay_s"] == point.quality.force.undeclared_delay_s
        assert provenance["journal_check"] == before[point.id].provenance["journal_check"]
    for point in opened(retimed.after):
        assert ("rewritten" in point.provenance) == (point.provenance != before[point.id].provenance)


def test_what_was_noted_keeps_its_place_among_the_samples(retimed: Retimed) -> None:
    before = {file.stem: read_events(file) for file in retimed.before.glob("*.h5")}
    for point in retimed.changed():
        (now,), (then,) = read_events(point.path), before[point.id]
        assert now[1:] == then[1:] == ("note", "halfway, über alles")
        assert abs(now[0] - then[0]) < 5_000_000


def write_without_edges(folder: Path, dampings: tuple[float, ...]) -> dict[str, SyntheticRig]:
    """Points without edges, one for each damping (N s/m): with 20 N s/m the force is below the noise of its input."""
    rigs = {}
    for number, damping in enumerate(dampings, 1):
        rig = SyntheticRig(
            frequency_Hz=2.0, cycles=5, edges=False, seed=number, damping=damping, stiffness=0.0, noise_N=0.1,
            jitter_s=3e-4,
        )
        context = rig.context(controller_delay_s=0.0, provenance={"bench_hash": "one bench"})
        context = replace(context, point=replace(context.point, id=f"p{number:03}"))
        content = JournalContent("", with_controller_record(rig, 0.0), (), end={"stopped_by": None, "lost_records": 0})
        write_file(folder / f"p{number:03}.h5", build(content, context)[0])
        rigs[f"p{number:03}"] = rig
    return rigs


def test_a_force_too_weak_for_its_own_clock_is_tied_by_the_latency_that_other_points_measured(tmp_path: Path) -> None:
    rigs = write_without_edges(tmp_path, (2000.0, 20.0, 1000.0, 10.0))
    weak = {"p002", "p004"}
    before = {point.id: point for point in opened(tmp_path)}
    assert {point.id for point in before.values() if point.verdict == "suspect"} == weak
    assert {finished.id for finished in retime(tmp_path)} == weak
    for point in opened(tmp_path):
        assert (point.verdict, tuple(point.reasons)) == ("valid", ())
        if point.id not in weak:
            continue
        assert point.quality.skew.method == "force by campaign, displacement by signals"
        assert point.skew_std_s < 0.4 * before[point.id].skew_std_s
        clock_s = point.time_s + float(point.test["controller_clock_at_zero_s"])
        inside = (clock_s > rigs[point.id].start_s + 0.5) & (clock_s < rigs[point.id].start_s + 3.0)
        lags_s = np.linspace(-4e-3, 4e-3, 401)
        misfits = [
            np.mean((point.force_N[inside] - rigs[point.id].force(clock_s[inside] - lag_s)) ** 2) for lag_s in lags_s
        ]
        assert abs(lags_s[int(np.argmin(misfits))]) < 2.0 * point.skew_std_s
    assert list(retime(tmp_path)) == []


def test_without_a_strong_force_nothing_is_known_of_the_latency(tmp_path: Path) -> None:
    write_without_edges(tmp_path, (20.0, 10.0))
    assert list(retime(tmp_path)) == []
    assert {point.verdict for point in opened(tmp_path)} == {"suspect"}
