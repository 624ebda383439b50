"""Runs are named by their directory, by `last` or -1, or by a part of the name that is in one run only."""

from __future__ import annotations

from pathlib import Path

import click
import pytest

from rig.cli.options import Command, RunPath

NAMES = ("20260101T000000Z-MR-001-aaaaaa", "20260301T000000Z-MR-002-bbbbbb", "20260201T000000Z-imported-cccc")


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in NAMES:
        (tmp_path / "logs" / name / "points").mkdir(parents=True)
    (tmp_path / "logs" / "no-run").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path / "logs"


def taken(*arguments: str) -> list[str]:
    got: list[Path] = []

    @click.command(cls=Command)
    @click.argument("runs", type=RunPath(), nargs=-1)
    @click.option("--resume", type=RunPath())
    @click.option("--seed", type=int)
    def command(runs: tuple[Path, ...], resume: Path | None, seed: int | None) -> None:
        got.extend([*runs, *([resume] if resume else []), *([Path(str(seed))] if seed is not None else [])])

    command.main(list(arguments), standalone_mode=False)
    return [path.as_posix() for path in got]


@pytest.mark.parametrize(("given", "place"), [
    ("last", 1), ("-1", 1), ("-2", 2), ("-3", 0), ("aaaaaa", 0), ("imported", 2), ("MR-002", 1), (NAMES[0], 0),
])
def test_a_short_form_names_a_run_in_logs(logs: Path, given: str, place: int) -> None:
    assert taken(given) == [f"logs/{NAMES[place]}"]


def test_options_take_short_forms_and_numbers_stay_numbers(logs: Path) -> None:
    assert taken("-2", "--resume", "-1", "--seed", "-5") == [f"logs/{NAMES[2]}", f"logs/{NAMES[1]}", "-5"]


@pytest.mark.parametrize("given", ["MR-00", "-4", "last-9"])
def test_a_form_that_fits_several_runs_or_none_is_refused(logs: Path, given: str) -> None:
    with pytest.raises(click.BadParameter):
        taken(given)


def test_what_exists_goes_before_short_forms(logs: Path) -> None:
    (logs.parent / "last").mkdir()
    assert taken("last", "elsewhere/last", "unknown") == ["last", "elsewhere/last", "unknown"]
