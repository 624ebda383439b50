from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from synthetic_rig import SyntheticRig, with_controller_record

from drivers.ring import Channel
from drivers.sample_stream import SampleScale, SampleStream
from protocols.line_format import LineDecoder
from protocols.quality import Quality
from protocols.sensor_format import preset
from rig.recording.alignment.alignment import Alignment, NothingRecorded, align, lost_samples
from rig.recording.alignment.sensor_clock import matched_edges
from rig.recording.conversion.conversion import build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import SensorContext
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.clock_model import by_edges


def aligned(rig: SyntheticRig) -> Alignment:
    return align(rig.records(), rig.context())


def true_force_error_N(rig: SyntheticRig, found: Alignment) -> np.ndarray:
    return found.values["force"] - rig.force(found.time_s + found.origin_s)


@pytest.mark.parametrize("seed", range(5))
def test_with_edges_force_and_displacement_meet_within_microseconds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig = SyntheticRig(
        seed=seed, force_ppm=rng.normal(0, 150), displacement_ppm=rng.normal(0, 150),
        force_latency_s=rng.uniform(0, 0.02), jitter_s=rng.uniform(1e-4, 5e-3),
    )
    found = aligned(rig)
    slope_N_s = np.max(np.abs(np.diff(rig.force(found.time_s + found.origin_s)))) * rig.rate_Hz
    force = found.timed["force"]
    assert np.max(np.abs(force.records["value"] - rig.force(force.time_s))) < slope_N_s * 10e-6
    assert np.nanpercentile(np.abs(true_force_error_N(rig, found)), 98) < slope_N_s * 20e-6
    assert found.skew_std_s < 10e-6
    assert found.skew_method == "force by edges, displacement by edges"


def test_the_skew_that_arrival_would_have_made_is_reported() -> None:
    rig = SyntheticRig(force_latency_s=0.012, displacement_latency_s=0.002)
    found = aligned(rig)
    assert found.arrival_skew_s == pytest.approx(0.010, abs=0.0003)
    assert found.skew_s == 0.0


@pytest.mark.parametrize("device_clocks", [True, False])
def test_without_edges_the_stated_uncertainty_covers_the_true_skew(device_clocks: bool) -> None:
    rig = SyntheticRig(edges=False, device_clocks=device_clocks)
    found = aligned(rig)
    true_base_s = rig.start_s - 0.5 + 0.0013 + np.arange(len(found.time_s)) / rig.rate_Hz / (1 - 120e-6)
    error_s = (found.time_s + found.origin_s - true_base_s).mean()
    assert abs(error_s) < 3 * found.timed["displacement"].clock.std_s
    hidden_s = rig.force_latency_s - rig.displacement_latency_s
    assert abs(hidden_s) < 2 * found.skew_std_s
    assert found.skew_method.startswith("force by device clock" if device_clocks else "force by nominal rate")


def test_lost_samples_leave_a_hole_that_nothing_is_drawn_across() -> None:
    whole, holed = aligned(SyntheticRig()), aligned(SyntheticRig(lost=(300, 301, 302, 700)))
    assert holed.timed["force"].lost == 4
    extra = np.isnan(holed.values["force"]) & ~np.isnan(whole.values["force"])
    assert 8 <= extra.sum() <= 14
    assert np.all(holed.flags[extra] != 0)
    same = ~np.isnan(holed.values["force"])
    assert np.nanmax(np.abs(holed.values["force"] - whole.values["force"])[same]) < 1.0


def test_a_declared_delay_is_taken_off() -> None:
    rig = SyntheticRig()
    slow = rig.context(sensors={
        "force": SensorContext("load_cell", 250.0, delay_s=0.003), "displacement": SensorContext("lvdt", 250.0),
    })
    plain, delayed = align(rig.records(), rig.context()), align(rig.records(), slow)
    assert np.median(plain.timed["force"].time_s - delayed.timed["force"].time_s) == pytest.approx(0.003, abs=1e-9)
    assert delayed.arrival_skew_s - plain.arrival_skew_s == pytest.approx(0.003, abs=1e-6)


def test_measured_current_follows_on_the_same_time_base() -> None:
    found = aligned(SyntheticRig(current_A=1.25))
    assert np.nanmedian(found.values["current"]) == 1.25
    assert np.isnan(found.values["current"]).sum() <= 2
    assert 0 < found.timed["coil_current"].clock.std_s < 0.01


def test_a_point_without_force_cannot_be_aligned() -> None:
    rig = SyntheticRig()
    records = rig.records()
    with pytest.raises(NothingRecorded, match="force"):
        align(records[records["channel"] != 1], rig.context())


