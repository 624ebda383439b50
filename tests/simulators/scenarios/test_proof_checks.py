"""What the judge of worlds says of a stop's cause and proof, of what comes after it, of faults with nothing to show."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from matrices import matrix_text

from simulators.scenarios.drawn_rig import bench_file
from simulators.scenarios.plan import FaultEvent, ScenarioPlan
from simulators.scenarios.proof_invariants import (
    a_current_that_comes_back_is_reported,
    a_held_rod_stays,
    what_is_proved_is_true,
)
from simulators.scenarios.runs import live
from simulators.scenarios.scenario import Noted, Session
from simulators.scenarios.stop_invariants import (
    a_fault_ends_the_motion,
    a_stalled_watcher_is_noticed,
    a_stop_fault_is_noticed,
    stop_stays_stopped,
    stops_have_a_cause,
)
from simulators.scenarios.view import View

BENCH = Path(__file__).resolve().parents[3] / "examples" / "demo-bench.toml"
SAFE_NS, ENDS_S = 1_000_000_000_000, 6.0
JAMMED = "load-train:jammed"
SLIPS = "actuator-frozen:slips"


class Shown:
    """A session in which a stop is proved at 0 s: the truth from 1 s before, as rows every millisecond."""

    def __init__(self, root: Path) -> None:
        shutil.copy(BENCH, root / "bench.toml")
        (root / "matrix.toml").write_text(matrix_text("0 A", amplitude="6 mm", frequency="4 Hz"), encoding="utf-8")
        self.root = root
        self.t_s = np.arange(-1.0, ENDS_S, 1e-3)
        self.rows = np.zeros((len(self.t_s), 7))
        self.rows[:, 0] = SAFE_NS + 1e9 * self.t_s
        self.log: list[Noted] = []
        self.journal: list[dict[str, Any]] = [self._entry("safe", 0.0, current_zero=True, stop="S2")]
        self.events: tuple[FaultEvent, ...] = ()
        self.happened: tuple[tuple[float, FaultEvent], ...] = ()

    @staticmethod
    def _entry(what: str, at_s: float, **more: object) -> dict[str, Any]:
        at_ns = SAFE_NS + 1e9 * at_s
        return {"event": "station", "what": what, "t_ns": at_ns, "latched_ns": at_ns, "host_ns": at_ns, **more}

    def tells(self, slug: str, at_s: float, what: str = "also") -> None:
        """The station tells of something."""
        self.journal.append(self._entry(what, at_s, slug=slug))

    def notes(self, code: str, text: str, at_s: float) -> None:
        """The devices' log has a line."""
        self.log.append(Noted(round(SAFE_NS + 1e9 * at_s), code, text))

    def moves(self, begins_s: float, ends_s: float, m_s: float) -> None:
        """The rod moves at this speed."""
        moving = (self.t_s >= begins_s) & (self.t_s < ends_s)
        self.rows[moving, 1] = m_s
        self.rows[:, 3] = np.cumsum(self.rows[:, 1]) * 1e-3

    def flows(self, begins_s: float, ends_s: float, current_A: float) -> None:
        """This current flows."""
        self.rows[(self.t_s >= begins_s) & (self.t_s < ends_s), 2] = current_A

    @property
    def view(self) -> View:
        """As the judges see it."""
        truth = SimpleNamespace(arrays=self.rows, log=self.log)
        plan = ScenarioPlan(1, "", self.events)
        scenario = SimpleNamespace(root=self.root, plan=plan, journal=self.journal)
        first_ns, last_ns = int(self.rows[0, 0]), int(self.rows[-1, 0])
        answer = SimpleNamespace(exit_code=0, rig_state="safe")
        session = Session(1, first_ns, cast("Any", truth), last_ns, last_ns, 0, answer)
        session.happened = list(self.happened)
        return View(cast("Any", scenario), session)


@pytest.fixture
def shown(tmp_path: Path) -> Shown:
    return Shown(tmp_path)


