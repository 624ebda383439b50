"""Damper models, methods, report sections and exports of other packages, and the command that lists all plug-ins."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from rig import dampers
from rig.cli.main import main
from rig.document.blocks import Heading, Items, Listing, Markup, Note, Paragraph, Table
from rig.document.html import fragment
from rig.document.words import POOR, plain
from rig.errors import FileProblem
from rig.export import EXPORTERS, export
from rig.matrix.model import load_matrix
from rig.optimisers import METHODS, minimise
from rig.plugins import PlugInProblem
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.report.plugin_sections import blocks_of, installed_sections

if TYPE_CHECKING:
    from conftest import Install

QUICK = (Path(__file__).resolve().parents[2] / "examples" / "quick.toml").read_text(encoding="utf-8")
FIT = {
    "model": "bingham", "equation": "F = ...", "hysteresis": "kwok", "method": "separable", "adequate": True,
    "warnings": [],
    "parameters": {"c0": {"value": 512.5, "unit": "N s/m", "low": 500.0, "high": 525.0, "identifiable": True, "x": 1}},
}  # fmt: skip


class Bowl:
    """Sum of squares about (1, 2, 3)."""

    n_parameters = 3

    def batch(self, points: np.ndarray) -> np.ndarray:
        return np.sum((points - np.array([1.0, 2.0, 3.0])) ** 2, axis=1)


def matrix(folder: Path, identify: str, prior: str = "demo") -> Path:
    """A matrix file with that table."""
    path = folder / "matrix.toml"
    path.write_text(QUICK.replace('"demo"', f'"{prior}"') + f"\n[identify]\n{identify}\n", encoding="utf-8")
    return path


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """A run of one point in memory: 1 Hz, 10 mm, F = 1000 N s/m times v."""
    time_s = np.arange(0.0, 1.0, 0.01)
    speed_m_s = 0.01 * 2 * np.pi * np.cos(2 * np.pi * time_s)
    point = RecordedPoint.from_arrays(
        time_s=time_s, displacement_m=0.01 * np.sin(2 * np.pi * time_s), force_N=1000.0 * speed_m_s,
        velocity_m_s=speed_m_s, id="p001", waveform="sine", amplitude_m=0.01, frequency_Hz=1.0, current_A=0.5,
        cycles=1.0,
    )  # fmt: skip
    return Run(tmp_path / "a-run", (point,))


@pytest.mark.nightly
def test_a_plug_ins_model_is_known_wherever_models_are_named(my_lab: Path) -> None:
    model = dampers.model("my_lab_friction")
    assert "my_lab_friction" in list(dampers.MODELS)
    assert dampers.parameter_set("demo-my-lab-friction").values == model.demonstration
    read = load_matrix(matrix(my_lab, 'model = "my_lab_friction"\nmethod = "my_lab_shrinking"', "demo-my-lab-friction"))
    assert (read.identify.model, read.identify.method) == ("my_lab_friction", "my_lab_shrinking")
    time_s = np.arange(0.0, 1.0, 1e-3)
    u_m, v_m_s = 0.02 * np.sin(2 * np.pi * time_s), 0.04 * np.pi * np.cos(2 * np.pi * time_s)
    force_N = model.force(model.demonstration, u_m, v_m_s, np.zeros(1000), 1.0, 1e-3)
    # Slid by 20 mm the friction is whole: F = 700 + 110 times v, 80 + 250, - 150, at mid-stroke.
    assert force_N[500] == pytest.approx(-(810.0 * 0.04 * np.pi) - 330.0 - 150.0, rel=1e-3)


def test_names_are_listed_without_loading_and_a_broken_model_is_refused_before_anything_moves(install: Install) -> None:
    folder = install("ill-lab", {"mr_rig.damper_models": {"ill_model": "ill_lab:Model"}}, "raise OSError('no file')")
    assert "ill_model" in dampers.MODELS
    with pytest.raises(PlugInProblem, match=r"ill-lab 1\.0 .*ill_model = ill_lab:Model.*OSError: no file"):
        dampers.model("ill_model")
    for expected in ("ill_model", "all"):
        with pytest.raises(FileProblem, match=r"identify\.model.*ill-lab 1\.0"):
            load_matrix(matrix(folder, f'model = "{expected}"'))
    assert dampers.model("bingham").name == "bingham"
    assert load_matrix(matrix(folder, 'model = "bingham"')).identify.model == "bingham"


@pytest.mark.parametrize(
    ("source", "why"),
    [
        ("Model = 3", "expected a rig.dampers.DamperModel"),
        ("from rig.dampers.plastic import BinghamModel as Model", "got a model named 'bingham'"),
    ],
)
def test_what_is_no_model_of_that_name_is_refused(install: Install, source: str, why: str) -> None:
    install("odd-lab", {"mr_rig.damper_models": {"odd_model": "odd_lab:Model"}}, source)
    with pytest.raises(PlugInProblem, match=why):
        dampers.model("odd_model")


def test_a_plug_ins_method_finds_the_bottom_of_a_bowl(my_lab: Path) -> None:
    result = minimise(Bowl(), method="my_lab_shrinking", bounds=[(-10.0, 10.0)] * 3, budget=20_000, seed=1)
    assert result.best == pytest.approx([1.0, 2.0, 3.0], abs=1e-3)
    assert "my_lab_shrinking" in METHODS


def test_a_method_without_defaults_is_refused(install: Install) -> None:
    source = (
        "from dataclasses import dataclass\n"
        "@dataclass\nclass Method:\n    step: float\n    def run(self, search): ...\n"
    )
    folder = install("odd-lab", {"mr_rig.methods": {"odd_method": "odd_lab:Method"}}, source)
    with pytest.raises(FileProblem, match=r"identify\.method.*step"):
        load_matrix(matrix(folder, 'method = "odd_method"'))


def test_a_section_comes_into_the_report_and_a_failing_one_is_a_remark(
    my_lab: Path, install: Install, run: Run
) -> None:
    install("ill-lab", {"mr_rig.report_sections": {"ill": "ill_lab:section"}}, "def section(run, fit): 1 / 0")
    install("old-lab", {"mr_rig.report_sections": {"old": "old_lab:section"}}, (
        "from rig.report.fragment import box, heading, table, text\n"
        "def section(run, fit): return heading('Old', 'a <b>note</b>') + box('bad', text('<&>')) + "
        "table(['Point', 'J'], [('', ['p001', '2.5'])], (1,))"
    ))  # fmt: skip
    first, *second, old = installed_sections(run, None)
    assert isinstance(first, Note)
    assert "ill-lab 1.0" in plain(first.words)
    assert "ZeroDivisionError" in plain(first.words)
    # Work of F = c v over a cycle: pi c omega A^2 = pi * 1000 * 2 pi * 1e-4 J, less the last of 100 samples.
    (made,) = (block for block in second if isinstance(block, Table))
    assert made.rows[0].cells[0] == "p001"
    assert 1.9 < float(plain(made.rows[0].cells[1])) < 2.0
    # HTML of earlier plug-ins is in the page as it is, and as blocks in the other formats
    assert isinstance(old, Markup)
    assert old.html in fragment([old])
    title, note, doubt, listed = old.blocks
    assert (title, note) == (Heading("Old"), Paragraph("a note", small=True))
    assert doubt == Note(POOR, "<&>")
    assert isinstance(listed, Table)
    assert [column.numeric for column in listed.columns] == [False, True]
    assert listed.rows[0].cells == ("p001", "2.5")
    assert blocks_of("loose <ul><li>a</li></ul><pre>x\ny</pre>") == [Paragraph("loose"), Items(("a",)), Listing("x\ny")]


def test_a_run_is_exported_as_csv_with_its_numbers(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Run, "open", lambda path: run)
    files = export(tmp_path / "a-run", "csv", tmp_path / "out")
    assert [file.name for file in files] == ["points.csv", "p001.csv"]
    (listed,) = csv.DictReader(files[0].read_text().splitlines())
    assert (listed["id"], listed["amplitude_m"], listed["verdict"]) == ("p001", "0.01", "valid")
    rows = list(csv.DictReader(files[1].read_text().splitlines()))
    assert len(rows) == 100
    assert list(rows[0]) == ["time_s", "displacement_m", "velocity_m_s", "force_N", "current_measured_A"]
    assert [float(rows[25][name]) for name in ("displacement_m", "current_measured_A")] == pytest.approx([0.01, 0.5])
    assert float(rows[0]["force_N"]) == pytest.approx(1000.0 * 0.02 * np.pi)


def test_a_plug_ins_export_is_one_of_the_formats(
    my_lab: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Run, "open", lambda path: run)
    (file,) = export(tmp_path / "a-run", "my_lab_gnuplot", tmp_path / "out")
    assert file.read_text().splitlines()[:2] == ["# p001", "0.000000 0.0000000 62.832"]
    assert {"csv", "json", "c", "inverse"} <= set(EXPORTERS)
    assert list(EXPORTERS)[-1] == "my_lab_gnuplot"


def run_rig(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, Any]:
    """Exit code and JSON answer of a command."""
    code = main([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_a_fit_is_exported_as_its_values_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fit, out = tmp_path / "fit.json", tmp_path / "values"
    fit.write_text(json.dumps(FIT), encoding="utf-8")
    code, answer = run_rig(capsys, "export", str(fit), "--to", "json", "--out", str(out))
    assert code == 0
    assert answer["files"] == [str(out / f"{tmp_path.name}-parameters.json")]
    content = json.loads(Path(answer["files"][0]).read_text())
    assert content["parameters"] == {
        "c0": {"value": 512.5, "unit": "N s/m", "low": 500.0, "high": 525.0, "identifiable": True}
    }
    assert "warnings" not in content


def test_an_export_of_what_is_not_there_is_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fit = tmp_path / "fit.json"
    fit.write_text(json.dumps(FIT), encoding="utf-8")
    requested = ("--out", str(tmp_path / "out"))
    code, answer = run_rig(capsys, "export", str(fit), "--to", "xls", *requested)
    assert code == 2
    assert answer["error"] == f"export: got 'xls', expected one of {', '.join(EXPORTERS)}"
    code, answer = run_rig(capsys, "export", str(fit), "--to", "csv", *requested)
    assert code == 2
    assert "specify a campaign folder" in answer["error"]
    code, answer = run_rig(capsys, "export", str(tmp_path), "--to", "csv", *requested)
    assert code == 2
    fit.write_text("{}", encoding="utf-8")
    code, answer = run_rig(capsys, "export", str(tmp_path), "--to", "json", *requested)
    assert code == 2
    assert "model: is missing" in answer["error"]
    assert not (tmp_path / "out").exists()


def test_rig_plugins_lists_each_with_its_state(
    my_lab: Path, install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    code, answer = run_rig(capsys, "plugins")
    assert code == 0
    assert [(one["kind"], one["name"], one["state"]) for one in answer["plugins"]] == [
        ("sensor", "my_lab_cell", "ok"), ("damper model", "my_lab_friction", "ok"),
        ("method", "my_lab_shrinking", "ok"), ("report section", "my_lab_energy", "ok"),
        ("export", "my_lab_gnuplot", "ok"),
    ]
    install(
        "sly-lab", {"mr_rig.methods": {"separable": "sly_lab:a"}, "mr_rig.damper_models": {"bingham": "sly_lab:b"},
                    "mr_rig.exports": {"lost": "sly_lab:c"}}, "",
    )  # fmt: skip
    code, answer = run_rig(capsys, "plugins")
    assert code == 2
    states = {one["name"]: one["state"] for one in answer["plugins"] if one["package"] == "sly-lab"}
    assert states == {"bingham": "shadowed", "separable": "shadowed", "lost": "broken"}
    assert main(["plugins"]) == 2
    message = capsys.readouterr().out
    assert "the built-in method 'separable' is used instead" in message
    assert "has no attribute 'c'" in message


def test_without_plug_ins_that_is_reported(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.plugins.found", lambda group: ())
    assert run_rig(capsys, "plugins") == (0, {"plugins": []})
    assert main(["plugins"]) == 0
    assert "no plug-ins are installed" in capsys.readouterr().out
