"""`[acceptance]`: bands that the matrix measures, the verdict on the specimen, and the verdict in every output."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from in_process import rig

from rig.campaign.file_copies import keep_matrix, kept_hashes
from rig.campaign.results import CampaignResult
from rig.cli.comparison_tables import specimen_blocks
from rig.cli.job import JobResult
from rig.cli.junit import JUnitReport, Outcome, take_specimen
from rig.comparison.planned_bands import check_acceptance
from rig.comparison.specimen import (
    SpecimenResult,
    read_specimen,
    specimen_result,
    untested,
    write_specimen,
)
from rig.display import SI
from rig.document.blocks import Note
from rig.errors import EXIT_DONE, EXIT_IDENTIFICATION, EXIT_NOT_ACCEPTED, EXIT_NOT_ALL_VALID, FileProblem
from rig.matrix.model import load_matrix
from rig.page.ended_run import EndedRun
from rig.recording.run import Run
from rig.recording.tested_specimens import SpecimenVerdict
from rig.report.acceptance import acceptance_section, specimen_fact

Make = Callable[..., Path]
REBOUND_N = 1000.0 * 2 * math.pi * 0.02 - 50.0
"""F = c v + F0 at the peak of the sine of `made_run`: 75.66 N."""
MATRIX = """
format = 1
[specimen]
serial_number = "S-a"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["1 Hz"]
current = ["0.5 A", "1 A"]
[acceptance]
bands = "bands.toml"
"""
REBOUND = '[[rebound_force]]\ncurrent = "{current} A"\nlow = "{low} N"\nhigh = "{high} N"\n'


def kept(folder: Path, bands: Path, matrix: str = MATRIX) -> Run:
    """A run with its matrix and its bands as a campaign keeps them."""
    file = bands.parent / "matrix.toml"
    file.write_text(matrix)
    keep_matrix(file, folder / "matrix.toml")
    description = json.loads((folder / "campaign.json").read_text())
    table = load_matrix(file).acceptance
    assert table is not None
    hashes = {"files": kept_hashes(folder), "acceptance": table.digest}
    (folder / "campaign.json").write_text(json.dumps({**description, "hashes": hashes}))
    return Run.open(folder)


def result_of(run: Run) -> SpecimenResult:
    result = specimen_result(run)
    assert result is not None
    return result


def test_the_verdict_on_the_specimen_follows_from_its_values(made_run: Make, made_point: Make, bands: Make) -> None:
    folder = made_run("a")
    assert specimen_result(Run.open(folder)) is None, "without [acceptance]"
    good = REBOUND.format(current=0.5, low=70, high=90)
    run = kept(folder, bands(good))
    for text, verdict, margin in (
        (good, "ok", REBOUND_N - 70.0),
        (REBOUND.format(current=0.5, low=80, high=90), "not-ok", REBOUND_N - 80.0),
        (good + REBOUND.format(current=1, low=0, high=900), "not-tested", math.nan),
        (REBOUND.format(current=0.5, low=80, high=90) + REBOUND.format(current=1, low=0, high=9), "not-ok", -4.34),
    ):
        result = result_of(kept(folder, bands(text)))
        assert (str(result.verdict), result.serial_number) == (verdict, "S-a")
        assert result.deciding is not None
        assert result.deciding.margin == pytest.approx(margin, abs=0.2, nan_ok=True)
    made_point(folder, "p002", 1000.0, current_A=1.0, verdict="invalid")
    result = result_of(kept(folder, bands(good + REBOUND.format(current=1, low=0, high=900))))
    assert result.verdict == SpecimenVerdict.NOT_TESTED
    assert run.path == folder


def test_the_matrix_can_replace_the_decision_rule(made_run: Make, bands: Make) -> None:
    """U = 2 * 2 % of 75.66 N = 3.03 N."""
    folder = made_run("a", percent=2.0)
    for rule, low, verdict in (
        ("simple", 74, "ok"), ("guarded-acceptance", 72, "ok"), ("guarded-acceptance", 74, "not-tested"),
        ("guarded-acceptance", 77, "not-ok"), ("guarded-rejection", 77, "ok"), ("guarded-rejection", 80, "not-ok"),
    ):
        matrix = MATRIX + f'decision = "{rule}"\n'
        result = result_of(kept(folder, bands(REBOUND.format(current=0.5, low=low, high=900)), matrix))
        assert (rule, low, str(result.verdict)) == (rule, low, verdict)
        assert result.acceptance is not None
        assert result.acceptance.decision == rule
    unstated = made_run("b")
    matrix = MATRIX + 'decision = "guarded-rejection"\n'
    result = result_of(kept(unstated, bands(REBOUND.format(current=0.5, low=80, high=900)), matrix))
    assert result.verdict == SpecimenVerdict.NOT_TESTED, "an uncertainty that is not stated proves nothing"


def test_bands_of_another_name_decide_nothing(made_run: Make, bands: Make) -> None:
    """The matrix that is kept with the run was edited: it names wider bands than those of the campaign."""
    folder = made_run("a")
    run = kept(folder, bands(REBOUND.format(current=0.5, low=80, high=90)))
    assert result_of(run).verdict == SpecimenVerdict.NOT_OK
    records = folder / "records"
    (records / "wide.toml").write_text((records / "bands.toml").read_text().replace("80 N", "70 N"))
    matrix = folder / "matrix.toml"
    matrix.write_text(matrix.read_text().replace("records/bands.toml", "records/wide.toml"))
    result = result_of(run)
    assert result.verdict == SpecimenVerdict.NOT_TESTED
    assert "records/wide.toml, which is not a file of this campaign" in result.reason


def test_a_decision_rule_that_was_changed_after_the_start_decides_nothing(made_run: Make, bands: Make) -> None:
    folder = made_run("a", percent=2.0)
    guarded = MATRIX + 'decision = "guarded-acceptance"\n'
    run = kept(folder, bands(REBOUND.format(current=0.5, low=74, high=900)), guarded)
    matrix, text = folder / "matrix.toml", (folder / "matrix.toml").read_text()
    for edited, word in (
        (text.replace("guarded-acceptance", "simple"), "acceptance.decision was changed"),
        (text.replace('decision = "guarded-acceptance"', ""), "acceptance.decision was changed"),
        (text.partition("[acceptance]")[0], "[acceptance] was removed"),
    ):
        matrix.write_text(edited)
        result = result_of(run)
        assert result.verdict == SpecimenVerdict.NOT_TESTED
        assert word in result.reason
    matrix.write_text(text)
    assert result_of(run).acceptance is not None


def test_bands_that_were_changed_or_lost_after_the_start_decide_nothing(made_run: Make, bands: Make) -> None:
    folder = made_run("a")
    run = kept(folder, bands(REBOUND.format(current=0.5, low=70, high=90)))
    copy = folder / "records" / "bands.toml"
    copy.write_text(copy.read_text().replace("70 N", "10 N"))
    assert result_of(run).verdict == SpecimenVerdict.NOT_TESTED
    assert "changed after the campaign" in result_of(run).reason
    copy.unlink()
    assert result_of(run).verdict == SpecimenVerdict.NOT_TESTED
    copy.symlink_to(folder / "campaign.json")
    assert "symbolic link" in result_of(run).reason


def test_the_verdict_is_written_read_shown_and_makes_the_exit_code(made_run: Make, bands: Make) -> None:
    folder = made_run("a")
    result = result_of(kept(folder, bands(REBOUND.format(current=0.5, low=80, high=90))))
    write_specimen(folder, result)
    assert read_specimen(folder).to_json() == result.to_json()
    (listed,) = json.loads(rig("runs", "--in", folder.parent, "--json").stdout)["runs"]
    assert (listed["specimen"], listed["specimen_verdict"]) == ("S-a", "not-ok")
    assert "not-ok" in rig("runs", "--in", folder.parent).stdout
    assert EndedRun(folder).specimen == {"verdict": "not-ok", "reason": result.reason}
    assert result.reason.startswith("rebound force at sine, 20 mm, 1 Hz, 0.5 A (p001): 75.6")
    assert "allowed 80 to 90 N, margin -4.3" in result.reason

    campaign = CampaignResult(folder, (), 1, 1, "safe", None, "", refused=False, wall_s=1.0, motion_s=1.0)
    job = JobResult(campaign, specimen=result)
    assert (job.exit_code, job.to_json()["specimen"]) == (EXIT_NOT_ACCEPTED, "not-ok")
    assert job.to_json()["acceptance"]["results"][0]["margin"] == pytest.approx(REBOUND_N - 80.0, abs=0.2)
    assert JobResult(campaign).exit_code == EXIT_DONE
    assert JobResult(campaign, error="no fit", specimen=result).exit_code == EXIT_IDENTIFICATION
    invalid = CampaignResult(folder, (), 0, 1, "safe", None, "", refused=False, wall_s=1.0, motion_s=1.0)
    assert JobResult(invalid, specimen=result).exit_code == EXIT_NOT_ALL_VALID, "first the verdict on the test"
    assert JobResult(campaign, specimen=untested(folder, "no point")).exit_code == EXIT_NOT_ACCEPTED

    verdict, value = specimen_blocks(result, SI)
    assert isinstance(verdict, Note)
    assert isinstance(value, Note)
    assert "Specimen S-a: NOT OK against drawing 4711 (simple): 1 of 1 values" in str(verdict.words)
    assert str(value.words).startswith("FAIL  rebound force")
    assert specimen_fact(result).value == "NOT OK"
    assert len(acceptance_section(result, SI)) == 3
    report = JUnitReport(None, "rig run")
    take_specimen(report, result)
    assert (report.cases["specimen"].outcome, report.cases["specimen"].kind) == (Outcome.FAILURE, "not-ok")


@pytest.mark.parametrize(
    ("band", "problem"),
    [
        ('[[energy]]\ncurrent = "2 A"\nhigh = "9 J"\n', "energy[1] (2 A): no point of the matrix matches this band"),
        ('[[energy]]\npoint = "p009"\nhigh = "9 J"\n', "energy[1] (p009): no point of the matrix"),
        ('[[friction_force]]\nhigh = "9 N"\n', "friction_force[1]: the matrix has no slow triangle test"),
        ("[[dynamic_range]]\nlow = 2\n", "the dynamic range of p001, p002 requires the same motion at 0 A"),
        ('[[energy]]\nmost_change = "5 %"\n', "energy[1]: most_change limits the change relative to another run"),
        ('[[parameter]]\nname = "Fyz"\nunit = "N"\nlow = 1\n', "parameter[1] (Fyz): Fyz is not a parameter of any"),
        ('[[parameter]]\nname = "Fya"\nunit = "kN"\nlow = 1\n', 'unit = "kN": Fya is fitted in "N"'),
    ],
)
def test_bands_that_limit_what_the_matrix_does_not_measure_are_refused(
    bands: Make, tmp_path: Path, band: str, problem: str
) -> None:
    (tmp_path / "matrix.toml").write_text(MATRIX)
    bands(REBOUND.format(current=0.5, low=70, high=90) + band)
    with pytest.raises(FileProblem) as caught:
        check_acceptance(tmp_path / "matrix.toml", load_matrix(tmp_path / "matrix.toml"))
    (line,) = caught.value.problems
    assert problem in line
    assert caught.value.file.endswith("bands.toml")


def test_bands_that_the_matrix_measures_are_accepted(bands: Make, tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX.replace('["0.5 A"', '["0 A", "0.5 A"') + '[friction]\namplitude = "10 mm"\n')
    bands(
        '[[rebound_force]]\nspeed = "0.126 m/s"\nlow = "0 N"\n[[dynamic_range]]\nlow = 2\n[[gas_force]]\nlow = "0 N"\n'
        '[[parameter]]\nname = "Fya"\nunit = "N"\nlow = 1\n'
    )
    check_acceptance(matrix, load_matrix(matrix))
    with pytest.raises(FileProblem, match="no model is fitted in this campaign"):
        check_acceptance(matrix, load_matrix(matrix), fitted=False)


def test_the_digest_follows_the_bands_and_not_the_name_of_their_file(bands: Make, tmp_path: Path) -> None:
    path = tmp_path / "matrix.toml"
    path.write_text(MATRIX.partition("[acceptance]")[0])
    without = load_matrix(path).digest
    text = REBOUND.format(current=0.5, low=70, high=90)
    bands(text)
    path.write_text(MATRIX)
    given = load_matrix(path).digest
    assert given != without
    (tmp_path / "bands.toml").rename(tmp_path / "other.toml")
    path.write_text(MATRIX.replace("bands.toml", "other.toml"))
    assert load_matrix(path).digest == given
    (tmp_path / "other.toml").write_text(text + "\n")
    assert load_matrix(path).digest != given
    (tmp_path / "other.toml").unlink()
    with pytest.raises(FileProblem, match=r"line 12: acceptance\.bands.*there is no such file"):
        load_matrix(path)
