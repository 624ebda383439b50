"""Ring records in, facts out."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import State
from protocols.quality import Quality
from rig.campaign.execution.observer import Observer, RequestedMotion
from rig.campaign.preflight.rest_check import RestLimits, check_rest, exchanged, watch_rest
from rig.campaign.sequencer import event as ev
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.rest import AtRest

LIMITS = RestLimits(
    force_N=5000.0, position_min_m=-0.085, position_max_m=0.085, disagreement_m=0.005, range_N=10_000.0,
    zero_N=25.0, current_zero_A=0.02, force_per_wire=1.0,
    displacement_per_wire=1e-3, force_offset_N=0.0, displacement_offset_m=0.0,
)
REQUESTED = RequestedMotion("sine", 2.0, 250.0)


def zeros(seen: AtRest) -> ev.Event:
    return ev.ZerosJudged(check_rest(seen, LIMITS))


def records(*rows: tuple[Channel, int, float]) -> NDArray[Any]:
    """Records of (channel, arrival ns, value); the device clock is the arrival in microseconds."""
    block = np.zeros(len(rows), RECORD_DTYPE)
    for index, (channel, host_ns, value) in enumerate(rows):
        block[index]["channel"], block[index]["host_ns"], block[index]["value"] = channel, host_ns, value
        block[index]["device_us"] = host_ns // 1000
    return block


def status(host_ns: int, state: State, position_m: float = 0.0, pulses: int = 0) -> NDArray[Any]:
    return records(
        (Channel.STATE, host_ns, state), (Channel.POSITION, host_ns, position_m), (Channel.PULSE, host_ns, pulses)
    )


def show(observer: Observer, records: NDArray[Any]) -> ev.Event | None:
    return observer.observe(RecordBlock(records))


def test_the_centre_is_reached_when_the_actuator_holds_there_after_the_move() -> None:
    observer = Observer()
    observer.await_centre(0.010, since_ns=100)
    assert show(observer, status(50, State.HOLD, 0.010)) is None
    assert show(observer, status(150, State.MOVING, 0.010)) is None
    assert show(observer, status(200, State.HOLD, 0.004)) is None
    assert show(observer, status(300, State.HOLD, 0.0101)) == ev.Centred()
    assert show(observer, status(400, State.HOLD, 0.010)) is None, "a fact is reported once"


def test_a_program_has_ended_when_it_was_seen_running_and_holds_again() -> None:
    observer = Observer()
    show(observer, status(50, State.HOLD))
    observer.await_program(0.0, 100, REQUESTED, 0.0)
    assert show(observer, status(150, State.HOLD)) is None, "still the hold from before the start"
    assert show(observer, status(200, State.RUNNING, 0.01)) is None
    assert show(observer, status(300, State.HOLD, 0.002)) == ev.ProgramEnded(at_centre=False)


def test_a_program_too_short_to_be_seen_is_known_by_its_pulses() -> None:
    observer = Observer()
    show(observer, status(50, State.HOLD, pulses=7))
    observer.await_program(0.0, 100, REQUESTED, 0.0)
    assert show(observer, status(150, State.HOLD, pulses=7)) is None
    assert show(observer, status(200, State.HOLD, pulses=12)) == ev.ProgramEnded(at_centre=True)


def test_a_program_has_ended_only_when_every_sensor_was_read_after_it() -> None:
    observer = Observer()
    show(observer, status(50, State.HOLD))
    show(observer, records((Channel.FORCE, 50, 1.0), (Channel.DISPLACEMENT, 50, 0.0)))
    observer.await_program(0.0, 100, REQUESTED, 0.0)
    assert show(observer, status(200, State.RUNNING, 0.01)) is None
    assert show(observer, status(300, State.HOLD)) is None, "the sensors' samples of the last cycles are still unread"
    assert show(observer, records((Channel.FORCE, 310, 1.0))) is None
    assert show(observer, records((Channel.DISPLACEMENT, 330, 0.0))) == ev.ProgramEnded(at_centre=True)


@pytest.mark.parametrize(
    ("states", "ended_by"),
    [
        ((State.RUNNING, State.FADING, State.HOLD, State.OFF), {State.FADING}),
        ((State.RUNNING, State.HALTING, State.HOLD), {State.HALTING}),
        ((State.RUNNING, State.FADING, State.HALTING, State.OFF), {State.FADING, State.HALTING}),
        ((State.RUNNING, State.FADING, State.HOLD, State.MOVING, State.HOLD), set()),
        ((State.RUNNING, State.HOLD, State.OFF), set()),
    ],
)
def test_how_the_last_motion_ended_is_what_the_controller_showed(states: list[State], ended_by: set[State]) -> None:
    observer = Observer()
    for host_ns, state in enumerate(states, start=100):
        show(observer, status(host_ns, state))
    assert observer.ended_by == ended_by


def ended(done: float, *early: State) -> ev.ProgramEnded:
    """How a program of 1 + 6 + 1 cycles ends that went through these states and shows so many cycles at its end."""
    observer = Observer()
    show(observer, status(50, State.HOLD))
    observer.await_program(0.0, 100, REQUESTED, 8.0)
    for host_ns, state in enumerate((State.RUNNING, *early), start=200):
        assert show(observer, status(host_ns, state)) is None
    show(observer, records((Channel.CYCLES_DONE, 299, done)))
    event = show(observer, status(300, State.HOLD))
    assert isinstance(event, ev.ProgramEnded)
    return event


@pytest.mark.parametrize(
    ("done", "early", "message"),
    [
        (8.0, (), ""),
        (7.0, (), "7 of 8 requested cycles completed"),
        (0.0, (), "0 of 8 requested cycles completed"),
        (8.0, (State.FADING,), "the controller was FADING"),
        (8.0, (State.HALTING,), "the controller was HALTING"),
        (3.0, (State.FADING,), "the controller was FADING"),
    ],
)
def test_a_program_that_nobody_here_stopped_shows_when_it_was_cut_short(
    done: float, early: tuple[State, ...], message: str
) -> None:
    assert ended(done, *early).cut_short == message


def test_cycles_of_the_program_before_are_not_counted() -> None:
    observer = Observer()
    show(observer, records((Channel.STATE, 50, State.HOLD), (Channel.CYCLES_DONE, 50, 12.0)))
    observer.await_program(0.0, 100, REQUESTED, 0.0)
    show(observer, records((Channel.STATE, 150, State.HOLD), (Channel.CYCLES_DONE, 150, 12.0)))
    assert observer.cycles_done == 0
    show(observer, records((Channel.STATE, 200, State.RUNNING), (Channel.CYCLES_DONE, 200, 1.0)))
    assert observer.cycles_done == 1


def test_a_program_that_tripped_has_not_ended() -> None:
    observer = Observer()
    observer.await_program(0.0, 100, REQUESTED, 0.0)
    assert show(observer, status(150, State.RUNNING)) is None
    assert show(observer, status(200, State.TRIPPED)) is None


def test_the_current_is_settled_after_three_samples_in_a_row_within_tolerance() -> None:
    observer = Observer()
    observer.await_current(1.0, 0.02, since_ns=100)
    current = Channel.COIL_CURRENT
    assert show(observer, records((current, 50, 1.0), (current, 110, 1.0), (current, 120, 0.99))) is None
    assert show(observer, records((current, 130, 1.03), (current, 140, 1.0), (current, 150, 1.01))) is None
    assert show(observer, records((current, 160, 0.985))) == ev.CurrentSettled()


def test_a_rest_passes_on_the_controllers_clock() -> None:
    observer = Observer()
    show(observer, status(1_000_000_000, State.HOLD))
    observer.await_rest(2.0)
    assert show(observer, status(2_900_000_000, State.HOLD)) is None
    assert show(observer, status(3_000_000_000, State.HOLD)) == ev.RestOver()


def test_standstill_is_a_position_that_stays_for_a_moment_of_the_controllers_clock() -> None:
    observer = Observer()
    show(observer, status(1_000_000_000, State.HOLD, 0.010))
    observer.await_standstill()
    assert show(observer, status(1_200_000_000, State.HOLD, 0.0090)) is None
    assert show(observer, status(1_400_000_000, State.HOLD, 0.0091)) is None
    assert show(observer, status(1_500_000_000, State.HOLD, 0.0090)) == ev.Standstill()


def still(observer: Observer, force_N: float) -> None:
    """A rod that moves until 1.2 s, with 500 N, and rests from then on; standstill is established at 1.51 s."""
    show(observer, status(1_000_000_000, State.HOLD, 0.010))
    observer.await_standstill()
    channels = (Channel.DISPLACEMENT, Channel.CONTROLLER_FORCE)
    moving = [(Channel.FORCE, 1_100_000_000 + n, 500.0) for n in range(20)]
    show(observer, np.concatenate([status(1_200_000_000, State.HOLD, 0.0), records(*moving)]))
    resting = [(Channel.FORCE, 1_300_000_000 + n, force_N) for n in range(20)]
    resting += [(channel, 1_300_000_000 + n, 0.0) for n in range(20) for channel in channels]
    assert show(observer, records(*resting)) is None
    assert show(observer, status(1_510_000_000, State.HOLD, 0.0)) == ev.Standstill()


@pytest.mark.parametrize("force_N", [0.0, 900.0])
def test_a_rest_window_begins_with_the_standstill_that_comes_before_it(force_N: float) -> None:
    observer = Observer()
    still(observer, force_N)
    watch_rest(observer, zeros)
    assert show(observer, status(1_690_000_000, State.HOLD, 0.0)) is None
    event = show(observer, status(1_700_000_000, State.HOLD, 0.0))
    assert isinstance(event, ev.ZerosJudged)
    assert (event.cause is None) is (force_N == 0.0)


def test_records_after_a_standstill_make_it_no_part_of_a_later_rest_window() -> None:
    observer = Observer()
    still(observer, 900.0)
    show(observer, status(1_600_000_000, State.HOLD, 0.0))
    watch_rest(observer, zeros)
    channels = (Channel.FORCE, Channel.DISPLACEMENT, Channel.CONTROLLER_FORCE)
    show(observer, records(*((channel, 1_700_000_000 + n, 0.0) for n in range(20) for channel in channels)))
    assert show(observer, status(2_090_000_000, State.HOLD, 0.0)) is None
    assert show(observer, status(2_110_000_000, State.HOLD, 0.0)) == ev.ZerosJudged(None)


def test_zeros_are_evaluated_over_the_rest_window() -> None:
    observer = Observer()
    show(observer, status(1_000_000_000, State.OFF))
    watch_rest(observer, zeros)
    channels = (Channel.FORCE, Channel.DISPLACEMENT, Channel.CONTROLLER_FORCE)
    block = [(channel, 1_100_000_000 + n, 0.0) for n in range(20) for channel in channels]
    assert show(observer, records(*block)) is None
    assert show(observer, status(1_600_000_000, State.OFF)) == ev.ZerosJudged(None)


def test_the_rest_window_begins_with_the_first_status_after_connecting() -> None:
    observer = Observer()
    watch_rest(observer, zeros)
    channels = (Channel.FORCE, Channel.DISPLACEMENT, Channel.CONTROLLER_FORCE)
    assert show(observer, status(7_000_000_000, State.OFF)) is None
    block = [(channel, 7_100_000_000 + n, 0.0) for n in range(20) for channel in channels]
    assert show(observer, records(*block)) is None
    assert show(observer, status(7_450_000_000, State.OFF)) is None
    assert show(observer, status(7_510_000_000, State.OFF)) == ev.ZerosJudged(None)


@pytest.mark.parametrize("force_N", [0.0, 900.0])
def test_what_came_in_the_last_half_second_of_connecting_is_the_rest_window(force_N: float) -> None:
    observer = Observer()
    watch_rest(observer, zeros)
    begin_ns = 7_000_000_000
    parts = [records((Channel.FORCE, begin_ns - 1, 500.0))]
    for step in range(71):  # a status each 10 ms, 0.7 s; the force of the first 0.2 s is not part of the window
        now_ns = begin_ns + 10_000_000 * step
        parts.append(status(now_ns, State.OFF))
        parts.append(records(
            (Channel.FORCE, now_ns, 500.0 if step < 20 else force_N), (Channel.DISPLACEMENT, now_ns, 0.0),
            (Channel.CONTROLLER_FORCE, now_ns, 0.0),
        ))  # fmt: skip
    event = show(observer, np.concatenate(parts))
    assert isinstance(event, ev.ZerosJudged), "nothing more is waited for"
    assert (event.cause is None) is (force_N == 0.0)


def test_a_host_that_was_held_up_waits_for_enough_samples_instead_of_blaming_a_sensor() -> None:
    observer = Observer()
    show(observer, status(1_000_000_000, State.OFF))
    watch_rest(observer, zeros)
    statuses = [(Channel.CONTROLLER_FORCE, 1_100_000_000 + n, 0.0) for n in range(20)]
    few = [(channel, 1_100_000_000 + n, 0.0) for n in range(3) for channel in (Channel.FORCE, Channel.DISPLACEMENT)]
    show(observer, records(*statuses, *few))
    assert show(observer, status(1_600_000_000, State.OFF)) is None
    late = [(channel, 1_700_000_000 + n, 0.0) for n in range(9) for channel in (Channel.FORCE, Channel.DISPLACEMENT)]
    assert show(observer, records(*late)) == ev.ZerosJudged(None)


def test_a_sensor_that_calls_its_own_samples_faulty_at_rest_is_refused_though_they_look_well() -> None:
    observer = Observer()
    watch_rest(observer, zeros)
    show(observer, status(1_000_000_000, State.OFF))
    channels = (Channel.FORCE, Channel.DISPLACEMENT, Channel.CONTROLLER_FORCE)
    block = records(*((channel, 1_100_000_000 + n, 0.0) for n in range(20) for channel in channels))
    block["flags"][block["channel"] == Channel.FORCE] = Quality.SENSOR_FAULT
    show(observer, block)
    event = show(observer, status(1_600_000_000, State.OFF))
    assert isinstance(event, ev.ZerosJudged)
    assert event.cause is not None
    assert "load cell: 20 samples at rest" in event.cause.detail


def test_live_values_are_the_last_ones() -> None:
    observer = Observer()
    show(observer, records((Channel.FORCE, 1, 10.0), (Channel.FORCE, 2, 12.0), (Channel.COIL_CURRENT, 2, 0.5)))
    assert observer.last == {Channel.FORCE: 12.0, Channel.COIL_CURRENT: 0.5}


def rest(
    force_N: float = -270.0, noise_N: float = 5.0, lvdt_m: float = 0.0, lvdt_noise_m: float = 5e-6, samples: int = 50,
    *, controller_N: float = math.nan,
) -> AtRest:
    wobble = np.where(np.arange(samples) % 2, 1.0, -1.0)
    coarse_N = force_N if math.isnan(controller_N) and not math.isnan(force_N) else controller_N
    return AtRest(
        force_N + noise_N * wobble, lvdt_m + lvdt_noise_m * wobble, np.zeros(20), np.full(20, np.nan_to_num(coarse_N))
    )


def test_a_tared_rig_with_gas_force_passes() -> None:
    assert check_rest(rest(), LIMITS) is None


@pytest.mark.parametrize(
    ("shown", "named"),
    [
        (rest(force_N=1200.0), "load cell at rest"),
        (rest(noise_N=150.0), "load cell's noise"),
        (rest(force_N=230.0, controller_N=-270.0), "differ by +500"),
        (
            replace(rest(force_N=230.0, controller_N=-270.0, lvdt_m=2e-6), position_m=np.full(20, -2e-6)),
            "differ by +500",
        ),
        (rest(lvdt_m=0.006), "LVDT vs. controller"),
        (rest(lvdt_noise_m=1e-3), "LVDT's noise"),
        (rest(samples=5), "load cell: 5 samples"),
        (rest(force_N=float("nan")), "finite"),
        (rest(lvdt_m=float("inf")), "finite"),
        (replace(rest(), force_flagged=3), "load cell: 3 samples"),
        (replace(rest(), displacement_flagged=1), "LVDT: 1 samples"),
    ],
    ids=[
        "offset", "noisy", "disagree", "disagree-at-zero", "apart", "moving", "too-few", "nan", "inf", "faulty-force",
        "faulty-lvdt",
    ],
)
def test_a_rig_that_is_not_tared_or_not_at_rest_is_refused_by_name(shown: AtRest, named: str) -> None:
    cause = check_rest(shown, LIMITS)
    assert cause is not None
    assert cause.slug == "not-tared"
    assert named in cause.detail


@pytest.mark.parametrize("scale", [1e-3, 2e-3])
def test_exchanged_plugs_are_reported_by_what_both_would_show_the_other_way_round(scale: float) -> None:
    limits = replace(LIMITS, displacement_per_wire=scale, force_offset_N=20.0, displacement_offset_m=1e-3)
    right = rest(force_N=-300.0)
    swapped = exchanged(right, limits)
    cause = check_rest(swapped, limits)
    assert cause is not None
    assert cause.slug == "sensors-swapped"
    assert check_rest(exchanged(swapped, limits), limits) is None


@pytest.mark.parametrize(
    "seen", [replace(rest(), force_N=-rest().force_N), replace(rest(lvdt_m=-0.02), position_m=np.full(9, 0.02))]
)
def test_a_wrong_sign_shows_at_rest_where_there_is_something_to_show(seen: AtRest) -> None:
    cause = check_rest(seen, LIMITS)
    assert cause is not None
    assert cause.slug == "sensors-swapped"
    assert "sign is wrong" in cause.detail
