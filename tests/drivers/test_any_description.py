"""What a description's author may write: refused with its place, or usable whatever the device sends. No traceback."""

from __future__ import annotations

import math
import struct
import time
import tomllib
import warnings
from pathlib import Path
from typing import Any

import pytest

from drivers.can_current_source import CanCurrentSource
from drivers.devices.dbc_file import DbcText, parse_dbc
from drivers.devices.ecu_description import EcuDescription
from drivers.devices.ecu_roles import describe
from drivers.devices.source import source_problems
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import controller
from drivers.register_maps.proof import unproved
from drivers.ring import RECORD
from drivers.roles import ActuatorLimits, WatchdogAction
from protocols.errors import LocalProtocolError, RemoteProtocolError
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import from_description
from rig.errors import FileProblem
from rig.files.descriptions import checked, problems_of, table_of
from rig.files.toml_source import parse_toml
from rig.station.interlocks.current_interlock import thrown_away

HUGE = 10**400
"""A whole number that TOML carries and no float holds."""
VALUE = r"(?P<value>[+-]?\d+\.\d)"


def refused_format(table: dict[str, Any]) -> str:
    return "; ".join(f"{'.'.join(map(str, place))}: {text}" for place, text in problems_of("sensor-format", table))


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"kind": [1], "pattern": VALUE}, "kind: must be 'lines', 'frames', 'modbus' or 'can'"),
        ({"pattern": "(" * 480 + VALUE + ")" * 480}, "nested 481 levels deep"),
        ({"columns": {"value": 256}, "separator": ";", "maximum_length": 256}, "too many columns"),
        ({"columns": {"value": 1}, "separator": "é"}, "one ASCII character"),
        ({"pattern": VALUE, "template": "X{value:.1f}"}, "produces 'X0.0', which does not match the pattern"),
        ({"pattern": rf"(?P<sign>-?){VALUE}", "sign": "separate", "number": "hexadecimal-signed"}, "already "
            "contain the sign"),
        ({"pattern": r"(?P<value>[0-9A-F]+-?)", "sign": "trailing", "number": "hexadecimal"},
         "cannot have a trailing sign"),
    ],
)  # fmt: skip
def test_a_format_that_nothing_can_be_made_of_is_refused(table: dict[str, Any], says: str) -> None:
    assert says in refused_format(table)


@pytest.mark.parametrize(
    "table",
    [
        {"pattern": rf"{VALUE} °"}, {"pattern": rf"{VALUE}(?P<unit>µm)", "unit": "µm"},
        {"pattern": rf"{VALUE} (?P<unit>.*)", "unit": "µm"},
        {"pattern": rf"{{address}}{VALUE}", "address": "é", "request": "{address}?"},
    ],
)  # fmt: skip
def test_a_line_is_ascii_text(table: dict[str, Any]) -> None:
    assert "is not a character of ASCII" in refused_format(table)


def test_a_packed_field_has_64_bits_and_a_packed_frame_256_bytes() -> None:
    fields: dict[str, Any] = {"value": {}}
    wide = {"packed": ["1vvvvvvv"] + ["0vvvvvvv"] * 199, "fields": fields}
    assert "has 1400 bits marked v; a field can have at most 64" in refused_format(wide)
    long = {"packed": ["1vvvvvvv"] + ["0xxxxxxx"] * 19_999, "fields": fields}
    assert "20000 bytes" in refused_format(long)


def test_a_class_in_brackets_is_re2s_and_nothing_is_warned_of() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = from_description({"pattern": "(?P<value>[[:digit:]]+)"})
    assert isinstance(made, LineFormat)
    assert LineDecoder(made, answers=True).feed(b"12\r\n")[0][2] == 12.0


def test_a_file_with_a_number_of_5000_digits_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(f"pattern = '(?P<value>1)'\nscale = {'1' * 5000}\n")
    with pytest.raises(FileProblem, match="not valid TOML"):
        table_of("sensor-format", path)