def test_edges_are_matched_by_count_across_both_wraps() -> None:
    pulses, edges = np.zeros(8, RECORD_DTYPE), np.zeros(6, RECORD_DTYPE)
    pulses["value"], pulses["host_ns"] = [65533, 65534, 65535, 0, 1, 2, 3, 4], np.arange(8) * 10**9
    pulses["device_us"] = np.arange(8) * 10**6
    edges["sequence"], edges["host_ns"] = [255, 256, 257, 258, 259, 260], np.arange(2, 8) * 10**9
    edges["device_us"] = np.arange(2, 8) * 10**6 + 500
    pairs = matched_edges(edges, pulses)
    assert len(pairs) == 6
    assert np.allclose(pairs[:, 0] - pairs[:, 1], 500e-6)


def test_one_wild_edge_does_not_move_the_clock() -> None:
    local_s = np.arange(10.0)
    reference_s = local_s * (1 + 50e-6) + 3.0
    wild = reference_s.copy()
    wild[4] += 0.01
    assert by_edges(local_s, wild).time_s(local_s) == pytest.approx(reference_s, abs=2e-6)


def test_two_edges_claim_no_perfection() -> None:
    assert by_edges(np.array([0.0, 1.0]), np.array([5.0, 6.0])).std_s > 1e-6


def test_losses_are_counted_through_the_wrap_of_the_sequence() -> None:
    assert lost_samples(np.array([2**32 - 2, 2**32 - 1, 0, 3], np.uint32)) == 2
    assert lost_samples(np.array([5], np.uint32)) == 0


def by_lines(rig: SyntheticRig, lost: slice) -> np.ndarray:
    """The rig's records with a load cell that sends lines without a number or clock, some of which do not arrive."""
    records = rig.records()
    sent = records[records["channel"] == 1]
    kept = np.delete(sent, lost)
    stream = SampleStream(
        LineDecoder(preset("signed-decimal")), Channel.FORCE, SampleScale(rate_Hz=rig.rate_Hz), has_sequence=False
    )
    stream.take(b"\r\n", int(kept["host_ns"][0]))
    received = [
        record for value, host_ns in kept[["value", "host_ns"]].tolist()
        for record in stream.take(f"{value:+010.1f} N\r\n".encode(), host_ns).records
    ]
    joined = np.concatenate((records[records["channel"] != 1], np.array(received, RECORD_DTYPE)))
    return joined[np.argsort(joined["host_ns"], kind="stable")]


@pytest.mark.parametrize("seed", range(5))
def test_lines_that_never_arrived_are_lost_in_the_file_and_time_goes_on_behind_them(seed: int) -> None:
    rig = SyntheticRig(edges=False, force_ppm=0.0, seed=seed, jitter_s=3e-4)
    found, whole = (align(by_lines(rig, lost), rig.context()) for lost in (slice(700, 750), slice(0, 0)))
    force = found.timed["force"]
    assert abs(force.lost - 50) <= 1
    assert whole.timed["force"].lost == 0
    assert np.isnan(found.values["force"]).sum() >= 48, "nothing is drawn across the hole"
    after = rig.start_s - 0.5 + np.arange(1000, len(force.records) + 50) / rig.rate_Hz + rig.force_latency_s
    assert np.abs(force.time_s[-len(after):] - after).max() < 1.6 / rig.rate_Hz


def without_force_clock(rig: SyntheticRig, uncounted: int) -> Alignment:
    """The rig with a load cell that has no clock, some samples of which are lost without anybody counting them."""
    records = rig.records()
    force = np.flatnonzero(records["channel"] == 1)
    records["device_us"][force] = -1
    records["sequence"][force[700:]] -= np.uint32(uncounted)
    return align(np.delete(records, force[700 : 700 + uncounted]), rig.context())


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("uncounted", [1, 4])
def test_samples_lost_below_the_watchs_tolerance_widen_what_is_stated_of_the_clock(uncounted: int, seed: int) -> None:
    rig = SyntheticRig(edges=False, force_ppm=0.0, seed=seed, jitter_s=3e-4)
    found, whole = (without_force_clock(rig, lost) for lost in (uncounted, 0))
    assert found.timed["force"].lost == 0, "nobody could count them"
    assert found.timed["force"].clock.std_s > np.hypot(whole.timed["force"].clock.std_s, 0.4 * uncounted / 250.0)
    assert whole.timed["force"].clock.std_s < 2.5e-3, "a line that loses nothing pays nothing"


