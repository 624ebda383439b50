"""Feeds damaged input to every parser: `python tests/fuzz/fuzz.py [--inputs N] [--seed S] [TARGET...]`.

Two things are demanded of each input: nothing but the parser's own error comes out (a crash is anything else), and what
is accepted is what the bytes say, told by another way of reading them (no silent wrong value). HDF5 is read by a C
library: run as a command, every target has a process of its own, so a crash there is seen and reported too.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import math
import random
import re
import subprocess
import sys
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from decimal import Decimal
from functools import cache
from pathlib import Path

import cantools
import h5py
import numpy as np
from damage import chunks, damaged

from drivers.current_source import SourceCounters
from drivers.devices.source import FOLDER, current_source
from drivers.frame_checks import FrameChecks
from drivers.register_maps.map_file import controller
from drivers.register_maps.recipe import Write
from drivers.roles import ActuatorLimits, WatchdogAction
from protocols import frame_format, line_format, modbus, slcan
from protocols.binary_decoder import BinaryDecoder
from protocols.binary_format import BinaryFormat
from protocols.errors import RemoteProtocolError
from protocols.sensor_format import from_description, preset
from protocols.sensor_presets import TABLES
from rig.bench.model import Bench
from rig.errors import FileProblem
from rig.files.descriptions import problems_of
from rig.matrix.model import load_matrix
from rig.recording.conversion.conversion import finish_alone
from rig.recording.external_tests import ImportSettings, read_tests
from rig.recording.file_formats.table_file import Dialect
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.importing import import_tests
from rig.recording.journal.journal_file import JournalWriter, parse_journal
from rig.recording.layout import AlignedChannel, PointContext, PointFile, SensorContext
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.recording.run import Run
from rig.test_point import TestPoint
from simulators.ecu_wire import Command as CurrentCommand
from simulators.ecu_wire import Shown
from simulators.emulated_ecu import DEMO_ECU
from simulators.frame_writer import FrameWriter
from simulators.line_writer import LineWriter

EXAMPLES = Path(__file__).parents[2] / "examples"
INPUTS = 20_000
SLOW = {"bench": 20, "matrix": 20, "csv": 40, "foreign": 20, "hdf5": 20, "hdf5-structure": 20, "journal": 20}
"""Targets that read files take this many times fewer inputs."""

DEMO = controller("demo")
LIMITS = ActuatorLimits(-0.08, 0.08, 0.8, 60.0, 5e3, 1.0, 20.0, 500, WatchdogAction.FADE_AND_HOLD)
DEMO_DBC = cantools.database.load_file(FOLDER / "demo_ecu.dbc")
COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
TEST = {"id": "p001", "waveform": "sine", "amplitude_m": 0.05, "frequency_Hz": 1.0, "current_A": 0.5}


def fuzz_frame16(source: random.Random) -> None:
    """Sensor frames: every reading given, encoded again, stands in the bytes."""
    sent = [
        frame_format.encode(source.uniform(-1e4, 1e4), source.randrange(1 << 16), source.randrange(1 << 32), 0, 3)
        for _ in range(source.randrange(1, 5))
    ]
    data = damaged(b"".join(sent), source)
    decoder = frame_format.FrameDecoder()
    for reading in [each for part in chunks(data, source) for each in decoder.feed(part)]:
        sequence, device_us, value, status, edges = reading
        if not math.isnan(value):
            assert frame_format.encode(value, sequence, device_us, status, edges) in data


def fuzz_lines(source: random.Random) -> None:
    """Readings of every shipped line format: the number's digits stand in the bytes, in this order."""
    names = [name for name in TABLES if isinstance(preset(name), line_format.LineFormat)]
    shipped = preset(source.choice(names))
    assert isinstance(shipped, line_format.LineFormat)
    numbers = np.array([round(source.uniform(0, 9), 1) for _ in range(4)])
    data = damaged(LineWriter(shipped, -9.0, 9.0)(numbers, np.zeros(4, np.uint8)).tobytes(), source)
    decoder = line_format.LineDecoder(shipped)
    for _, _, value, _, _ in [each for part in chunks(data, source) for each in decoder.feed(part)]:
        if math.isfinite(value):
            digits = f"{Decimal(repr(abs(value))):f}".replace(".", "").strip("0").encode()
            assert digits in re.sub(rb"[^0-9]", b"", data), (value, data)
        else:
            assert math.isnan(value)


