"""A run from elsewhere writes nothing outside of its folder: ids are names, links are not followed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.cli.main import main
from rig.errors import DataWarning, FileProblem
from rig.export.point_tables import write_points
from rig.identification import identify
from rig.recording.atomic_write import inner_folder, open_to_append, write_text_durably
from rig.recording.conversion.recovery import recover
from rig.recording.importing import import_tests
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
    stored(campaign, point_id, point_id)
    write_points(Run.open(campaign), tmp_path)
    assert (tmp_path / f"{point_id}.csv").is_file()


def stored(folder: Path, name: str, point_id: str, **provenance: str) -> None:
    """A point's file under a name."""
    path = folder / "points" / f"{name}.h5"
    shutil.copy(FIRST_VERSION, path)
    with h5py.File(path, "r+") as file:
        file["entry/test"].attrs["id"] = point_id
        for key, value in provenance.items():
            file["entry/provenance"].attrs[key] = value


def test_a_copy_of_a_recording_is_left_out_and_named_and_takes_no_other_points_place(campaign: Path) -> None:
    """The export wrote both to p001.csv, and a fit was refused for all points."""
    stored(campaign, "p000", "p001", journal_check="a")
    stored(campaign, "p001", "p001", journal_check="a")
    stored(campaign, "p001-attempt2", "p001", journal_check="b")
    with pytest.warns(DataWarning, match=r"p000 left out as a copy \(points/p000.h5 contains .* as points/p001.h5\)"):
        run = Run.open(campaign)
    assert [point.path.stem for point in run.points if point.path] == ["p001", "p001-attempt2"]


def test_files_with_swapped_names_and_of_another_campaign_are_named_and_used(campaign: Path) -> None:
    (campaign / "campaign.json").write_text('{"id": "ours", "hash": "1"}', encoding="utf-8")
    stored(campaign, "p001", "p010", journal_check="a")
    stored(campaign, "p010", "p001", journal_check="b", campaign="theirs", campaign_hash="2")
    with pytest.warns(DataWarning) as warned:
        run = Run.open(campaign)
    message = "\n".join(str(one.message) for one in warned)
    assert "points/p001.h5 contains the point p010" in message
    assert "points/p010.h5 contains the point p001" in message
    assert "points/p010.h5 was recorded in another campaign (theirs)" in message
    assert sorted(point.id for point in run.points) == ["p001", "p010"]


def test_recovery_names_the_files_that_cannot_be_read(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stored(campaign, "p002", "p002")
    (campaign / "points" / "p001.h5").mkdir()
    assert main(["recover", str(campaign)]) == 0
    assert "points/p001.h5 cannot be read: is a folder" in capsys.readouterr().err


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


@pytest.mark.parametrize(("place", "name", "value"), [
    ("entry/quality", "reasons", 5), ("entry/quality", "reasons", [1.0, 2.0]), ("entry/data/force", "crc32", "x"),
    ("entry/quality", "reason_kinds", 5), ("entry/data/force", "crc32", [1, 2]),
    ("entry/data/force", "crc32", float("nan")),
])
def test_attributes_of_another_kind_are_refused_in_words(
    campaign: Path, place: str, name: str, value: object
) -> None:
    shutil.copy(FIRST_VERSION, campaign / "points" / "p001.h5")
    with h5py.File(campaign / "points" / "p001.h5", "r+") as file:
        file[place].attrs[name] = value
    with pytest.raises(FileProblem, match=r"reason(s|_kinds) = .*; expected texts|do not match their check"):
        _ = Run.open(campaign).points[0].force_N


def test_a_damaged_file_among_others_is_named_with_the_way_out(campaign: Path) -> None:
    shutil.copy(FIRST_VERSION, campaign / "points" / "p001.h5")
    (campaign / "points" / "p002.h5").write_bytes(b"damaged")
    with pytest.warns(DataWarning, match=r"points/p002.h5: .*Fix: restore the file from a backup, or move it out"):
        run = Run.open(campaign)
    assert [point.id for point in run.points] == ["p001"]
    assert len(run.unreadable) == 1
    assert run.left_out[0].startswith("p002 left out: unreadable (points/p002.h5")


def test_every_command_goes_on_without_a_damaged_file_and_names_it(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    t = np.arange(1000) * 0.004
    for name, phase in (("a", 0.0), ("b", 0.4)):
        x_mm, v_m_s = 20.0 * np.sin(9.0 * t + phase), 0.18 * np.cos(9.0 * t + phase)
        rows = np.column_stack([t, x_mm, 400.0 * v_m_s + 100.0 * np.tanh(v_m_s / 0.02)])
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.5f", ",", header="t_s,x_mm,F_N", comments="")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    run = import_tests([tmp_path / "a.csv", tmp_path / "b.csv"], columns=columns, out=tmp_path / "runs", current_A=0.5)
    damaged = run / "points" / "b.h5"
    damaged.write_bytes(damaged.read_bytes()[:1000])
    for arguments in (
        ["identify", str(run), "--model", "asymmetric"], ["report", str(run)], ["compare", str(run), str(run)],
        ["export", str(run), "--to", "csv", "--out", str(tmp_path / "tables")],
    ):
        capfd.readouterr()
        assert main(arguments) == 0, arguments
        assert "b left out: unreadable" in capfd.readouterr().err, arguments
    assert "b left out: unreadable" in (run / "report.html").read_text(encoding="utf-8")
    assert "b left out: unreadable" in (run / "fit.json").read_text(encoding="utf-8")
    assert main(["runs", "--in", str(run.parent), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["runs"][0]["remark"].startswith("b left out: unreadable")


@pytest.mark.parametrize("channel", ["force", "time", "displacement"])
def test_a_test_with_damaged_values_takes_no_other_with_it(tmp_path: Path, channel: str) -> None:
    t = np.arange(2000) * 0.004
    for name, phase in (("a", 0.0), ("b", 0.4)):
        x_mm, v_m_s = 20.0 * np.sin(9.0 * t + phase), 0.18 * np.cos(9.0 * t + phase)
        rows = np.column_stack([t, x_mm, 400.0 * v_m_s + 100.0 * np.tanh(v_m_s / 0.02)])
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.5f", ",", header="t_s,x_mm,F_N", comments="")
    columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
    run = import_tests([tmp_path / "a.csv", tmp_path / "b.csv"], columns=columns, out=tmp_path, current_A=0.5)
    with h5py.File(run / "points" / "a.h5", "r+") as file:
        file[f"entry/data/{channel}"][:10] = 3.0
    fit = identify(Run.open(run), model="asymmetric")
    assert any("points/a.h5" in warning and "damaged" in warning for warning in map(str, fit.warnings))