def test_the_measured_current_is_unknown_across_a_lost_frame() -> None:
    rig = SyntheticRig()
    records = rig.records()
    frames = np.flatnonzero(records["channel"] == Channel.COIL_CURRENT)
    whole, holed = (
        np.isnan(align(kept, rig.context()).values["current"]).sum()
        for kept in (records, np.delete(records, frames[300:301]))
    )
    assert holed - whole in {4, 5, 6}, "20 ms of samples at 250 Hz"


def test_a_long_points_edges_are_matched_without_room_for_every_pair() -> None:
    count = 20_000
    pulses, edges = np.zeros(count, RECORD_DTYPE), np.zeros(count, RECORD_DTYPE)
    pulses["value"], pulses["host_ns"] = (np.arange(count) + 60_000) % 65536, np.arange(count) * 10**8
    pulses["device_us"] = np.arange(count) * 10**5
    edges["sequence"], edges["host_ns"] = np.arange(count) + 60_000 % 256, np.arange(count) * 10**8 + 3 * 10**6
    edges["device_us"] = np.arange(count) * 10**5 + 250
    tracemalloc.start()
    pairs = matched_edges(edges[5:], pulses)
    most_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(pairs) == count - 5
    assert np.allclose(pairs[:, 0] - pairs[:, 1], 250e-6)
    assert most_bytes < 50e6


@pytest.mark.parametrize("kept", [1, 3, 9, 15, 60])
def test_a_point_cut_off_after_a_few_samples_of_a_fast_sensor_can_still_be_aligned(kept: int) -> None:
    rig = SyntheticRig(rate_Hz=10_000.0)
    records = with_controller_record(rig, 0.0)
    spare = np.concatenate([np.flatnonzero(records["channel"] == number)[kept:] for number in (1, 2)])
    found = align(np.delete(records, spare), rig.context(controller_delay_s=0.0))
    assert len(found.time_s) == kept
    assert found.timed["force"].sensor.match is None


def with_clock_steps(rig: SyntheticRig, back: dict[int, int]) -> np.ndarray:
    """The rig's records, the device clock of some force samples off by so many microseconds."""
    records = rig.records()
    force = np.flatnonzero(records["channel"] == 1)
    for at, step_us in back.items():
        records["device_us"][force[at]] += step_us
    return records


@pytest.mark.parametrize("step_us", [-900_000, 900_000], ids=["back", "forward"])
def test_samples_whose_clock_steps_stay_in_what_was_received_flagged_and_counted(step_us: int) -> None:
    rig = SyntheticRig()
    whole, found = (align(with_clock_steps(rig, back), rig.context()) for back in ({}, {400: step_us, 700: step_us}))
    force = found.timed["force"]
    assert (force.disordered, force.lost) == (2, 0)
    assert len(force.received) == len(whole.timed["force"].records) == len(force.records) + 2
    marked = np.flatnonzero(force.received["flags"] & Quality.CLOCK_BACK)
    assert marked.tolist() == [400, 700]
    assert np.array_equal(np.flatnonzero(np.isnan(force.received_s)), marked)
    assert np.all(np.diff(force.time_s) > 0.0)
    same = np.isfinite(found.values["force"])
    assert np.count_nonzero(~same) - np.count_nonzero(np.isnan(whole.values["force"])) <= 8
    assert np.nanmax(np.abs(found.values["force"] - whole.values["force"])[same]) < 1e-6


def test_a_file_holds_every_sample_that_came_and_says_how_many_have_no_place_in_time(tmp_path: Path) -> None:
    rig = SyntheticRig()
    records = with_clock_steps(rig, {400: -900_000})
    content = JournalContent("", records, end={"stopped_by": None, "lost_records": 0})
    file, quality = build(content, rig.context())
    write_file(tmp_path / "p001.h5", file)
    point = RecordedPoint.open(tmp_path / "p001.h5")
    assert len(point.raw("force")["value"]) == np.count_nonzero(records["channel"] == 1)
    assert point.quality.force.disordered_samples == 1
    assert point.lost_samples == 0
    assert np.all(np.diff(point.force_samples.time_s) > 0.0)
    assert quality.verdict.verdict == "valid", quality.verdict.reasons


def test_every_resampled_channel_says_by_which_method(tmp_path: Path) -> None:
    rig = SyntheticRig()
    content = JournalContent("", rig.records(), end={"stopped_by": None, "lost_records": 0})
    file, _ = build(content, rig.context())
    methods = {channel.name: channel.attributes.get("method") for channel in file.channels}
    assert all(methods.values()), methods
    assert "never beyond the two adjacent samples" in methods["force"]
