"""A program that was loaded in advance runs once, with the descriptors that it is given, and ends if it is not used."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from drivers.prepared import Prepared

PROGRAM = """
import os, sys
def load_in_advance(text):
    global loaded
    loaded = text
def main(arguments):
    print(loaded, *arguments, file=sys.stderr, flush=True)
    print(os.getpid(), flush=True)
    sys.stdin.readline()
    return 3
"""


@pytest.fixture
def prepared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Prepared]:
    (tmp_path / "program.py").write_text(PROGRAM)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    made = Prepared("program", ["early"])
    yield made
    made.close()


def test_it_runs_with_its_arguments_and_holds_the_locks_until_its_end(prepared: Prepared, tmp_path: Path) -> None:
    log, lock = tmp_path / "log", tmp_path / "lock"
    lock.touch()
    prepared.prepare()
    with log.open("ab") as messages, lock.open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        process = prepared.start(["a", "b c"], {2: messages.fileno()}, [held.fileno()])
    assert process is not None
    assert process.stdin is not None
    assert process.stdout is not None
    assert int(process.stdout.readline()) == process.pid
    with lock.open() as other:
        with pytest.raises(BlockingIOError):
            fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
        process.stdin.close()
        assert process.wait(10.0) == 3
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    process.stdout.close()
    assert log.read_text() == "early a b c\n"
    assert prepared.start([], {}) is None, "a process runs once"


@pytest.mark.parametrize("end", ["killed", "closed"])
def test_one_that_has_ended_is_replaced_by_an_ordinary_start(prepared: Prepared, end: str) -> None:
    prepared.prepare()
    waiting = prepared._waiting
    assert waiting is not None
    process, line = waiting
    ends: dict[str, Callable[[], None]] = {"killed": process.kill, "closed": line.close}
    ends[end]()
    assert process.wait(10.0) == {"killed": -9, "closed": 0}[end], "it ends if no message arrives"
    assert prepared.start(["a"], {}) is None
