"""Exported C and Python beside the fit that they came from: its forces, its currents, and where it extrapolates."""

from __future__ import annotations

import importlib.util
import json
import os
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from rig.dampers import model as damper_model
from rig.export import export
from rig.identification import Fit

DT_S = 1e-3
T_S = np.arange(500) * DT_S
NAMES = ("asymmetric", "lost_motion", "sprung_bouc_wen", "modified_bouc_wen", "lugre", "asymmetric+saturating")
LAW = {"k_sat": 0.4}
BAND = {"current_A": [0.0, 2.0], "half_width_N": [5.0, 5.0], "source": "fitted tests"}
TESTED = {
    "displacement_m": [-0.03, 0.03], "velocity_m_s": [-0.35, 0.35], "current_A": [0.0, 2.0],
    "temperature_degC": [20.0, 40.0], "only_at_A": [], "band": BAND,
}  # fmt: skip


def fit_of(name: str, folder: Path, tested: dict[str, object] | None = None) -> tuple[Fit, Path]:
    """A fit with the model's demonstration values."""
    damper = damper_model(name)
    values = damper_model(name.partition("+")[0]).demonstration | {key: LAW[key] for key in LAW if key in damper.names}
    error = {"rmse_N": 5.0, "mae_N": 4.0, "sd_N": 5.0, "r_squared": 0.99, "nrmse_percent_of_peak": 1.0, "per_test": []}
    parameters = {key: {"value": value, "unit": "", "identifiable": True, "low": None, "high": None,
                        "standard_error": None} for key, value in values.items()}  # fmt: skip
    content = {
        "model": name, "hysteresis": damper.hysteresis, "method": "separable", "weight": "1", "adequate": True,
        "warnings": [], "evaluations": 1, "wall_s": 0.0, "objective": 1.0, "condition": 1.0, "parameters": parameters,
        "error": error, "current": {"dependence": "affine"}, "tested": tested or TESTED,
    }  # fmt: skip
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fit.json").write_text(json.dumps(content))
    return Fit.load(folder / "fit.json"), folder / "fit.json"


def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two tones, so that some reversals are small; the acceleration is the one that a fit takes of the velocity."""
    slow, fast = 2.0 * np.pi * 2.3, 2.0 * np.pi * 11.0
    u = 0.02 * np.sin(slow * T_S) + 0.002 * np.sin(fast * T_S + 1.0)
    v = 0.02 * slow * np.cos(slow * T_S) + 0.002 * fast * np.cos(fast * T_S + 1.0)
    return u, v, np.gradient(v, DT_S, edge_order=2)


MAIN = """#include <stdio.h>
#include "{stem}.h"
int main(void) {{
    double d[{upper}_MEMORY], u, v, a, current, temperature;
    int first = 1;
    while (scanf("%lf %lf %lf %lf %lf", &u, &v, &a, &current, &temperature) == 5) {{
        double force = first ? {stem}_start(d, u, v, a, current) : {stem}_step(d, u, v, a, current, 1e-3);
        printf("%.17g %d\\n", force, {stem}_beyond(u, v, current, temperature));
        first = 0;
    }}
    return 0;
}}
"""


class Compiled:
    """An exported model, compiled by gcc."""

    def __init__(self, fit: Path, folder: Path) -> None:
        compiler = shutil.which("gcc")
        if compiler is None:
            (pytest.fail if os.environ.get("CI") else pytest.skip)("gcc (C compiler) is not installed")
        header, source = export(fit, "c", folder)
        (folder / "main.c").write_text(MAIN.format(stem=header.stem, upper=header.stem.upper()))
        self.program = folder / "main"
        strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off"]
        subprocess.run(
            [str(compiler), *strict, "main.c", source.name, "-lm", "-o", "main"], cwd=folder, check=True, timeout=60
        )

    def run(self, *columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Forces (N) and what lies beyond, of rows of u, v, a, current and temperature."""
        lines = "\n".join(" ".join(repr(float(x)) for x in row) for row in zip(*columns, strict=True))
        reported = subprocess.run([self.program], input=lines, capture_output=True, text=True, check=True, timeout=60)
        force, beyond = np.array(reported.stdout.split(), dtype=float).reshape(-1, 2).T
        return force, beyond.astype(int)


