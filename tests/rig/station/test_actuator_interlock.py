"""What the devices say about themselves: bits, clocks, heartbeats, leases, and the LVDT against the controller."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from drivers.current_source import SourceFault, SourceState, SourceStatus, SourceTemperature
from drivers.register_maps.map_file import controller
from drivers.roles import ActuatorStatus, FaultBit, Input, State
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.current_interlock import EcuInterlock

OURS = 77
NOTHING_SENT = [(0, 0)]
"""What a controller acknowledges that has not been asked for anything."""
MS = 1_000_000


def status(ms: int, **changes: float) -> ActuatorStatus:
    values: dict[str, float] = dict.fromkeys(ActuatorStatus._fields, 0)
    values |= {
        "received_ns": ms * MS,
        "heartbeat": ms // 10,
        "state": State.HOLD,
        "clock_us": (ms * 1000) % (1 << 32),
        "owner": OURS,
        "inputs": Input.E_STOP_CLOSED | Input.HYDRAULICS_ON,
        **changes,
    }
    return ActuatorStatus(**values)  # type: ignore[arg-type]  # numbers by name


def interlock() -> ActuatorInterlock:
    made = ActuatorInterlock(
        OURS, controller("demo").capabilities, frozen_after_ns=150 * MS, disagreement_m=0.005, lag_s=0.03
    )
    made.leased = True
    return made


def slugs(
    made: ActuatorInterlock, answer: ActuatorStatus, lvdt_m: float | None = None, speed: float = 0.0
) -> list[str]:
    return [finding.slug for finding in made.check(answer, lvdt_m, speed, NOTHING_SENT)]


@pytest.mark.parametrize(
    ("bits", "slug"),
    [
        (FaultBit.WATCHDOG, "host-silent"),
        (FaultBit.E_STOP, "estop"),
        (FaultBit.SUPPLY_PRESSURE, "supply-pressure"),
        (FaultBit.POSITION_LIMIT, "stroke-limit"),
        (FaultBit.FOLLOWING_ERROR, "controller-trip"),
        (FaultBit.SENSOR, "feedback-lost"),
        (1 << 20, "controller-trip"),
    ],
)
def test_every_fault_bit_is_named(bits: int, slug: str) -> None:
    assert slugs(interlock(), status(0, fault_bits=int(bits), state=State.TRIPPED)) == [slug]


@pytest.mark.parametrize("name", ["position_m", "velocity_m_s", "force_N"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_controller_that_measures_no_finite_number_is_not_trusted(name: str, value: float) -> None:
    made = interlock()
    assert slugs(made, status(0), 0.0) == []
    assert [slugs(made, status(ms, **{name: value}), 0.1) for ms in (10, 20)] == [["feedback-lost"]] * 2


@pytest.mark.parametrize(("gap_ms", "moving"), [(40, False), (500, True)])
def test_a_rod_that_was_not_seen_for_half_a_second_is_not_reported_to_have_stood(gap_ms: int, moving: bool) -> None:
    made = interlock()
    for ms in range(0, 200, 10):
        made.check(status(ms), 0.0, 0.0, NOTHING_SENT)
    assert not made.moving(0.1)
    made.check(status(190 + gap_ms), 0.0, 0.0, NOTHING_SENT)
    assert made.moving(0.1) is moving
    for ms in range(200 + gap_ms, 320 + gap_ms, 10):
        made.check(status(ms), 0.0, 0.0, NOTHING_SENT)
    assert not made.moving(0.1)


@pytest.mark.parametrize(("state", "proved_ms"), [(State.HOLD, 100), (State.TRIPPED, 4000)])
def test_behind_a_trip_the_rod_has_to_stand_for_a_whole_period_since_its_state_does_not_show_the_fade_out(
    state: State, proved_ms: int
) -> None:
    made = interlock()
    for ms in range(0, 200, 10):
        made.check(status(ms, state=State.FADING), 0.0, 0.0, NOTHING_SENT)
    found = []
    for ms in range(200, 5000, 10):
        made.check(status(ms, state=state), 0.0, 0.0, NOTHING_SENT)
        found += [] if made.moving(0.1, period_s=4.0) else [ms - 190]
    assert found[0] == pytest.approx(proved_ms, abs=15)


def test_several_fault_bits_give_several_findings() -> None:
    both = int(FaultBit.WATCHDOG | FaultBit.FORCE_LIMIT)
    assert slugs(interlock(), status(0, fault_bits=both, state=State.TRIPPED)) == ["host-silent", "force-limit"]


def test_open_e_stop_chain_is_seen_in_the_inputs() -> None:
    assert slugs(interlock(), status(0, inputs=int(Input.HYDRAULICS_ON))) == ["estop"]


def test_lease_of_another_host_and_a_lost_lease_are_distinguished() -> None:
    assert slugs(interlock(), status(0, owner=5)) == ["second-master"]
    assert slugs(interlock(), status(0, owner=0)) == ["actuator-reboot"]


def test_nobodys_lease_is_no_finding_before_we_hold_it() -> None:
    made = interlock()
    made.leased = False
    assert slugs(made, status(0, owner=0)) == []


def test_clock_wraps_without_a_finding_and_goes_on() -> None:
    made = interlock()
    wrap_ms = (1 << 32) // 1000
    for ms in range(wrap_ms - 50, wrap_ms + 60, 10):
        assert slugs(made, status(ms)) == []
    assert made.clock_s == pytest.approx(0.1, abs=0.001)


def test_clock_that_falls_back_is_a_reboot() -> None:
    made = interlock()
    slugs(made, status(60_000))
    assert slugs(made, status(60_010, clock_us=1000)) == ["actuator-reboot"]


def test_heartbeat_that_stalls_is_a_fault_after_its_time_only() -> None:
    made = interlock()
    found = [(ms, slugs(made, status(ms, heartbeat=3))) for ms in range(0, 200, 10)]
    assert [ms for ms, names in found if names] == [160, 170, 180, 190]
    assert found[-1][1] == ["actuator-frozen"]


def test_position_register_that_stands_while_the_lvdt_moves_is_frozen() -> None:
    made = interlock()
    found = [slugs(made, status(ms, position_m=0.01), 0.01 + ms * 1e-4, 0.1) for ms in range(0, 60, 10)]
    assert found[1] == []
    assert "actuator-frozen" in found[-1]


def test_two_equal_readings_of_a_quantised_register_are_not_frozen() -> None:
    made = interlock()
    places_m = [0.010, 0.010, 0.014, 0.018, 0.018, 0.022]
    found = [slugs(made, status(10 * k, position_m=x), 0.01 + 4e-3 * k, 0.4) for k, x in enumerate(places_m)]
    assert not any("actuator-frozen" in names for names in found)


def test_a_controller_requested_twice_at_the_same_instant_of_its_clock_is_not_frozen() -> None:
    made = interlock()
    found = [slugs(made, status(ms, position_m=0.01, clock_us=10**6), 0.01 + ms * 1e-4, 0.1) for ms in range(0, 60, 10)]
    assert not any("actuator-frozen" in names for names in found)


def test_an_answer_from_before_the_motion_that_is_read_after_the_lvdt_is_not_frozen() -> None:
    made = interlock()
    rod_m = [0.010] * 10 + [0.018, 0.026]
    lvdt_m = [0.010] * 9 + [0.014, 0.022, 0.030]
    pairs = zip(rod_m, lvdt_m, strict=True)
    found = [slugs(made, status(10 * k, position_m=x), y, 0.4) for k, (x, y) in enumerate(pairs)]
    assert not any("actuator-frozen" in names for names in found)


def test_rod_at_rest_is_not_frozen() -> None:
    made = interlock()
    assert all(slugs(made, status(ms, position_m=0.01), 0.01 + 1e-5 * (ms % 20), 0.0) == [] for ms in range(0, 900, 10))


def test_disagreement_is_evaluated_at_rest_and_forgiven_for_the_age_difference_in_motion() -> None:
    made = interlock()
    moving = [slugs(made, status(ms, position_m=0.5e-3 * ms, velocity_m_s=0.5, state=State.RUNNING),
                    0.5e-3 * ms - 0.015, 0.5)
              for ms in range(0, 200, 10)]  # fmt: skip
    assert all(names == [] for names in moving)
    resting = [slugs(made, status(ms, position_m=0.1), 0.094, 0.0) for ms in range(200, 300, 10)]
    assert resting[:5] == [[]] * 5
    assert resting[5:] == [["position-disagreement"]] * 5, "for as long as it lasts: also once armed"


def test_controller_moves_by_state_or_by_position() -> None:
    made = interlock()
    assert made.moving(0.1)
    for ms in range(0, 200, 10):
        made.check(status(ms), None, math.nan, NOTHING_SENT)
    assert not made.moving(0.1)
    made.check(status(200, state=State.FADING), None, math.nan, NOTHING_SENT)
    assert made.moving(0.1)
    made.check(status(210, state=State.TRIPPED, fault_bits=1, position_m=0.01), None, math.nan, NOTHING_SENT)
    assert made.moving(0.1)


def coil(**changes: float) -> SourceStatus:
    values: dict[str, float] = dict.fromkeys(SourceStatus._fields, 0) | {"state": SourceState.ENABLED, **changes}
    return SourceStatus(**values)  # type: ignore[arg-type]  # numbers by name


@pytest.mark.parametrize(
    ("bit", "slug"),
    [
        (SourceFault.OVER_TEMPERATURE, "ecu-overtemp"),
        (SourceFault.OPEN, "coil-open-short"),
        (SourceFault.SHORT, "coil-open-short"),
        (SourceFault.COMMAND_CHECK, "ecu-command"),
        (SourceFault.RESTARTED, "ecu-restart"),
    ],
)
def test_every_ecu_fault_bit_is_named(bit: SourceFault, slug: str) -> None:
    assert [f.slug for f in EcuInterlock(3.15, 120.0, lambda: 0).check_status(coil(faults=int(bit)), 5)] == [slug]


def test_a_command_time_out_waits_too_since_the_controller_may_know_of_a_silent_host() -> None:
    polls = [7]
    made = EcuInterlock(3.15, 120.0, lambda: polls[0])
    late = coil(faults=int(SourceFault.COMMAND_TIMEOUT))
    assert made.check_status(late, 5) == []
    polls[0] = 9
    assert [f.slug for f in made.check_status(late, 5)] == ["ecu-command"]


def test_undervoltage_waits_for_two_polls_of_the_controller_which_may_know_of_an_open_e_stop_chain() -> None:
    polls = [7]
    made = EcuInterlock(3.15, 120.0, lambda: polls[0])
    low = coil(faults=int(SourceFault.UNDERVOLTAGE))
    assert [made.check_status(answer, 5) for answer in (low, low, coil(), low)] == [[], [], [], []]
    polls[0] = 8
    assert made.check_status(low, 5) == []
    polls[0] = 9
    assert [f.slug for f in made.check_status(low, 5)] == ["ecu-overtemp"]


def test_undervoltage_does_not_wait_for_a_controller_that_says_nothing() -> None:
    made = EcuInterlock(3.15, 120.0, lambda: 0)
    low = coil(faults=int(SourceFault.UNDERVOLTAGE))
    assert made.check_status(low, 0) == []
    assert [f.slug for f in made.check_status(low, 50_000_000)] == ["ecu-overtemp"]


def test_a_program_that_runs_past_its_end_is_a_stop_that_was_ignored() -> None:
    made = interlock()
    made.expect_program(0.3, 3.0)
    running = [slugs(made, status(ms, state=State.RUNNING), None, math.nan) for ms in range(0, 500, 10)]
    assert all(names == [] for names in running[:37])
    assert running[38] == ["stop-ignored"], "within 100 ms of the program's end"
    made.expect_program(0.3, 3.0)
    assert slugs(made, status(510, state=State.HOLD), None, math.nan) == []


def test_a_program_timed_by_the_hosts_clock_gets_what_the_two_clocks_may_differ_by() -> None:
    """0.3 s, 0.07 s as ever, 0.1 % of it, and 0.03 s by which this host may be late: 0.4003 s."""
    clockless = replace(controller("demo").capabilities, clock=False)
    made = ActuatorInterlock(OURS, clockless, frozen_after_ns=150 * MS, disagreement_m=0.005, lag_s=0.03)
    made.expect_program(0.3, 3.0)
    running = [slugs(made, status(ms, state=State.RUNNING), None, math.nan) for ms in range(0, 500, 10)]
    assert all(names == [] for names in running[:40])
    assert running[41] == ["stop-ignored"]


def test_a_controller_that_says_hold_while_the_lvdt_moves_is_not_believed() -> None:
    made = interlock()
    found = [slugs(made, status(ms, state=State.HOLD), 1e-6 * ms, 0.1) for ms in range(0, 150, 10)]
    assert found[:11] == [[]] * 11
    assert found[11:] == [["stop-ignored"]] * 4


def test_an_lvdt_that_is_read_late_does_not_disprove_a_controller_that_holds() -> None:
    """Its last value is from the motion before; every other poll has a new one, then the rod is seen to stand."""
    made = interlock()
    held = [slugs(made, status(ms, state=State.HOLD), 1e-6 * (ms // 20), 0.1) for ms in range(0, 200, 10)]
    assert held == [[]] * 20
    assert slugs(made, status(200, state=State.HOLD), 1e-5, 0.0) == []


@pytest.mark.parametrize(("current_A", "trips"), [(3.15, False), (3.151, True), (-3.151, True)])
def test_measured_current_beyond_the_limit_trips_in_both_directions(current_A: float, trips: bool) -> None:
    assert bool(EcuInterlock(3.15, 120.0, lambda: 0).check_status(coil(current_A=current_A), 5)) is trips


def test_hot_coil_and_a_new_boot_count_are_findings() -> None:
    made = EcuInterlock(3.15, 120.0, lambda: 0)
    assert made.check_temperature(SourceTemperature(119.9, 40.0, 13.5, 4), 5) == []
    assert [f.slug for f in made.check_temperature(SourceTemperature(120.1, 40.0, 13.5, 4), 5)] == ["coil-temperature"]
    assert [f.slug for f in made.check_temperature(SourceTemperature(20.0, 40.0, 13.5, 5), 5)] == ["ecu-restart"]


def test_a_temperature_that_stays_away_for_five_of_its_periods_is_a_finding_for_as_long_as_it_does() -> None:
    made = EcuInterlock(3.15, 120.0, lambda: 0)
    warm = SourceTemperature(60.0, 40.0, 13.5, 4)
    for _ in range(3):
        for _ in range(50):
            made.check_status(coil(), 5)
        assert made.check_temperature_age(5) == []
        made.check_temperature(warm, 5)
    for _ in range(51):
        made.check_status(coil(), 5)
    found = [*made.check_temperature_age(6), *made.check_temperature_age(7)]
    assert [(finding.slug, finding.value, finding.limit) for finding in found] == [("ecu-silent", 0.51, 0.5)] * 2
    made.check_temperature(warm, 8)
    assert made.check_temperature_age(8) == []