def fuzz_frames(source: random.Random) -> None:
    """Described frames, drawn and damaged: what passes a CRC was sent; what passes nothing but marks is finite."""
    size = source.choice((1, 2, 3, 4))
    sum_kind = source.choice(("crc16-modbus", "crc32", "crc16-x25", "none"))
    stuffing = source.choice(("none", "dle", "slip", "escape"))
    marks = {
        "none": {"sync": [0xA5, 0x5A]}, "dle": {"sync": [0x10, 2], "end": [0x10, 3]}, "slip": {"end": [0xC0]},
        "escape": {"sync": [2], "end": [3]},
    }[stuffing]  # fmt: skip
    sync = len(marks.get("sync", []))
    made = from_description({
        **marks, "stuffing": stuffing, "checksum": sum_kind,
        "length": sync + size + {"crc32": 4, "none": 0}.get(sum_kind, 2) + len(marks.get("end", [])),
        "fields": {"value": {"at": sync, "type": f"i{8 * size}", "order": source.choice(("little", "big"))}},
    })  # fmt: skip
    assert isinstance(made, BinaryFormat)
    numbers = [float(source.randrange(-(1 << 8 * size - 1), 1 << 8 * size - 1)) for _ in range(5)]
    writer, plain = FrameWriter(made, 0.0, 1.0), np.zeros(5, np.int64)
    data = damaged(writer.joined(writer(np.array(numbers), plain.astype(np.uint8), plain, plain)), source)
    decoder = BinaryDecoder(made)
    for _, _, value, _, _ in [each for part in chunks(data, source) for each in decoder.feed(part)]:
        assert math.isfinite(value)
        assert sum_kind == "none" or value in numbers, (value, numbers)


def fuzz_formats(source: random.Random) -> None:
    """A description with anything in it is a format, or every reason why it is none."""
    anything = [0, -1, 1.5, "", "x", "\\", "(?P<value>", [1], [3, 1], {}, {"value": 3}, True, "é", ["", []]]
    table = dict(source.choice([TABLES[name] for name in TABLES]))
    for _ in range(source.randrange(1, 4)):
        known = sorted({*table, "sync", "fields", "packed", "columns", "separator", "request", "bits", "kind"})
        table[source.choice(known)] = source.choice(anything)
    if not problems_of("sensor-format", table):
        from_description(table)


def fuzz_slcan(source: random.Random) -> None:
    """CAN frames as lines: each one given, written again, stands in the bytes."""
    sent = [slcan.encode_frame(source.randrange(0x800), source.randbytes(source.randrange(9))) for _ in range(4)]
    sent.append(slcan.encode_frame(source.randrange(1 << 29), b"", extended=True, remote=True, length=3))
    data = damaged(b"".join(sent), source)
    decoder = slcan.SlcanDecoder()
    for frame in [each for part in chunks(data, source) for each in decoder.feed(part)]:
        identifier, payload, extended, remote, length = frame
        line = slcan.encode_frame(identifier, payload, extended, remote, length)[:-1]
        assert line in data.upper().replace(b"\a", b"").replace(b"T", b"t") or line.lower() in data.lower().replace(
            b"\a", b""
        )


def fuzz_ecu(source: random.Random) -> None:
    """ECU frames: a status that the driver accepts is what cantools reads; the simulated ECU takes any command."""
    ecu, driver = DEMO_ECU.load(), current_source("demo")
    current_A, counter = round(source.uniform(-3, 3), 3), source.randrange(15)
    for _ in range(counter):
        ecu.frame("CoilStatus", Shown())
    data = damaged(ecu.frame("CoilStatus", Shown(2, current_A, device_us=7700))[1], source)
    status = driver.heard[driver.status]
    checks = FrameChecks(driver, SourceCounters())
    if len(data) == status.size and checks.step(driver.status, status, data) is not None:
        decoded = DEMO_DBC.decode_message("CoilStatus", data)
        assert math.isclose(status.reader.read(data)["measured_current"], decoded["Current"])
    for sent in (data, damaged(ecu.commands(CurrentCommand(counter, True, False, current_A))[0][1], source)):
        with contextlib.suppress(RemoteProtocolError):
            ecu.command(0x120, sent)


