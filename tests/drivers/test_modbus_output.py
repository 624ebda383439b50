"""An analogue output on Modbus commands the coil's current: its file, its driver against a module written by hand."""

from __future__ import annotations

import socket
import struct
import threading
import time
import tomllib
from collections.abc import Callable, Iterator

import pytest

from drivers.current_source import SourceFault, SourceState, SourceStatus
from drivers.devices.supply import SupplyConnection, supply_missing
from drivers.devices.supply_file import supply
from drivers.errors import DriverError
from drivers.modbus_output import ModbusOutput
from rig.files.descriptions import problems_of

FILE = """
maker = "Acme"
settling_ms = 20
[range]
current_A = [0, 2]
[modbus]
word_order = "little"
[quantities]
current = {address = 0x64, scale = 0.001, unit = "A"}
measured_current = {address = 20, function = "input", type = "f32", unit = "mA"}
enable = {address = 3, function = "coil", access = "w"}
kind = {address = 200, type = "u32"}
guard = {address = 300, unit = "ms"}
alive = {address = 301}
serial_number = {address = 210, type = "string", length = 2}
[identity]
kind = 0x00020001
[watchdog]
time_s = 0.5
start = {guard = 500}
feed = {alive = "$toggle"}
stop = {guard = 0}
"""


class Module:
    """A module by the Modbus application protocol, written out by hand; it measures what it commands."""

    def __init__(self) -> None:
        self.holding = dict.fromkeys([0x64, 300, 301], 0) | {200: 1, 201: 2, 210: 0x4142, 211: 0x3700}
        self.coil = 0
        self.gain = 1.0
        self.mute = False
        self.refuses: set[int] = set()
        self.requests: list[str] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"modbus-tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    @property
    def written(self) -> list[str]:
        return [request for request in self.requests if request[:2] in {"05", "10", "06"}]

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            threading.Thread(target=self._talk, args=(connection,), daemon=True).start()

    def _talk(self, connection: socket.socket) -> None:
        with connection:
            while (head := connection.recv(7)) and len(head) == 7:
                request = connection.recv(struct.unpack(">H", head[4:6])[0] - 1)
                self.requests.append(request.hex())
                if not self.mute:
                    answer = self._answer(request)
                    connection.sendall(head[:4] + struct.pack(">H", len(answer) + 1) + head[6:] + answer)

    def _answer(self, request: bytes) -> bytes:
        function, address, count = struct.unpack(">BHH", request[:5])
        if address in self.refuses:
            return bytes([function | 0x80, 2])
        if function == 5:
            self.coil = count >> 8 & 1
            return request
        if function == 16:
            self.holding[address] = struct.unpack(">H", request[6:8])[0]
            return request[:5]
        if function == 4:
            milliampere = self.gain * self.holding[0x64] * self.coil
            high, low = struct.unpack(">HH", struct.pack(">f", milliampere))
            words = [low, high]
        else:
            words = [self.holding.get(address + place, 0) for place in range(count)]
        return bytes([function, 2 * len(words)]) + struct.pack(f">{len(words)}H", *words)


@pytest.fixture
def module() -> Iterator[Module]:
    made = Module()
    yield made
    made.close()


def driver(module: Module, text: str = FILE, **more: object) -> ModbusOutput:
    described = supply(tomllib.loads(text))
    assert described.output is not None
    given = SupplyConnection(module.url, described, poll_s=0.005, timeout_s=0.2, **more)  # type: ignore[arg-type]
    made = ModbusOutput(given, described.output)
    made.open()
    return made


@pytest.fixture
def source(module: Module) -> Iterator[ModbusOutput]:
    made = driver(module)
    yield made
    made.close()


def read_until(source: ModbusOutput, done: Callable[[SourceStatus], bool]) -> SourceStatus:
    deadline, status = time.monotonic() + 10.0, None
    while time.monotonic() < deadline:
        for status in source.read_batch(0.05).statuses:
            if done(status):
                return status
    pytest.fail(f"never seen; the last was {status}")


def run(source: ModbusOutput, current_A: float) -> SourceStatus:
    source.start(0.01)
    source.command(current_A)
    source.send_now()
    return read_until(source, lambda status: status.current_A == pytest.approx(current_A))


