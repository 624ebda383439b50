"""The actuator's default map: golden words, the documented addresses, limits there and back."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.register_maps.map_file import controller
from drivers.roles import ActuatorLimits, ActuatorStatus, Pressure
from protocols.errors import LocalProtocolError, RemoteProtocolError
from simulators import controller_firmware as actuator
from simulators.controller_firmware import decode_identity, decode_limits, encode_limits

ROOT = Path(__file__).parents[2]
GOLDEN = tomllib.loads((ROOT / "tests" / "golden" / "actuator.toml").read_text())
LIMITS = ActuatorLimits(-0.085, 0.085, 0.75, 60.0, 5000.0, 1.5, 20.0, 500)


def words(text: str) -> list[int]:
    return [int(word, 16) for word in text.split()]


def decode_status(registers: list[int], received_ns: int) -> ActuatorStatus:
    """What the driver makes of the words of one poll."""
    described = controller("demo")
    (read,) = described.status_reads
    return described.status(read.decode(registers), received_ns, {})


def test_golden_status_words_decode() -> None:
    assert GOLDEN["status_address"] == actuator.STATUS.address
    status = decode_status(words(GOLDEN["status_words"]), received_ns=5_000_000)
    expected = {"received_ns": 5_000_000, **GOLDEN["status"], "stated_pressure": Pressure.ON}
    assert status._asdict() == pytest.approx(expected, rel=1e-7)


def test_a_status_acknowledges_a_command_by_its_number_and_its_kind() -> None:
    status = decode_status(words(GOLDEN["status_words"]), received_ns=0)
    command, sequence = status.acked_command, status.acked_sequence
    assert status.acknowledges(command, sequence)
    assert not status.acknowledges(command + 1, sequence), "another master's command under the same number"
    assert not status.acknowledges(command, sequence + 1)


def test_identity_words_decode() -> None:
    text = "0102 0304 449A 5000 0001 0000 0000 0003 CAFE F00D"
    text += " 4D52 2D52 4947 0000 0000 0000 0000 0000" + " 0000" * 8  # "MR-RIG", no model
    text += " 5349 4D2D 3100" + " 0000" * 5 + " 312E 3200 0000 0000"  # "SIM-1", "1.2"
    identity = decode_identity(words(text))
    assert identity.signature_u32 == actuator.SIGNATURE_U32
    assert identity.signature_f32 == actuator.SIGNATURE_F32
    assert (identity.layout_version, identity.boot_count, identity.config_hash) == (1, 3, 0xCAFEF00D)
    assert (identity.vendor, identity.model) == ("MR-RIG", "")
    assert (identity.serial_number, identity.firmware) == ("SIM-1", "1.2")


def test_config_words_are_those_of_the_documented_addresses() -> None:
    got = encode_limits(LIMITS)
    # 0.75 = 0x3F400000, 60 = 0x42700000, 5000 = 0x459C4000, 1.5 = 0x3FC00000, 20 = 0x41A00000
    assert got[4:] == words("3F40 0000 4270 0000 459C 4000 3FC0 0000 41A0 0000 01F4 0001")
    back = decode_limits(got)
    assert back.position_min_m == pytest.approx(-0.085, rel=1e-7)
    assert back.watchdog_ms == 500
    assert back.watchdog_action == actuator.WatchdogAction.FADE_AND_HOLD


def test_every_documented_address_is_in_the_map() -> None:
    documented = {}
    for line in (ROOT / "docs" / "wires.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) == 7 and re.fullmatch(r"\d+( / \d+)*", cells[2]):
            names = cells[3].split(" / ")
            documented |= dict(zip(names, map(int, cells[2].split(" / ")), strict=True))
    documented = {name: at for name, at in documented.items() if not name.startswith("reserved")}
    assert (documented.pop("setpoint_position"), documented.pop("setpoint_velocity")) == (360, 362)
    held = {register.name: register.address for block in actuator.MAP.blocks.values() for register in block.registers}
    assert len(documented) > 50
    assert documented == {name: at for name, at in held.items() if not name.startswith("table_value")}


def test_every_block_fits_one_request() -> None:
    assert {name: (block.address, block.count) for name, block in actuator.MAP.blocks.items()} == {
        "identity": (0, 38), "status": (100, 34), "config": (200, 16), "command": (300, 24), "watchdog": (350, 1),
        "table": (400, 122),
    }


def test_a_limit_that_is_not_finite_is_our_own_error() -> None:
    with pytest.raises(LocalProtocolError, match=r"'force_max'.*not a finite number"):
        encode_limits(ActuatorLimits(-0.1, 0.1, 1.0, 1.0, float("inf"), 1.0, 1.0, 500))


@pytest.mark.parametrize("decode", [lambda w: decode_status(w, 0), decode_identity, decode_limits])
def test_a_short_answer_is_the_peers_error(decode: Callable[..., object]) -> None:
    with pytest.raises(RemoteProtocolError, match=r"expected .* registers, got 3"):
        decode([0, 0, 0])