def fuzz_modbus(source: random.Random) -> None:
    """Frames and registers: accepted words are the bytes of the answer, accepted limits encode to the same words."""
    (read,), (written,) = DEMO.limit_reads, Write(DEMO.limit_values(LIMITS)).requests({})
    request, words = modbus.read_request(read.address, read.count), written.words
    answer = bytes([3, 2 * len(words)]) + b"".join(word.to_bytes(2, "big") for word in words)
    data = damaged(modbus.encode_tcp(7, 1, answer), source)
    frames = modbus.TcpFrames()
    with contextlib.suppress(RemoteProtocolError):
        for part in chunks(data, source):
            frames.feed(part)
            while (frame := frames.next()) is not None:
                got = modbus.decode_words(request, frame[2], read.count)
                assert b"".join(word.to_bytes(2, "big") for word in got) in data
                limits = DEMO.held_limits(read.decode(got), None)
                if all(map(math.isfinite, asdict(limits).values())):
                    (again,) = Write(DEMO.limit_values(limits)).requests({})
                    assert list(again.words) == list(got)
    with contextlib.suppress(RemoteProtocolError):
        modbus.rtu_answer_size(data, request)


@contextmanager
def file_of(data: bytes, name: str) -> Iterator[Path]:
    """A file with these bytes, for a moment."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        yield path


def quantity(text: object, units: dict[str, float]) -> float | None:
    """The SI value of `number unit`; None for what this reader does not know."""
    found = re.fullmatch(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*(\S+)\s*", text) if isinstance(text, str) else None
    return float(found[1]) * units[found[2]] if found and found[2] in units else None


def fuzz_bench(source: random.Random) -> None:
    """Bench files: an accepted speed and force limit is the file's number in its unit."""
    data = damaged((EXAMPLES / "demo-bench.toml").read_bytes(), source)
    with file_of(data, "bench.toml") as path, contextlib.suppress(FileProblem):
        bench = Bench.load(path)
        limits = tomllib.loads(data.decode())["limits"]
        low, high = bench.limits.position_m
        assert -1.0 <= low < high <= 1.0
        for value, key, units in (
            (bench.limits.speed_m_s, "speed", {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2}),
            (bench.limits.force_N, "force", {"N": 1.0, "kN": 1e3}),
        ):
            expected = quantity(limits.get(key), units)
            assert math.isfinite(value)
            assert value > 0
            assert expected is None or math.isclose(value, expected, rel_tol=1e-12)


def fuzz_matrix(source: random.Random) -> None:
    """Matrix files: accepted amplitudes and frequencies are the file's; every point is finite and named once."""
    data = damaged((EXAMPLES / "quick.toml").read_bytes(), source)
    with file_of(data, "matrix.toml") as path, contextlib.suppress(FileProblem):
        points = load_matrix(path).points()
        assert len({point.id for point in points}) == len(points)
        given = tomllib.loads(data.decode()).get("matrix", {})
        amplitudes = [quantity(text, {"mm": 1e-3, "m": 1.0, "cm": 1e-2}) for text in given.get("amplitude", ())]
        for point in points:
            assert all(map(math.isfinite, (point.amplitude_m, point.frequency_Hz, point.current_A)))
            if amplitudes and None not in amplitudes and "point" not in tomllib.loads(data.decode()):
                assert any(math.isclose(point.amplitude_m, value or 0.0, rel_tol=1e-9) for value in amplitudes)


def csv_text() -> bytes:
    time_s = np.arange(400) * 0.01
    x_mm, force_N = 5.0 * np.sin(2 * np.pi * time_s), 300.0 * np.cos(2 * np.pi * time_s)
    rows = [f"{t:.3f},{x:.4f},{f:.2f}" for t, x, f in zip(time_s, x_mm, force_N, strict=True)]
    return "\n".join(["t_s,x_mm,F_N", *rows, ""]).encode()


CSV = csv_text()


def fuzz_csv(source: random.Random) -> None:
    """Foreign tests: refused with the line, or every force is the number in its line; NaN where the line has none.

    A last line that was cut off may have its number in part, or no place: nothing is believed of it.
    """
    data = damaged(CSV, source)
    with file_of(data, "a.csv") as path, contextlib.suppress(FileProblem):
        run = Run.open(import_tests([path], columns=COLUMNS, out=path.parent / "out", current_A=0.5))
        lines = [line.split(",") for line in data.decode().strip().splitlines() if line.strip()]
        column = [name.strip() for name in lines[0]].index("F_N")
        cells = [line[column].strip() if len(line) > column else "" for line in lines[1:]]
        expected = np.array([math.nan if cell in {"", "-", "--"} else float(cell) for cell in cells])
        force_N = run.points[0].force_N
        if not data.endswith(b"\n") and (len(force_N) < len(expected) or np.isnan(force_N[-1])):
            force_N, expected = force_N[: len(expected) - 1], expected[:-1]
        np.testing.assert_allclose(force_N, expected, rtol=1e-6, atol=1e-3)