def test_it_is_read_and_nothing_is_written_before_it_is_started(module: Module, source: ModbusOutput) -> None:
    read_until(source, lambda status: source.counters.statuses > 4)
    assert module.written == []
    assert source.identity is not None
    assert (source.identity.serial_number, source.identity_problem) == ("AB7", "")


def test_a_current_is_the_register_then_the_coil_and_a_stop_takes_both_back(
    module: Module, source: ModbusOutput
) -> None:
    assert run(source, 1.5).state == SourceState.ENABLED
    source.command(0.0, enable=False)
    source.send_now()
    assert read_until(source, lambda status: status.current_A == 0.0).state == SourceState.OFF
    of_current = [request for request in module.written if not request.startswith("10012d")]
    assert of_current[-4:] == ["10006400010205dc", "050003ff00", "1000640001020000", "0500030000"]
    assert "10012c00010201f4" in of_current, "its time-out is set to 500 ms"
    assert {"10012d0001020000", "10012d0001020001"} <= set(module.written), "and fed by a bit that changes"
    source.close()
    assert module.written[-1] == "10012c0001020000", "the time-out is ended with the connection"


def test_zero_is_written_at_once_while_nothing_else_is_due(module: Module) -> None:
    described = supply(tomllib.loads(FILE))
    assert described.output is not None
    slow = ModbusOutput(SupplyConnection(module.url, described, poll_s=1.0, timeout_s=0.2), described.output)
    slow.open()
    run(slow, 1.0)
    slow.command(0.0, enable=False)
    slow.send_now()
    deadline = time.monotonic() + 0.9
    while (module.holding[0x64], module.coil) != (0, 0):
        assert time.monotonic() < deadline, "its turn was not waited for"
        time.sleep(0.005)
    slow.close()


def test_a_module_that_lost_its_value_and_a_coil_without_current_are_faults(module: Module) -> None:
    source = driver(module)
    run(source, 1.0)
    module.holding[0x64] = 0
    assert read_until(source, lambda status: status.faults != 0).faults & SourceFault.RESTARTED
    source.command(0.0, enable=False, clear_faults=True)
    source.send_now()
    read_until(source, lambda status: status.faults == 0)
    module.gain = 0.0
    source.command(1.0)
    source.send_now()
    assert read_until(source, lambda status: status.faults != 0).faults == SourceFault.OPEN
    source.close()


def test_silence_gives_no_status_and_what_was_requested_is_written_again(module: Module, source: ModbusOutput) -> None:
    run(source, 1.0)
    module.mute = True
    assert not source.read_batch(0.3).statuses
    module.holding[0x64], module.mute = 0, False
    read_until(source, lambda status: status.current_A == pytest.approx(1.0))


def test_a_module_that_comes_back_after_it_was_given_up_is_set_to_zero(module: Module, source: ModbusOutput) -> None:
    run(source, 1.0)
    module.mute = True
    source.read_batch(0.01)
    source.command(0.0, enable=False)
    source.send_now()
    took_s = []
    for _ in range(5):
        began_s = time.monotonic()
        source.read_batch(0.02)
        took_s.append(time.monotonic() - began_s)
    assert min(took_s) < 0.15, "a reader does not wait 0.2 s each time for an answer that does not come"
    module.coil, module.mute = 1, False
    deadline = time.monotonic() + 5.0
    while module.coil and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not module.coil


def test_a_write_that_is_refused_is_a_fault_and_a_map_that_is_not_there_is_reported(module: Module) -> None:
    module.refuses = {3}
    source = driver(module)
    source.start(0.01)
    assert read_until(source, lambda status: status.faults != 0).faults == SourceFault.COMMAND_CHECK
    source.close()
    module.refuses = {20}
    source = driver(module)
    with pytest.raises(DriverError, match="exception 2"):
        source.read_batch(2.0)
    source.close()


def test_a_zero_that_is_refused_is_not_reported_where_nothing_can_be_read_back(module: Module) -> None:
    text = """
    [range]
    current_A = [0, 2]
    [quantities]
    current = {address = 0x64, scale = 0.001, unit = "A", access = "w"}
    fault_bits = {address = 202}
    [faults]
    open = {quantity = "fault_bits", bit = 0}
    """
    source = driver(module, text)
    run(source, 1.0)
    module.refuses = {0x64}
    source.command(0.0, enable=False)
    source.send_now()
    status = read_until(source, lambda status: status.faults != 0)
    assert (status.faults, status.current_A) == (SourceFault.COMMAND_CHECK, 1.0)
    module.refuses = set()
    source.close()


