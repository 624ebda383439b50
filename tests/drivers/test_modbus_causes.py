"""What is wrong behind a Modbus link is named by its cause: a hole in the map, an echo, a value that was not taken.

The peers are raw sockets written here: TCP with a hole in its registers, RTU whose line returns what is sent.
"""

from __future__ import annotations

import socket
import struct
import threading
import tomllib
from collections.abc import Callable, Iterator

import pytest

from drivers.connection import ActuatorConnection, LinkKind
from drivers.errors import DriverError, LocalEcho, NoAnswer, OtherAnswer, RequestRefused, WrongLayout
from drivers.modbus_actuator import ModbusActuator
from drivers.modbus_link import ModbusLink
from drivers.port_causes import with_fix
from drivers.register_maps.map_file import controller
from protocols.modbus import encode_rtu
from rig.station.interlocks.link_faults import link_slug
from rig.station.threads.devices import slug_of

TEXT = """
[modbus]
first_address = 40001
[quantities]
state = {address = 40101}
position = {address = 40102, type = "i16", unit = "um"}
force = {address = 40108, type = "i16", unit = "N"}
force_2 = {address = 40109}
target = {address = 40201, type = "i16", unit = "um"}
power = {address = 40202}
[state]
off = {quantity = "state", equals = 0}
hold = true
[commands]
hydraulics-on = {write = {power = 1}}
hydraulics-off = {write = {power = 0}}
[setpoint]
write = {target = "$position"}
"""
Answer = Callable[[bytes], bytes | None]


class Peer:
    """Answers each request by a function of its PDU; None: not at all."""

    def __init__(self, answer: Answer, *, rtu: bool = False, echo: bool = False) -> None:
        self._answer, self._rtu, self._echo = answer, rtu, echo
        self._server = socket.create_server(("127.0.0.1", 0))
        scheme = "modbus-rtu:socket" if rtu else "modbus-tcp"
        self.url = f"{scheme}://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._server.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            with connection:
                while data := connection.recv(4096):
                    pdu = data[1:-2] if self._rtu else data[7:]
                    answer = self._answer(pdu)
                    if self._echo:
                        connection.sendall(data)
                    if answer is None:
                        continue
                    tcp = data[:4] + struct.pack(">HB", len(answer) + 1, data[6]) + answer
                    connection.sendall(encode_rtu(1, answer) if self._rtu else tcp)


@pytest.fixture
def peer() -> Iterator[Callable[..., Peer]]:
    made: list[Peer] = []

    def make(answer: Answer, **how: bool) -> Peer:
        made.append(Peer(answer, **how))
        return made[-1]

    yield make
    for one in made:
        one.close()


def with_holes(holes: set[int], refused: bytes | None, longest: int = 125) -> Answer:
    """Registers from 0 on that hold 0, but for some addresses; what `refused` is for a read that touches those."""

    def answer(pdu: bytes) -> bytes | None:
        function, address, count = struct.unpack(">BHH", pdu[:5])
        if function != 3:
            return pdu[:5]
        if holes & set(range(address, address + count)) or count > longest:
            return refused
        return bytes([3, 2 * count]) + bytes(2 * count)

    return answer


def refusal(answer: Answer, peer: Callable[..., Peer], text: str = TEXT, **how: bool) -> DriverError:
    """What connecting ends in, as the station does it."""
    made = peer(answer, **how)
    actuator = ModbusActuator(ActuatorConnection(made.url, 1, 0.05), controller(tomllib.loads(text)))
    try:
        actuator.open()
        actuator.read_identity()
        actuator.read_status()
    except DriverError as error:
        return error
    finally:
        actuator.close()
    raise AssertionError("it was read")


IDENTITY = TEXT.replace("[state]", 'model = {address = 40001, access = "r"}\n[identity]\nmodel = 0\n[state]')
EXCEPTION_2 = b"\x83\x02"


