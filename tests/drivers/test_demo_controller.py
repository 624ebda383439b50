"""The actuator's default map: golden words, the documented addresses, limits there and back."""

import re
import tomllib
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.register_maps.controller_map import STATUS
from drivers.register_maps.map_file import controller
from drivers.register_maps.recipe import Write
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Pressure, WatchdogAction
from protocols.errors import LocalProtocolError, RemoteProtocolError
from simulators.emulated_codec import raw_of, words_of

ROOT = Path(__file__).parents[2]
GOLDEN = tomllib.loads((ROOT / "tests" / "golden" / "actuator.toml").read_text())
DEMO = controller("demo")
LIMITS = ActuatorLimits(-0.085, 0.085, 0.75, 60.0, 5000.0, 1.5, 20.0, 500)


def words(text: str) -> list[int]:
    return [int(word, 16) for word in text.split()]


def decode_status(registers: list[int], received_ns: int) -> ActuatorStatus:
    """What the driver makes of the words of one poll."""
    (read,) = DEMO.status_reads
    return DEMO.status(read.decode(registers), received_ns, {})


def decode_identity(registers: list[int]) -> ActuatorIdentity:
    (read,) = DEMO.identity_reads
    return DEMO.identity(read.decode(registers))


def decode_limits(registers: list[int]) -> ActuatorLimits:
    (read,) = DEMO.limit_reads
    return DEMO.held_limits(read.decode(registers), None)


def encode_limits(limits: ActuatorLimits) -> list[int]:
    (request,) = Write(DEMO.limit_values(limits)).requests({})
    assert (request.function, request.address) == (16, 200)
    return list(request.words)


def test_golden_status_words_decode() -> None:
    assert GOLDEN["status_address"] == DEMO.status_reads[0].address
    status = decode_status(words(GOLDEN["status_words"]), received_ns=5_000_000)
    expected = {"received_ns": 5_000_000, **GOLDEN["status"], "stated_pressure": Pressure.ON}
    assert status._asdict() == pytest.approx(expected, rel=1e-7)


def test_golden_status_words_are_those_that_the_simulated_controller_lays_down() -> None:
    shown = dict(zip(STATUS, (GOLDEN["status"].get(name, 0) for name in ActuatorStatus._fields[1:]), strict=True))
    shown |= {"clock": 1e-6 * shown["clock_us"], "pulse_clock": 1e-6 * shown["pulse_clock_us"]}
    laid = [0] * 34
    for quantity in DEMO.status_reads[0].quantities:
        at = quantity.address - GOLDEN["status_address"]
        laid[at : at + quantity.length] = words_of(quantity, raw_of(quantity, float(shown[quantity.name])))
    assert laid == words(GOLDEN["status_words"])


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
    assert identity.signature_u32 == 0x01020304
    assert identity.signature_f32 == 1234.5
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
    assert back.watchdog_action == WatchdogAction.FADE_AND_HOLD


def test_every_documented_address_is_in_the_map() -> None:
    documented = {}
    for line in (ROOT / "docs" / "wires.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) == 7 and re.fullmatch(r"\d+( / \d+)*", cells[2]):
            names = cells[3].split(" / ")
            documented |= dict(zip(names, map(int, cells[2].split(" / ")), strict=True))
    documented = {name: at for name, at in documented.items() if not name.startswith("reserved")}
    assert (documented.pop("setpoint_position"), documented.pop("setpoint_velocity")) == (360, 362)
    assert len(documented) > 50
    held = {quantity.name: quantity.address for quantity in DEMO.quantities.values()}
    assert documented == {name: at for name, at in held.items() if name != "table_values"}


def test_every_block_fits_one_request() -> None:
    every = (DEMO.identity_reads, DEMO.status_reads, DEMO.limit_reads)
    assert [[(read.address, read.count) for read in of] for of in every] == [[(0, 38)], [(100, 34)], [(200, 16)]]
    for command, recipe in DEMO.recipes.commands.items():
        assert [(one.address, len(one.words)) for step in recipe for one in step.requests({})] == [(300, 24)], command
    table = [(one.address, len(one.words)) for step in DEMO.recipes.table for one in step.requests({}, [0.0] * 60)]
    assert table == [(400, 122)]


def test_a_limit_that_is_not_finite_is_our_own_error() -> None:
    with pytest.raises(LocalProtocolError, match=r"'force_max'.*not a finite number"):
        encode_limits(ActuatorLimits(-0.1, 0.1, 1.0, 1.0, float("inf"), 1.0, 1.0, 500))


@pytest.mark.parametrize("decode", [lambda w: decode_status(w, 0), decode_identity, decode_limits])
def test_a_short_answer_is_the_peers_error(decode: Callable[..., object]) -> None:
    with pytest.raises(RemoteProtocolError, match=r"expected .* registers, got 3"):
        decode([0, 0, 0])
