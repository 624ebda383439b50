"""A register map's file: what a stranger writes is read as he means it; what cannot be is told at once, with lines."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from drivers.capabilities import WatchdogKind
from drivers.register_maps.access_plan import writes
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_file import FOLDER, controller
from drivers.roles import ActuatorLimits, Command, FaultBit, Input, State
from protocols.errors import LocalProtocolError, RemoteProtocolError
from rig.bench.model import Bench
from rig.cli.schema import SCHEMAS
from rig.errors import FileProblem
from rig.files.descriptions import checked, table_of
from rig.files.toml_source import parse_toml

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "how-to" / "write-a-register-map.md").read_text(encoding="utf-8")
SMALLEST = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)[0]


def read(text: str) -> ControllerMap:
    return controller(checked("register-map", parse_toml(Path("mine.toml"), text)))


def problems(text: str) -> list[str]:
    with pytest.raises(FileProblem) as refused:
        read(text)
    return refused.value.problems


def edited(*pairs: tuple[str, str]) -> str:
    text = SMALLEST
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    return text


def test_the_smallest_map_of_the_page_is_read_and_says_what_it_does_not_have() -> None:
    controller = read(SMALLEST)
    assert controller.name == "ACME MC-4"
    can = controller.capabilities
    assert (can.generator, can.hydraulics, can.force_input, can.watchdog) == (True, True, True, WatchdogKind.NONE)
    assert can.can_be_stopped
    assert {"watchdog", "lease", "acknowledge", "limits"} <= {name for name, _ in can.lacking()}
    assert [(read.space, read.address, read.count) for read in controller.status_reads] == [("input", 0, 4)]


def test_codes_bits_scales_and_units_mean_what_the_file_says() -> None:
    controller = read(SMALLEST)
    (status_read,) = controller.status_reads
    # -1234 x 0.01 mm, 250 daN, alarm bits 1 and 2, state 3
    status = controller.status(status_read.decode([3, 0x10000 - 1234, 250, 0b110]), 5_000_000_000, {})
    assert (status.state, status.position_m, status.force_N) == (State.RUNNING, pytest.approx(-0.01234), 2500.0)
    assert status.fault_bits == FaultBit.E_STOP
    assert status.inputs == Input.E_STOP_CLOSED | Input.HYDRAULICS_ON
    assert (status.clock_us, status.heartbeat) == (5_000_000, 500)
    off = controller.status(status_read.decode([0, 0, 0, 0]), 0, {})
    assert off.hydraulics_off
    unnamed = controller.status(status_read.decode([7, 0, 0, 0]), 0, {})
    assert unnamed.state not in set(State)


APART = (("force     = {address = 2", "force = {address = 20"), ("alarms    = {address = 3", "alarms = {address = 30"))


@pytest.mark.parametrize(
    ("words", "bytes_", "registers"),
    [
        # 305419896 = 0x12345678 um = 305.419896 m, worked out by hand for each order
        ("big", "big", [0x1234, 0x5678]), ("little", "big", [0x5678, 0x1234]),
        ("big", "little", [0x3412, 0x7856]), ("little", "little", [0x7856, 0x3412]),
    ],
)  # fmt: skip
def test_word_and_byte_order_are_stated_per_file_and_per_quantity(
    words: str, bytes_: str, registers: list[int]
) -> None:
    order = f'word_order = "{words}", byte_order = "{bytes_}"'
    for text in (
        edited(('"i16", scale = 0.01, unit = "mm"}\nforce', f'"u32", unit = "um", {order}}}\nforce'),
               *APART),
        edited(("[quantities]", "[modbus]\n" + order.replace(", ", "\n") + "\n[quantities]"),
               ('type = "i16", scale = 0.01, unit = "mm"}\nforce', 'type = "u32", unit = "um"}\nforce'),
               *APART),
    ):  # fmt: skip
        position = read(text).quantities["position"]
        assert position.decode(registers) == pytest.approx(305.419896)
        assert position.encode(305.419896) == registers


@pytest.mark.parametrize(
    ("kind", "registers", "value"),
    [
        ("i32", [0xFFFF, 0xFFFE], -2.0), ("f32", [0x4048, 0xF5C3], 3.14), ("u64", [0, 0, 1, 0], 65536.0),
        ("i64", [0xFFFF, 0xFFFF, 0xFFFF, 0xFF00], -256.0), ("f64", [0x4009, 0x1EB8, 0x51EB, 0x851F], 3.14),
        ("i16", [0x8000], -32768.0),
    ],
)  # fmt: skip
def test_every_type_is_read_as_the_standards_have_it(kind: str, registers: list[int], value: float) -> None:
    text = edited(("alarms    = {address = 3", f'other = {{address = 50, type = "{kind}"}}\nalarms = {{address = 3'))
    assert read(text).quantities["other"].decode(registers) == pytest.approx(value, rel=1e-7)


@pytest.mark.parametrize(
    ("entry", "words", "value"),
    [
        ('address = 50, type = "bcd16"', [0x1234], 1234), ('address = 50, type = "bcd32"', [0x1234, 0x5678], 12345678),
        ('address = 50, type = "bcd32", word_order = "little", scale = 0.01, unit = "mm"', [0x5678, 0x0012], 1.25678),
        ('address = [53, 50], type = "i32"', [0xFFFE, 9, 9, 0xFFFF], -2),
        ('address = [50, 52], type = "f32"', [0x4148, 9, 0], 12.5),
        ('address = [51, 50], type = "bcd32"', [0x0042, 0x0007], 70042),
    ],
)
def test_decimal_digits_and_registers_apart_are_read_and_written(entry: str, words: list[int], value: float) -> None:
    made = read(edited(("alarms    = {address = 3", f"other = {{{entry}}}\nalarms = {{address = 3")))
    other = made.quantities["other"]
    assert other.decode(words) == pytest.approx(value)
    written = {one.address: one.words for one in writes({other: value})}
    laid = {at + i: word for at, words in written.items() for i, word in enumerate(words)}
    assert laid == {50 + i: word for i, word in enumerate(words) if word != 9}


def test_a_number_that_is_not_decimal_is_no_value() -> None:
    made = read(edited(("alarms    = {address = 3", 'other = {address = 50, type = "bcd16"}\nalarms = {address = 3')))
    with pytest.raises(RemoteProtocolError, match="0x12A4 is not a BCD number"):
        made.quantities["other"].decode([0x12A4])
    with pytest.raises(LocalProtocolError, match="0 to 9999"):
        made.quantities["other"].encode(10000)


def test_addresses_may_be_numbered_as_the_manual_does() -> None:
    first = "[modbus]\nfirst_address = {holding = 40001, input = 30001, coil = 1}\n[quantities]"
    text = edited(("[quantities]", first), ("address = 0, function = \"coil\"", "address = 5, function = \"coil\""))
    for old in range(4):
        text = text.replace(f'{{address = {old}, function = "input"', f'{{address = {30001 + old}, function = "input"')
    for old in range(100, 106):
        text = text.replace(f"{{address = {old}", f"{{address = {40001 + old}")
    controller = read(text)
    assert [(one.space, one.address, one.count) for one in controller.status_reads] == [("input", 0, 4)]
    assert controller.quantities["pump"].address == 4
    assert controller.quantities["frequency"].address == 104


def test_reads_are_planned_within_gaps_lengths_and_what_may_not_be_read() -> None:
    text = edited(
        ("[quantities]", "[modbus]\nlargest_gap = 4\nlargest_read = 10\nunreadable = [[5, 6]]\n[quantities]"),
        ("alarms    = {", 'velocity = {address = 8, function = "input", unit = "mm/s"}\nalarms = {'), ("= 3,", "= 4,"),
    )
    text = text.replace('cycles    =', 'servo_error = {address = 12, function = "input", unit = "um"}\ncycles    =')
    planned = [(one.address, one.count) for one in read(text).status_reads]
    assert planned == [(0, 5), (8, 5)], "registers 5 and 6 are never read; 9 to 11 are a gap of three"


def test_neighbours_are_written_together_and_a_trigger_last() -> None:
    controller = read(SMALLEST)
    start = controller.recipe(Command.START)
    assert start is not None
    given = {"amplitude": 0.02, "frequency": 1.5, "all_cycles": 12.0}
    requests = [one for step in start for one in step.requests(given)]  # type: ignore[union-attr]  # only writes
    assert [(one.function, one.address, one.words) for one in requests] == [
        (16, 103, (2000, 150, 12)), (16, 100, (2,)),
    ]  # fmt: skip
    on = controller.recipe(Command.HYDRAULICS_ON)
    assert on is not None
    assert [(one.function, one.address, one.words) for one in on[0].requests({})] == [(5, 0, (1,))]  # type: ignore[union-attr]
    assert controller.recipe(Command.FADE_STOP) == controller.recipe(Command.HALT), "it stops in one way only"


WRONG = [
    (("position  = {address = 1", "place     = {address = 1"), "position is missing"),
    (("amplitude = {address = 103", "amplitude = {address = 102"), r"line \d+: quantities.amplitude: overlaps 'speed'"),
    (("amplitude = {address = 103", "amplitude = {address = 65536"), "0 to 65535"),
    (("frequency = {address = 104,", "frequency = {address = 65535, type = \"u32\","), "extend beyond the last "
        "register"),
    (("scale = 0.01, unit = \"Hz\"", "scale = 0, unit = \"Hz\""), r"line \d+: quantities.frequency.scale = 0: "),
    (("unit = \"Hz\"", "unit = \"hertz\""), "unknown unit"),
    (("unit = \"daN\"", "unit = \"mm\""), "force is a force"),
    (("type = \"i16\", unit = \"daN\"", "type = \"int16\""), "must be 'u16'"),
    (("hold = 1", "held = 1"), "did you mean hold"),
    (("moving = 2", "moving = 1"), "hold and moving both have code 1"),
    (("e-stop = {quantity = \"alarms\"", "e-stop = {quantity = \"alarm\""), "did you mean alarms"),
    (("e-stop = {quantity = \"alarms\", bit = 1", "e-stop = {quantity = \"alarms\", bit = 16"), "0 to 15"),
    (("{write = {pump = 0}}", "{write = {pumps = 0}}"), "pumps = 0: is not in .quantities.; did you mean pump"),
    (("{write = {command = 3}}", "{write = {alarms = 3}}"), "cannot be written"),
    (("speed = \"$speed\"", "speed = \"$sped\""), "did you mean \\$speed"),
    (("speed = \"$speed\"", "speed = \"$target\""), "target is a length, but speed is a speed"),
    (("target = \"$target\", ", ""), "the target of this command is missing"),
    (("amplitude = \"$amplitude\", ", ""), "the amplitude of the program is missing"),
    (("frequency = \"$frequency\", ", ""), "the frequency of the program is missing"),
    (("reset = {write = {command = 4}}", ""), "reset is missing"),
    (("halt = {write = {command = 3}}", ""), "fade-stop or halt is missing"),
    (("hydraulics-off = {write = {pump = 0}}", ""), "hydraulics-off is missing"),
    (("off = 0\n", ""), "off is missing"),
    (("running = 3\n", ""), None),
    (("{write = {command = 3}}", "{wait = {quantity = \"state\", equals = 1}}"), "within: missing"),
    (("{write = {command = 3}}", "{wait = {quantity = \"state\"}, within = \"0 s\"}"), "more than 0"),
    (("{write = {command = 3}}", "{recipe = \"stop\"}"), "'stop' is not in .recipes."),
    (("{write = {command = 3}}", '{recipe = "a"}\n[recipes]\na = {recipe = "b"}\nb = {recipe = "a"}'), "a -> b -> a"),
    (("{write = {command = 3}}", "{write = {command = 70000}}"), "70000 does not fit"),
    (("halt = {write = {command = 3}}", "halt = [{pause = \"9 s\"}, {write = {command = 3}}]"), "a stop must start"),
    (("hydraulics-off = {write = {pump = 0}}", "hydraulics-off = {write = {pump = 1}}"), "off: .*hydraulics-on"),
    (("[faults]", "[watchdog]\nkind = \"counter\"\n[faults]"), "requires write"),
    (("[faults]", "[watchdog]\nkind = \"dog\"\n[faults]"), "must be 'counter'"),
    (("[faults]", "[setpoint]\nwrite = {target = \"$position\"}\n[faults]"), "a device with a function generator"),
    (("[faults]", "[indirect]\npointers = 1\ndata = 2\nquantities = [\"x\"]\n[faults]"), "'x' is not in"),
    (("format = 1", "format = 2"), "must be 1"),
    (("frequency = {address = 104", "frequency = {address = [104, 110]"), "requires 1 different addresses"),
    (("alarms    = {address = 3,", 'alarms = {address = [3, 200], type = "u32",'), "198 registers apart.*at most 125"),
    (("alarms    = {address = 3,", "alarms = {address = [3, 3], type = 'u32',"), "requires 2 different addresses"),
    (("pump      = {address = 0, function = \"coil\"}", "pump = {address = 90, bit = 2, access = 'w'}"), "first read"),
    (("pump      = {address = 0,", "pump = {address = 0, write_function = 22,"), "22 is not 5 or 15"),
    (("move-to = [{write = {target = \"$target\", speed = \"$speed\"}}, {write = {command = 1}}]\nstart = [\n"
      "    {write = {amplitude = \"$amplitude\", frequency = \"$frequency\", cycles = \"$all_cycles\"}},\n"
      "    {write = {command = 2}},\n]", "move-to = {write = {target = \"$target\"}}"), "only moves from one position"),
    (("format = 1", "format_ = 1"), "did you mean format"),
    (("[state] ", "[stat] "), "did you mean state"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), WRONG)
def test_what_cannot_be_is_refused_by_place(change: tuple[str, str], message: str | None) -> None:
    if message is None:
        read(edited(change))
        return
    assert any(re.search(message, problem) for problem in problems(edited(change))), problems(edited(change))


def test_recipes_that_double_thirty_times_are_refused_at_once() -> None:
    doubling = "".join(f'r{i} = [{{recipe = "r{i + 1}"}}, {{recipe = "r{i + 1}"}}]\n' for i in range(30))
    text = edited(("halt = {write = {command = 3}}", 'halt = [{write = {command = 3}}, {recipe = "r0"}]'))
    found = problems(f'{text}\n[recipes]\n{doubling}r30 = {{pause = "1 ms"}}\n')
    assert len(found) == 1
    assert "call other recipes more than 500 times" in found[0]


def test_all_problems_of_a_file_are_reported_at_once_in_the_order_of_its_lines() -> None:
    entries = edited(('unit = "Hz"', 'unit = "hertz"'), ("hold = 1", "held = 1"), ("halt = {write", "halt = {wait"))
    contradictions = edited(
        ('scale = 0.01, unit = "Hz"', "scale = 0"), ("moving = 2", "moving = 1"),
        ("{write = {pump = 0}}", "{write = {pumps = 0}}"), WRONG[1][0],
    )
    for text, count in ((entries, 4), (contradictions, 4)):
        lines = [int(problem.removeprefix("line ").partition(":")[0]) for problem in problems(text)]
        assert len(lines) >= count
        assert lines == sorted(lines)


@pytest.mark.parametrize(
    "text", ["", "a = [[[", "format = 1\n", "x = 1\n[y]\n", "quantities = 3\n", "[quantities]\nposition = 3\n"]
)
def test_what_is_no_register_map_is_refused(text: str) -> None:
    assert problems(text)


def test_every_map_that_is_read_fits_the_schema_and_editors_see_what_is_wrong() -> None:
    import tomllib

    validator = Draft202012Validator(SCHEMAS["register-map"]())
    for text in (SMALLEST, (FOLDER / "demo_controller.toml").read_text(encoding="utf-8")):
        assert [error.message for error in validator.iter_errors(json.loads(json.dumps(tomllib.loads(text))))] == []
    data = tomllib.loads(SMALLEST)
    data["quantities"]["position"]["adr"] = 3
    assert list(validator.iter_errors(data))


def test_limits_that_a_device_shows_as_well_as_it_can_are_held() -> None:
    text = edited(("cycles    =", 'position_min = {address = 200, type = "i16", unit = "mm"}\n'
                   'position_max = {address = 201, type = "i16", unit = "mm"}\ncycles    ='))  # fmt: skip
    controller = read(text)
    assert controller.capabilities.limits_read_back
    expected = ActuatorLimits(-0.0851, 0.085, 0.75, 60.0, 5000.0, 1.5, 20.0, 500)
    assert controller.held_limits({"position_min": -0.085, "position_max": 0.085}, expected) == expected
    other = controller.held_limits({"position_min": -0.085, "position_max": 0.095}, expected)
    assert other.position_max_m == pytest.approx(0.095)


def bench_with(folder: Path, register_map: str) -> Path:
    text = (ROOT / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
    assert 'register_map = "demo"' in text
    bench = folder / "bench.toml"
    bench.write_text(text.replace('register_map = "demo"', f'register_map = "{register_map}"'), encoding="utf-8")
    return bench


def test_a_bench_names_a_map_by_its_path_from_the_benchs_own_folder(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    path = tmp_path / "maps" / "mine.toml"
    path.write_text(SMALLEST, encoding="utf-8")
    bench = Bench.load(bench_with(tmp_path, "maps/mine.toml"))
    assert bench.actuator.register_map == str(path)
    before = bench.digest
    path.write_text(edited(("{write = {command = 3}}", "{write = {command = 5}}")), encoding="utf-8")
    assert Bench.load(tmp_path / "bench.toml").digest != before, "another map is another rig"
    other = tmp_path / "elsewhere"
    other.mkdir()
    (other / "same.toml").write_text(SMALLEST, encoding="utf-8")
    assert Bench.load(bench_with(other, "same.toml")).digest == before, "the same map at another place is the same rig"


def test_a_bench_with_a_wrong_map_tells_everything_that_is_wrong_in_it(tmp_path: Path) -> None:
    text = edited(("scale = 0.01, unit = \"Hz\"", "scale = 0"), ("hold = 1", "hold = 2"))
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    with pytest.raises(FileProblem) as refused:
        Bench.load(bench_with(tmp_path, "mine.toml"))
    reported = str(refused.value)
    of_map = r"line \d+: actuator.register_map = \"mine.toml\": mine.toml: line \d+: "
    assert re.search(rf"{of_map}quantities.frequency.scale = 0: ", reported)
    assert re.search(r"mine.toml: line \d+: state.moving = 2: hold and moving both have code 2", reported)
    with pytest.raises(FileProblem, match="there is no such file"):
        Bench.load(bench_with(tmp_path, "missing.toml"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (SMALLEST.encode("utf-16"), "UTF-16"),
        (SMALLEST.encode() + b"\n[[[", r"line \d+: not valid TOML"),
        (b"a = " + b"[" * 100_000, "nested more than 12 levels deep"),
        (b"#" * 300_000, "larger than 256 KiB"),
        (None, "is a folder"),
    ],
)
def test_a_map_that_is_no_such_file_is_refused_with_its_path(
    tmp_path: Path, content: bytes | None, message: str
) -> None:
    path = tmp_path / "mine.toml"
    if content is None:
        path.mkdir()
    else:
        path.write_bytes(content)
    with pytest.raises(FileProblem, match=message) as refused:
        table_of("register-map", path)
    assert str(path) in str(refused.value)


def test_a_map_upon_another_one_has_its_entries_but_for_those_it_is_without() -> None:
    controller = read('base = "demo"\nwithout = ["quantities.owner", "table"]\n[quantities]\nforce = {address = 700}\n')
    assert not controller.capabilities.lease
    assert not controller.capabilities.table
    assert controller.quantities["force"].address == 700
    assert "did you mean demo" in problems('base = "demos"\n')[0]
    assert any(
        "is not an entry in demo" in reported for reported in problems('base = "demo"\nwithout = ["state.holds"]\n')
    )


def test_a_generator_that_has_no_waveform_command_makes_sines_only() -> None:
    assert not read(SMALLEST).capabilities.triangle
    edited_map = edited(
        ("cycles    =", "shape = {address = 110}\ncycles    ="),
        ('cycles = "$all', 'shape = "$waveform", cycles = "$all'),
        ("[faults]", "[waveforms]\nsine = 1\ntriangle = 2\n[faults]"),
    )
    assert read(edited_map).capabilities.triangle
    assert not read(edited_map.replace("triangle = 2", "")).capabilities.triangle
    only = read(edited_map.replace("sine = 1", "")).capabilities
    assert (only.sine, only.triangle) == (False, True), "it goes between two points"


def test_a_bench_that_counts_on_a_watchdog_before_it_trips_is_refused(tmp_path: Path) -> None:
    slow = edited(
        ("cycles    =", "alive = {address = 110}\ncycles    ="),
        ("e-stop = {", 'watchdog = {quantity = "alarms", bit = 9}\ne-stop = {'),
        ("[faults]", '[watchdog]\nkind = "counter"\nwrite = {alive = "$counter"}\ntime = "2 s"\n[faults]'),
    )
    (tmp_path / "mine.toml").write_text(slow, encoding="utf-8")
    with pytest.raises(FileProblem, match=r"actuator.watchdog.*trips after 2000 ms; allowed: at least 2000 ms"):
        Bench.load(bench_with(tmp_path, "mine.toml"))