def text_blocks(times: np.ndarray, x: np.ndarray, force: np.ndarray) -> bytes:
    """Blocks with repeated headings, thousands by an apostrophe, an event, a number for no value."""
    rows = [f"{t:.3f}\t{a:.3f}\t{f:,.1f}".replace(",", "'") for t, a, f in zip(times, x, force + 2000.0, strict=True)]
    rows[70] = "0.7\tSwitched\t"
    rows[90] = "0.900\t-9999\t2'000.0"
    heading = "Time\tStroke\tLoad\nSec\tmm\tN\n"
    first, second = "\n".join(rows[:100]), "\n".join(rows[100:])
    return f"MTS793|MPT\n\n{heading}{first}\n\nData\t1\n{heading}{second}".encode()


def text_lvm(times: np.ndarray, x: np.ndarray, force: np.ndarray) -> bytes:
    """Two segments."""
    text = "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\tOne\n***End_of_Header***\n\n"
    for part in (slice(0, 100), slice(100, 200)):
        text += ("Channels\t2\nY_Unit_Label\tmm\tN\nX_Dimension\tTime\tTime\nX0\t0\t0\nDelta_X\t0.01\t0.01\n"
                 "***End_of_Header***\nX_Value\tStroke\tLoad\tComment\n")  # fmt: skip
        rows = zip(times[part], x[part], force[part], strict=True)
        text += "".join(f"{t:.3f}\t{a:.4f}\t{f:.3f}\n" for t, a, f in rows)
    return text.encode()


def imported_files() -> list[tuple[str, bytes, dict[str, str]]]:
    """Small files of every format that is read, each with the columns of its test."""
    from nptdms import ChannelObject, TdmsWriter
    from openpyxl import Workbook
    from scipy.io import savemat

    t = np.arange(200) * 0.01
    x, force = 20.0 * np.sin(6.28 * t), 900.0 * np.cos(6.28 * t)
    named = {"time": "Time", "displacement": "Stroke", "force": "Load"}
    by_path = {"time": "r/t:s", "displacement": "r/x:mm", "force": "r/F:N"}
    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        file["r/t"], file["r/x"], file["r/F"] = t, x, force
    matlab = io.BytesIO()
    savemat(matlab, {"d": np.array([{"t": t, "x": x, "F": force}] * 2, dtype=object)}, do_compression=True)
    scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": "Linear", "NI_Scale[0]_Linear_Slope": 0.05,
             "NI_Scale[0]_Linear_Y_Intercept": 0.0, "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF}  # fmt: skip
    tdms = io.BytesIO()
    with TdmsWriter(tdms) as writer:
        writer.write_segment([
            ChannelObject("g", "Stroke", x, {"wf_increment": 0.01, "unit_string": "mm"}),
            ChannelObject("g", "Load", np.round(20.0 * force).astype(np.int16),
                          {"wf_increment": 0.01, "unit_string": "N", **scale}),
        ])  # fmt: skip
    book, sheet = io.BytesIO(), Workbook()
    numbers = np.column_stack([t, x, force]).tolist()
    for row in [["Time", "Stroke", "Load"], ["s", "mm", "N"], *numbers]:
        sheet.active.append(row)
    sheet.save(book)
    keys = {"FORMAT": "BINARY", "NUM_HEADER_BLOCKS": "4", "CHANNELS": "2", "DELTA_T": "0.01", "PTS_PER_FRAME": "50",
            "PTS_PER_GROUP": "100", "FRAMES": "4", "DESC.CHAN_1": "Stroke", "UNITS.CHAN_1": "mm",
            "SCALE.CHAN_1": "0.001", "DESC.CHAN_2": "Load", "UNITS.CHAN_2": "N", "SCALE.CHAN_2": "0.05"}  # fmt: skip
    head = b"".join(key.encode().ljust(32, b"\0") + value.encode().ljust(96, b"\0") for key, value in keys.items())
    samples = np.round(np.stack([x / 0.001, force / 0.05])).astype("<i2").reshape(2, 2, 100).transpose(1, 0, 2)
    unnamed = {"displacement": "Stroke", "force": "Load"}
    return [
        ("a.dat", text_blocks(t, x, force), named), ("a.lvm", text_lvm(t, x, force), unnamed),
        ("a.h5", held.getvalue(), by_path), ("a.tdms", tdms.getvalue(), unnamed), ("a.xlsx", book.getvalue(), named),
        ("a.mat", matlab.getvalue(), {"time": "d(1).t:s", "displacement": "d(1).x:mm", "force": "d(1).F:N"}),
        ("a.rsp", head.ljust(2048, b"\0") + samples.tobytes(), unnamed),
    ]  # fmt: skip