MAP = """
[quantities]
state = {address = 0}
position = {address = 1, type = "i16", scale = 0.01, unit = "mm"}
pump = {address = 0, function = "coil"}
command = {address = 100}
target = {address = 101, type = "i16", scale = 0.01, unit = "mm"}
amplitude = {address = 103, scale = 0.01, unit = "mm"}
frequency = {address = 104, scale = 0.01, unit = "Hz"}
cycles = {address = 105}
QUANTITIES
[state]
off = 0
hold = 1
running = 3
tripped = 9
[commands]
hydraulics-on = {write = {pump = 1}}
hydraulics-off = {write = {pump = 0}}
move-to = {write = {target = "$target", command = 1}}
start = {write = {amplitude = "$amplitude", frequency = "$frequency", cycles = "$all_cycles", command = 2}}
halt = {write = {command = 3}}
reset = {write = {command = 4}}
TABLES
"""


def read(quantities: str = "", tables: str = "", top: str = "", halt: str = "command = 3") -> ControllerMap:
    text = MAP.replace("QUANTITIES", quantities).replace("TABLES", tables)
    text = text.replace("halt = {write = {command = 3}}", f"halt = {{write = {{{halt}}}}}")
    return controller(checked("register-map", parse_toml(Path("mine.toml"), top + text)))


FED = (
    '[faults]\nwatchdog = {quantity = "state", equals = 9}\n'
    '[watchdog]\nkind = "counter"\nwrite = {alive = "$counter"}'
)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"quantities": 'velocity = {address = 40, type = "string", length = 2}'}, "velocity must be a number"),
        ({"quantities": 'clock = {address = 40, type = "string", length = 2}'}, "clock must be a number"),
        ({"quantities": 'speed_max = {address = 40, type = "string", length = 2}'}, "speed_max must be a number"),
        ({"quantities": 'config_hash = {address = 40, type = "string", length = 2}'}, "config_hash must be a number"),
        ({"quantities": 'boot_count = {address = 40, type = "f32"}'}, "boot_count must be a whole number"),
        ({"quantities": 'clock = {address = 40, scale = 5e-324, unit = "us"}'}, "is implausible"),
        ({"quantities": f'velocity = {{address = 40, scale = {HUGE}, unit = "mm/s"}}'}, "more than 64 bits"),
        ({"quantities": "many = {address = 40, count = 3}", "halt": "many = 3"}, "only a [table] can write these "
            "values"),
        ({"quantities": "many = {address = 40, count = 3}", "tables": "[identity]\nmany = 3"}, "this quantity has "
            "3 values"),
        ({"quantities": 'many = {address = 40, count = 3}', "tables": '[faults]\nsensor = {quantity = "many"}'},
         "a condition requires a single number"),
        ({"quantities": 'model = {address = 40, type = "string", length = 1}', "tables": '[identity]\nmodel = "ABCD"'},
         "is too long; allowed: at most 2 characters"),
        ({"quantities": 'model = {address = 40, type = "string", length = 4}', "tables": '[identity]\nmodel = "µC"'},
         "a string must be ASCII"),
        ({"tables": "[identity]\nstate = 1"}, "cannot identify the device"),
        ({"quantities": 'speed_max = {address = 40, access = "r"}'}, "which is written and read back"),
        ({"quantities": 'speed_max = {address = 40, access = "w"}'}, "which is written and read back"),
        ({"top": 'base = "demo"\nwithout = ["name.x"]\n'}, "'name.x' is not an entry in demo"),
        ({"top": 'base = "demo"\nwithout = ["format.1"]\n'}, "'format.1' is not an entry in demo"),
        ({"quantities": 'alive = {address = 60, type = "i16"}', "tables": FED}, "$counter ranges from 0 to 65535"),
        ({"quantities": 'alive = {address = 60, function = "coil"}', "tables": FED}, '"$toggle"'),
        ({"quantities": "alive = {address = 60, scale = 10}", "tables": FED}, "$counter ranges from 0 to 65535"),
        ({"quantities": "number = {address = 60, scale = 0.1}", "halt": 'command = 3, number = "$sequence"'},
         "$sequence ranges from 0 to 65535"),
        ({"quantities": 'number = {address = 60, type = "i16"}', "halt": 'command = 3, number = "$owner"'},
         "$owner ranges from 1 to 65535"),
    ],
)  # fmt: skip
def test_a_map_that_could_not_be_driven_is_refused(given: dict[str, str], says: str) -> None:
    with pytest.raises(FileProblem) as caught:
        read(**given)
    assert says in str(caught.value)


