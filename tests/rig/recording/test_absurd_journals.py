"""Journals whose every check fits and whose content cannot be, crashes and hangs: each named, the others finished."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import threading
import zlib
from pathlib import Path

import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from rig.clock import monotonic_ns
from rig.recording.conversion.conversion import finish_alone
from rig.recording.conversion.converter import Converter
from rig.recording.conversion.finaliser import Finaliser
from rig.recording.conversion.recovery import recover
from rig.recording.journal import journal_file as journal
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.journal.recorder import PointJournal
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

RIG = SyntheticRig(cycles=3, frequency_Hz=2.0)
RECORDS = RIG.records()
WAIT_S = 60.0


def written(path: Path, records: np.ndarray = RECORDS, header: str = "") -> Path:
    writer = JournalWriter(path, header or RIG.context().to_json())
    for start in range(0, len(records), 500):
        writer.append(records[start : start + 500])
    writer.close(stopped_by=None, lost_records=0)
    return path


def header(**changes: object) -> str:
    """The synthetic rig's header with entries at dotted places changed; `...` takes one out."""
    found = json.loads(RIG.context().to_json())
    for place, value in changes.items():
        *parents, last = place.split("__")
        inner = found
        for parent in parents:
            inner = inner[parent]
        if value is ...:
            del inner[last]
        else:
            inner[last] = value
    return json.dumps(found)


def changed(field: str, value: float, rows: slice = slice(300, 301)) -> np.ndarray:
    records = RECORDS.copy()
    records[field][rows] = value
    return records


HEADERS: dict[str, str] = {
    "frequency 0": header(point__frequency_Hz=0.0),
    "frequency nan": json.dumps(json.loads(header())).replace('"frequency_Hz": 2.0', '"frequency_Hz": NaN'),
    "frequency of 400 digits": header(point__frequency_Hz=10**400),
    "waveform missing": header(point__waveform=...),
    "waveform a number": header(point__waveform=3),
    "cycles text": header(point__cycles="many"),
    "cycles 1e300": header(point__cycles=1e300),
    "rate 0": header(sensors__force__rate_Hz=0.0),
    "rate 1e18": header(sensors__displacement__rate_Hz=1e18),
    "no force": header(sensors__force=...),
    "delay text": header(sensors__force__delay_s="late"),
    "device rate 0": header(device_rate=0.0),
    "device rate missing": header(device_rate=None),
    "point a list": header(point=[1, 2]),
    "sensors a number": header(sensors=3),
    "not an object": "[]",
    "deep": "[" * 100_000,
    "empty": "{}",
}
RECORDED: dict[str, np.ndarray] = {
    "device clock 2^63 - 1": changed("device_us", 2**63 - 1),
    "device clock -2^63": changed("device_us", -(2**63)),
    "host clock 2^63 - 1": changed("host_ns", 2**63 - 1),
    "host clock negative": changed("host_ns", -5),
    "host clock years apart": changed("host_ns", 10**17),
    "sixty thousand channels": changed("channel", np.arange(len(RECORDS)) + 100, slice(None)),
    "nothing": RECORDS[:0],
    "one record": RECORDS[:1],
    "no displacement": RECORDS[RECORDS["channel"] != 2],
}
ODD: dict[str, np.ndarray] = {
    "infinite value": changed("value", np.inf),
    "value 1e308": changed("value", 1e308),
    "value nan": changed("value", np.nan),
    "all values 1e308": changed("value", 1e308, slice(None)),
    "sequence back": changed("sequence", 0),
    "sequence far ahead": changed("sequence", 2**31 - 5),
    "random sequence": changed("sequence", np.random.default_rng(1).integers(0, 2**32, len(RECORDS)), slice(None)),
    "channel unknown": changed("channel", 65_535),
    "all flags": changed("flags", 65_535, slice(None)),
    "arrivals equal": changed("host_ns", 10**11, slice(None)),
}


@pytest.mark.parametrize("text", HEADERS.values(), ids=HEADERS.keys())
def test_a_header_that_cannot_be_is_named_and_its_journal_kept(tmp_path: Path, text: str) -> None:
    path = written(tmp_path / "p001.journal", RECORDS[:2000], text)
    answer = finish_alone(path)
    assert answer.error.startswith("p001.journal: ")
    assert answer.error_slug == "unreadable"
    assert path.exists()
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("records", RECORDED.values(), ids=RECORDED.keys())
def test_records_that_cannot_be_are_named_and_their_journal_kept(tmp_path: Path, records: np.ndarray) -> None:
    path = written(tmp_path / "p001.journal", records)
    answer = finish_alone(path)
    assert answer.error_slug == "unreadable", answer
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("records", ODD.values(), ids=ODD.keys())
def test_an_odd_sample_ends_in_a_file_that_keeps_it_or_in_a_named_error(tmp_path: Path, records: np.ndarray) -> None:
    path = written(tmp_path / "p001.journal", records)
    answer = finish_alone(path)
    if answer.error:
        assert answer.error_slug == "unreadable"
        assert path.exists()
    else:
        received = RecordedPoint.open(Path(answer.file)).raw("force")
        assert received is not None
        sent = records[records["channel"] == 1]
        assert np.array_equal(received["value"], sent["value"], equal_nan=True)