@pytest.mark.parametrize("code", ["FAULT", "FAULT_ENDS"])
@pytest.mark.parametrize("noted_s", [-0.05, 0.009, 0.5])
def test_what_presses_a_held_rod_by_tenths_of_a_millimetre_after_the_proof_takes_nothing_from_it(
    shown: Shown, code: str, noted_s: float
) -> None:
    """The plant is brought up to date once in 10 ms: the rod has moved before the fault's line is written."""
    shown.notes(code, JAMMED, noted_s)
    shown.moves(noted_s - 0.009, noted_s + 0.05, 6e-3)
    assert list(what_is_proved_is_true(shown.view)) == []


@pytest.mark.parametrize(("noted_s", "speed_m_s"), [(0.05, 0.03), (-0.05, 0.03), (0.05, -0.03)])
def test_a_rod_that_goes_a_millimetre_while_something_presses_on_it_did_not_stand(
    shown: Shown, noted_s: float, speed_m_s: float
) -> None:
    shown.notes("FAULT", JAMMED, noted_s)
    shown.moves(0.06, 0.2, speed_m_s)
    (found,) = what_is_proved_is_true(shown.view)
    assert found == ("standstill was confirmed before the rod moved again at 0.03 m/s", SAFE_NS)


@pytest.mark.parametrize("fault", [None, ("load-train", 0.05), (JAMMED, -0.3), (JAMMED, 0.3), ("current-stuck", 0.05)])
def test_a_rod_that_moves_on_with_nothing_to_press_it_just_then_did_not_stand(
    shown: Shown, fault: tuple[str, float] | None
) -> None:
    if fault is not None:
        shown.notes("FAULT", *fault)
    shown.moves(0.06, 0.1, 6e-3)
    assert [words for words, _ in what_is_proved_is_true(shown.view)] == [
        "standstill was confirmed before the rod moved again at 0.006 m/s"
    ]


def test_a_rod_that_moves_when_its_standstill_is_proved_is_found_whatever_presses_on_it_later(shown: Shown) -> None:
    shown.notes("FAULT", JAMMED, 0.1)
    shown.moves(-0.5, 0.0, 6e-3)
    (words,) = [words for words, _ in what_is_proved_is_true(shown.view)]
    assert words == "standstill was confirmed while the rod moved at 0.006 m/s"


@pytest.mark.parametrize(
    ("noted_s", "begins_s", "found"),
    [(0.2, 0.2, 0), (-0.025, -0.025, 0), (-0.1, -0.1, 2), (0.2, 0.1, 1), (None, 0.2, 1)],
)
def test_a_transducer_that_slips_after_the_proof_or_too_shortly_before_it_takes_nothing_from_it(
    shown: Shown, noted_s: float | None, begins_s: float, found: int
) -> None:
    if noted_s is not None:
        shown.notes("FAULT", SLIPS, noted_s)
    shown.moves(begins_s, 1.2, 0.02)
    assert len(list(what_is_proved_is_true(shown.view))) == found


@pytest.mark.parametrize(
    ("speed_m_s", "ends_s", "off_s", "fault", "found"),
    [
        (0.02, 1.5, 0.8, None, 0), (0.02, 1.5, 5.0, None, 1), (0.02, 0.3, 5.0, None, 0), (0.002, 5.0, 5.0, None, 1),
        (0.02, 1.5, 5.0, "modbus-busy", 0), (0.02, 1.5, 5.0, "lvdt-pulled", 0), (0.02, 1.5, 5.0, "loadcell-pulled", 1),
        (0.02, 1.5, 5.0, "stop-ignored", 1), (0.02, 1.5, 5.0, "stop-ignored:pressure", 0),
    ],
)
def test_a_held_rod_that_leaves_its_place_loses_its_pressure(
    shown: Shown, speed_m_s: float, ends_s: float, off_s: float, fault: str | None, found: int
) -> None:
    shown.notes("FAULT", SLIPS, 0.2)
    if fault is not None:
        shown.notes("FAULT", fault, 0.1)
    shown.moves(0.2, ends_s, speed_m_s)
    shown.rows[shown.t_s < off_s, 5] = 2.0
    assert len(list(a_held_rod_stays(shown.view))) == found


@pytest.mark.parametrize(("noted_s", "speed_m_s", "found"), [(4.0, 6e-3, 0), (4.0, 0.03, 1), (None, 6e-3, 1)])
def test_a_stopped_rod_may_be_pressed_long_after_the_stop_too(
    shown: Shown, noted_s: float | None, speed_m_s: float, found: int
) -> None:
    shown.tells("estop", -0.5, "trip")
    if noted_s is not None:
        shown.notes("FAULT", JAMMED, noted_s)
    shown.moves(4.0, 4.05, speed_m_s)
    assert len(list(stop_stays_stopped(shown.view))) == found


