"""Values of a run's response, endurance and hybrid tests, each with the point to which its row belongs."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rig.characteristics.endurance_tests import EnduranceTest, endurance_tests
from rig.characteristics.hybrid_tests import HybridTest, hybrid_tests
from rig.characteristics.loop import Measured
from rig.errors import FileProblem
from rig.identification.points.response_steps import ResponseTest
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.results.quantities import ENDURANCE_CYCLES, ENDURANCE_PROGRESS, cycles_to, response_time, wear
from rig.signals.step_response.result import LEVEL_NAMES, TimeResult
from rig.signals.wear_trend import RULES, StopRule
from rig.test_point import ENDURANCE

Values = dict[str, Measured]


def special_values(run: Run, response: Sequence[ResponseTest], remarks: list[str]) -> dict[str, Values]:
    """Values by id of the point.

    Args:
        run: the run.
        response: its response tests.
        remarks: extended by what cannot be read.
    """
    values: dict[str, Values] = {}
    for test in response:
        values.setdefault(test.id, {}).update(_of_response(test))
    try:
        for hybrid in hybrid_tests(run):
            values.setdefault(hybrid.id, {}).update(_of_hybrid(hybrid))
    except FileProblem as error:
        remarks.append(f"hybrid tests: {error.problems[0]}")
    try:
        for endurance in endurance_tests(run):
            last = _last_block(run, endurance.ledger.test)
            if last is not None:
                values.setdefault(last.id, {}).update(_of_endurance(endurance))
    except FileProblem as error:
        remarks.append(f"endurance tests: {error.problems[0]}")
    return values


def _exact(value: float) -> Measured:
    """A value whose uncertainty is not known."""
    return Measured(value, math.nan, math.nan)


def _of_response(test: ResponseTest) -> Values:
    """Measured times of one step; a time that the rig cannot resolve has no row."""
    times: dict[str, TimeResult] = {"dead_time": test.force.dead}
    times |= {name: test.best(place) for place, name in enumerate(LEVEL_NAMES)}
    if test.current is not None:
        times["coil_t63"] = test.current.best(0)
    return {
        response_time(name, switched="on" if test.rises else "off", direction=test.direction):
            Measured(time.value_s, time.std_s, math.nan)
        for name, time in times.items() if time.measured
    }  # fmt: skip


def _of_hybrid(test: HybridTest) -> Values:
    numbers = test.numbers
    known = {
        "hybrid_delay": test.reported.get("delay_s"), "hybrid_energy_error": test.reported.get("energy_share"),
        "hybrid_tracking_error": None if numbers is None else numbers.tracking_nrms,
        "hybrid_reference_error": None if numbers is None else numbers.reference_error,
        "hybrid_hop_error": None if numbers is None else numbers.hop_error,
    }
    return {name: _exact(value) for name, value in known.items() if value is not None}


def _last_block(run: Run, test: str) -> RecordedPoint | None:
    """The last block of an endurance test, preferably one that is not invalid."""
    blocks = [
        point for point in run.points
        if point.kind == ENDURANCE and point.endurance is not None and point.endurance.test == test
    ]
    usable = [point for point in blocks if point.verdict != "invalid"]
    return next(reversed(usable or blocks), None)


def _of_endurance(test: EnduranceTest) -> Values:
    """Cycles, the rule that ended the test, and the change of every statistic in the last section."""
    ledger = test.ledger
    cycles = float(ledger.cycles_run)
    values = {ENDURANCE_CYCLES: _exact(cycles), ENDURANCE_PROGRESS: _exact(cycles / test.planned)}
    if ledger.reached:
        values[cycles_to(ledger.reached)] = _exact(cycles)
    for name in RULES if len(ledger.sections) else ():
        change = ledger.followed(StopRule(name, 1.0)).change  # the limit does not affect the change
        values[wear(name)] = _exact(float(change[-1]))
    return values