def test_a_span_of_anything_but_two_names_is_refused() -> None:
    text = MAP.replace("QUANTITIES", "").replace("TABLES", "")
    text = text.replace("halt = {write = {command = 3}}", 'halt = {write = {command = 3}, span = [["a"], "b"]}')
    with pytest.raises(FileProblem, match="span"):
        checked("register-map", parse_toml(Path("mine.toml"), text))


def test_codes_of_waveforms_fit_their_register() -> None:
    text = MAP.replace("QUANTITIES", "wave = {address = 60}")
    text = text.replace("TABLES", "[waveforms]\nsine = 1\ntriangle = 70000")
    text = text.replace("command = 2}}", 'command = 2, wave = "$waveform"}}')
    with pytest.raises(FileProblem, match=r"waveforms\.triangle = 70000: 70000 does not fit wave"):
        checked("register-map", parse_toml(Path("mine.toml"), text))


def test_a_clock_and_a_watchdog_time_of_floats_may_show_anything() -> None:
    made = read('clock = {address = 40, type = "f64", unit = "s"}\nwatchdog_time = {address = 50, type = "f32"}')
    for shown in (1e305, math.inf, math.nan):
        with pytest.raises(RemoteProtocolError, match="the clock shows"):
            made.clock_us(shown)
        assert not math.isfinite(made.held_limits({"watchdog_time": shown * 1e10}, None).watchdog_ms)


@pytest.mark.parametrize("kind", ["u32", "i32", "u64"])
def test_a_whole_number_proves_the_device_as_it_is_not_about(kind: str) -> None:
    made = read(f'signature = {{address = 40, type = "{kind}"}}', "[identity]\nsignature = 0x01020304")
    for shown, proves in ((0x01020304, True), (0x01020305, False)):
        answers = [(one, made.quantities["signature"].encode(shown)) for one in made.identity_reads]
        values = {name: value for one, words in answers for name, value in one.decode(words).items()}
        assert (unproved(made, values, answers) == ("", "")) is proves


DBC = """VERSION ""
BU_: H E
BO_ 256 Cmd: 8 H
 SG_ Set : 0|16@1- (0.001,0) [0|0] "A" E
BO_ 257 Stat: 8 E
 SG_ Cur : 0|32@1- (1,0) [0|0] "A" H
 SG_ Clk : 32|32@1+ (1,0) [0|0] "us" H
BO_ 258 Big: 8 E
 SG_ Clk64 : 0|64@1+ (1,0) [0|0] "us" H
SIG_VALTYPE_ 257 Cur : 1;
"""
ROLES = 'command = "Cmd.Set"\nmeasured_current = "Stat.Cur"\n'


class Port:
    """A bus on which the test puts frames."""

    class stamps:  # noqa: N801 - stands for an attribute
        uncertainty_ns = 0

    bus_errors = malformed = 0
    at_ns: tuple[int, ...] = ()

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes, bool, bool, int]] = []

    def receive(self, timeout_s: float) -> tuple[list[tuple[int, bytes, bool, bool, int]], int]:
        del timeout_s
        frames, self.frames = self.frames, []
        return frames, time.monotonic_ns()


def described(roles: str = ROLES, dbc: str = DBC) -> EcuDescription:
    return describe("ecu", parse_dbc(dbc), tomllib.loads(roles))


def heard(roles: str, *frames: tuple[int, bytes]) -> CanCurrentSource:
    port = Port()
    source = CanCurrentSource(port, described(roles))  # type: ignore[arg-type]  # as much of a port as is used
    for identifier, data in frames:
        port.frames = [(identifier, data, False, False, len(data))]
        for record in source.read_batch(0.0).records:
            RECORD.pack(*record)
    return source


