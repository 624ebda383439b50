"""The index of runs says what the files say, whatever happened to them outside."""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import threading
from pathlib import Path
from typing import Any

import pytest

from rig.errors import DataWarning, FileProblem
from rig.results import run_index
from rig.results.run_index import NAME, RunFilter, Summary, listed

ANY = RunFilter()


class Reader:
    """Makes a summary of what lies in a run's files; counts how often it is asked."""

    def __init__(self) -> None:
        self.requests: list[str] = []

    def __call__(self, place: Path) -> Summary:
        self.requests.append(place.name)
        campaign: dict[str, Any] = json.loads((place / "campaign.json").read_text())
        points = sorted(path.read_text() for path in (place / "points").iterdir())
        fit = place / "fit.json"
        return {"id": place.name, "specimen": campaign["specimen"], "started": campaign["started"],
                "verdict": points[-1] if points else "", "model": fit.read_text() if fit.exists() else ""}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(run_index, "SETTLED_NS", -60_000_000_000)  # files of this very moment count as settled
    for k, (specimen, verdict, model) in enumerate((("MR-1", "valid", "bilinear"), ("MR-2", "suspect", ""))):
        (tmp_path / f"r{k}" / "points").mkdir(parents=True)
        (tmp_path / f"r{k}" / "campaign.json").write_text(json.dumps(
            {"specimen": specimen, "started": f"2026-0{k + 1}-15T10:00:00+00:00"}))  # fmt: skip
        (tmp_path / f"r{k}" / "points" / "p001.h5").write_text(verdict)
        if model:
            (tmp_path / f"r{k}" / "fit.json").write_text(model)
    (tmp_path / "notes").mkdir()
    return tmp_path


def checked(folder: Path) -> list[str]:
    """Which runs were read again; what is listed equals what a first look at the files gives."""
    reader = Reader()
    got = listed(folder, reader, ANY)
    read_names = sorted(reader.requests)
    assert got == [reader(place) for place in sorted(folder.iterdir()) if (place / "points").is_dir()]
    return read_names


def replaced(path: Path, text: str) -> None:
    path.with_suffix(".new").write_text(text)
    os.replace(path.with_suffix(".new"), path)


def test_what_has_not_changed_is_not_read_again(folder: Path) -> None:
    assert checked(folder) == ["r0", "r1"]
    assert checked(folder) == []


def test_a_listing_that_is_interrupted_keeps_what_it_has_read(folder: Path) -> None:
    looked_at: list[tuple[int, int]] = []

    def interrupt(done: int, total: int) -> None:
        looked_at.append((done, total))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        listed(folder, Reader(), ANY, None, interrupt)
    assert looked_at == [(1, 2)]
    assert checked(folder) == ["r0"]  # r1, the newest, was read before


def same_size_and_time(path: Path) -> None:
    state = path.stat()
    path.write_text(path.read_text().replace("valid", "inval"))
    os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))


@pytest.mark.parametrize(("change", "read"), [
    (lambda f: shutil.rmtree(f / "r0"), []),
    (lambda f: (f / "r0").rename(f / "r9"), ["r9"]),
    (lambda f: shutil.copytree(f / "r0", f / "r5"), ["r5"]),
    (lambda f: replaced(f / "r1" / "points" / "p001.h5", "valid"), ["r1"]),
    (lambda f: same_size_and_time(f / "r0" / "points" / "p001.h5"), ["r0"]),
    (lambda f: (f / "r0" / "points" / "p002.h5").write_text("invalid"), ["r0"]),
    (lambda f: (f / "r0" / "fit.json").unlink(), ["r0"]),
    (lambda f: (f / "r1" / "fit.json").write_text("dahl"), ["r1"]),
    (lambda f: (f / NAME).unlink(), ["r0", "r1"]),
])
def test_what_changed_outside_is_read_again_and_nothing_else(folder: Path, change: Any, read: list[str]) -> None:  # noqa: ANN401 - any call
    checked(folder)
    change(folder)
    assert checked(folder) == read
    assert checked(folder) == []


