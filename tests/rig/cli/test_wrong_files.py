"""Bench and matrix files wrong on purpose, as a test engineer writes them: one clear line each, exit 2, in a second.

Every row: a change to a good file, and what the message must say. All of them must name line, key and value where there
are such, and never show a pattern, a traceback or a character that commands the terminal.
"""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.cli.main import main
from rig.errors import EXIT_USAGE
from rig.matrix.model import Matrix, load_matrix

EXAMPLES = Path(__file__).parents[3] / "examples"
BENCH = (EXAMPLES / "demo-bench.toml").read_text()
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
[matrix]
amplitude = ["5 mm"]
frequency = ["1 Hz"]
current = ["0 A"]
cycles = 10
"""
SPEED, LOAD_CELL, TCP = 'speed = "0.8 m/s"', "/dev/serial/by-id/usb-load-cell", "modbus-tcp://192.168.0.10:502"
LONGEST_S = 1.0
MANY = ", ".join(f'"{number} mA"' for number in range(2000))

WRONG_BENCHES = {
    "no unit": (SPEED, 'speed = "0.8"', 'limits.speed = "0.8": 0.8 has no unit; a speed is written as,'),
    "bare number": (SPEED, "speed = 0.8", "the number 0.8 has no unit"),
    "unquoted quantity": (SPEED, "speed = 0.8 m/s", "not valid TOML: speed = 0.8 m/s: unexpected text after the value"),
    "foreign unit": (SPEED, 'speed = "3 kn"', 'unknown unit "kn" (known units: m/s, mm/s, cm/s, '),
    "unit with spaces": (SPEED, 'speed = "0.8 m / s"', 'did you mean "m/s"?'),
    "unit of another quantity": (SPEED, 'speed = "25 N"', "25 N is a force; a speed is written as, for example,"),
    "decimal comma": (SPEED, 'speed = "0,8 m/s"', "the decimal separator must be a point"),
    "empty text": (SPEED, 'speed = ""', "not a number with a unit"),
    "negative": (SPEED, 'speed = "-0.8 m/s"', "too small (allowed: more than 0 m/s to 5 m/s)"),
    "1e400": (SPEED, 'speed = "1e400 m/s"', "the number is too large"),
    "1e400 in the key's unit": (SPEED, "speed_m_s = 1e400", "limits.speed_m_s = inf"),
    "NaN": (SPEED, "speed = nan", "not a finite number"),
    "300 digits": (SPEED, "speed_m_s = 0x" + "f" * 300, "the integer has more than 64 bits"),
    "50,000 spaces": (SPEED, f'speed = "1 m{" " * 50_000}x"', "not a number with a unit"),
    "true": (SPEED, "speed = true", "not true or false"),
    "list": (SPEED, 'speed = ["0.8 m/s"]', "not a list"),
    "table": (SPEED, "speed = {}", "not a table"),
    "date": (SPEED, "speed = 2020-01-01", "not a date"),
    "unit of another quantity in the key": (SPEED, "speed_mm = 800", "unknown key; did you mean speed_mm_s?"),
    "twice": (SPEED, SPEED + "\n" + SPEED, "this key is specified twice; keep one of them"),
    "no closing quote": (SPEED, 'speed = "0.8 m/s', "the closing quote is missing"),
    "no equals sign": (SPEED, 'speed "0.8 m/s"', "expected key = value"),
    "backslash": (SPEED, r'speed = "\q"', "double each backslash in a string in double quotes"),
    "zero byte": (SPEED, SPEED + "#\0", "control character. Fix: delete it"),
    "escape sequence as key": (SPEED, SPEED + '\n"\\u001b[31mx" = 1', r"limits.\x1b[31mx = 1: unknown key"),
    "misspelt key": (SPEED, SPEED.replace("speed", "speeed"), "unknown key; did you mean speed?"),
    "key of another table": (SPEED, SPEED + '\npoll = "10 ms"', "this key is not allowed here. Fix: move it to "
        "[actuator]"),
    "table twice": ("[lvdt]", "[load_cell]", "this table is specified twice; put all its keys under one heading"),
    "missing key": ('force = "5 kN"\n', "", 'limits.force: missing; write, for example, force = "5 kN"'),
    "missing list": ('position = ["-85 mm", "85 mm"]\n', "", 'write, for example, position = ["-85 mm", "85 mm"]'),
    "one of two": ('["-85 mm", "85 mm"]', '["-85 mm"]', "limits.position[2]: missing; the list needs 2 entries"),
    "exchanged ends": ('["-85 mm", "85 mm"]', '["85 mm", "-85 mm"]', "the first value must be less than the second"),
    "whole number in quotes": ("device_id = 1", 'device_id = "1"', "must be a whole number (allowed: 0 to 255)"),
    "beyond the range": ("device_id = 1", "device_id = 300", "actuator.device_id = 300: too large (allowed: 0 to 255)"),
    "version in quotes": ("format = 1", 'format = "1"', "must be 1; write the number without quotes"),
    "name on two lines": ('name = "', 'name = "a\\nb', "must be 1 to 64 characters on one line, for example"),
    "maker instead of interface": ('"socketcan"', '"peak"', 'did you mean "pcan"? known: socketcan'),
    "upper case interface": ('"socketcan"', '"SocketCAN"', 'did you mean "socketcan"?'),
    "no port number": (TCP, "modbus-tcp://192.168.0.10", "requires a host and a port from 1 to 65535, for example"),
    "port 99999": (TCP, "modbus-tcp://192.168.0.10:99999", "port out of range"),
    "no scheme": (TCP, "192.168.0.10:502", 'must have a form such as "modbus-tcp://192.168.0.10:502" or "modbus-rtu:'),
    "serial line of no kind": (TCP, "modbus-rtu:tcp://a:1", "unknown kind of port tcp://"),
    "sensor without a scheme": (LOAD_CELL, "192.168.0.7:4001", 'write "socket://192.168.0.7:4001"'),
    "misspelt scheme": (LOAD_CELL, "sockt://192.168.0.7:4001", 'did you mean "socket://"?'),
    "negative sensitivity": (
        "sensitivity = 0.001", "sensitivity = -0.001", 'write sensitivity = 0.001 and polarity = "reversed"',
    ),
    "unknown polarity": (
        "sensitivity = 0.001", 'sensitivity = 0.001\npolarity = "inverted"', "must be 'normal' or 'reversed'",
    ),
    "NaN sensitivity": ("sensitivity = 0.001", "sensitivity = nan", "must be a finite number"),
    "due date as text": ("due = 2030-01-01", 'due = "2030-01-01"', "must be a date such as 2030-01-01"),
    "thirteenth month": ("due = 2030-01-01", "due = 2030-13-01", "dates must have the form 2030-01-31"),
}  # fmt: skip

WRONG_MATRICES = {
    "value twice": ('["1 Hz"]', '["1 Hz", "1 Hz"]', "duplicate value 1 Hz; to repeat points, set `repeats = N`"),
    "value twice in other units": ('["5 mm"]', '["5 mm", "0.5 cm"]', "duplicate value 5 mm; to repeat points, set"),
    "no list": ('["1 Hz"]', '"1 Hz"', "must be a list in [ ]"),
    "negative current": ('["0 A"]', '["-1 A"]', 'matrix.current[1] = "-1 A": too small (allowed: 0 A to 20 A)'),
    "two cycles": ("cycles = 10", "cycles = 2", "matrix.cycles = 2: too small (allowed: 3 to 10000)"),
    "no repeats": ("cycles = 10", "repeats = 0", "too small (allowed: 1 to 1000)"),
    "unknown waveform": ("cycles = 10", 'waveform = ["sinus"]', "'road' or 'file'; did you mean sine?"),
    "frequency left out": ('frequency = ["1 Hz"]\n', "", "missing: frequency (or speed). Fix: specify current"),
    "serial number with a blank": ('"MR-001"', '"MR 001"', '- or _ (at most 32 characters), for example "MR-001"'),
    "path as serial number": ('"MR-001"', '"../x"', "must be a letter or digit, followed by letters, digits"),
    "no points": (MATRIX[MATRIX.index("[matrix]") :], "", "no test points are defined. Fix: complete [matrix], or add "
        "a [[point]]"),
    "single brackets": ("cycles = 10", "[point]", "its own heading in double brackets: [[point]]"),
    "empty point": ("cycles = 10", "[[point]]", 'point[1].current: missing; write, for example, current = "0.5 A"'),
    "method misspelt": ("cycles = 10", '[identify]\nmethod = "separably"', "did you mean separable?"),
    "model misspelt": ("cycles = 10", '[identify]\nmodel = "bouc-wen"', "unknown model; did you mean bouc_wen?"),
    "setting under the wrong table": (
        "cycles = 10", "[identify]\nrepeats = 2", "this key is not allowed here. Fix: move it to [matrix]",
    ),
    "random without a seed": ("cycles = 10", 'order = "random"', 'order = "random" requires a seed, for example seed '
        '= 1'),
    "millions of points": (
        '["0 A"]', f"[{MANY}]\nrepeats = 1000",
        "2000000 test points: (1 x 2000 x 1 x 1 waveforms x currents",
    ),
}  # fmt: skip

Run = Callable[[str, Path], str]


@pytest.fixture
def run_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Plan with a wrong file of one kind and a good one of the other; give what standard error says."""

    def run(kind: str, wrong: Path) -> str:
        good = tmp_path / "good.toml"
        good.write_text(MATRIX if kind == "bench" else BENCH)
        files = (good, wrong) if kind == "bench" else (wrong, good)
        begun_s = time.process_time()
        code = main(["plan", str(files[0]), "--bench", str(files[1])])
        assert time.process_time() - begun_s < LONGEST_S
        output = capsys.readouterr()
        assert (code, output.out) == (EXIT_USAGE, "")
        assert "Traceback" not in output.err
        assert not re.search(r"\^\[|\(\?|\\x[0-9a-f]{2}-|\$\"|pattern|[\x00-\x09\x0b-\x1f\x7f]", output.err), output.err
        return output.err

    return run


