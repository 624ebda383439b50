"""Results kept beside a point: with them, without them and whatever the cache holds, results are the same."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import pytest

import rig.recording.point_cache as point_cache
from rig.characteristics.summary import characterise
from rig.errors import DataWarning
from rig.identification.models.measurement import Measurement
from rig.identification.points import preparation
from rig.identification.points.preparation import prepare
from rig.recording.importing import import_tests
from rig.recording.run import Run


@pytest.fixture(scope="module")
def imported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one test of six cycles, with a warning of its preparation: times that are rounded irregularly."""
    folder, random = tmp_path_factory.mktemp("tests"), np.random.default_rng(2)
    time_s = np.arange(600) / 100.0 + random.uniform(0.0, 0.002, 600)
    speed = np.cos(2.0 * np.pi * time_s)
    table = np.column_stack(
        (time_s, 20.0 * np.sin(2.0 * np.pi * time_s), 500.0 * np.tanh(9.0 * speed) + random.normal(0.0, 2.0, 600))
    )
    np.savetxt(folder / "test.csv", table, "%.6f", ",", header="t_s,x_mm,F_N", comments="")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    return import_tests([folder / "test.csv"], columns=columns, current_A=0.5, out=folder)


@pytest.fixture
def run(tmp_path: Path, imported: Path) -> Path:
    return Path(shutil.copytree(imported, tmp_path / "run"))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Points that were prepared from their files, not taken from a cache."""
    names: list[str] = []

    def prepared(point: object, skew: object) -> Measurement:
        names.append(point.id)  # type: ignore[attr-defined]
        return original(point, skew)  # type: ignore[arg-type]

    original = preparation._made
    monkeypatch.setattr(preparation, "_made", prepared)
    return names


def contents(value: object) -> dict[str, object]:
    """The fields of a dataclass, arrays as bytes, numbers by their digits; the file's path left out."""
    shown = {}
    for one in fields(value):  # type: ignore[arg-type]
        held = getattr(value, one.name)
        held = contents(held) if one.name == "motion_error" and held is not None else held
        shown[one.name] = held.tobytes() if isinstance(held, np.ndarray) else repr(held)
    shown.pop("file", None)
    return shown


def entry(run: Path, name: str = "prepared") -> Path:
    return run / "cache" / f"test.{name}"


def test_a_kept_measurement_is_the_one_that_was_made_bit_for_bit(run: Path, made: list[str], tmp_path: Path) -> None:
    first = prepare(Run.open(run)[0])
    moved = run.rename(tmp_path / "moved")
    again = prepare(Run.open(moved)[0])
    assert made == ["test"], "moved or copied, a run keeps its cache"
    assert contents(again) == contents(first)
    assert again.file == str(moved / "points" / "test.h5")
    assert [(one.slug, one.numbers) for one in again.warnings] == [(one.slug, one.numbers) for one in first.warnings]
    assert again.warnings
    assert again.u_m.flags.writeable
    assert again.u_m.flags.aligned, "a compiled model takes no other arrays without being compiled again"


def test_kept_characteristics_are_the_ones_that_were_made(run: Path) -> None:
    first = characterise(Run.open(run))
    assert entry(run, "loop").is_file()
    again = characterise(Run.open(run))
    assert repr(again) == repr(first)
    assert json.dumps(again.to_json()) == json.dumps(first.to_json())


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-100])


def flipped(file: Path) -> None:
    raw = bytearray(file.read_bytes())
    raw[-50] ^= 1
    file.write_bytes(raw)


def emptied(file: Path) -> None:
    file.write_bytes(b"")


def replaced_by_a_pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def forged(file: Path) -> None:
    """A whole entry with the right key and none of the values."""
    raw = file.read_bytes()
    start = len(point_cache.KIND) + 40
    key = json.loads(raw[start : start + int.from_bytes(raw[start - 8 : start], "little")])["key"]
    file.write_bytes(b"".join(point_cache._packed(point_cache.Entry({}, {}), key)))


@pytest.mark.parametrize("damage", [replaced_by_a_pipe, forged])
def test_an_entry_that_holds_something_else_is_made_again(
    run: Path, made: list[str], damage: Callable[[Path], None]
) -> None:
    first = prepare(Run.open(run)[0])
    damage(entry(run))
    assert contents(prepare(Run.open(run)[0])) == contents(first)
    assert len(made) == 2


@pytest.mark.parametrize("damage", [cut, flipped, emptied])
def test_a_damaged_entry_is_made_again_and_named_once(
    run: Path, made: list[str], damage: Callable[[Path], None]
) -> None:
    first = prepare(Run.open(run)[0])
    damage(entry(run))
    with pytest.warns(DataWarning, match=r"test\.prepared: this cache entry is damaged") as told:
        assert contents(prepare(Run.open(run)[0])) == contents(first)
    damage(entry(run))
    assert contents(prepare(Run.open(run)[0])) == contents(first)
    assert len(made) == 3
    assert len(told) == 1


def test_an_entry_of_other_code_or_of_another_content_is_made_again(
    run: Path, made: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(Run.open(run)[0])
    monkeypatch.setattr(point_cache, "_code", lambda: "another version")
    prepare(Run.open(run)[0])
    assert len(made) == 2
    opened = Run.open(run)[0]
    with h5py.File(run / "points" / "test.h5", "r+") as file:
        file["entry/test"].attrs["current_A"] = 0.7
    prepare(opened)  # the file is another one than that which was opened: neither read from the cache nor kept for it
    assert prepare(Run.open(run)[0]).nominal_current_A == 0.7
    assert len(made) == 4


def test_arrays_that_were_changed_in_memory_are_used_and_not_kept(run: Path, made: list[str]) -> None:
    prepare(Run.open(run)[0])
    point = Run.open(run)[0]
    point.force_N[:] *= 2.0
    assert np.ptp(prepare(point).force_N) > 1900.0
    untouched = Run.open(run)[0]
    assert untouched.force_N.size
    assert np.ptp(prepare(untouched).force_N) < 1100.0
    assert len(made) == 2, "arrays that were only read are no reason to prepare it again"


def test_no_link_is_followed_neither_for_reading_nor_for_writing(run: Path, made: list[str], tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (run / "cache").symlink_to(elsewhere)
    prepare(Run.open(run)[0])
    assert not list(elsewhere.iterdir())
    (run / "cache").unlink()
    prepare(Run.open(run)[0])
    target = elsewhere / "target"
    shutil.move(entry(run), target)
    entry(run).symlink_to(target)
    before = target.read_bytes()
    prepare(Run.open(run)[0])
    assert len(made) == 3
    assert target.read_bytes() == before
    assert not entry(run).is_symlink(), "replaced by a file of its own"


def test_a_run_in_which_nothing_can_be_written_is_evaluated_all_the_same(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError("read-only")

    monkeypatch.setattr(point_cache, "write_unflushed", refuse)
    assert prepare(Run.open(run)[0]).u_m.size


def test_commands_that_keep_one_entry_at_once_leave_a_whole_one_and_nothing_beside(run: Path, made: list[str]) -> None:
    prepare(Run.open(run)[0])
    caches = [point_cache.PointCache(Run.open(run)[0], "prepared", "None") for _ in range(4)]
    first = caches[0].read()
    assert first is not None
    entry(run).unlink()
    assert [cache.read() for cache in caches] == [None] * 4
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda cache: [cache.write(first) for _ in range(20)], caches))
    assert [file.name for file in (run / "cache").iterdir()] == ["test.prepared"]
    prepare(Run.open(run)[0])
    assert len(made) == 1
