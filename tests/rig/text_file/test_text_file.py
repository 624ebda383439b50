"""JSON that people hand on: damaged, hostile, endless."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from rig.errors import FileProblem
from rig.text_file import FirstRead, read_json, read_text


def test_a_small_limit_of_the_first_read_does_not_limit_a_later_one(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"0123456789")
    first = FirstRead()
    assert first.read(path, 3) == b"0123", "one byte more than the limit"
    assert first.read(path, 20) == b"0123456789"
    path.write_bytes(b"changed")
    assert first.read(path, 3) == b"0123"
    assert first.read(path, 50) == b"0123456789", "the content at the first complete read"


HOSTILE = {
    "nothing": (b"", "not valid JSON"),
    "a key twice": (b'{"a": [{"m": 1, "n": 2, "m": 3}], "b": 1}', "a.0.m: the key occurs more than once"),
    "list": (b"[1]", "expected a JSON object, got list"),
    "nested": (b'{"a":' * 200_000, "not valid JSON: nested too deeply"),
    "nested lists": (b"[" * 1_000_000, "not valid JSON: nested too deeply"),
    "long number": (b'{"a": ' + b"1" * 100_000 + b"}", "not valid JSON"),
    "binary": (b"\x89HDF\r\n\x1a\n", "not UTF-8 text"),
    "cut off": (b'{"a": 1', "not valid JSON"),
}


@pytest.mark.parametrize(("content", "expected"), HOSTILE.values(), ids=HOSTILE)
def test_hostile_JSON_is_refused_at_once(tmp_path: Path, content: bytes, expected: str) -> None:
    path = tmp_path / "fit.json"
    path.write_bytes(content)
    begun_s = time.process_time()
    with pytest.raises(FileProblem, match=expected) as caught:
        read_json(path)
    assert time.process_time() - begun_s < 1.0
    assert caught.value.file == str(path)


def test_a_file_beyond_its_limit_is_not_read_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "campaign.json"
    with path.open("wb") as file:
        file.truncate(10_000_000_000)
    with pytest.raises(FileProblem, match="larger than 32 MB"):
        read_json(path)


def test_a_pipe_nobody_writes_to_is_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(FileProblem, match="is a pipe, not a file"):
        read_text(path, 1000)


def test_an_object_is_read(tmp_path: Path) -> None:
    path = tmp_path / "fit.json"
    path.write_bytes('\ufeff{"a": "µ"}\r\n'.encode())
    assert read_json(path) == {"a": "µ"}