def lines_of(error: str, path: Path) -> list[str]:
    """The lines without the file's name, which each must begin with."""
    assert all(line.startswith(f"{path}: ") for line in error.splitlines()), error
    return [line.removeprefix(f"{path}: ") for line in error.splitlines()]


@pytest.mark.parametrize(
    ("kind", "old", "new", "expected"),
    [("bench", *row) for row in WRONG_BENCHES.values()]
    + [("matrix", *row) for row in WRONG_MATRICES.values()],
    ids=[name for name, row in WRONG_BENCHES.items()] + list(WRONG_MATRICES),
)
def test_a_wrong_entry_is_one_clear_line(
    run_rig: Run, tmp_path: Path, kind: str, old: str, new: str, expected: str
) -> None:
    text = BENCH if kind == "bench" else MATRIX
    assert old in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(old, new, 1))
    lines = lines_of(run_rig(kind, path), path)
    assert any(expected in line for line in lines), lines
    assert len(lines) == 1, lines
    if "test point" not in expected:
        assert re.match(r"line \d+: ", lines[0]), lines


def test_what_a_slcan_channel_must_be_is_a_port_too(run_rig: Run, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    text = BENCH.replace('"socketcan"', '"slcan"').replace('channel = "can0"', 'channel = "tcp://h:1"')
    path.write_text(text)
    (line,) = lines_of(run_rig("bench", path), path)
    assert 'ecu.channel = "tcp://h:1": unknown kind of port tcp://' in line


ENCODINGS = {
    "empty": (b"", "this file has no entries"),
    "only comments": (b"# nothing\n", "this file has no entries"),
    "latin-1": (b"# a\n# 20 \xb0C\n", "line 2: not UTF-8 text (byte 0xb0 at 9). Fix: save the file as UTF-8"),
    "UTF-16": (BENCH.encode("utf-16"), "UTF-16 text. Fix: save it as UTF-8"),
    "CR alone": (BENCH.replace("\n", "\r").encode(), "the lines end with CR alone. Fix: save the file with LF or "
        "CR LF"),
    "binary": (b"\x89HDF\r\n\x1a\n" + bytes(100), "line 1: not UTF-8 text"),
    "JSON": (b'{"format": 1}', "line 1: not valid TOML"),
    "YAML": (b"limits:\n  speed: 0.8 m/s\n", "line 1: not valid TOML: limits:"),
    "50,000 dotted keys": (b"a" + b".a" * 50_000 + b" = 1", "line 1: a key has more than 12 parts"),
    "dots in a heading": (b"[" + b".".join([b"a"] * 100_000) + b"]", "line 1: a key has more than 12 parts"),
    "nested lists": (b"a = " + b"[" * 100_000, "line 1: lists and tables are nested more than 12 levels deep"),
    "nested tables": (b"a = " + b"{a=" * 50_000, "nested more than 12 levels deep"),
    "28,000 keys": (b"".join(b"k%d=1\n" % n for n in range(28_000)), "further errors omitted"),
    "20,000 dotted keys": (b"".join(b"k%d.a=1\n" % n for n in range(20_000)), "line 1: k0: unknown key"),
    "9,000 empty lists": (
        b"format=1\n" + b"[[current_step]]\ncurrent=[]\n" * 9_000, "too many entries; allowed: at most 30000",
    ),
    "120,000 numbers": (b"a=[" + b"1," * 120_000 + b"]", "too many entries; allowed: at most 30000"),
    "open quotes": (b'"a' * 80_000, "line 1: not valid TOML"),
    "a megabyte": (b"#" * 1_000_000, "larger than 256 KiB"),
    "a number of 5,000 digits": (b"a = " + b"1" * 5000, "not valid TOML"),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["bench", "matrix"])
@pytest.mark.parametrize(("content", "expected"), ENCODINGS.values(), ids=ENCODINGS)
def test_a_file_that_is_none_is_refused_at_once(
    run_rig: Run, tmp_path: Path, kind: str, content: bytes, expected: str
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_bytes(content)
    lines = lines_of(run_rig(kind, path), path)
    assert any(expected in line for line in lines), lines[:3]
    assert len(lines) <= 50


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _loop(path: Path) -> None:
    path.symlink_to(path.name)


def _unix_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(path))


PLACES: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: None, "there is no such file"),
    "folder": (Path.mkdir, "is a folder, not a file"),
    "pipe": (_pipe, "is a pipe, not a file"),
    "symlink loop": (_loop, "cannot be read: "),
    "endless device": (lambda path: path.symlink_to("/dev/zero"), "is a device, not a file"),
    "socket": (_unix_socket, "cannot be read: "),
}


