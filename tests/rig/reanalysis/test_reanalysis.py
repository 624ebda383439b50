"""Results are made again next to the originals, which stay byte for byte; what differs is listed with its cause."""

from __future__ import annotations

import errno
import json
import shutil
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import h5py
import numpy as np
import pytest
from in_process import rig

from rig import reanalysis, version
from rig.campaign.setup import described
from rig.campaign_folder import run_path
from rig.clock import utc_now
from rig.comparison import compare
from rig.errors import FileProblem, Refused
from rig.fits.fit_record import FitRecord
from rig.reanalysis import ReanalysisOptions, reanalyse, reanalyse_each
from rig.reanalysis.changes import Cause, value_changes
from rig.reanalysis.fit_settings import FitSettings
from rig.reanalysis.stage import staged
from rig.recording.conversion.delay_correction import write_verdict
from rig.recording.conversion.rebuilding import can_be_rebuilt
from rig.recording.importing import import_tests
from rig.recording.journal.journal_lock import campaign_held
from rig.recording.quality.verdict import Verdict, suspect
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.test_point import ENDURANCE, LOOP, RESPONSE

NO_FIT = ReanalysisOptions(fit=False)


def bytes_of(folder: Path) -> dict[str, str]:
    """SHA-256 of every file of a run, its reanalyses left out."""
    return {
        str(file.relative_to(folder)): sha256(file.read_bytes()).hexdigest()
        for file in sorted(folder.rglob("*"))
        if file.is_file() and "reanalysed" not in file.relative_to(folder).parts
    }


@pytest.fixture(scope="module")
def again(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, reanalysis.Reanalysis, bool]:
    """The campaign analysed again, and whether the original stayed byte for byte."""
    campaign = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("logs") / recorded.name))
    before = bytes_of(campaign)
    result = reanalyse(campaign)
    return campaign, result, bytes_of(campaign) == before


def test_originals_stay_and_the_result_is_a_complete_run(again: tuple[Path, reanalysis.Reanalysis, bool]) -> None:
    campaign, result, unchanged = again
    assert unchanged
    assert result.result is not None
    assert result.result.parent == campaign / "reanalysed"
    run = Run.open(result.result)
    assert [point.id for point in run.points] == ["p001", "p002", "p003"]
    assert {point.provenance["reanalysed_from_software"] for point in run.points} == {"mr-damper-rig 0.9.0"}
    assert FitRecord.load(result.result).model == "bingham"
    page = (result.result / "report.html").read_text(encoding="utf-8")
    assert f"{campaign.name} (reanalysed: {result.result.name})" in page
    assert not [file for file in result.result.rglob("*") if file.is_file() and b".partial" in file.read_bytes()]
    assert run_path(campaign / "reanalysed" / "last") == result.result


def test_samples_verdicts_and_values_that_differ_have_their_causes(
    again: tuple[Path, reanalysis.Reanalysis, bool]
) -> None:
    _, result, _ = again
    aligned = {point.id: point for point in result.points if Cause.ALIGNMENT in point.causes}
    assert aligned, "the points' delays are known from all of them together"
    assert all(0.01 < point.force_percent < 20.0 for point in aligned.values())
    assert result.recorded_by == ("mr-damper-rig 0.9.0",)
    assert result.models == ("bingham", "bingham")
    assert result.characteristics
    assert {cause for one in result.characteristics for cause in one.causes} == {Cause.ALIGNMENT}
    known = [one for one in result.fit if one.std > 0.0]
    assert known
    for one in known:
        assert one.causes == (Cause.ALIGNMENT,)
        assert one.change == pytest.approx(one.parts[Cause.ALIGNMENT], rel=1e-4)
    written = json.loads((result.result / "reanalysis.json").read_text()) if result.result else {}
    assert written["fit"] == result.to_json()["fit"]


def test_commands_take_the_result_and_compare_it_with_the_original(
    again: tuple[Path, reanalysis.Reanalysis, bool]
) -> None:
    campaign, result, _ = again
    compared = compare([campaign, campaign / "reanalysed" / "last"])
    assert not any("specified more than once" in remark for remark in compared.remarks)
    assert compared.runs[1].name.startswith(f"{campaign.name} (reanalysed")
    with pytest.raises(FileProblem, match="resume the original"):
        described(result.result or campaign)