def module_of(fit: Path, folder: Path) -> ModuleType:
    (path,) = export(fit, "python", folder)
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{folder.name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def close(found: np.ndarray, expected: np.ndarray) -> None:
    """To 1e-6 of the peak, twice that where `simulate` integrates what the code follows exactly along its curve."""
    assert np.ptp(expected) > 100.0
    assert np.max(np.abs(found - expected)) < 2e-6 * np.max(np.abs(expected))


@pytest.mark.few(2)
@pytest.mark.parametrize("name", NAMES)
def test_exported_code_gives_the_force_of_simulate_and_of_the_inverse(name: str, tmp_path: Path) -> None:
    """Behind a spring the inverse tells the force that the current leads to, `simulate` the one on the way there."""
    fit, file = fit_of(name, tmp_path)
    compiled, module = Compiled(file, tmp_path / "c"), module_of(file, tmp_path / "python")
    u, v, a = motion()
    warm = np.full(u.size, np.nan)
    current = 1.0 + 0.6 * np.sin(2.0 * np.pi * 1.7 * T_S)
    simulated = fit.simulate(T_S, u, current, velocity_m_s=v)["force_N"].to_numpy()
    answer = fit.inverse(simulated + 20.0 * np.sin(30.0 * T_S), v, u, time_s=T_S)
    found = answer["current_A"].to_numpy()
    assert np.ptp(found) > 0.3
    again = fit.simulate(T_S, u, found, velocity_m_s=v)
    for given, expected in ((current, simulated), (found, again["force_N"].to_numpy())):
        close(compiled.run(u, v, a, given, warm)[0], expected)
        close(np.array(module.force(u.tolist(), v.tolist(), a.tolist(), given.tolist(), DT_S)), expected)
    states = [column for column in answer if column.startswith("state_")]
    for column in states:
        assert np.allclose(answer[column], again[column], rtol=1e-9, atol=1e-12)
    if name != "sprung_bouc_wen":
        close(answer["force_N"].to_numpy(), again["force_N"].to_numpy())


BITS = {"displacement_m": 1, "velocity_m_s": 2, "current_A": 4, "temperature_degC": 8}


@pytest.mark.parametrize("only_at_A", [(), (0.0, 1.0, 2.0)])
@pytest.mark.parametrize("warmth", [[20.0, 40.0], None])
def test_exported_code_says_of_every_sample_what_predict_says(
    only_at_A: tuple[float, ...], warmth: list[float] | None, tmp_path: Path
) -> None:
    tested = TESTED | {"only_at_A": list(only_at_A), "temperature_degC": warmth}
    fit, file = fit_of("asymmetric", tmp_path, tested)
    random = np.random.default_rng(1)
    u, v, current = random.uniform(-0.04, 0.04, 300), random.uniform(-0.5, 0.5, 300), random.uniform(-0.3, 2.4, 300)
    current[:60] = random.choice([0.0, 1.04, 2.0, 2.039, 2.05], 60)
    temperature = random.choice([10.0, 19.0, 30.0, 41.9, 50.0], 300)
    reported = fit.predict(
        {"displacement_m": u, "velocity_m_s": v, "current_A": current, "temperature_degC": temperature}
    )
    words = reported["beyond"].tolist()
    assert {*" ".join(words).split()} == set(BITS)
    assert warmth is None or words.count("") > 20
    module = module_of(file, tmp_path / "python")
    assert [module.beyond(*row) for row in zip(u, v, current, temperature, strict=True)] == words
    compiled = Compiled(file, tmp_path / "c")
    bits = [sum(BITS[name] for name in text.split()) for text in words]
    assert compiled.run(u, v, 0.0 * u, current, temperature)[1].tolist() == bits
    without = fit.predict({"displacement_m": u, "velocity_m_s": v, "current_A": current})["beyond"].tolist()
    assert [module.beyond(*row) for row in zip(u, v, current, strict=True)] == without
    bits = [sum(BITS[name] for name in text.split()) for text in without]
    assert compiled.run(u, v, 0.0 * u, current, np.full(300, np.nan))[1].tolist() == bits


def test_the_files_state_temperature_and_currents_between_which_nothing_is_known(tmp_path: Path) -> None:
    _, file = fit_of("asymmetric", tmp_path, TESTED | {"only_at_A": [0.0, 2.0]})
    for target in ("c", "octave", "python", "modelica"):
        text = export(file, target, tmp_path / target)[0].read_text()
        assert "temperature_degC 20 to 40, only near the currents 0, 2 A" in text
    assert module_of(file, tmp_path / "python").TESTED["temperature_degC"] == (20.0, 40.0)
    (values,) = export(file, "json", tmp_path / "json")
    assert json.loads(values.read_text())["tested"]["velocity_m_s"] == [-0.35, 0.35]


def test_a_fit_that_does_not_say_what_was_tested_exports_code_that_says_so(tmp_path: Path) -> None:
    _, file = fit_of("asymmetric", tmp_path)
    content = json.loads(file.read_text())
    del content["tested"]
    file.write_text(json.dumps(content))
    one = np.zeros(1)
    assert Compiled(file, tmp_path / "c").run(one, one, one, one, one)[1].tolist() == [16]
    assert module_of(file, tmp_path / "python").beyond(0.0, 0.0, 0.0) == "range not known"


def test_the_modelica_block_says_at_every_instant_what_lies_beyond(tmp_path: Path) -> None:
    rumoca = pytest.importorskip("rumoca", reason="rumoca (Modelica compiler) is not installed")
    fit, file = fit_of("asymmetric", tmp_path)
    (block,) = export(file, "modelica", tmp_path)
    (tmp_path / "Shaken.mo").write_text(f"""model Shaken
  {block.stem} d;
equation
  d.u = 0.04*sin(14.45*time);
  d.v = 0.578*cos(14.45*time);
  d.a = -8.352*sin(14.45*time);
  d.current = 1.0 + 2.0*sin(3.0*time);
end Shaken;
""")
    reported = rumoca.Session().load(str(tmp_path / "Shaken.mo"), model="Shaken").simulate(t=(0, 0.6), dt=0.001)
    data = {key: np.asarray(values) for key, values in reported.to_dict()["data"].items()}
    table = {"displacement_m": data["d.u"], "velocity_m_s": data["d.v"], "current_A": data["d.current"]}
    words = fit.predict(table)["beyond"]
    assert data["d.beyond"].tolist() == [sum(BITS[name] for name in text.split()) for text in words]
    assert len(set(data["d.beyond"])) >= 4


@pytest.mark.filterwarnings("ignore:fmi. the FMU contains:rig.errors.DataWarning")  # without mingw-w64
def test_the_functional_mock_up_unit_says_at_every_step_what_lies_beyond(tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed")
    fit, file = fit_of("sprung_bouc_wen", tmp_path)
    (unit,) = export(file, "fmi", tmp_path / "out")
    u, v, a = (2.0 * part for part in motion())
    current = 1.0 + 1.5 * np.sin(2.0 * np.pi * 1.7 * T_S)
    rows = list(zip(T_S, u, v, a, current, strict=True))
    signals = np.array(rows, dtype=[(name, np.float64) for name in ("time", "u", "v", "a", "current")])
    result = fmpy.simulate_fmu(
        str(unit), stop_time=T_S[-1] + DT_S, step_size=DT_S, output_interval=DT_S, input=signals,
        output=["force", "beyond"],
    )  # fmt: skip
    words = fit.simulate(T_S, u, current, velocity_m_s=v)["beyond"]
    bits = [sum(BITS[name] for name in text.split()) for text in words]
    assert len(set(bits)) >= 4
    reported = result["beyond"][1 : u.size + 1]
    assert np.mean(reported == np.array(bits)) > 0.99