@pytest.mark.parametrize("kind", ["bench", "matrix"])
@pytest.mark.parametrize(("make", "expected"), PLACES.values(), ids=PLACES)
def test_what_is_no_regular_file_is_refused_without_waiting(
    run_rig: Run, tmp_path: Path, kind: str, make: Callable[[Path], object], expected: str
) -> None:
    path = tmp_path / "wrong.toml"
    make(path)
    (line,) = lines_of(run_rig(kind, path), path)
    assert expected in line


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_an_unreadable_file_is_refused(run_rig: Run, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(BENCH)
    path.chmod(0)
    assert "cannot be read: Permission denied" in run_rig("bench", path)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace(" = ", "\t=\t"),
    ],
    ids=["BOM", "CR LF", "tabs"],
)
def test_how_editors_save_is_no_mistake(tmp_path: Path, change: Callable[[str], str]) -> None:
    bench, matrix = tmp_path / "bench.toml", tmp_path / "matrix.toml"
    bench.write_bytes(change(BENCH).encode())
    matrix.write_bytes(change(MATRIX).encode())
    assert Bench.load(bench) == Bench.load(EXAMPLES / "demo-bench.toml")
    assert isinstance(load_matrix(matrix), Matrix)


def test_exchanged_files_are_one_line_that_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    matrix, bench = tmp_path / "m.toml", tmp_path / "b.toml"
    matrix.write_text(MATRIX)
    bench.write_text(BENCH)
    assert main(["plan", str(bench), "--bench", str(matrix)]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"this is the bench file. Fix: rig plan {matrix} --bench {bench}")
    assert "exchanged" in line


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (("m", "--bench", "m"), "this is a matrix file, expected a bench file"),
        (("b", "--bench", "b"), "this is a bench file, expected a matrix file"),
        (("s", "--bench", "b"), "this is a study file, expected a matrix file. Fix: pass it as rig study"),
    ],
)
def test_a_file_of_another_kind_is_called_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], files: tuple[str, ...], expected: str
) -> None:
    texts = {"m": MATRIX, "b": BENCH, "s": (EXAMPLES / "paper-tables.toml").read_text()}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert main(["plan", *(str(tmp_path / item) if item in texts else item for item in files)]) == EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
