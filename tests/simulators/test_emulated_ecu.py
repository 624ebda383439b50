"""The simulated ECU as users' files say: packed by cantools and sealed by other code than the driver's, they agree."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.current_source import SourceCounters
from drivers.devices.source import FOLDER, current_source
from drivers.frame_checks import FrameChecks
from protocols.errors import RemoteProtocolError
from simulators.ecu_wire import Command, Shown
from simulators.emulated_ecu import EmulatedEcu

ROOT = Path(__file__).parents[2]
GOLDEN = tomllib.loads((ROOT / "tests" / "golden" / "ecu.toml").read_text())
DBC, ROLES = ROOT / "examples" / "coil-driver.dbc", ROOT / "examples" / "coil-driver-roles.toml"
PROFILES: dict[str, dict[str, Any]] = {
    "none": {}, "counter": {"counter": "Alive", "counter_max": 14},
    "counter+crc": {
        "counter": "Alive", "crc": "Checksum", "polynomial": 0x2F, "initial": 0x5A, "final_xor": 0xA5,
        "data_id": 0x1234, "last_byte": 5,
    },
    "e2e-1": {"data_id": 0x5A1, "data_id_mode": "alt", "counter": "Alive", "crc": "Checksum"},
    "e2e-2": {"data_ids": list(range(100, 116)), "counter": "Alive", "crc": "Checksum"},
    "e2e-11": {"data_id": 0xBEEF, "counter": "Alive", "crc": "Checksum"},
}  # fmt: skip
SHOWN = Shown(2, 1.25, 0, 20.0, 123_456, 41.3, 25.0, 13.5, 4, 77)


@pytest.mark.parametrize("case", GOLDEN["status"], ids=lambda case: case["name"])
def test_the_demos_status_by_hand_is_what_the_worn_demo_sends_and_the_driver_reads(case: dict[str, Any]) -> None:
    worn = EmulatedEcu(FOLDER / "demo_ecu.dbc", FOLDER / "demo_ecu.toml")
    shown = Shown(case["state"], case["current_A"], case["faults"], device_us=100 * case["device_time_ticks"])
    for _ in range(case["counter"]):
        worn.frame("CoilStatus", shown)
    sent = worn.frame("CoilStatus", shown)[1]
    golden = bytes.fromhex(case["bytes"])
    # The duty cycle has no role: it stays 0, and the checksum with it.
    assert sent[1:5] + sent[6:] == golden[1:5] + golden[6:]
    described = current_source("demo")
    status = described.heard[described.status]
    assert status.protection.difference(golden) == 0
    assert status.protection.count(golden) == case["counter"]
    values = status.reader.read(golden)
    assert values == {
        "measured_current": case["current_A"], "state": case["state"], "faults": case["faults"],
        "clock": case["device_time_ticks"],
    }


def emulated_with(profile: str) -> EmulatedEcu:
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    table = {"profile": profile, **PROFILES[profile]}
    roles["protection"] = {"DriverCommand": table, "DriverStatus": table}
    return EmulatedEcu(DBC, roles)


@pytest.mark.parametrize("profile", PROFILES)
def test_driver_and_worn_ecu_understand_each_other_in_every_profile(profile: str) -> None:
    worn = emulated_with(profile)
    described = worn.described
    (frame,) = described.sent
    for count in range(20):
        on = count % 2
        data = frame.writer.write({"command": -1.5 + 0.25 * count, "enable": 2 * on, "clear_faults": on})
        frame.protection.seal(data, count)
        asked = worn.command(frame.identifier | 1 << 31, bytes(data))
        assert asked is not None
        assert asked[1:] == (bool(on), bool(on), -1.5 + 0.25 * count)
        assert worn.commands(asked) == [(frame.identifier | 1 << 31, bytes(data))]
    checks = FrameChecks(described, SourceCounters())
    status = described.heard[described.status]
    for count in range(20):
        identifier, told = worn.frame("DriverStatus", replace(SHOWN, device_us=5000 * count + 499))
        assert identifier == described.status
        assert checks.step(identifier, status, told) == 1, f"frame {count}"
        assert checks.step(identifier, status, told) is None, "the same again"
        assert status.reader.read(told) == {"measured_current": 1.25, "state": 4, "clock": 10 * count}
    if profile not in {"none", "counter"}:
        assert status.protection.difference(worn.damaged((identifier, told))[1]) != 0
        with pytest.raises(RemoteProtocolError):
            worn.command(frame.identifier | 1 << 31, worn.damaged((described.status, bytes(data)))[1])


def test_pages_come_in_turn_with_faults_and_temperatures_as_the_file_says() -> None:
    worn = EmulatedEcu(DBC, ROLES)
    health = worn.described.heard[worn.described.status + 0x100]
    told: dict[str, float] = {}
    pages = []
    for _ in range(3):
        shown = Shown(faults=1 << 2 | 1 << 6, coil_degC=60.0, supply_V=12.0, serial_number=9)
        data = worn.frame("DriverHealth", shown)[1]
        pages.append(data[0])
        told |= health.reader.read(data)
    assert pages == [0, 1, 2]
    assert told["faults"] == 1 << 0 | 1 << 15, "open is bit 0, restarted bit 15"
    assert told["coil_temperature"] == pytest.approx(60.0, abs=0.051)
    assert (told["supply_voltage"], told["serial_number"], told["layout"]) == (12.0, 9, 3)


def test_without_a_stated_timeout_it_keeps_its_current_for_ever_and_with_one_it_does_not() -> None:
    assert EmulatedEcu(DBC, ROLES).timeout_s(0.1) == 0.06
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    del roles["command_timeout"]
    assert EmulatedEcu(DBC, roles).timeout_s(0.1) == math.inf


def test_without_enable_and_reset_it_is_on_and_forgets_its_faults_at_0_A() -> None:
    worn = EmulatedEcu(DBC, {"command": "DriverCommand.Target", "measured_current": "DriverStatus.Actual"})
    asked = [worn.command(*worn.commands(Command(-1, True, False, current_A))[0]) for current_A in (1.0, 0.0)]
    assert asked == [Command(-1, True, False, 1.0), Command(-1, True, True, 0.0)]


def test_a_wrong_data_id_is_named_and_other_damage_is_not_taken_for_it() -> None:
    theirs, ours = emulated_with("e2e-11"), emulated_with("e2e-1")
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    roles["protection"]["DriverStatus"] |= {"profile": "e2e-11", "data_id": 0xBEEE}
    wrong = EmulatedEcu(DBC, roles).described
    for described, slug in ((wrong, "e2e-data-id"), (ours.described, "ecu-crc"), (theirs.described, "")):
        checks = FrameChecks(described, SourceCounters())
        for count in range(20):
            identifier, told = theirs.frame("DriverStatus", Shown(2, 0.1 * count))
            checks.step(identifier, described.heard[identifier], told)
        assert checks.refusal()[0] == slug
    checks = FrameChecks(wrong, SourceCounters())
    for _ in range(4):
        checks.step(wrong.status, wrong.heard[wrong.status], theirs.frame("DriverStatus", SHOWN)[1])
    assert "E2E data id" in checks.refusal()[1]
    assert "[protection.DriverStatus]" in checks.refusal()[1]