@cache
def whole_files() -> list[tuple[str, bytes, dict[str, str]]]:
    """These files, made once; each is read before it is damaged."""
    made = imported_files()
    for name, data, columns in made:
        with file_of(data, name) as path:
            (test,) = read_tests([path], ImportSettings(columns, 0.5, dialect=Dialect(event_rows="skip")))
            assert abs(np.nanmax(test.displacement_m) - 0.02) < 1e-4
    return made


def fuzz_imported(source: random.Random) -> None:
    """Files of other programs: refused in words, or read, whatever is damaged."""
    name, data, columns = source.choice(whole_files())
    dialect = Dialect(
        event_rows=source.choice(("refuse", "skip", "split")), thousands=source.choice((None, "", ",", "'")),
        sheet=source.choice((None, "all")),
    )
    with file_of(damaged(data, source), name) as path, contextlib.suppress(FileProblem), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for test in read_tests([path], ImportSettings(columns, 0.5, dialect=dialect)):
            assert len(test.time_s) == len(test.force_N) >= 16
            assert np.all(np.diff(test.time_s) > 0.0)


def hdf5_bytes() -> bytes:
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        path = Path(folder) / "p001.h5"
        time_s = np.arange(500) / 250.0
        channels = [AlignedChannel("force", np.sin(time_s), "N", "Force"),
                    AlignedChannel("displacement", np.cos(time_s), "m", "Displacement")]  # fmt: skip
        write_file(path, PointFile(time_s, 250.0, channels, test=TEST))
        return path.read_bytes()


HDF5: list[bytes] = []


def fuzz_hdf5(source: random.Random) -> None:
    """Points from outside: refused, or read; a declared length is what comes."""
    if not HDF5:
        HDF5.append(hdf5_bytes())
    with file_of(damaged(HDF5[0], source), "p001.h5") as path, contextlib.suppress(FileProblem):
        point = RecordedPoint.open(path)
        assert len(point.time_s) == len(point.force_N) == len(point.displacement_m)


def fuzz_hdf5_structure(source: random.Random) -> None:
    """Sound HDF5 with something in it that no recording has: refused by name, or read without a word of it."""
    if not HDF5:
        HDF5.append(hdf5_bytes())
    with file_of(HDF5[0], "p001.h5") as path:
        with h5py.File(path, "r+") as file:
            place = file[source.choice(["/", "entry", "entry/data", "entry/test", "entry/events"])]
            odd = source.randrange(8)
            if odd == 0:
                shape = (source.choice([1, 500, 10**6, 10**9, 2**40]),)
                chunks = (min(shape[0], source.choice([1, 500, 10**6, 2**28])),)
                place.create_dataset("odd", shape, source.choice(["i1", "f8", "S3", "S70000", "f2", "?", "c16"]),
                                     chunks=chunks, compression=source.choice([None, "gzip", "lzf"]))
            elif odd == 1:
                place.attrs["odd"] = source.choice([np.zeros(2**source.randrange(20)), "text", np.zeros((2, 2)), True])
            elif odd == 2:
                place["odd"] = source.choice([h5py.SoftLink("/entry"), h5py.ExternalLink("x.h5", "/"), file["entry"]])
            elif odd == 3:
                place["odd"] = np.dtype([("a", "i4")])
            elif odd == 4:
                place.attrs["odd"] = source.choice([file["entry"].ref, file["entry/data/force"].regionref[1:3]])
            elif odd == 5:
                inner = place
                for _ in range(source.randrange(10)):
                    inner = inner.create_group("odd")
            elif odd == 6:
                for number in range(source.choice([3, 2_500])):
                    place[f"odd{number}"] = file["entry/data/force"]
            else:
                place.create_dataset("odd", data=["a", "b"], dtype=h5py.string_dtype())
        with contextlib.suppress(FileProblem):
            point = RecordedPoint.open(path)
            assert len(point.time_s) == len(point.force_N) == 500