def test_blocks_no_recorder_writes_count_as_damage_and_cost_nothing_else(tmp_path: Path) -> None:
    path = written(tmp_path / "p001.journal")
    whole = len(journal.read_journal(path).records)
    bodies = [
        (journal.RECORDS, b"x" * 33), (journal.EVENT, b'{"time_ns": 1e400, "code": "a", "text": "b"}'),
        (journal.EVENT, b"[]"), (journal.EVENT, b"[" * 200_000), (journal.END, b"3"), (journal.EVENT, b"\xff\xfe"),
        (journal.EVENT, json.dumps({"time_ns": 2**70, "code": "a", "text": "b"}).encode()),
    ]
    data = path.read_bytes()
    for index, (kind, body) in enumerate(bodies, start=20):
        check = zlib.crc32(body, zlib.crc32(journal.CHECKED.pack(kind, 0, index, len(body))))
        data += journal.BLOCK.pack(journal.BLOCK_MAGIC, kind, 0, index, len(body), check) + body
    content = journal.parse_journal(data)
    assert len(content.records) == whole
    assert content.events == ()
    assert content.damaged_bytes == len(data) - path.stat().st_size


def test_a_block_that_claims_a_place_beyond_the_file_does_not_hide_those_behind_it(tmp_path: Path) -> None:
    path = written(tmp_path / "p001.journal", RECORDS[:600])
    body, index = RECORDS[:1].tobytes(), 2**32 - 1
    check = zlib.crc32(body, zlib.crc32(journal.CHECKED.pack(journal.RECORDS, 0, index, len(body))))
    planted = journal.BLOCK.pack(journal.BLOCK_MAGIC, journal.RECORDS, 0, index, len(body), check) + body
    data = path.read_bytes()
    start = data.index(journal.BLOCK_MAGIC)
    content = journal.parse_journal(data[:start] + planted + data[start:])
    assert len(content.records) == 600
    assert (content.missing_blocks, content.damaged_bytes) == (0, len(planted))


def test_absurd_journals_between_good_ones_are_named_and_the_good_ones_finished(campaign: Path) -> None:
    points = campaign / "points"
    written(points / "a1.journal")
    written(points / "a2.journal", RECORDED["device clock 2^63 - 1"])
    written(points / "a3.journal", header=HEADERS["frequency of 400 digits"])
    written(points / "a4.journal")
    (points / "a5.journal").write_bytes(b"MRJOURN1" + b"\xff" * 40)
    written(points / "a6.journal", ODD["all values 1e308"])
    written(points / "a7.journal")
    answers = {answer.id: answer for answer in recover(campaign)}
    assert [answers[name].verdict for name in ("a1", "a4", "a7")] == ["valid", "valid", "valid"]
    assert all(answers[name].error_slug == "unreadable" for name in ("a2", "a3", "a5"))
    assert "device_us from" in answers["a2"].error
    assert {point.id for point in Run.open(campaign).usable} >= {"a1", "a4", "a7"}
    again = {answer.id: answer.error for answer in recover(campaign)}
    assert again.keys() >= {"a2", "a3", "a5"}
    assert not again.keys() & {"a1", "a4", "a7"}