def test_a_current_that_is_no_number_gives_no_status(module: Module) -> None:
    source = driver(module)
    source.close()  # its own thread has ended
    counters = source.counters
    before = counters.statuses
    source._take({"measured_current": float("nan")})
    assert (counters.statuses - before, counters.unmeasured_in_a_row, counters.bad_in_a_row) == (0, 1, 1)


def test_another_module_is_known_by_what_it_shows(module: Module) -> None:
    module.holding[201] = 5
    source = driver(module, identity="XY")
    read_until(source, lambda status: True)
    assert "kind is 327681, expected 131073" in source.identity_problem
    assert "expected text that contains 'XY'" in source.identity_problem
    source.close()


def test_without_a_measurement_the_value_read_back_is_reported_and_all_that_is_missing_is_reported(
    module: Module,
) -> None:
    text = """
    [range]
    current_A = [0, 2]
    [quantities]
    current = {address = 0x64, scale = 0.001, unit = "A"}
    """
    source = driver(module, text)
    assert run(source, 0.5).current_A == 0.5
    assert not source.traits.measures
    assert source.traits.own_timeout_s is None
    message = dict(supply_missing(supply(tomllib.loads(text))))
    assert {"timeout", "measurement", "enable", "faults", "identity", "coil-temperature"} == message.keys()
    assert "keeps its value" in message["timeout"]
    source.close()


@pytest.mark.parametrize(
    ("before", "after", "place", "says"),
    [
        ("current = {", "amperes = {", "quantities", "current is missing"),
        ('scale = 0.001, unit = "A"', 'scale = 0.001, unit = "mm"', "quantities.current", 'unit = "A"'),
        ('scale = 0.001, unit = "A"', 'offset = 0.5, unit = "A"', "quantities.current", "nearest to 0 A"),
        ("scale = 0.001", "scale = 0.00001", "quantities.current", "cannot represent 2 A"),
        ("[0, 2]", "[2, 0]", "range.current_A", "the first value must be less than the second"),
        ('{address = 0x64,', '{address = 0x64, access = "r",', "quantities.current", "holding register"),
        ("{address = 0x64,", '{address = [0x66, 0x64], type = "i32",', "quantities.current", "one after the other"),
        ("{guard = 500}", "{current = 0}", "watchdog.start", "reserved for the test matrix and for stops"),
        ("{guard = 500}", "{guarded = 500}", "watchdog.start.guarded", "did you mean guard"),
        ('"$toggle"', '"$current"', "watchdog.feed.alive", "is not available here"),
        ("time_s = 0.5", "time_s = 0", "watchdog.time_s", "allowed: 0.1 to 60"),
        ("kind = 0x00020001", "kid = 1", "identity.kid", "did you mean kind"),
        ("address = 20,", "address = 65535,", "quantities.measured_current.address", "beyond the last register"),
        ("[watchdog]", "[watchdg]", "watchdg", "did you mean watchdog"),
    ],
)
def test_what_is_wrong_in_its_file_is_reported_with_its_place(before: str, after: str, place: str, says: str) -> None:
    problems = problems_of("supply", tomllib.loads(FILE.replace(before, after)))
    assert any(".".join(map(str, where)) == place and says in text for where, text in problems), problems


def test_an_output_that_nothing_brings_to_zero_is_refused() -> None:
    live_zero = FILE.replace("[0, 2]", "[0.4, 2]")
    assert problems_of("supply", tomllib.loads(live_zero)) == [], "it is switched off by enable"
    without = live_zero.replace("enable = ", "other = ")
    problems = problems_of("supply", tomllib.loads(without))
    assert any("the coil could not be switched off" in text for _, text in problems)


def test_nothing_to_read_is_refused() -> None:
    text = '[range]\ncurrent_A = [0, 2]\n[quantities]\ncurrent = {address = 1, scale = 0.001, unit = "A", access = "w"}'
    problems = problems_of("supply", tomllib.loads(text))
    assert any("no readable quantity" in text for _, text in problems)
