"""A rig whose controller appears as a user's register map: a matrix completes, and the rows that apply end as they say.

The maps in `tests/simulators/maps`: `scaled` (integers, input registers, a coil; no watchdog), `handshake`
(little-endian words, a status word, discrete inputs, a keep-alive), `streamed` (no generator, a counter beside the
set-point), `pulses` (function 6, pulsed coils, a state of inputs alone).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from matrices import matrix_text
from row_scenarios import ONCE, RowScenario, scenario_of
from test_every_row import check_row

if TYPE_CHECKING:
    from conftest import Start

SLOW = matrix_text("0.5 A", "1.0 A", amplitude="10 mm", frequency="1 Hz", cycles=5)
MAPS = Path(__file__).parents[1] / "simulators" / "maps"


def wearing(here: RowScenario, name: str, *more: str) -> RowScenario:
    simulator = (*here.setting.simulator, "--register-map", str(MAPS / f"{name}.toml"), *more)
    return replace(here, setting=replace(here.setting, simulator=simulator))


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "link"),
    [
        ("scaled", "tcp"), ("scaled", "rtu"), ("handshake", "tcp"), ("handshake", "rtu"),
    ],
)  # fmt: skip
def test_a_matrix_completes_on_a_controller_of_a_users_map(name: str, link: str, begin_scenario: Start) -> None:
    here = wearing(RowScenario(ONCE), name, "--actuator", link)
    ending = begin_scenario(here.setting).finish(None)
    assert ending.exit_code == 0, ending.answer["points"]
    assert ending.verdicts() == {"p001": "valid"}
    assert "actuator-without-limits" in {line.get("slug") for line in ending.log}


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["pulses", "streamed"])
def test_slow_points_are_valid_without_a_force_input_or_a_generator_too(name: str, begin_scenario: Start) -> None:
    setting = wearing(RowScenario(ONCE), name, *(("--actuator", "tcp") if name == "streamed" else ())).setting
    ending = begin_scenario(replace(setting, matrix=SLOW)).finish(None)
    assert ending.exit_code == 0, ending.answer["points"]
    assert ending.verdicts() == {"p001": "valid", "p002": "valid"}


ROWS = {
    "handshake": (
        "modbus-reset", "modbus-halfopen", "modbus-busy", "stop-ignored", "host-silent", "watchdog-absent", "estop",
        "register-layout", "coil-open-short", "loadcell-pulled", "sigint", "sigkill", "host-late",
    ),
    "scaled": ("modbus-reset", "stop-ignored", "lvdt-pulled", "coil-open-short", "sigint", "sigkill"),
}  # fmt: skip


@pytest.mark.few(1)
@pytest.mark.apart
@pytest.mark.parametrize(("name", "slug"), [(name, slug) for name, slugs in ROWS.items() for slug in slugs])
def test_rows_end_as_the_matrix_says_on_a_users_map(name: str, slug: str, begin_scenario: Start) -> None:
    here = wearing(scenario_of(slug), name)
    check_row(slug, begin_scenario(here.setting), here)
