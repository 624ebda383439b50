"""The CAN bus, the current ECU and the coil: what their rows have beside what `test_every_row.py` asks of all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_stopped

if TYPE_CHECKING:
    from conftest import Run


@pytest.mark.nightly
def test_an_adapter_that_is_gone_is_named_and_the_ecu_goes_to_zero_by_itself(
    run: Run
) -> None:
    ending = run("can-busoff:lost@6.3")
    assert_stopped(ending, "can-busoff", slug_of_station="can-lost")
    assert ending.truth.first("ECU_FAULT", text="COMMAND_TIMEOUT")


@pytest.mark.nightly
def test_status_frames_that_come_twice_warn_and_stop_when_they_keep_coming(run: Run) -> None:
    ending = run("ecu-late@6.3")
    assert_stopped(ending, "ecu-late")
    assert "ecu-late" in ending.warned()


@pytest.mark.nightly
def test_an_ecu_without_supply_stops_the_rig(run: Run) -> None:
    assert_stopped(run("ecu-overtemp:undervoltage@6.3"), "ecu-overtemp")


@pytest.mark.nightly
@pytest.mark.parametrize(("fault", "bit"), [("coil-open-short", "OPEN"), ("coil-open-short:short", "SHORT")])
def test_a_broken_coil_stops_the_rig(run: Run, fault: str, bit: str) -> None:
    ending = run(f"{fault}@6.3")
    assert_stopped(ending, "coil-open-short")
    (trip,) = [line for line in ending.log if line.get("what") == "trip"]
    assert bit in trip["detail"]


@pytest.mark.nightly
def test_a_current_off_its_setpoint_is_flagged_at_once_and_spoils_the_point(run: Run) -> None:
    ending = run("current-tracking@6.3")
    assert ending.exit_code == 5, ending.output
    assert "current-tracking" in ending.warned()
    assert ending.trips() == []
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}
    assert any(reason.startswith("current-tracking") for reason in ending.point("p002").reasons)


@pytest.mark.nightly
def test_more_current_than_the_bench_allows_stops_the_rig(run: Run) -> None:
    ending = run("current-tracking:over@6.3")
    assert_stopped(ending, "current-tracking", stop="S2", slug_of_station="overcurrent")
    assert np.max(ending.truth.current_A) > 3.0, "the fault: it really flowed"
