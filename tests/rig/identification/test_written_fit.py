"""Where a fit is written, that none is lost, and which folders are taken for a run."""

import json
from pathlib import Path

import pytest

from rig.campaign_folder import CampaignFolder
from rig.dampers import model
from rig.errors import FileProblem
from rig.fits.entries import ErrorSummary, Evaluation, SolverReport
from rig.fits.fit_file import INTERVAL
from rig.identification.runs import write_fit
from rig.identification.uncertainty.fit import Fit


def fit(name: str) -> Fit:
    nothing = ErrorSummary(1.0, 1.0, 1.0, 1.0, 1.0, ())
    return Fit(name, {}, SolverReport("separable"), Evaluation(nothing, adequate=True), form=model(name).equation)


def test_an_older_fit_is_kept_each_time_under_a_name_of_its_own(tmp_path: Path) -> None:
    kept = [write_fit(fit(name), tmp_path)[1] for name in ("asymmetric", "kwok", "bingham")]
    assert kept[0] is None
    assert json.loads((tmp_path / "fit.json").read_text())["model"] == "bingham"
    assert [json.loads(path.read_text())["model"] for path in kept[1:] if path] == ["asymmetric", "kwok"]
    assert all(path.name.startswith("fit-20") for path in kept[1:] if path)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_fit_says_its_equation_and_the_name_of_its_intervals() -> None:
    written = fit("asymmetric").to_json()
    assert written["equation"].startswith("F = m a + C(I, sgn v) v")
    assert written["interval"] == INTERVAL


def test_a_folder_in_which_one_campaign_lies_replaces_it_and_one_with_two_is_refused(tmp_path: Path) -> None:
    assert CampaignFolder.found(tmp_path).path == tmp_path
    (tmp_path / "one" / "points").mkdir(parents=True)
    assert CampaignFolder.found(tmp_path).path == tmp_path / "one"
    assert CampaignFolder.found(tmp_path / "one").path == tmp_path / "one"
    (tmp_path / "two" / "points").mkdir(parents=True)
    with pytest.raises(FileProblem, match="2 campaigns found in this folder"):
        CampaignFolder.found(tmp_path)
