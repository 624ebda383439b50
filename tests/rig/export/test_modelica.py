"""Models as Modelica: compiled and simulated by Rumoca beside the model's own force."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from rig.cli.main import main
from rig.dampers import model as damper_model
from rig.dampers.catalogue import CATALOGUE
from rig.dampers.model import DamperModel
from rig.export import export
from rig.export.code.modelica_source import PROVED

WITHOUT_STATES = [model for model in CATALOGUE if model.states == 0]
SHAKEN = """model Shaken
  {name} d;
equation
  d.u = 0.02*sin(14.45*time) + 0.002*sin(69.1*time + 1.0);
  d.v = 0.289*cos(14.45*time) + 0.1382*cos(69.1*time + 1.0);
  d.a = -4.17605*sin(14.45*time) - 9.54962*sin(69.1*time + 1.0);
  d.current = 1.0 + 0.6*sin(10.7*time);
end Shaken;
"""
"""Two tones, so that some reversals are small; the current changes on the way."""
FINE_S, EVERY = 1e-4, 10
"""So finely our own force is integrated where a tool's states are held beside it, and every so many of its samples."""


def values_of(model: DamperModel) -> dict[str, float]:
    values = dict(damper_model(model.name.partition("+")[0]).demonstration)
    if model.hysteresis == "printed":
        values["lambda"] = values.pop("delta") / values["beta"]
    law = {"k_sat": 0.9, "q2": -0.1, "q3": 0.01, "x at 1 A": 1.2}
    return values | {name: value for name, value in law.items() if name in model.names}


def fit_of(model: DamperModel, folder: Path) -> Path:
    reported = {"low": None, "high": None, "standard_error": None, "identifiable": True, "unit": ""}
    parameters = {name: reported | {"value": value} for name, value in values_of(model).items()}
    tested = {"displacement_m": [-0.03, 0.03], "velocity_m_s": [-0.3, 0.3], "current_A": [0.0, 2.0]}
    fit = {"model": model.name, "hysteresis": model.hysteresis, "parameters": parameters, "tested": tested}
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fit.json").write_text(json.dumps(fit))
    return folder / "fit.json"


def finely(model: DamperModel) -> np.ndarray:
    """Our own force along the shaking, from the same start as the block's: springs free, the loop in its middle."""
    t = FINE_S * np.arange(6001)
    u = 0.02 * np.sin(14.45 * t) + 0.002 * np.sin(69.1 * t + 1.0)
    v = 0.289 * np.cos(14.45 * t) + 0.1382 * np.cos(69.1 * t + 1.0)
    a = -4.17605 * np.sin(14.45 * t) - 9.54962 * np.sin(69.1 * t + 1.0)
    force = model.force(values_of(model), u, v, a, 1.0 + 0.6 * np.sin(10.7 * t), FINE_S)
    return np.asarray(force)[::EVERY]


def integrated(model: DamperModel, folder: Path) -> float:
    """Largest difference of the forces where Rumoca integrates the internal states, relative to the peak."""
    try:
        import rumoca
    except ImportError:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("rumoca (Modelica compiler) is not installed")
    (file,) = export(fit_of(model, folder), "modelica", folder)
    (folder / "Shaken.mo").write_text(SHAKEN.format(name=file.stem))
    config = rumoca.SimConfig(rtol=1e-10, atol=1e-13)
    shaken = rumoca.Session().load(str(folder / "Shaken.mo"), model="Shaken")
    reported = shaken.simulate(t=(0, 0.6), dt=0.001, config=config).to_dict()["data"]
    force, own = np.asarray(reported["d.force"]), finely(model)
    assert force.size == own.size == 601
    assert np.ptp(own) > 100.0
    assert np.ptp(reported["d.s0"]) > 1e-4, "the state moves"
    return float(np.max(np.abs(force - own)) / np.max(np.abs(own)))


def proved(model: DamperModel, folder: Path, shaken: str = SHAKEN, name: str = "d") -> float:
    """Largest difference of the forces, relative to the peak."""
    try:
        import rumoca
    except ImportError:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("rumoca (Modelica compiler) is not installed")
    (file,) = export(fit_of(model, folder), "modelica", folder)
    (folder / "Shaken.mo").write_text(shaken.format(name=file.stem))
    simulated = rumoca.Session().load(str(folder / "Shaken.mo"), model="Shaken").simulate(t=(0, 0.6), dt=0.001)
    reported = {key.removeprefix(f"{name}."): np.asarray(data) for key, data in simulated.to_dict()["data"].items()}
    motion = [reported[key] for key in ("u", "v", "a", "current")]
    assert np.ptp(motion[0]) > 0.02
    assert np.ptp(motion[1]) > 0.15
    force = np.asarray(model.force(values_of(model), *motion, 0.001))
    assert force.size == 601
    assert np.ptp(force) > 100.0
    return float(np.max(np.abs(reported["force"] - force)) / np.max(np.abs(force)))


def test_rumoca_simulates_every_model_without_states_with_its_force(tmp_path: Path) -> None:
    assert len(WITHOUT_STATES) >= 7
    for k, model in enumerate(WITHOUT_STATES):
        assert proved(model, tmp_path / str(k)) < 1e-9, model.name


def test_rumoca_integrates_the_states_of_every_model_that_is_offered_with_them(tmp_path: Path) -> None:
    offered = [model for model in CATALOGUE if model.states and model.name in PROVED]
    assert {model.name for model in offered} == PROVED
    for model in offered:
        assert integrated(model, tmp_path / model.name) < 1e-6, model.name


def test_a_current_law_is_in_a_model_with_states_too(tmp_path: Path) -> None:
    assert integrated(damper_model("lugre+saturating"), tmp_path) < 1e-6


def test_the_recipe_of_the_page_runs(tmp_path: Path) -> None:
    page = Path(__file__).parents[3] / "docs" / "how-to" / "use-a-fit-elsewhere.md"
    (recipe,) = re.findall(r"```modelica\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    assert proved(damper_model("asymmetric"), tmp_path, recipe, "damper") < 1e-9


@pytest.mark.parametrize("text", ["asymmetric+saturating", "bingham+polynomial"])
def test_a_current_law_is_in_it(text: str, tmp_path: Path) -> None:
    assert proved(damper_model(text), tmp_path) < 1e-9


def test_the_block_says_equation_units_ranges_and_the_hash_of_the_fit(tmp_path: Path) -> None:
    (file,) = export(fit_of(damper_model("bingham"), tmp_path), "modelica", tmp_path)
    text = file.read_text()
    assert file.name == "damper_bingham.mo"
    for piece in (
        'block damper_bingham "MR damper', 'input Real v(unit = "m/s")', "// Equation: ", "// SHA-256 of the fit: ",
        "velocity_m_s -0.3 to 0.3", "end damper_bingham;\n",
    ):  # fmt: skip
        assert piece in text


@pytest.mark.parametrize(("text", "why"), [
    ("sprung_bouc_wen", "internal states"), ("viscoelastic_plastic+saturating", "internal states"),
    ("bingham+per-current@0,1,2", "a table in its equation"),
])
def test_what_no_tool_proved_is_not_offered(
    text: str, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fit = fit_of(damper_model(text), tmp_path)
    assert main(["export", str(fit), "--to", "modelica", "--out", str(tmp_path / "out")]) == 2
    message = " ".join(capsys.readouterr().err.split())
    assert f"{text} has {why}: its Modelica code could not be verified" in message
    assert "--to fmi" in message
    assert not list((tmp_path / "out").glob("*.mo"))
