"""A run from elsewhere writes nothing outside of its folder: ids are names, links are not followed."""

from __future__ import annotations

import shutil
from pathlib import Path

import h5py
import pytest

from rig.errors import FileProblem
from rig.export.point_tables import write_points
from rig.recording.atomic_write import inner_folder, open_to_append, write_text_durably
from rig.recording.conversion.recovery import recover
from rig.recording.run import Run

FIRST_VERSION = Path(__file__).with_name("first_version.h5")


@pytest.mark.parametrize("point_id", [
    "../../elsewhere", "/etc/cron.d/job", "..", ".hidden", "a/b", "a\\b", "C:x", "p\n1", "p\x1b[2J", "", "x" * 300,
])
def test_a_points_id_is_a_name_and_never_a_path(campaign: Path, point_id: str) -> None:
    shutil.copy(FIRST_VERSION, campaign / "points" / "p001.h5")
    with h5py.File(campaign / "points" / "p001.h5", "r+") as file:
        file["entry/test"].attrs["id"] = point_id
    with pytest.raises(FileProblem) as refused:
        Run.open(campaign)
    (problem,) = refused.value.problems
    assert problem.startswith("points/p001.h5: /entry/test: id = ")


@pytest.mark.parametrize("point_id", ["p001", "Dämpfer 3, 5 mm (2)", "a" * 150])
def test_names_that_are_no_paths_are_exported_under_themselves(tmp_path: Path, campaign: Path, point_id: str) -> None:
    shutil.copy(FIRST_VERSION, campaign / "points" / "p001.h5")
    with h5py.File(campaign / "points" / "p001.h5", "r+") as file:
        file["entry/test"].attrs["id"] = point_id
    write_points(Run.open(campaign), tmp_path)
    assert (tmp_path / f"{point_id}.csv").is_file()


@pytest.mark.parametrize("link", ["symbolic", "hard"])
@pytest.mark.parametrize("name", ["fit.json", "fit.json.tmp"])
def test_a_link_in_the_way_of_a_file_is_replaced_and_not_written_through(tmp_path: Path, name: str, link: str) -> None:
    victim, run = tmp_path / "victim", tmp_path / "run"
    victim.write_text("mine")
    run.mkdir()
    if link == "symbolic":
        (run / name).symlink_to(victim)
    else:
        (run / name).hardlink_to(victim)
    write_text_durably(run / "fit.json", "fit")
    assert victim.read_text() == "mine"
    assert (run / "fit.json").read_text() == "fit"
    assert not (run / "fit.json").is_symlink()


def test_folders_and_logs_that_are_links_are_refused(tmp_path: Path, campaign: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (campaign / "reference").symlink_to(elsewhere)
    with pytest.raises(OSError, match="symbolic link"):
        inner_folder(campaign, "reference")
    (campaign / "finaliser.log").symlink_to(elsewhere / "log")
    with pytest.raises(OSError, match="symbolic links"):
        open_to_append(campaign / "finaliser.log")
    (campaign / "points").rmdir()
    (campaign / "points").symlink_to(elsewhere)
    with pytest.raises(FileProblem):
        recover(campaign)
    assert list(elsewhere.iterdir()) == []
