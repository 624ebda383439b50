"""`rig check --listen` only listens, and the lines of a bench file that it proposes can be loaded."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import threading
from pathlib import Path

import cantools
import pytest

from drivers.sensor_formats import described_format
from protocols.line_format import LineFormat
from rig.bench.model import Bench
from rig.cli.main import main

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"
LINES = [f"ST,{5.0 * math.sin(k / 9.0):+08.3f} kN\r\n".encode() for k in range(120)]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    code = main(["check", "--listen", *arguments])
    return code, capsys.readouterr().out


def captured(folder: Path, data: bytes) -> str:
    path = folder / "captured.bin"
    path.write_bytes(data)
    return str(path)


@pytest.mark.parametrize("tail", [b"", b" S"])
def test_captured_lines_become_lines_of_a_bench_file_that_loads(
    tail: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ends = [tail and (b" O" if k > 110 else tail) for k in range(len(LINES))]
    lines = [line.replace(b"\r", end + b"\r") for line, end in zip(LINES, ends, strict=True)]
    code, reported = run(capsys, captured(tmp_path, b"".join(lines)[9:]), "--json")
    answer = json.loads(reported)
    assert (code, answer["found"], answer["readings"], answer["damaged"]) == (0, True, 119, 0)
    assert answer["examples"][0]["value"] == pytest.approx(5.0 * math.sin(1 / 9.0), abs=6e-4)
    demo = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
    begin, end = demo.index("[load_cell]"), demo.index("[lvdt]")
    bench = tmp_path / "bench.toml"
    bench.write_text(demo[:begin] + answer["toml"] + "\n" + demo[end:], encoding="utf-8")
    cell = Bench.load(bench).load_cell
    assert cell.sensitivity == 1000.0
    made = described_format(cell.format)
    assert isinstance(made, LineFormat)
    assert made.decode(lines[5].rstrip())[0] == pytest.approx(float(LINES[5][3:11]))
    assert not tail or math.isnan(made.decode(lines[111].rstrip())[0]), "the overload letter is kept"


def test_a_format_is_tried_on_captured_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("columns = { value = [4, 11], unit = [13, 14] }\nunit = \"kN\"\n", encoding="utf-8")
    data = captured(tmp_path, b"".join(LINES[:50]) + b"ST,+01x.000 kN\r\n" + b"".join(LINES[50:]))
    code, reported = run(capsys, data, "--format", str(mine))
    assert code == 0
    assert "are 119 readings; 1 damaged" in reported
    assert f"14 at {16 * 50}" in reported
    wrong, reported = run(capsys, data, "--format", "optoncdt")
    assert wrong == 5
    mine.write_text("columns = { value = [4, 11] }\nunt = \"kN\"\ndecimals = 12\n", encoding="utf-8")
    assert main(["check", "--listen", data, "--format", str(mine)]) == 2
    reported = capsys.readouterr().err
    assert "mine.toml: line 2: unt = " in reported
    assert "mine.toml: line 3: decimals = 12: too large (allowed: 0 to 9)" in reported


def test_a_port_is_listened_to_and_nothing_is_sent(capsys: pytest.CaptureFixture[str]) -> None:
    heard: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.settimeout(0.005)
                for line in LINES:
                    with contextlib.suppress(TimeoutError):
                        try:
                            connection.sendall(line)
                            heard.append(connection.recv(64))
                        except (BrokenPipeError, ConnectionResetError):
                            return

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        code, reported = run(capsys, f"socket://127.0.0.1:{server.getsockname()[1]}", "--seconds", "0.4", "--json")
        thread.join()
    answer = json.loads(reported)
    assert (code, answer["format"]) == (0, "lines")
    assert 50.0 < answer["rate_Hz"] < 210.0
    assert b"".join(heard) == b""


def test_what_fits_nothing_is_reported_with_what_to_try(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, reported = run(capsys, captured(tmp_path, bytes(range(256)) * 3))
    assert code == 5
    assert "no format matches; the data start with 00 01 02" in reported
    assert "add-a-sensor-format.md" in reported


@pytest.mark.parametrize("kind", ["dbc", "kcd", "sym"])
def test_a_log_of_a_bus_is_shown_by_identifiers_and_decoded_by_a_network_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    dbc = Path(__file__).resolve().parents[3] / "drivers/devices/demo_ecu.dbc"
    if kind != "dbc":
        network = cantools.database.load_file(dbc)
        dbc = tmp_path / f"demo.{kind}"
        dbc.write_text(getattr(network, f"as_{kind}_string")(), encoding="utf-8")
    # CoilTemperature 0x122: 31.5 degC, 25.0 degC, 13.50 V, boot count 3, little-endian as docs/wires.md has it.
    log = "".join(f"({k / 10:.6f}) can0 122#3B01FA0046050300\n({k / 10:.6f}) can0 7FF#0{k % 10}\n" for k in range(20))
    path = tmp_path / "bus.log"
    path.write_text(log, encoding="utf-8")
    code, reported = run(capsys, str(path), "--dbc", str(dbc), "--json")
    answer = json.loads(reported)
    assert (code, answer["frames"], answer["unknown_identifiers"]) == (0, 40, [0x7FF])
    temperature = answer["identifiers"][0]
    assert temperature["message"] == "CoilTemperature"
    assert temperature["signals"]["CoilTemperature"] == pytest.approx([31.5, 31.5])
    assert temperature["signals"]["Supply"] == pytest.approx([13.5, 13.5])
    assert temperature["period_ms"] == pytest.approx(100.0)
    code, reported = run(capsys, str(path))
    assert "7FF" in reported
    assert "changing bytes: 0" in reported


def test_a_port_that_is_not_there_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "--listen", "/dev/no-such-port", "--baud", "9600"]) == 2
    assert "cannot be opened: No such file" in capsys.readouterr().err
