"""What of a campaign.json a resumed campaign's simulated rig is given: an allow-list of options and shapes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
import pytest

from rig.campaign.results import CampaignOptions
from rig.campaign.resume import (
    ALLOWED,
    FLAG,
    OF_ONE_SESSION,
    StrangeArgument,
    as_before,
    left_out,
    of_the_rig,
    speed_before,
)
from rig.errors import FileProblem
from simulators.__main__ import main


def campaign(folder: Path, **simulated: object) -> Path:
    described = {"hashes": {}, "simulated": {"speed": 5.0, "seed": 3, "arguments": [], **simulated}}
    (folder / "campaign.json").write_text(json.dumps(described), encoding="utf-8")
    (folder / "matrix.toml").write_text("", encoding="utf-8")
    return folder


def resumed(folder: Path) -> CampaignOptions:
    return as_before(folder, CampaignOptions(folder / "matrix.toml", folder, resume_path=folder))


def test_every_option_of_the_simulated_rig_is_either_the_rigs_or_a_sessions() -> None:
    options = {name: each for each in main.params for name in (*each.opts, *each.secondary_opts)}
    undecided = set(options) - set(ALLOWED) - set(OF_ONE_SESSION)
    assert not undecided, "decide whether a resumed campaign is given them again"
    for name, each in options.items():
        assert isinstance(each, click.Option)
        takes_value = not each.is_flag
        assert takes_value == (OF_ONE_SESSION[name] if name in OF_ONE_SESSION else ALLOWED[name] != FLAG)


def test_files_and_faults_of_a_session_are_left_out_and_the_rig_is_kept() -> None:
    kept, dropped = of_the_rig(
        ["--truth", "/tmp/x.h5", "--no-real-time", "--bench=/etc/passwd", "--option", "load_cell.noise=2.0", "--fault",
         "estop@3", "--rate", "500", "--exit-when-idle", "--specimen=serial_number=\"A\"", "--hum", "40 N"]
    )  # fmt: skip
    assert kept == (
        "--no-real-time", "--option=load_cell.noise=2.0", "--rate=500", '--specimen=serial_number="A"', "--hum=40 N",
    )
    assert dropped == ("--truth", "--bench", "--fault", "--exit-when-idle")


@pytest.mark.parametrize(
    "arguments",
    [
        ["--model", "--truth=/tmp/x"],
        ["--option", "a.b=1\n--truth=/tmp/x"],
        ["--option", "--truth"],
        ["--rate", "/tmp/x"],
        ["--rate", "١٢"],
        ["--auxiliary", "4 --truth x"],
        ["--ports", "pty|socket"],
        ["--no-real-time=1"],
        ["--set"],
        ["--output", "/tmp/x"],
        ["/tmp/x"],
        ["--"],
        ["-h"],
        [7],
        [["--truth", "x"]],
        [None],
    ],
    ids=repr,
)
def test_anything_else_is_refused(arguments: list[Any], tmp_path: Path) -> None:
    with pytest.raises(StrangeArgument):
        of_the_rig(arguments)
    with pytest.raises(FileProblem, match=r"campaign\.json"):
        resumed(campaign(tmp_path, arguments=arguments))


@pytest.mark.parametrize(
    "simulated",
    [{"speed": "fast"}, {"speed": float("nan")}, {"speed": 1e9}, {"speed": -1}, {"seed": -1}, {"seed": "x"},
     {"seed": None}, {"arguments": "--truth"}, {"arguments": {"--truth": "x"}}, {"arguments": 5}],
    ids=repr,
)  # fmt: skip
def test_a_description_that_no_campaign_wrote_is_refused(simulated: dict[str, Any], tmp_path: Path) -> None:
    folder = campaign(tmp_path, **simulated)
    for read in (resumed, speed_before, left_out):
        with pytest.raises(FileProblem, match="simulated"):
            read(folder)


@pytest.mark.parametrize("simulated", ["yes", [1], 5, True])
def test_a_description_of_another_kind_is_refused(simulated: object, tmp_path: Path) -> None:
    folder = campaign(tmp_path)
    described = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
    (folder / "campaign.json").write_text(json.dumps(described | {"simulated": simulated}), encoding="utf-8")
    with pytest.raises(FileProblem, match="simulated"):
        resumed(folder)


def test_a_campaign_goes_on_with_its_own_seed_and_rig(tmp_path: Path) -> None:
    folder = campaign(tmp_path, arguments=["--rate", "500", "--truth", "x.h5"])
    options = resumed(folder)
    assert (options.seed, options.simulate, options.simulator_args) == (3, True, ("--rate=500",))
    assert left_out(folder) == ("--truth",)
    assert speed_before(folder) == 5.0


@pytest.mark.parametrize(
    "argument",
    [
        "--register-map=/home/lab/My Rig/map.toml", "--register-map=delta-rmc", "--dbc=/home/lab/coil-driver.dbc",
        "--ecu-roles=/home/lab/roles.toml", "--supply=rs-hmp", "--supply=my-supply.toml", "--by-hand=off",
        "--force-format=laumas-fast", "--displacement-format=/home/lab/Messgerät.toml", "--actuator=setpoints",
    ],
)
def test_a_rig_that_wears_a_bench_wears_it_again(argument: str) -> None:
    assert of_the_rig([argument]) == ((argument,), ())


@pytest.mark.parametrize("argument", ["--supply=../../bin/sh -c x", "--dbc=--bench", "--by-hand=maybe"])
def test_what_is_no_file_and_no_name_is_refused(argument: str) -> None:
    with pytest.raises(StrangeArgument):
        of_the_rig([argument])