@pytest.mark.parametrize(("begins_s", "found"), [(-0.008, 0), (-0.03, 0), (-0.2, 1)])
def test_a_current_that_begins_after_the_last_status_was_measured_is_not_in_the_proof(
    shown: Shown, begins_s: float, found: int
) -> None:
    shown.flows(begins_s, 0.05, 0.3)
    assert len(list(what_is_proved_is_true(shown.view))) == found


def test_a_current_that_has_not_gone_yet_is_in_the_proof(shown: Shown) -> None:
    shown.flows(-0.5, 0.002, 0.3)
    (words,) = [words for words, _ in what_is_proved_is_true(shown.view)]
    assert words == "0 A was confirmed while the current was 0.30 A"


@pytest.mark.parametrize(
    ("lasts_s", "slug", "found"),
    [(0.2, None, 0), (1.0, None, 1), (1.0, "force-limit", 1), (1.0, "current-stuck", 0), (1.0, "overcurrent", 0),
     (1.0, "ecu-silent", 0)],
)  # fmt: skip
def test_a_current_that_comes_back_after_the_proof_is_reported_or_what_hides_it(
    shown: Shown, lasts_s: float, slug: str | None, found: int
) -> None:
    shown.flows(-0.008, lasts_s, 0.3)
    if slug is not None:
        shown.tells(slug, 0.2)
    assert len(list(a_current_that_comes_back_is_reported(shown.view))) == found


@pytest.mark.parametrize(("ordered_s", "found"), [(None, 1), (0.003, 1), (-0.001, 0), (-0.5, 0)])
def test_the_pressure_is_off_before_that_is_proved_not_soon_after(
    shown: Shown, ordered_s: float | None, found: int
) -> None:
    shown.journal[0]["stop"] = "S1"
    shown.rows[:, 5] = 2.0
    if ordered_s is not None:
        shown.notes("HYDRAULICS_OFF", "DONE", ordered_s)
        shown.rows[shown.t_s > ordered_s, 5] = 0.0
    assert len(list(what_is_proved_is_true(shown.view))) == found


@pytest.mark.parametrize("fault", ["current-stuck", "current-stuck:full", "coil-open-short", "coil-open-short:short"])
@pytest.mark.parametrize(
    ("request_s", "flowing_A", "found"),
    [(None, 0.0, 0), (-0.5, 0.0, 1), (2.0, 0.0, 1), (None, 0.06, 1)],
)
def test_a_fault_of_the_current_has_nothing_to_show_while_none_is_requested_and_none_flows(
    shown: Shown, fault: str, request_s: float | None, flowing_A: float, found: int
) -> None:
    shown.events = (FaultEvent(fault, 0.1),)
    shown.notes("SET_CURRENT", "0.500 A", -0.9)
    shown.notes("SET_CURRENT", "0.000 A", -0.8)
    if request_s is not None:
        shown.notes("SET_CURRENT", "0.500 A", request_s)
    shown.log.sort(key=lambda line: line.host_ns)
    shown.notes("FAULT", fault, 0.0)
    shown.moves(0.0, 4.0, 0.1)
    shown.flows(3.0, 3.1, flowing_A)
    assert len(list(a_stop_fault_is_noticed(shown.view))) == found


@pytest.mark.parametrize(
    ("register_map", "fault", "found"),
    [("float-drive", "second-master", 0), ("float-drive", "actuator-frozen", 1), ("demo", "second-master", 1)],
)
def test_a_lease_that_is_taken_has_nothing_to_show_where_there_is_none_and_no_command_is_shown(
    shown: Shown, register_map: str, fault: str, found: int
) -> None:
    (shown.root / "bench.toml").write_text(bench_file(register_map), encoding="utf-8")
    shown.events = (FaultEvent(fault, 0.1),)
    shown.notes("FAULT", fault, 0.0)
    shown.moves(0.0, 4.0, 0.1)
    assert len(list(a_stop_fault_is_noticed(shown.view))) == found
    assert len(list(a_fault_ends_the_motion(shown.view))) == found


