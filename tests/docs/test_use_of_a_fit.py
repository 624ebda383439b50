"""The recipes of the pages on using a fit, and the sessions of the Python pages, run as they stand."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

from rig.dampers import model
from rig.identification import Measurement, identify
from rig.identification.runs import write_fit

DOCS = Path(__file__).parents[2] / "docs"
PAGE = DOCS / "how-to" / "use-a-fitted-model.md"


RATE_Hz = 250.0


def sines() -> list[Measurement]:
    """Sines of 20 mm at two frequencies and two currents, 5 N of noise."""
    rng, damper = np.random.default_rng(3), model("asymmetric")
    values = damper.demonstration
    tests = []
    for frequency_Hz in (0.5, 1.0, 2.0):
        for current_A in (0.0, 1.0, 2.0):
            t = np.arange(round(2.0 / frequency_Hz * RATE_Hz)) / RATE_Hz
            omega, amps = 2.0 * np.pi * frequency_Hz, np.full(t.size, current_A)
            u, v = 0.02 * np.sin(omega * t), 0.02 * omega * np.cos(omega * t)
            force = damper.force(values, u, v, -(omega**2) * u, amps, 1.0 / RATE_Hz) + rng.normal(0.0, 5.0, t.size)
            tests.append(Measurement(
                f"p{len(tests)}", u, v, -(omega**2) * u, force, amps, 1.0 / RATE_Hz, amplitude_m=0.02,
                frequency_Hz=frequency_Hz, nominal_current_A=current_A, noise_N=5.0,
                samples_per_cycle=round(RATE_Hz / frequency_Hz),
            ))  # fmt: skip
    return tests


def test_every_recipe_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "RUN" / "points").mkdir(parents=True)
    write_fit(identify(sines()), tmp_path / "RUN")
    monkeypatch.chdir(tmp_path)
    recipes = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(recipes) == 6
    names: dict[str, Any] = {"tests": sines()}
    for recipe in recipes:
        exec(recipe, names)
    assert list(names["answer"]["attainable"]) == [True, False]
    assert names["motion"].shape[0] == 1000
    assert names["command"].attainable


@pytest.mark.parametrize("page", ["python.md", "how-to/come-from-lmfit-or-matlab.md"])
def test_the_session_of_a_python_page_runs(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    Path("tests").mkdir()
    for test in sines():
        pd.DataFrame({  # six cycles
            "time_s": 0.002 * np.arange(2 * test.u_m.size), "displacement_mm": 1e3 * np.tile(test.u_m, 2),
            "force_N": np.tile(test.force_N, 2), "current_A": np.tile(test.current_A, 2),
        }).to_csv(f"tests/{test.id}.csv", index=False)  # fmt: skip
    (session,) = re.findall(r"```python\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    names: dict[str, Any] = {}
    exec(session, names)
    assert "beta" in capsys.readouterr().out
    assert Path("fit.json").is_file()
    assert len(names["run"]) == 9
    sys.modules["matplotlib.pyplot"].close("all")
