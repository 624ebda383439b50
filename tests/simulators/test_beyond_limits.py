"""Faults that drive the rig beyond its limits really do, whatever the controller watches."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import numpy as np
import pytest

from simulators.injection import BEYOND_LIMITS, VARIANTS
from simulators.options import RigOptions
from simulators.plant.records import MODE_HALT, MODE_LOCKED, MODE_PROGRAM
from simulators.plant.step import COIL_TEMPERATURE, CURRENT, FORCE, PISTON, VELOCITY
from simulators.rig import RunOptions, SimulatedRig

Rows = np.ndarray[tuple[int, int], np.dtype[np.float64]]
SUPPLY_PA = 210e5


def lived(story: Callable[[SimulatedRig], None]) -> None:
    async def run() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket"))
        rig.warm_up()
        await rig.open()
        rig.plant.state["accumulator_Pa"] = SUPPLY_PA
        begin(rig)
        try:
            story(rig)
        finally:
            await rig.close()

    asyncio.run(run())


def begin(rig: SimulatedRig) -> None:
    """A program of 6 mm at 4 Hz."""
    for name in ("program_step", "phase_cycles", "cycles_done", "tripped", "setpoint_m", "position_m", "velocity_m_s"):
        rig.plant.state[name] = 0
    rig.plant.order(
        mode=MODE_PROGRAM, pressure=2, amplitude_m=6e-3, centre_m=0.0, frequency_Hz=4.0, full_cycles=50,
        ramp_in_cycles=1,
    )  # fmt: skip


def passed(rig: SimulatedRig, seconds: float) -> Rows:
    """What the plant does in so much time, with the ticks of the rig."""
    rows = []
    for _ in range(round(200 * seconds)):
        for action in rig.every_tick:
            action()
        rig.ecu.tick(0.0)
        rig.advance(40)
        rows.append(rig.plant.out.copy())
    return np.concatenate(rows)


def share(rows: Rows, column: int, limit: float) -> float:
    """The largest of a column in all, as a share of a limit."""
    return float(np.abs(rows[:, column]).max()) / limit


REACHES = {
    "second-master:span": (VELOCITY, 1.0), "second-master:offset": (PISTON, 0.095),
    "load-train:jammed": (FORCE, 10e3), "current-stuck:full": (CURRENT, 3.0),
    "ecu-overtemp:coil": (COIL_TEMPERATURE, 120.0),
}  # fmt: skip
"""Column of the plant's output and limit: the controller's own, or the bench's."""


@pytest.mark.parametrize("variant", REACHES)
def test_the_rig_is_driven_beyond_a_limit_and_within_it_before(variant: str) -> None:
    column, limit = REACHES[variant]

    def story(rig: SimulatedRig) -> None:
        assert share(passed(rig, 0.5), column, limit) < 0.5
        VARIANTS[variant](rig)
        assert share(passed(rig, 1.5), column, limit) > 1.05

    lived(story)


@pytest.mark.parametrize("variant", ["second-master:span", "second-master:offset"])
def test_a_panel_whose_limit_detectors_are_on_again_stops_the_rod(variant: str) -> None:
    def story(rig: SimulatedRig) -> None:
        undo = VARIANTS[variant](rig)
        passed(rig, 2.0)
        assert int(rig.plant.command["mode"][0]) == MODE_PROGRAM
        assert undo is not None
        undo()
        rig.plant.order(centre_m=0.2)
        passed(rig, 0.5)
        assert int(rig.plant.command["mode"][0]) in {MODE_HALT, MODE_LOCKED}

    lived(story)


def test_a_jumping_set_point_asks_for_all_the_acceleration_there_is() -> None:
    def story(rig: SimulatedRig) -> None:
        before = np.diff(passed(rig, 0.5)[:, VELOCITY]).max() / rig.plant.dt_s
        VARIANTS["second-master:jumps"](rig)
        rig.plant.order(acceleration_max_m_s2=60.0)
        harder = np.diff(passed(rig, 1.0)[:, VELOCITY]).max() / rig.plant.dt_s
        assert before < 10.0
        assert harder == pytest.approx(60.0)
        assert abs(float(rig.plant.command["centre_m"][0])) <= 6.001e-3, "back and forth"

    lived(story)


def test_a_slipping_transducer_shows_the_program_while_the_rod_is_elsewhere() -> None:
    def story(rig: SimulatedRig) -> None:
        VARIANTS["actuator-frozen:slips"](rig)
        rows = passed(rig, 1.5)
        random = np.random.default_rng(0)
        shown_m = [rig.plant.position_input.read(random) for _ in range(50) if len(passed(rig, 0.01))]
        assert max(map(abs, shown_m)) < 7e-3
        assert np.mean(rows[-2000:, PISTON]) == pytest.approx(-0.02, abs=1e-3)

    lived(story)


def test_every_one_of_them_has_its_test() -> None:
    assert set(BEYOND_LIMITS) == {*REACHES, "second-master:jumps", "actuator-frozen:slips"}
