"""A program's motion, followed batch by batch while it runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import Input
from rig.campaign.execution.observer import MOST_SAMPLES, MotionMeasurement, RequestedMotion
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE

REQUESTED = RequestedMotion("sine", 2.0, 250.0)


def lvdt(amplitude_m: NDArray[np.float64], rate_Hz: float, frequency_Hz: float) -> NDArray[np.void]:
    time_s = np.arange(len(amplitude_m)) / rate_Hz
    records = np.zeros(len(time_s), RECORD_DTYPE)
    records["host_ns"] = records["device_us"] = np.round(1e6 * time_s)
    records["value"] = amplitude_m * np.sin(2.0 * np.pi * frequency_Hz * time_s)
    records["sequence"] = np.arange(len(time_s))
    records["channel"] = Channel.DISPLACEMENT
    return records


def other(channel: Channel, value: float) -> NDArray[np.void]:
    records = np.zeros(1, RECORD_DTYPE)
    records["channel"], records["value"] = channel, value
    return records


@pytest.mark.parametrize("rate_Hz", [250.0, 10_000.0])
def test_it_does_not_matter_in_which_batches_the_samples_arrive(rate_Hz: float) -> None:
    records = lvdt(np.full(int(6 * rate_Hz), 0.02), rate_Hz, 2.0)
    expected = replace(REQUESTED, rate_Hz=rate_Hz)
    whole, pieces = MotionMeasurement(expected), MotionMeasurement(expected)
    whole.add(RecordBlock(records))
    cuts = np.sort(np.random.default_rng(1).integers(0, len(records), 300))
    for batch in np.split(records, cuts):
        pieces.add(RecordBlock(batch))
    assert whole.motion() == pieces.motion()
    found = whole.motion()
    assert found is not None
    assert found.amplitude_m == pytest.approx(0.02, rel=1e-3)


def test_of_a_very_long_program_the_last_cycles_are_measured() -> None:
    early, late = np.full(MOST_SAMPLES, 0.03), np.full(MOST_SAMPLES + 1000, 0.02)
    sight = MotionMeasurement(REQUESTED)
    for batch in np.array_split(lvdt(np.concatenate((early, late)), 250.0, 2.0), 400):
        sight.add(RecordBlock(batch))
    found = sight.motion()
    assert found is not None
    assert found.amplitude_m == pytest.approx(0.02, rel=1e-3)


def test_what_the_machine_could_not_do_is_seen_in_the_whole_program() -> None:
    sight = MotionMeasurement(REQUESTED)
    sight.add(RecordBlock(other(Channel.INPUTS, float(Input.VALVE_SATURATED))))
    sight.add(RecordBlock(other(Channel.SERVO_ERROR, -0.004)))
    sight.add(RecordBlock(lvdt(np.full(1500, 0.02), 250.0, 2.0)))
    sight.add(RecordBlock(other(Channel.SERVO_ERROR, 0.001)))
    found = sight.motion()
    assert found is not None
    assert (found.valve_saturated, found.following_error_m) == (True, 0.004)


def test_without_a_full_cycle_there_is_no_motion() -> None:
    assert MotionMeasurement(REQUESTED).motion() is None
    short = MotionMeasurement(REQUESTED)
    short.add(RecordBlock(lvdt(np.full(60, 0.02), 250.0, 2.0)))
    assert short.motion() is None