@pytest.mark.parametrize("damage", [lambda whole: b"no database" * 1000, lambda whole: whole[:5000]])
def test_a_damaged_database_is_named_and_made_again(folder: Path, damage: Any) -> None:  # noqa: ANN401 - any call
    checked(folder)
    (folder / NAME).write_bytes(damage((folder / NAME).read_bytes()))
    with pytest.warns(DataWarning, match=r"\.rig-runs\.sqlite: damaged .* rebuilt from the run directories"):
        assert checked(folder) == ["r0", "r1"]
    assert checked(folder) == []


def test_a_database_of_a_newer_version_is_named_and_left_as_it_is(folder: Path) -> None:
    checked(folder)
    with sqlite3.connect(folder / NAME) as index:
        index.execute("CREATE TABLE schema_version (version INTEGER)")
        index.execute("INSERT INTO schema_version VALUES (99)")
    index.close()
    before = (folder / NAME).read_bytes()
    with pytest.warns(DataWarning, match="got schema version 99, expected at most 2"):
        assert checked(folder) == ["r0", "r1"]
    assert (folder / NAME).read_bytes() == before


def test_two_runs_that_change_places_are_distinguished(folder: Path) -> None:
    checked(folder)
    for old, new in (("r0", "x"), ("r1", "r0"), ("x", "r1")):
        (folder / old).rename(folder / new)
    assert checked(folder) == ["r0", "r1"]


def test_a_folder_moved_as_a_whole_keeps_its_index(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    checked(folder)
    there = tmp_path_factory.mktemp("elsewhere") / "runs"
    folder.rename(there)
    assert checked(there) == []
    there.rename(folder)


def test_an_index_of_another_format_is_made_again(folder: Path) -> None:
    checked(folder)
    with sqlite3.connect(folder / NAME) as index:
        index.execute("DROP TABLE runs")
        index.execute("CREATE TABLE runs (other TEXT)")
        index.execute("UPDATE format SET written = 'of another program'")
    index.close()
    assert checked(folder) == ["r0", "r1"]
    assert checked(folder) == []


def test_a_run_changed_a_moment_ago_is_read_again_next_time(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_index, "SETTLED_NS", 3600_000_000_000)
    assert checked(folder) == ["r0", "r1"]
    assert checked(folder) == ["r0", "r1"]


def test_where_the_index_cannot_be_written_the_files_are_read(folder: Path) -> None:
    (folder / NAME).mkdir()
    assert checked(folder) == ["r0", "r1"]
    assert checked(folder) == ["r0", "r1"]


def test_calls_at_once_do_not_disturb_each_other(folder: Path) -> None:
    answers: list[int] = []
    threads = [threading.Thread(target=lambda: answers.append(len(listed(folder, Reader(), ANY)))) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert answers == [2] * 6
    assert checked(folder) == []


@pytest.mark.parametrize(("run_filter", "names"), [
    (RunFilter(specimen="MR-2"), ["r1"]), (RunFilter(specimen="MR-?"), ["r0", "r1"]), (RunFilter(specimen="mr-1"), []),
    (RunFilter(date="2026"), ["r0", "r1"]), (RunFilter(date="2026-02"), ["r1"]), (RunFilter(date="2026-01-15"), ["r0"]),
    (RunFilter(date="2026-01-16:"), ["r1"]), (RunFilter(date=":2026-01"), ["r0"]),
    (RunFilter(date="2026-01-15:2026-02-15"), ["r0", "r1"]), (RunFilter(date="2025"), []),
    (RunFilter(verdict="suspect"), ["r1"]), (RunFilter(model="bilinear"), ["r0"]),
    (RunFilter(model="bilinear", verdict="suspect"), []),
])
def test_all_filters_must_hold(folder: Path, run_filter: RunFilter, names: list[str]) -> None:
    for _ in range(2):  # by the files, by the index
        assert [run["id"] for run in listed(folder, Reader(), run_filter)] == names


@pytest.mark.parametrize("date", ["yesterday", "2026-1", "1:2:3", ":", ""])
def test_a_date_that_cannot_be_read_is_refused(date: str) -> None:
    with pytest.raises(FileProblem, match="expected 2026, 2026-11, 2026-11-23"):
        RunFilter(date=date)