@pytest.fixture(scope="module")
def present(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of one point as this version makes it."""
    run = Path(shutil.copytree(recorded, tmp_path_factory.mktemp("logs") / recorded.name))
    for name in ("p002", "p003"):
        (run / "points" / f"{name}.h5").unlink()
    result = reanalyse(run, NO_FIT).result
    assert result is not None
    return result


def test_the_same_version_changes_nothing_and_does_not_repeat_its_work(
    present: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(present, tmp_path / "run"))
    monkeypatch.setattr(version, "described", lambda: "1.2.3 (commit abc)")
    now = utc_now()
    monkeypatch.setattr("rig.reanalysis.reanalysis.utc_now", lambda: now)  # both results in the same second
    same = reanalyse(run, NO_FIT)
    assert (same.changed, same.changed_points, same.characteristics, same.fit) == (False, (), (), ())
    done = reanalyse(run)
    assert (done.up_to_date, done.result) == (True, same.result)
    (run / "matrix.toml").write_text("format = 1\n# another\n")
    monkeypatch.setattr("rig.reanalysis.reanalysis._made", lambda *_: same)
    assert not reanalyse(run).up_to_date
    assert len({folder.name for folder in (run / "reanalysed").iterdir()}) == 2


def test_a_changed_rule_and_a_changed_definition_are_told_apart(present: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(present, tmp_path / "run"))
    reason = suspect("force-scatter", "by a limit of the past")
    write_verdict(run / "points" / "p001.h5", Verdict.of([reason]), "test")
    stored = run / "characteristics.json"
    content = json.loads(stored.read_text())
    content["loops"][0]["energy_J"]["value"] *= 1.05
    stored.write_text(json.dumps(content))
    done = rig("reanalyse", "--no-fit", "--json", run)
    assert done.returncode == 0, done.stderr
    (again,) = json.loads(done.stdout)["runs"]
    (point,) = again["points"]
    changed = (point["id"], point["before"], point["after"], point["causes"])
    assert changed == ("p001", "suspect", "valid", [Cause.RULE])
    assert point["removed"] == ["force-scatter: by a limit of the past"]
    (energy,) = again["characteristics"]
    assert (energy["name"], energy["causes"]) == ("p001 energy_J", [Cause.DEFINITION])
    assert energy["after"] == pytest.approx(energy["before"] / 1.05)


def test_parts_of_a_change_are_attributed_step_by_step() -> None:
    (change,) = value_changes(
        {"x": (10.0, 0.5), "y": (1.0, 0.1)}, {"x": (11.0, 0.5), "y": (1.0, 0.1)}, {"x": (11.05, 0.4), "y": (1.0, 0.1)},
        Cause.ALIGNMENT, Cause.DEFINITION,
    )  # fmt: skip
    assert change.parts == pytest.approx({Cause.DEFINITION: 1.0, Cause.ALIGNMENT: 0.05})
    assert change.causes == (Cause.DEFINITION,)
    assert change.in_std == pytest.approx(2.1)
    (gone,) = value_changes({"z": (1.0, 0.1)}, {"z": (1.0, 0.1)}, {}, Cause.VERDICTS, Cause.DEFINITION)
    assert gone.causes == (Cause.VERDICTS,)


def test_imported_tests_keep_their_samples(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 6.0, 0.004)
    speed = 0.02 * 2.0 * np.pi * np.cos(2.0 * np.pi * time_s)
    table = np.column_stack([time_s, 20.0 * np.sin(2.0 * np.pi * time_s), 800.0 * speed])
    np.savetxt(tmp_path / "test.csv", table, delimiter=",", header="t_s,x_mm,F_N", comments="")
    run = import_tests([tmp_path / "test.csv"], columns={"time": "t_s", "displacement": "x_mm", "force": "F_N"},
                       out=tmp_path / "out", current_A=0.5)
    result = reanalyse(run)
    assert not result.changed_points
    assert result.result is not None
    assert any("imported" in remark for remark in result.remarks)
    assert any("no fit" in remark for remark in result.remarks)
    kept = RecordedPoint.open(result.result / "points" / "test.h5")
    assert np.array_equal(kept.force_N, Run.open(run).points[0].force_N)


def test_what_cannot_be_made_again_is_named_and_abandoned_results_are_removed(campaign: Path) -> None:
    points = campaign / "points"
    (points / "p003.h5").write_bytes((points / "p001.h5").read_bytes()[:5000])
    shutil.copyfile(points / "p002.h5", points / "p009.journal")
    with h5py.File(points / "p002.h5", "r+") as file:
        del file["entry/raw"]
    abandoned, held = (campaign / "reanalysed" / f".{name}.partial" for name in ("abandoned", "held"))
    for folder in (abandoned, held):
        (folder / "points").mkdir(parents=True)
    with campaign_held(held):
        result = reanalyse(campaign, NO_FIT)
    assert (abandoned.exists(), held.exists()) == (False, True)
    assert [point.id for point in result.points] == ["p001", "p002"]
    assert len(result.left_out) == 1
    assert "p003" in result.left_out[0]
    assert any("rig recover" in remark for remark in result.remarks)
    block = replace(RecordedPoint.open(points / "p001.h5"), kind=ENDURANCE)
    assert can_be_rebuilt(replace(block, kind=LOOP))
    assert not can_be_rebuilt(block), "the file of a block has only some of its samples"
    kept = result.points[1]
    assert kept.remark.startswith("the file contains no received samples")
    assert not kept.changed


def test_no_fit_is_expected_of_a_run_whose_points_serve_none(recorded: Path) -> None:
    loops = Run.open(recorded)
    assert FitSettings.of(None, loops, "") is not None
    response = replace(loops, points=tuple(replace(point, kind=RESPONSE) for point in loops.points))
    assert FitSettings.of(None, response, "") is None
    assert FitSettings.of(None, response, "bingham") is not None, "a model that is requested must be fitted or fail"


def test_an_interruption_or_a_full_disk_leaves_nothing(
    present: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(present, tmp_path / "run"))
    before = bytes_of(run)
    full = OSError(errno.ENOSPC, "No space left on device")
    for error, raised, message in ((full, FileProblem, "--out"), (KeyboardInterrupt(), KeyboardInterrupt, None)):

        def refuse(_points: Path, error: BaseException = error) -> None:
            raise error

        monkeypatch.setattr("rig.reanalysis.reanalysis.retime", refuse)
        with pytest.raises(raised, match=message):
            reanalyse(run, NO_FIT)
        assert bytes_of(run) == before
        assert not (run / "reanalysed").exists()
    monkeypatch.setattr("rig.reanalysis.stage.SPARE_BYTES", 1 << 60)
    with pytest.raises(FileProblem, match="MB required") as caught:
        reanalyse(run, NO_FIT)
    assert caught.value.slug == "disk-full"


def test_a_run_that_changes_meanwhile_has_no_result(
    present: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(present, tmp_path / "run"))

    def resumed(*_: object) -> reanalysis.Reanalysis:
        (run / "points" / "p009.journal").write_bytes(b"")
        return reanalysis.Reanalysis(run)

    monkeypatch.setattr("rig.reanalysis.reanalysis._made", resumed)
    with pytest.raises(FileProblem, match="were changed while it was analysed"):
        reanalyse(run, NO_FIT)
    assert not (run / "reanalysed").exists()


def test_results_made_at_the_same_time_have_their_own_names(tmp_path: Path) -> None:
    with staged(tmp_path, "r{}".format, 0) as (first, name), staged(tmp_path, "r{}".format, 0) as (second, other):
        assert (name.name, other.name) == ("r0", "r1")
        assert first.is_dir()
        assert second.is_dir()
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["r0", "r1"]


def test_a_campaign_that_runs_is_refused(campaign: Path) -> None:
    with campaign_held(campaign), pytest.raises(Refused) as caught:
        reanalyse(campaign)
    assert caught.value.slug == "two-instances"


def test_a_place_that_cannot_be_written_is_named_and_one_bad_run_does_not_affect_the_others(
    present: Path, tmp_path: Path
) -> None:
    campaign = Path(shutil.copytree(present, tmp_path / "logs" / "run"))
    (campaign / "reanalysed").write_text("a file")
    with pytest.raises(FileProblem, match="--out"):
        reanalyse(campaign, NO_FIT)
    with pytest.raises(FileProblem, match="specified twice"):
        reanalyse_each([campaign, campaign])
    empty, out = tmp_path / "logs" / "empty", tmp_path / "results"
    (empty / "points").mkdir(parents=True)
    made, failed = reanalyse_each([campaign, empty], ReanalysisOptions(out, fit=False))
    assert made.result is not None
    assert made.result.parent == out / campaign.name
    assert "no points were recorded" in failed.error or "not a run" in failed.error
    ended = rig("reanalyse", "--json", empty)
    assert ended.returncode == 2
    answer = json.loads(ended.stdout)
    assert (answer["reanalysed"], answer["failed"], answer["runs"][0]["result"]) == (0, 1, None)