def test_a_fault_of_anything_else_is_to_be_noticed_at_0_A_too(shown: Shown) -> None:
    shown.events = (FaultEvent("ecu-silent", 0.1),)
    shown.notes("FAULT", "ecu-silent", 0.0)
    shown.moves(0.0, 4.0, 0.1)
    assert [words for words, _ in a_stop_fault_is_noticed(shown.view)] == ["ecu-silent was not detected"]


@pytest.mark.parametrize(
    ("slug", "register_map", "fault", "ends_s", "found"),
    [
        ("setpoints-late", "demo-streamed", "modbus-busy", None, 0),
        ("setpoints-late", "demo-streamed", "modbus-busy", -0.7, 0),
        ("setpoints-late", "demo-streamed", "modbus-busy", -1.1, 1),
        ("setpoints-late", "demo", "loadcell-pulled", None, 1),
        ("second-master", "delta-rmc", "actuator-reboot", None, 0),
        ("second-master", "demo", "actuator-reboot", None, 1),
        ("hydraulics", "delta-rmc", "second-master", None, 0),
        ("hydraulics", "demo", "second-master", None, 1),
    ],
)
def test_what_explains_a_stop_depends_on_what_the_controller_shows_and_on_what_was_there_just_before(
    shown: Shown, slug: str, register_map: str, fault: str, ends_s: float | None, found: int
) -> None:
    (shown.root / "bench.toml").write_text(bench_file(register_map), encoding="utf-8")
    shown.tells(slug, -0.5, "trip")
    shown.journal[-1]["detail"] = ""
    shown.notes("FAULT", fault, -2.0)
    if ends_s is not None:
        shown.notes("FAULT_ENDS", fault, ends_s)
    assert len(list(stops_have_a_cause(shown.view))) == found


@pytest.mark.parametrize(("tripped_s", "found"), [(None, 1), (-4.5, 1), (0.2, 0), (2.1, 1)])
def test_a_stop_long_before_a_station_that_stalls_excuses_nothing(
    shown: Shown, tripped_s: float | None, found: int
) -> None:
    """The rod moves at 0 s to 1 s, while the station does not run."""
    shown.happened = ((SAFE_NS, FaultEvent("station-stalled", 0.0, 1.0)),)
    shown.moves(0.0, 3.0, 0.1)
    if tripped_s is not None:
        shown.tells("host-late", tripped_s, "trip")
    assert len(list(a_stalled_watcher_is_noticed(shown.view))) == found


@pytest.mark.parametrize(("besides", "found"), [(None, 1), ("loadcell-pulled", 1), ("rtu-crc", 0)])
def test_an_e_stop_explains_an_undervoltage_only_where_something_else_hides_it(
    shown: Shown, besides: str | None, found: int
) -> None:
    shown.tells("ecu-overtemp", -0.5, "trip")
    shown.journal[-1]["detail"] = "ECU fault UNDERVOLTAGE"
    shown.notes("FAULT", "estop", -0.52)
    if besides is not None:
        shown.notes("FAULT", besides, -0.53)
    assert len(list(stops_have_a_cause(shown.view))) == found


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("current", "events"),
    [
        ("0.5 A", ("foreign-stop@4", f"{JAMMED}@2.12+0.1")),
        ("0 A", ("current-stuck@0.3",)),
        ("0 A", ("coil-open-short@0.3",)),
    ],
)
def test_everything_holds_where_a_rod_is_pressed_after_its_stop_or_a_fault_has_nothing_to_show(
    tmp_path: Path, current: str, events: tuple[str, ...]
) -> None:
    matrix = matrix_text(current, amplitude="6 mm", frequency="4 Hz")
    plan = ScenarioPlan(1, matrix, tuple(map(FaultEvent.parse, events)))
    scenario, ended = live(plan, tmp_path, most_sessions=1)
    assert ended.failed == ()
    fault_ns = next(line.host_ns for line in scenario.sessions[0].truth.log if line.code == "FAULT")
    safe_ns = [line["t_ns"] for line in scenario.journal if line.get("what") == "safe"]
    assert all(at_ns < fault_ns < at_ns + 0.1e9 for at_ns in safe_ns)