def test_a_hanging_journal_is_given_up_by_name_and_the_next_one_finished(campaign: Path) -> None:
    points = campaign / "points"
    held, good = written(points / "p001.journal"), written(points / "p002.journal")
    handle = os.open(held, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with Converter(timeout_s=1.0) as converter:
        first = converter.finish(held)
        assert first.error_slug == "conversion-timeout"
        assert first.error.startswith("p001.journal: the conversion did not finish within 1 s")
        converter._timeout_s = 120.0  # however busy the machine is
        assert converter.finish(good).verdict == "valid"
        os.close(handle)
        assert converter.finish(held).verdict == "valid"


@pytest.mark.few(1)
@pytest.mark.parametrize("number", [signal.SIGSEGV, signal.SIGKILL, signal.SIGBUS])
def test_a_crash_while_a_file_is_made_costs_this_answer_only(campaign: Path, number: signal.Signals) -> None:
    points = campaign / "points"
    held, good = written(points / "p001.journal"), written(points / "p002.journal")
    handle = os.open(held, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    with Converter() as converter:
        converter.start()
        process = converter._process
        assert process is not None
        threading.Timer(0.5, process.send_signal, (number,)).start()
        answer = converter.finish(held)
        assert answer.error_slug == "conversion-crashed"
        assert number.name in answer.error
        assert converter.finish(good).verdict == "valid"
        os.close(handle)
        assert converter.finish(held).verdict == "valid"


def test_the_finaliser_outlives_the_process_that_makes_its_files(campaign: Path) -> None:
    points = campaign / "points"
    held, good = written(points / "p001.journal"), written(points / "p002.journal")
    handle = os.open(held, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    finaliser = Finaliser.start(campaign)
    finaliser.submit(PointJournal("p001", held, 0, 0))
    finaliser.submit(PointJournal("p002", good, 0, 0))
    os.kill(the_one_that_waits_for(held), signal.SIGSEGV)
    answer = finaliser.wait("p001", WAIT_S)
    assert answer.error_slug == "conversion-crashed"
    assert finaliser.wait("p002", WAIT_S).verdict == "valid"
    assert finaliser.alive
    os.close(handle)
    finaliser.close()
    assert [answer.verdict for answer in recover(campaign)] == ["valid"]


def the_one_that_waits_for(journal: Path) -> int:
    """The process that has come as far as the journal's lock, as the kernel lists it."""
    inode = f":{journal.stat().st_ino} "
    deadline_ns = monotonic_ns() + int(WAIT_S * 1e9)
    while monotonic_ns() < deadline_ns:
        for line in Path("/proc/locks").read_text(encoding="ascii").splitlines():
            if "-> FLOCK" in line and inode in line:
                return int(line.split()[5])
    raise AssertionError("nobody waits for the journal")


@pytest.mark.nightly
def test_a_journal_that_wants_all_memory_is_refused_it(campaign: Path) -> None:
    """A hole in a file costs no disk, and a block of 60 MB claimed again and again no more memory than one."""
    path = written(campaign / "points" / "p001.journal")
    with path.open("r+b") as file:
        file.truncate(1 << 30)
    with Converter() as converter:
        answer = converter.finish(path)
    assert answer.error or answer.verdict == "valid"


@pytest.fixture
def stray_files(campaign: Path) -> Path:
    """A campaign in which data lie under every name there is."""
    points = campaign / "points"
    written(points / "p001.journal")
    finish_alone(points / "p001.journal")
    whole = (points / "p001.h5").read_bytes()
    (points / "p001.h5.tmp").write_bytes(whole[:3000])
    written(points / "p002.journal")
    (points / "p002.h5.tmp").write_bytes(whole)
    (points / "p003.h5.tmp").write_bytes(whole)
    (points / "p004.h5.tmp").write_bytes(whole[:-100])
    written(points / "loop-2-unreadable-20260102T030405000000.journal.old")
    written(points / "p001-unreadable-20260102T030405000000.journal.old", RECORDS[: len(RECORDS) - 100])
    written(points / "p002-attempt2.journal")
    return campaign


def test_recovery_knows_every_name_under_which_data_can_lie(stray_files: Path) -> None:
    points = stray_files / "points"
    before = (points / "p001.h5").read_bytes()
    answers = recover(stray_files)
    assert [(answer.id, answer.verdict, answer.error) for answer in answers] == [
        (name, "valid", "") for name in ("p002-attempt2", "p002", "loop-2", "p001", "p003")
    ]
    assert sorted(path.name for path in points.iterdir()) == [
        "loop-2.h5", "p001-attempt1.h5.old", "p001.h5", "p002-attempt2.h5", "p002.h5", "p003.h5",
    ]
    assert (points / "p001.h5").read_bytes() == before, "what stands in its place stays"
    assert RecordedPoint.open(points / "loop-2.h5").id == "loop-2"
    assert recover(stray_files) == []


def test_a_damaged_file_in_a_points_place_does_not_keep_its_journal_from_being_finished(campaign: Path) -> None:
    points = campaign / "points"
    written(points / "p001.journal")
    kept = (points / "p001.journal").read_bytes()
    finish_alone(points / "p001.journal")
    damaged = (points / "p001.h5").read_bytes()[:2000]
    (points / "p001.h5").write_bytes(damaged)
    (points / "p001.journal").write_bytes(kept)
    assert [answer.verdict for answer in recover(campaign)] == ["valid"]
    assert Run.open(campaign).points[0].verdict == "valid"
    assert (points / "p001-attempt1.h5.old").read_bytes() == damaged


