"""What stands still by itself proves nothing: stops where a device lies, or is not heard, while the rod moves."""

from __future__ import annotations

from pathlib import Path

from matrices import matrix_text

from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.runs import live
from simulators.scenarios.scenario import Scenario

STILL_M_S = 5e-3


def ended(
    root: Path, *events: str, actuator: str = "tcp", options: tuple[str, ...] = (), slow: bool = False
) -> Scenario:
    """The world's first session; everything that must hold did."""
    amplitude, frequency, cycles = ("10 mm", "0.5 Hz", 3) if slow else ("6 mm", "2 Hz", 6)
    matrix = matrix_text("0.5 A", amplitude=amplitude, frequency=frequency, cycles=cycles)
    plan = ScenarioPlan(7, matrix, tuple(map(FaultEvent.parse, events)), actuator, options)
    scenario, found = live(plan, root, most_sessions=1)
    assert found.failed == ()
    return scenario


def test_a_stuck_lvdt_on_a_line_of_bad_answers_proves_no_standstill_and_the_pressure_goes(tmp_path: Path) -> None:
    scenario = ended(tmp_path, "rtu-crc@0.71", "sensor-stuck:lvdt@0.711", actuator="rtu")
    lines = [line for line in scenario.journal if line.get("event") == "station"]
    assert [line["slug"] for line in lines if line["what"] == "trip"] == ["rtu-crc"]
    assert not [line for line in lines if line["what"] == "safe"]
    unknown = next(line for line in lines if line["what"] == "unknown")
    assert unknown["reason"] == "standstill is not confirmed; devices without fresh data: controller, LVDT"
    assert scenario.sessions[0].exit_code == 7
    assert any(line.code == "HYDRAULICS_OFF" for line in scenario.sessions[0].truth.log), (
        "whether or not it is answered"
    )


def test_an_lvdt_that_comes_back_proves_standstill_over_a_whole_period_alone(tmp_path: Path) -> None:
    scenario = ended(tmp_path, "rtu-crc@0.71", "sensor-stuck:lvdt@0.711+1.2", actuator="rtu")
    truth = scenario.sessions[0].truth
    back_ns = next(line.host_ns for line in truth.log if line.code == "FAULT_ENDS")
    safe = next(line for line in scenario.journal if line.get("what") == "safe")
    assert safe["t_ns"] - back_ns > 0.5e9 - 20e6
    rows = truth.arrays
    assert abs(rows[(rows[:, 0] >= back_ns) & (rows[:, 0] < safe["t_ns"])][:, 1]).max() < STILL_M_S


def test_a_frozen_position_beside_a_pulled_lvdt_proves_nothing_though_the_controller_says_that_it_holds(
    tmp_path: Path,
) -> None:
    scenario = ended(tmp_path, "actuator-frozen@0.7", "lvdt-pulled@0.76")
    lines = [line for line in scenario.journal if line.get("event") == "station"]
    assert [line["slug"] for line in lines if line["what"] == "trip"] == ["actuator-frozen"]
    assert not [line for line in lines if line["what"] == "safe"]
    assert scenario.sessions[0].exit_code == 7
    assert scenario.sessions[0].truth.arrays[-1, 5] == 0, "the pressure is off"


def test_a_current_that_nobody_can_measure_after_a_stop_is_reported_by_the_force_at_rest(tmp_path: Path) -> None:
    """The coil's driver sticks at full current after the ECU's status frames have become unreadable."""
    scenario = ended(tmp_path, "can-malformed@0.7", "current-stuck:full@1.5")
    rows = scenario.sessions[0].truth.arrays
    assert rows[-1, 2] > 4.5
    answer = scenario.sessions[0].answer
    assert (answer.stop.kind, answer.stop.current_zero, answer.stop.pressure_off) == ("S2", False, True)
    (left,) = answer.findings
    assert left.slug == "current-left"
    assert left.values["end"] - left.values["start"] > 500, "the gas force, then the yield force at 5 A beside it"
    assert scenario.sessions[0].exit_code == 7
    assert any(line.get("event") == "finding" and line["slug"] == "current-left" for line in scenario.journal)


def test_a_stop_without_a_measured_current_whose_force_comes_back_is_as_before(tmp_path: Path) -> None:
    scenario = ended(tmp_path, "can-malformed@0.7")
    answer = scenario.sessions[0].answer
    assert (answer.stop.current_zero, answer.findings, scenario.sessions[0].exit_code) == (False, (), 4)


def test_a_slow_reversal_behind_a_trip_of_the_controller_is_no_standstill(tmp_path: Path) -> None:
    """Writes are lost: the controller's watchdog fades out behind TRIPPED, while the rod turns within 0.3 mm."""
    scenario = ended(tmp_path, "modbus-write-lost@1", slow=True)
    (safe,) = [line for line in scenario.journal if line.get("what") == "safe"]
    rows = scenario.sessions[0].truth.arrays
    moving = rows[abs(rows[:, 1]) > 1e-3]
    assert safe["t_ns"] > moving[-1, 0] + 1.8e9, "a period of 2 s after the last motion"
    assert not [line for line in scenario.journal if line.get("what") == "also" and line["slug"] == "stop-ignored"]


def test_a_quiet_lvdt_that_sticks_in_the_fade_out_proves_nothing_where_the_controller_is_not_heard(
    tmp_path: Path,
) -> None:
    """Steps of 0.1 mm: at rest it repeats one value too."""
    quiet = ("lvdt.resolution=0.1", "lvdt.noise=0.0001")
    scenario = ended(tmp_path, "rtu-crc@0.7", "sensor-stuck:lvdt@0.85", actuator="rtu", options=quiet)
    lines = [line for line in scenario.journal if line.get("event") == "station"]
    assert not [line for line in lines if line["what"] == "safe"]
    assert [line for line in lines if line["what"] == "unknown"]
    assert scenario.sessions[0].exit_code == 7