@pytest.mark.parametrize(
    ("holes", "refused", "message", "fix"),
    [
        ({103, 104}, EXCEPTION_2, "registers 40101 to 40108", "unreadable = [[40103, 40107]]"),
        ({105}, b"\x83\x04", "40103 to 40107, the registers between them", "largest_gap = 0"),
        ({105}, None, "40103 to 40107, the registers between them", "unreadable = [[40103, 40107]]"),
        ({107}, EXCEPTION_2, "force (holding register 40108) cannot be read", "remove these entries"),
        (set(range(200)), EXCEPTION_2, "none of the device's quantities can be read", "first_address"),
    ],
)
def test_a_hole_in_the_status_block_is_the_map_and_not_the_cable(
    holes: set[int], refused: bytes | None, message: str, fix: str, peer: Callable[..., Peer]
) -> None:
    error = refusal(with_holes(holes, refused), peer, TEXT.replace("force_2 = {address = 40109}\n", ""))
    assert isinstance(error, WrongLayout)
    assert slug_of(error) == "register-layout"
    assert message in error.message
    assert "position" in error.message
    assert fix in error.fix
    assert fix in with_fix(error)


def test_a_block_that_is_too_long_at_once_is_reported(peer: Callable[..., Peer]) -> None:
    text = TEXT.replace("40108", "40103").replace("40109", "40104")
    error = refusal(with_holes(set(), b"\x83\x03", longest=1), peer, text)
    assert slug_of(error) == "register-layout"
    assert "largest_read = 1" in error.fix


def test_a_device_that_says_nothing_at_all_is_no_matter_of_the_map(peer: Callable[..., Peer]) -> None:
    error = refusal(lambda _: None, peer)
    assert isinstance(error, NoAnswer)
    assert slug_of(error) == "no-answer"
    silent = refusal(with_holes(set(range(100, 110)), None), peer, IDENTITY)
    assert slug_of(silent) == "register-layout", "its identity was read: the registers of its status are not there"


def test_in_operation_nothing_is_looked_into(peer: Callable[..., Peer]) -> None:
    holes: set[int] = set()
    made = peer(with_holes(holes, EXCEPTION_2))
    actuator = ModbusActuator(ActuatorConnection(made.url, 1, 0.2), controller(tomllib.loads(TEXT)))
    actuator.open()
    actuator.read_identity()
    actuator.read_status()
    holes |= {105}
    with pytest.raises(RequestRefused) as raised:
        actuator.read_status()
    actuator.close()
    assert link_slug(raised.value, LinkKind.MODBUS_TCP) == "modbus-reject"


def test_a_line_that_returns_what_is_sent_is_an_echo(peer: Callable[..., Peer]) -> None:
    error = refusal(with_holes(set(), None), peer, rtu=True, echo=True)
    assert isinstance(error, LocalEcho)
    assert slug_of(error) == "rtu-echo"
    assert "echo" in error.fix


@pytest.mark.parametrize(("function", "words"), [(6, [7]), (16, [7, 8])])
def test_the_answer_to_a_write_is_no_echo(function: int, words: list[int], peer: Callable[..., Peer]) -> None:
    link = ModbusLink(peer(lambda pdu: pdu[:5], rtu=True).url, timeout_s=0.2)
    link.open()
    link.write(20, words, function)
    link.close()


@pytest.mark.parametrize("rtu", [False, True])
@pytest.mark.parametrize(
    ("function", "words", "message"),
    [(5, [1], "wrote 1 to coil 11, but the answer states 0"), (6, [7], "wrote 7 to register 11, but the answer "
        "states 9")],
)
def test_an_answer_with_another_value_is_a_value_that_was_not_taken(
    rtu: bool, function: int, words: list[int], message: str, peer: Callable[..., Peer]
) -> None:
    other = {5: b"\x00\x00", 6: b"\x00\x09"}[function]
    link = ModbusLink(peer(lambda pdu: pdu[:3] + other, rtu=rtu).url, timeout_s=0.2)
    link.open()
    with pytest.raises(OtherAnswer, match=message) as raised:
        link.write(11, words, function)
    link.close()
    kind = LinkKind.MODBUS_RTU if rtu else LinkKind.MODBUS_TCP
    assert link_slug(raised.value, kind) == slug_of(raised.value) == "modbus-mismatch"
