"""Runs are named by their directory, by `last` or -1, or by a part of the name that is in one run only."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.shell_completion import BashComplete

from rig.campaign_folder import run_path
from rig.cli.main import COMMANDS, cli
from rig.cli.options import Command, FitName, ResumedRun, RunOrFilter, RunPath
from rig.errors import FileProblem
from rig.recording.run import Run

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
    @click.option("--holdout", type=RunOrFilter())
    @click.option("--seed", type=int)
    def command(runs: tuple[Path, ...], **options: object) -> None:
        got.extend([*runs, *(Path(str(value)) for value in options.values() if value is not None)])

    command.main(list(arguments), standalone_mode=False)
    return [path.as_posix() for path in got]


@pytest.mark.parametrize(("given", "place"), [
    ("last", 1), ("LAST", 1), ("-1", 1), ("-2", 2), ("-3", 0), ("aaaaaa", 0), ("Imported", 2), ("mr-002", 1),
    (NAMES[0], 0),
])
def test_a_short_name_means_a_run_in_logs_or_in_the_folder_of_the_path(logs: Path, given: str, place: int) -> None:
    assert taken(given) == [f"logs/{NAMES[place]}"]
    assert run_path(logs / given) == logs / NAMES[place]
    assert run_path(f"{given}/fit.json") == Path("logs", NAMES[place], "fit.json")
    deep = Path("/no-such-folder", *["a"] * 1100)
    assert run_path(deep) == deep


def test_options_take_short_names_and_numbers_stay_numbers(logs: Path) -> None:
    assert taken("-2", "--resume", "-1", "--seed", "-5") == [f"logs/{NAMES[2]}", f"logs/{NAMES[1]}", "-5"]
    assert taken("--holdout", "-1") == [f"logs/{NAMES[1]}"]
    assert taken("--holdout", "last 30 %") == ["last 30 %"]
    assert taken("--holdout", "current_A=1") == ["current_A=1"]


@pytest.mark.parametrize(("given", "listed"), [
    ("MR-00", {0, 1}), ("-4", set()), ("last-1", set()), ("last-9", set()), ("MR-003", {0, 1}),
    ("importde", {2}), ("zzz", {0, 1, 2}),
])
def test_a_name_of_several_runs_or_none_is_refused_with_the_matching_or_similar_names(
    logs: Path, given: str, listed: set[int]
) -> None:
    with pytest.raises(FileProblem) as refused:
        run_path(given)
    lines = [line.strip() for line in str(refused.value).splitlines()]
    assert {k for k, name in enumerate(NAMES) if name in lines} == listed  # alone on a line, so that it can be copied
    with pytest.raises(click.BadParameter):
        taken(given)


def test_runs_without_points_are_ignored_where_another_run_matches(
    logs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (logs / NAMES[0] / "points" / "p001.h5").touch()
    assert taken("mr-00") == taken("last") == taken("-1") == [f"logs/{NAMES[0]}"]
    assert "ignored: 2" in capsys.readouterr().err
    assert taken("mr-002") == [f"logs/{NAMES[1]}"]
    assert ResumedRun().convert("last", None, None) == Path("logs", sorted(NAMES)[-1])


def test_what_exists_goes_before_short_names(logs: Path) -> None:
    (logs.parent / "last").mkdir()
    assert taken("last", "last/aaaaaa", "/elsewhere/aaaaaa") == ["last", "last/aaaaaa", "/elsewhere/aaaaaa"]


def test_python_finds_a_run_by_its_short_name(logs: Path) -> None:
    with pytest.raises(FileProblem) as refused:
        Run.open("last")
    assert Path(refused.value.file) == Path("logs", NAMES[1])


@pytest.mark.parametrize(("begun", "offered"), [
    ("", ["last", NAMES[1], NAMES[2], NAMES[0]]), ("20260", [NAMES[1], NAMES[2], NAMES[0]]), ("IMPO", [NAMES[2]]),
    ("MR-0", ["MR-0"]), ("logs/", ["logs/"]),
])
def test_the_shell_offers_runs_or_files(logs: Path, begun: str, offered: list[str]) -> None:
    found = BashComplete(cli, {}, "rig", "_RIG_COMPLETE").get_completions(["report"], begun)
    assert [item.value for item in found] == offered
    assert {item.type for item in found} == {"file" if offered == [begun] else "plain"}


def test_every_argument_called_a_run_takes_short_names() -> None:
    context = click.Context(cli)
    for name in COMMANDS:
        command = cli.get_command(context, name)
        for param in () if command is None else command.params:
            if param.name in {"run", "runs", "fits", "source", "resume", "resume_path", "holdout"}:
                assert isinstance(param.type, RunPath | RunOrFilter | FitName), (name, param.name)
