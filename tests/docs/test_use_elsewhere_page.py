"""The recipes of the how-to pages on exports and imports run as they stand."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from rig.cli.importing import command
from rig.dampers import model
from rig.errors import RigError
from rig.export import export

PAGES = Path(__file__).parents[2] / "docs" / "how-to"
NOT_STATED = {"low": None, "high": None, "standard_error": None, "identifiable": True}
DT_S = 1e-3
T = np.arange(400) * DT_S
OMEGA = 2.0 * np.pi * 5.0
U, V, A = 0.01 * np.sin(OMEGA * T), 0.01 * OMEGA * np.cos(OMEGA * T), -0.01 * OMEGA**2 * np.sin(OMEGA * T)


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", (PAGES / page).read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """All files of a fit in the working directory; the model's own force along U, V, A at 1 A."""
    damper = model("asymmetric")
    values = dict(damper.demonstration)
    parameters = {name: NOT_STATED | {"value": value} for name, value in values.items()}
    tested = {"displacement_m": [-0.03, 0.03], "velocity_m_s": [-0.5, 0.5], "current_A": [0.0, 2.0]}
    (tmp_path / "fit.json").write_text(json.dumps(
        {"model": "asymmetric", "hysteresis": "kwok", "parameters": parameters, "tested": tested}))  # fmt: skip
    for to in ("c", "octave", "python", "table", *(["fmi"] if shutil.which("gcc") else [])):
        export(tmp_path / "fit.json", to, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return np.asarray(damper.force(values, U, V, A, np.ones(T.size), DT_S))


def needs(name: str) -> str:
    if (found := shutil.which(name)) is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"{name} is not installed")
    return str(found)


def test_every_python_recipe_runs(exported: np.ndarray) -> None:
    import pandas

    needs("gcc")
    fields = ("time", "u", "v", "a", "current")
    signals = np.array(list(zip(T, U, V, A, np.ones(T.size), strict=True)), dtype=[(name, float) for name in fields])
    names: dict[str, Any] = {
        "u": U.tolist(), "v": V.tolist(), "a": A.tolist(), "current": [1.0] * T.size, "dt": DT_S, "pandas": pandas,
        "signals": signals,
    }  # fmt: skip
    recipes = blocks("use-a-fit-elsewhere.md", "python")
    assert len(recipes) == 3
    for recipe in recipes:
        exec(recipe, names)
    assert names["forces"] == pytest.approx(exported, rel=1e-9)
    assert (names["first"], names["second"]) == pytest.approx(tuple(exported[:2]))
    assert names["result"]["force"][1:300] == pytest.approx(exported[:299], rel=1e-9)


def test_the_c_recipe_compiles_and_gives_the_models_force(exported: np.ndarray) -> None:
    (recipe,) = blocks("use-a-fit-elsewhere.md", "c")
    head, body = recipe.split("\n", 1)
    motion = (("u", U), ("v", V), ("a", A))
    first, second = (", ".join(f"{name} = {float(values[k])!r}" for name, values in motion) for k in (0, 1))
    body = body.replace("\nforce = damper", f"\n{second};\nforce = damper")
    program = (f"#include <stdio.h>\n{head}\nint main(void) {{ double {first}, current = 1, dt = {DT_S!r};\n"
               f'{body}\nprintf("%.17g", force); return 0; }}\n')  # fmt: skip
    Path("main.c").write_text(program)
    subprocess.run([needs("gcc"), "main.c", "damper_asymmetric.c", "-lm", "-o", "main"], check=True, timeout=60)
    reported = subprocess.run(["./main"], capture_output=True, text=True, check=True, timeout=60).stdout
    assert float(reported) == pytest.approx(exported[1], rel=1e-9)


LONG_S = np.arange(1500) * 4e-3
X_MM, F_KN = 10.0 * np.sin(2.0 * np.pi * LONG_S), 0.3 * np.cos(2.0 * np.pi * LONG_S)


def columns(path: Path) -> None:
    rows = zip(LONG_S, X_MM, F_KN, strict=True)
    lines = [f"{t:.4f};{x:.6f};{force:.6f}".replace(".", ",") for t, x, force in rows]
    path.write_text("Zeit;Weg;Kraft\ns;mm;kN\n" + "\n".join(lines) + "\n")


def channels(path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([
            Signal(X_MM, LONG_S, unit="mm", name="Stroke"), Signal(F_KN, LONG_S, unit="kN", name="LoadCell"),
            Signal(np.full(LONG_S.size, 0.5), LONG_S, unit="A", name="I_coil"),
        ])  # fmt: skip
        file.save(path)


def workbook(path: Path) -> None:
    from openpyxl import Workbook

    book = Workbook()
    for sheet in (book.active, book.create_sheet("second")):
        sheet.append(["t [s]", "x [mm]", "F [kN]"])
        for row in zip(LONG_S.tolist(), X_MM.tolist(), F_KN.tolist(), strict=True):
            sheet.append(row)
    book.save(path)


def voltages(path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    wave = {"wf_increment": 4e-3, "wf_start_offset": 0.0, "unit_string": "V"}
    with TdmsWriter(path) as file:
        file.write_segment([
            ChannelObject("raw", "ai0", X_MM / 10.0, wave), ChannelObject("raw", "ai1", -2.0 * F_KN, wave),
        ])  # fmt: skip


def test_the_commands_of_the_import_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tests").mkdir()
    columns(Path("tests/loop_0.50A.csv"))
    channels(Path("run7.mf4"))
    workbook(Path("bench.xlsx"))
    voltages(Path("raw.tdms"))
    lines = re.findall(r"^rig import (.*)$", "\n".join(blocks("import-tests.md", "")), re.MULTILINE)
    assert len(lines) == 5
    columns(Path("tests/new.csv"))
    for line in (lines[0], lines[4], *lines[1:4]):  # `last` is then the run of the first line
        words = shlex.split(line.replace("tests/*.csv", "tests/loop_0.50A.csv"))
        try:
            done = CliRunner().invoke(command, words, standalone_mode=False, catch_exceptions=False)
        except RigError as error:
            pytest.fail(f"{line}: {error}")
        assert done.return_value == 0, done.output
    assert len(list(Path("logs").glob("*/points/*.h5"))) == 6  # of the workbook a test for each of two sheets