def journal_bytes() -> bytes:
    """A point of two sensors, two status channels and an event."""
    sensors = {"force": SensorContext("load_cell", 250.0), "displacement": SensorContext("lvdt", 250.0)}
    context = PointContext(TestPoint(**TEST, cycles=3), sensors)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        writer = JournalWriter(Path(folder) / "p001.journal", context.to_json())
        time_s = np.arange(1250) / 250.0
        for channel, value in ((1, 300.0 * np.cos(6.3 * time_s)), (2, 0.05 * np.sin(6.3 * time_s)), (20, 0 * time_s)):
            records = np.zeros(len(time_s), RECORD_DTYPE)
            records["host_ns"], records["device_us"] = 1e9 * (100.0 + time_s), 1e6 * time_s
            records["value"], records["channel"], records["sequence"] = value, channel, np.arange(len(time_s))
            writer.append(records)
        writer.event(100_000_000_000, "note", "text")
        writer.close(stopped_by=None, lost_records=0)
        return writer.path.read_bytes()


JOURNAL: list[bytes] = []
EXTREMES = (0, 1, -1, 2**31, 2**32 - 1, 2**63 - 1, -(2**63), 1e308, math.inf, math.nan, 10**400, "x", None, [], {})


def fuzz_journal(source: random.Random) -> None:
    """Journals damaged, or with sound checks and numbers that cannot be: a file, or a named error and the journal."""
    if not JOURNAL:
        JOURNAL.append(journal_bytes())
    data = damaged(JOURNAL[0], source) if source.random() < 0.3 else _absurd(JOURNAL[0], source)
    with file_of(data, "p001.journal") as path, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        answer = finish_alone(path)
        assert path.exists() == bool(answer.error), answer
        assert answer.error or RecordedPoint.open(Path(answer.file)).samples > 0


def _absurd(data: bytes, source: random.Random) -> bytes:
    """The journal written again with one entry of its header or some of its records changed, its checks right."""
    content = parse_journal(data)
    header, records = json.loads(content.context_json), content.records.copy()
    if source.random() < 0.5:
        inner = source.choice([header, header["point"], header["sensors"]["force"], header["sensors"]["displacement"]])
        inner[source.choice(sorted(inner))] = source.choice(EXTREMES)
    else:
        field = source.choice(RECORD_DTYPE.names or ())
        rows = source.choice([slice(None), slice(5), slice(700, 701), slice(0, None, 7)])
        with np.errstate(all="ignore"):
            if field == "value":
                records[field][rows] = source.choice([1e308, -1e308, math.inf, math.nan, 5e-324])
            else:
                kind = np.iinfo(RECORD_DTYPE[field])
                records[field][rows] = source.choice([kind.min, kind.max, 0, kind.max // 2, kind.max // 1000])
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        writer = JournalWriter(Path(folder) / "p001.journal", json.dumps(header))
        for start in range(0, len(records), 400):
            writer.append(records[start : start + 400])
        writer.close(stopped_by=None, lost_records=0)
        return writer.path.read_bytes()


TARGETS: dict[str, Callable[[random.Random], None]] = {
    "frame16": fuzz_frame16, "lines": fuzz_lines, "frames": fuzz_frames, "formats": fuzz_formats,
    "slcan": fuzz_slcan, "ecu": fuzz_ecu, "modbus": fuzz_modbus,
    "bench": fuzz_bench, "matrix": fuzz_matrix, "csv": fuzz_csv, "foreign": fuzz_imported, "hdf5": fuzz_hdf5,
    "hdf5-structure": fuzz_hdf5_structure, "journal": fuzz_journal,
}  # fmt: skip


def fuzz(target: str, inputs: int, seed: int) -> int:
    """Feed one target; the number of inputs. The first input that breaks a demand raises, its seed in a note."""
    count = max(1, inputs // SLOW.get(target, 1))
    for number in range(count):
        try:
            TARGETS[target](random.Random(f"{target} {seed} {number}"))
        except BaseException as error:
            error.add_note(f"fuzz target {target}, seed {seed}, input {number}")
            raise
    return count


def main() -> int:
    """Every target in a process of its own."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=", ".join(TARGETS))
    parser.add_argument("--inputs", type=int, default=INPUTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--here", action="store_true", help="in this process")
    given = parser.parse_args()
    targets = given.targets or list(TARGETS)
    if given.here:
        for target in targets:
            sys.stdout.write(f"{target:8} {fuzz(target, given.inputs, given.seed)} inputs, no crash, no wrong value\n")
        return 0
    settings = ["--here", "--inputs", str(given.inputs), "--seed", str(given.seed)]
    codes = [subprocess.run([sys.executable, __file__, each, *settings], check=False).returncode for each in targets]
    return 1 if any(codes) else 0


if __name__ == "__main__":
    sys.exit(main())
