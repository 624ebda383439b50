"""The simulated ECU as users' files say: packed by cantools and sealed by other code than the driver's, they agree."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import demo_ecu
import pytest
from e2e import p01, p02, p05, p11
from hypothesis import given
from hypothesis import strategies as st

from drivers.current_source import SourceCounters
from drivers.devices.dbc_file import can_database
from drivers.frame_checks import FrameChecks
from protocols.errors import LocalProtocolError, RemoteProtocolError
from simulators.bit_sums import remainder
from simulators.ecu_protection import seal_of
from simulators.ecu_wire import Command, Shown
from simulators.emulated_ecu import EmulatedEcu, EmulatedEcuFiles

ROOT = Path(__file__).parents[2]
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
SHOWN = Shown(2, 1.25, 0, 123_456, 41.3, 25.0, 13.5, 4, 77)


def emulated_with(profile: str) -> EmulatedEcu:
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    table = {"profile": profile, **PROFILES[profile]}
    roles["protection"] = {"DriverCommand": table, "DriverStatus": table}
    return EmulatedEcuFiles(DBC, roles).load()


@pytest.mark.parametrize("profile", PROFILES)
def test_driver_and_emulated_ecu_understand_each_other_in_every_profile(profile: str) -> None:
    emulated = emulated_with(profile)
    described = emulated.described
    (frame,) = described.sent
    for count in range(20):
        on = count % 2
        data = frame.writer.write({"command": -1.5 + 0.25 * count, "enable": 2 * on, "clear_faults": on})
        frame.protection.seal(data, count)
        requested = emulated.command(frame.identifier | 1 << 31, bytes(data))
        assert requested is not None
        assert requested[1:] == (bool(on), bool(on), -1.5 + 0.25 * count)
        assert emulated.commands(requested) == [(frame.identifier | 1 << 31, bytes(data))]
    checks = FrameChecks(described, SourceCounters())
    status = described.heard[described.status]
    for count in range(20):
        identifier, frame_data = emulated.frame("DriverStatus", replace(SHOWN, device_us=5000 * count + 499))
        assert identifier == described.status
        assert checks.step(identifier, status, frame_data) == 1, f"frame {count}"
        assert checks.step(identifier, status, frame_data) is None, "the same again"
        assert status.reader.read(frame_data) == {"measured_current": 1.25, "state": 4, "clock": 10 * count}
    if profile not in {"none", "counter"}:
        assert status.protection.difference(emulated.damaged((identifier, frame_data))[1]) != 0
        with pytest.raises(RemoteProtocolError):
            emulated.command(frame.identifier | 1 << 31, emulated.damaged((described.status, bytes(data)))[1])


@given(
    st.binary(min_size=8, max_size=8), st.integers(0, 0xFFF), st.integers(0, 14), st.binary(min_size=16, max_size=16)
)
def test_the_package_autosar_e2e_accepts_what_the_simulated_ecu_seals(
    payload: bytes, data_id: int, counter: int, ids: bytes
) -> None:
    message = demo_ecu.DBC.get_message_by_name("CoilTemperature")

    def sealed(profile: str, **given: Any) -> bytearray:  # noqa: ANN401 - entries of a roles file
        data = bytearray(payload)
        seal_of(message, {"profile": profile, **given}).put(data, counter)
        return data

    for mode in ("both", "alt", "low", "nibble"):
        peer = getattr(p01, f"E2E_P01_DATAID_{mode.upper()}")
        assert p01.e2e_p01_check(sealed("e2e-1", data_id=data_id, data_id_mode=mode), data_id, data_id_mode=peer)
    for mode in ("both", "nibble"):
        peer = getattr(p11, f"E2E_P11_DATAID_{mode.upper()}")
        assert p11.e2e_p11_check(sealed("e2e-11", data_id=data_id, data_id_mode=mode), data_id, data_id_mode=peer)
    assert p02.e2e_p02_check(bytes(sealed("e2e-2", data_ids=list(ids))), ids, length=8)
    assert p05.e2e_p05_check(bytes(sealed("e2e-5", data_id=data_id)), data_id)


# Check values over the text 123456789, from the catalogue of parametrised CRC algorithms.
@pytest.mark.parametrize(
    ("width", "polynomial", "start", "reflected", "last", "check"),
    [
        (8, 0x1D, 0xFF, False, 0xFF, 0x4B), (8, 0x31, 0, True, 0, 0xA1), (16, 0x1021, 0xFFFF, False, 0, 0x29B1),
        (16, 0x8005, 0xFFFF, True, 0, 0x4B37), (32, 0x04C11DB7, 0xFFFFFFFF, True, 0xFFFFFFFF, 0xCBF43926),
        (24, 0x864CFB, 0xB704CE, False, 0, 0x21CF02),
    ],
)
def test_a_division_gives_the_catalogues_check_value(
    width: int, polynomial: int, start: int, reflected: bool, last: int, check: int
) -> None:
    assert remainder(b"123456789", width, polynomial, start, reflected=reflected) ^ last == check


def test_pages_come_in_turn_with_faults_and_temperatures_as_the_file_says() -> None:
    emulated = EmulatedEcuFiles(DBC, ROLES).load()
    health = emulated.described.heard[emulated.described.status + 0x100]
    frame_data: dict[str, float] = {}
    pages = []
    for _ in range(3):
        shown = Shown(faults=1 << 2 | 1 << 6, coil_degC=60.0, supply_V=12.0, serial_number=9)
        data = emulated.frame("DriverHealth", shown)[1]
        pages.append(data[0])
        frame_data |= health.reader.read(data)
    assert pages == [0, 1, 2]
    assert frame_data["faults"] == 1 << 0 | 1 << 15, "open is bit 0, restarted bit 15"
    assert frame_data["coil_temperature"] == pytest.approx(60.0, abs=0.051)
    assert (frame_data["supply_voltage"], frame_data["serial_number"], frame_data["layout"]) == (12.0, 9, 3)


def test_without_a_stated_timeout_it_keeps_its_current_for_ever_and_with_one_it_does_not() -> None:
    assert EmulatedEcuFiles(DBC, ROLES).load().command_timeout_s == 0.06
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    del roles["command_timeout"]
    assert EmulatedEcuFiles(DBC, roles).load().command_timeout_s == math.inf


def test_without_enable_and_reset_it_is_on_and_forgets_its_faults_at_0_A() -> None:
    roles = {"command": "DriverCommand.Target", "measured_current": "DriverStatus.Actual"}
    emulated = EmulatedEcuFiles(DBC, roles).load()
    requested = [
        emulated.command(*emulated.commands(Command(-1, True, False, current_A))[0]) for current_A in (1.0, 0.0)
    ]
    assert requested == [Command(-1, True, False, 1.0), Command(-1, True, True, 0.0)]


def test_a_wrong_data_id_is_named_and_other_damage_is_not_taken_for_it() -> None:
    theirs, ours = emulated_with("e2e-11"), emulated_with("e2e-1")
    roles = tomllib.loads(ROLES.read_text(encoding="utf-8"))
    roles["protection"]["DriverStatus"] |= {"profile": "e2e-11", "data_id": 0xBEEE}
    wrong = EmulatedEcuFiles(DBC, roles).load().described
    for described, slug in ((wrong, "e2e-data-id"), (ours.described, "ecu-crc"), (theirs.described, "")):
        checks = FrameChecks(described, SourceCounters())
        for count in range(20):
            identifier, frame_data = theirs.frame("DriverStatus", Shown(2, 0.1 * count))
            checks.step(identifier, described.heard[identifier], frame_data)
        assert checks.refusal()[0] == slug
    checks = FrameChecks(wrong, SourceCounters())
    for _ in range(4):
        checks.step(wrong.status, wrong.heard[wrong.status], theirs.frame("DriverStatus", SHOWN)[1])
    assert "0xBEEF" in checks.refusal()[1], "what would fit"
    assert "[protection.DriverStatus]" in checks.refusal()[1]


@pytest.mark.parametrize("kind", ["kcd", "sym"])
def test_an_ecu_of_another_network_description_is_the_same(kind: str, tmp_path: Path) -> None:
    database = can_database(DBC.read_text(encoding="utf-8"))
    path = tmp_path / f"driver.{kind}"
    path.write_text(getattr(database, f"as_{kind}_string")(), encoding="utf-8")
    ecu, theirs = EmulatedEcuFiles(path, ROLES).load(), EmulatedEcuFiles(DBC, ROLES).load()
    assert ecu.described.signals == theirs.described.signals
    for name in theirs.periods_us:
        assert ecu.frame(name, SHOWN) == theirs.frame(name, SHOWN)
    assert ecu.commands(Command(3, True, False, 1.5)) == theirs.commands(Command(3, True, False, 1.5))


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ("hello", "kcd", "not a readable KCD file: syntax error: line 1"), ("", "arxml", "no element found"),
        ("hello", "sym", "Only SYM version 6.0"), ('<!DOCTYPE x [<!ENTITY a "b">]><x/>', "kcd", "document type"),
        ('<a>\n<Signal length="99999999"/>', "kcd", "line 2: 'length=\"99999999': a signal must lie"),
    ],
)  # fmt: skip
def test_a_network_description_that_cannot_be_read_is_refused_with_the_reason(
    text: str, kind: str, expected: str
) -> None:
    with pytest.raises(LocalProtocolError, match=expected):
        can_database(text, kind)