def test_a_current_that_is_no_number_beside_a_clock_is_counted() -> None:
    good, bad = struct.pack("<fI", 1.0, 1), struct.pack("<fI", math.nan, 2)
    source = heard(f'{ROLES}clock = "Stat.Clk"\n', (257, good), (257, bad), (257, struct.pack("<fI", 1.0, 3)))
    assert (source.counters.bad_checks, source.counters.statuses) == (1, 2)


@pytest.mark.parametrize("roles", [ROLES, f'{ROLES}clock = "Stat.Clk"\n'])
def test_currents_in_a_row_that_are_no_numbers_are_named(roles: str) -> None:
    frames = [(257, struct.pack("<fI", math.nan, place)) for place in range(3)]
    source = heard(roles, *frames)
    assert source.counters.unmeasured_in_a_row == 3
    assert thrown_away(source.counters) == "current-unmeasured"


def test_a_clock_of_64_bits_may_show_anything() -> None:
    status = struct.pack("<fI", 1.0, 1)
    source = heard(f'{ROLES}clock = "Big.Clk64"\n', (258, b"\xff" * 8), (257, status), (258, bytes(8)), (257, status))
    assert source.counters.statuses == 2


@pytest.mark.parametrize(
    ("roles", "says"),
    [
        ('command = {signal = "Cmd.Set", unit = "%", full_scale = "3.4.5 A"}\nmeasured_current = "Stat.Cur"', "unit"),
        ('command = {signal = "Cmd.Set", unit = ["A"]}\nmeasured_current = "Stat.Cur"', "must be a string"),
    ],
)
def test_roles_that_cannot_be_used_are_refused(roles: str, says: str) -> None:
    table = tomllib.loads(roles)
    problems: list[Any] = problems_of("ecu-roles", table) or list(source_problems(DbcText("mine.dbc", DBC), table))
    assert any(says in problem[1] for problem in problems), problems


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("Cmd: 8", "Cmd: 3000000000", "line 3: .*at most 1785 bytes"), ("0|16@1-", "0|1000000000@1-", "line 4: .*bits"),
        ("0|16@1-", "4000000000|16@1-", "line 4: .*bits"), ("(0.001,0)", f"({HUGE},0)", "cannot be used"),
        ("(0.001,0) [0|0]", f"(0.001,0) [-{HUGE}|{HUGE}]", "cannot be used"),
    ],
)  # fmt: skip
def test_sizes_and_numbers_of_a_dbc_are_refused_before_they_cost_anything(old: str, new: str, says: str) -> None:
    began_s = time.process_time()
    with pytest.raises(LocalProtocolError, match=says):
        parse_dbc(DBC.replace(old, new))
    assert time.process_time() - began_s < 5.0


def test_an_outputs_quantity_is_one_value_and_a_supplys_fault_a_whole_bit() -> None:
    current = {"address": 0, "scale": 0.001, "unit": "A"}
    output = {"quantities": {"current": current, "enable": {"address": 5, "count": 3}}, "range": {"current_A": [0, 2]}}
    assert "must be a single value. Fix: remove count" in [text for _, text in problems_of("supply", output)]
    supply = {
        "commands": {"set_current": "CURR {current_A}", "measure_current": "MEAS?", "read_faults": "F?"},
        "range": {"current_A": [0, 5]}, "faults": {"short": 1.5},
    }  # fmt: skip
    assert problems_of("supply", supply) == [(("faults", "short"), "must be a whole number (allowed: 0 to 31)")]


def test_limits_that_the_registers_cannot_hold_are_found_before_the_rig_is_armed() -> None:
    limits = ActuatorLimits(-0.05, 0.06, 0.5, 40.0, 4000.0, 2.0, 8.0, 400, int(WatchdogAction.FADE_AND_HOLD))
    made = read('position_min = {address = 40, unit = "mm"}\nforce_max = {address = 42, unit = "N"}')
    assert [text.partition(" (")[0] for text in made.unheld_limits(limits)] == ["'position_min'"]
    action = read("watchdog_action = {address = 40}", "[watchdog_actions]\nnone = 7")
    assert "fade-and-hold is not supported by this controller" in action.unheld_limits(limits)[0]
    assert read('force_max = {address = 42, unit = "N"}').unheld_limits(limits) == []
