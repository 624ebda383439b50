"""The serial sensors: the LVDT's faults, and what rows have beside what `test_every_row.py` asks of all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_refused, assert_spoiled, assert_stopped
from matrices import ONE_POINT
from row_scenarios import FAULT_S, PERIOD_S, spikes_are_flagged

if TYPE_CHECKING:
    from conftest import Run

SENSORS = (":lvdt",)
"""Whose fault it is; the load cell's are in `test_every_row.py`."""


def test_a_pulled_auxiliary_sensor_stops_the_rig_in_its_own_name(run: Run) -> None:
    ending = run(f"loadcell-pulled:auxiliary@{FAULT_S}", simulator=("--auxiliary", "1"), matrix=ONE_POINT, speed=1.0)
    assert_stopped(
        ending, "loadcell-pulled", slug_of_station="auxiliary-pulled", finished=(), broken="p001", speed=1.0,
        period_s=PERIOD_S,
    )  # fmt: skip


@pytest.mark.nightly
@pytest.mark.wire
@pytest.mark.parametrize("fault", ["usb-renumber:lvdt"])
def test_an_adapter_that_comes_up_elsewhere_stops_the_rig_and_is_not_reopened(
    run_wired: Run, fault: str
) -> None:
    """Its port was found by the serial number of the adapter (`--ports by-id`)."""
    ending = run_wired(f"{fault}@6.3", simulator=("--ports", "by-id"))
    assert_stopped(ending, "usb-renumber")
    point = ending.point("p002")
    happened = ending.truth.first("FAULT", text=fault)
    assert point.time_s[-1] - point.time_s[0] < 8.0
    assert ending.truth.time_s[-1] > happened.time_s + 0.5, "the rig went on, the host did not take the port again"


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_damaged_frames_warn_and_stop_when_there_are_many(run: Run, sensor: str) -> None:
    ending = run(f"serial-garbage{sensor}@6.3")
    assert_stopped(ending, "serial-garbage")
    assert "serial-garbage" in ending.warned()


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_bytes_without_one_valid_frame_stop_the_rig(run: Run, sensor: str) -> None:
    assert_stopped(run(f"serial-baud{sensor}@5.5", speed=2.0), "serial-baud", speed=2.0)


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", ["", *SENSORS])
def test_a_wrong_baud_rate_from_the_start_is_refused(run: Run, sensor: str) -> None:
    assert_refused(run(f"serial-baud{sensor}", speed=20.0), "serial-baud")


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_value_that_repeats_in_motion_stops_the_rig(run: Run, sensor: str) -> None:
    assert_stopped(run(f"sensor-stuck{sensor}@6.3"), "sensor-stuck")


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_three_saturated_samples_stop_the_rig_and_prove_nothing_of_its_standstill(
    run: Run, sensor: str
) -> None:
    assert_stopped(run(f"sensor-saturated{sensor}@6.3"), "sensor-saturated")


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_single_spikes_are_flagged_and_three_in_a_row_stop_the_rig(run: Run, sensor: str) -> None:
    ending = run(f"sensor-spike{sensor}@6.3")
    assert_stopped(ending, "sensor-spike")
    spikes_are_flagged(ending, "p002", "displacement")


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_samples_that_are_no_numbers_spoil_the_point(run: Run, sensor: str) -> None:
    assert_spoiled(run(f"sensor-nan{sensor}@6.3", speed=10.0), "sensor-nan")


@pytest.mark.nightly
def test_comma_and_nan_text_are_lost_samples_of_a_line_format(run: Run) -> None:
    ending = run("sensor-nan@6.3", simulator=("--force-format", "ascii"), speed=10.0)
    assert ending.exit_code in {4, 5}, ending.output
    assert ending.verdicts()["p002"] == "invalid"


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", SENSORS)
def test_gaps_are_stored_never_filled_and_spoil_the_point(run: Run, sensor: str) -> None:
    ending = run(f"sample-gap{sensor}@6.3", speed=10.0)
    assert_spoiled(ending, "sample-gap")
    assert ending.point("p002").lost_samples > 0


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("fault", "channel"), [("sample-gap:backwards", "force"), ("sample-gap:lvdt-backwards", "displacement")]
)
def test_samples_whose_device_clock_went_back_stay_in_raw_and_spoil_the_point(
    run: Run, fault: str, channel: str
) -> None:
    ending = run(f"{fault}@{FAULT_S}", matrix=ONE_POINT, speed=1.0)
    assert_spoiled(ending, "sample-gap", "device-time", points=("p001",))
    raw = ending.point("p001").raw(channel)
    assert raw is not None
    back = np.flatnonzero(np.diff(raw["device_us"]) < 0)
    assert back.size > 5, "they are in the file as they came"
    assert np.all(np.diff(raw["sequence"]) == 1), "and none is missing"


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_sensor_that_was_not_tared_is_refused_before_arming(run: Run, sensor: str) -> None:
    ending = run(f"not-tared{sensor}", speed=20.0)
    assert_refused(ending, "not-tared")
    assert not ending.truth.all("ACQUIRE"), "refused before the controller was even taken"


@pytest.mark.few(1)
@pytest.mark.parametrize("wrong", ["lvdt.gain=-1", "lvdt.gain=0.8", "load_cell.gain=-1"])
def test_wrong_sign_and_scale_are_refused_by_the_slow_proof_move(run: Run, wrong: str) -> None:
    ending = run(simulator=("--option", wrong))
    assert_refused(ending, "sensors-swapped", still_m=5e-3)  # 4 mm of the move, then what drifts without pressure
    assert ending.truth.state[-1] == 0, "hydraulics are off again"
