"""Fits as source code: compiled by gcc, run by Octave, Python and FMPy, and compared with the model."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.dampers import model as damper_model
from rig.dampers.catalogue import CATALOGUE
from rig.dampers.model import DamperModel
from rig.errors import EXIT_USAGE, DataWarning, FileProblem
from rig.export import export
from rig.fits.fit_file import FIX

pytestmark = pytest.mark.filterwarnings("ignore:fmi. the FMU contains:rig.errors.DataWarning")  # without mingw-w64
DT_S = 1e-3
ENOUGH = {"low": None, "high": None, "standard_error": 2.0, "identifiable": True}
NAMED = [f"{model.name}-{model.hysteresis}" for model in CATALOGUE]


def values_of(model: DamperModel) -> dict[str, float]:
    values = dict(model.demonstration)
    if model.hysteresis == "printed":
        values["lambda"] = values.pop("delta") / values["beta"]
    return values


def fit_of(model: DamperModel) -> dict[str, Any]:
    values = values_of(model)
    names = list(values)
    return {
        "model": model.name,
        "hysteresis": model.hysteresis,
        "equation": model.equation,
        "parameters": {name: ENOUGH | {"value": values[name], "unit": model.parameter(name).unit} for name in names},
        "correlation": {a: {b: 1.0 if a == b else 0.25 for b in names} for a in names},
        "current": {"dependence": "affine"},
        "tested": {"displacement_m": [-0.03, 0.03], "velocity_m_s": [-0.3, 0.3], "current_A": [0.0, 2.0]},
    }


def written(model: DamperModel, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "fit.json"
    file.write_text(json.dumps(fit_of(model)))
    return file


def motion() -> tuple[np.ndarray, ...]:
    """Two tones, so that some reversals are small; the current changes on the way. Shape (600,) each."""
    t = np.arange(600) * DT_S
    first, second = 2.0 * np.pi * 2.3, 2.0 * np.pi * 11.0
    u = 0.02 * np.sin(first * t) + 0.002 * np.sin(second * t + 1.0)
    v = 0.02 * first * np.cos(first * t) + 0.002 * second * np.cos(second * t + 1.0)
    a = -0.02 * first**2 * np.sin(first * t) - 0.002 * second**2 * np.sin(second * t + 1.0)
    return u, v, a, 1.0 + 0.6 * np.sin(2.0 * np.pi * 1.7 * t)


def expected(model: DamperModel) -> np.ndarray:
    return np.asarray(model.force(values_of(model), *motion(), DT_S))


def tool(name: str, what: str) -> str:
    """Where it is; where it is not, the test is skipped, and fails in continuous integration."""
    found = shutil.which(name)
    if found is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)(f"{name} ({what}) is not installed")
    return str(found)


def as_close_as_required(model: DamperModel, found: np.ndarray, expected: np.ndarray) -> None:
    bound = (1e-9 if model.states == 0 else 1e-6) * np.max(np.abs(expected))
    assert found.shape == expected.shape
    assert np.max(np.abs(found - expected)) < bound
    assert np.ptp(expected) > 100.0  # the motion makes a force worth comparing


OCTAVE_ONLY = re.compile(
    r"""[!#"]|\*\*|[-+*/^|&]=|\+\+|--|\)\(|\b(?:printf|do|until|unwind_protect|endfunction|endif|endwhile|endfor|end_\w+)\b"""
)


def check_matlab_reads(file: Path) -> None:
    """Nothing in it is Octave's alone, such as `!x`, `x != y`, `x += y`, `f(x)(1)` or `endif`."""
    code = [line.partition("%")[0] for line in file.read_text().splitlines()]
    assert [line for line in code if OCTAVE_ONLY.search(line)] == []


MAIN = """#include <stdio.h>
#include "damper_{name}.h"
int main(void) {{
    double d[DAMPER_{upper}_MEMORY], u, v, a, current;
    int first = 1;
    while (scanf("%lf %lf %lf %lf", &u, &v, &a, &current) == 4) {{
        double force = first ? damper_{name}_start(d, u, v, a, current) : damper_{name}_step(d, u, v, a, current, 1e-3);
        printf("%.17g\\n", force);
        first = 0;
    }}
    return 0;
}}
"""


@pytest.mark.few(3)
@pytest.mark.parametrize("model", CATALOGUE, ids=NAMED)
def test_gcc_compiles_the_model_without_a_warning_and_its_force_is_the_models(
    model: DamperModel, tmp_path: Path
) -> None:
    compiler = tool("gcc", "C compiler")
    files = export(written(model, tmp_path), "c", tmp_path / "c")
    assert [file.name for file in files] == [f"damper_{model.name}.h", f"damper_{model.name}.c"]
    (tmp_path / "c/main.c").write_text(MAIN.format(name=model.name, upper=model.name.upper()))
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off"]
    subprocess.run(
        [compiler, *strict, "main.c", files[1].name, "-lm", "-o", "main"], cwd=tmp_path / "c", check=True, timeout=60
    )
    lines = "\n".join(" ".join(repr(float(x)) for x in row) for row in zip(*motion(), strict=True))
    reported = subprocess.run(
        [tmp_path / "c/main"], input=lines, capture_output=True, text=True, check=True, timeout=60
    )
    as_close_as_required(model, np.array(reported.stdout.split(), dtype=float), expected(model))


def test_octave_runs_every_model_and_its_force_is_the_models(tmp_path: Path) -> None:
    octave = tool("octave-cli", "Octave")
    np.savetxt(tmp_path / "motion.txt", np.column_stack(motion()), fmt="%.17g")
    script = ["x = load('motion.txt')(1:200,:); u = x(:,1); v = x(:,2); a = x(:,3); c = x(:,4); h = 100;"]
    for name, model in zip(NAMED, CATALOGUE, strict=True):
        (file,) = export(written(model, tmp_path / name), "octave", tmp_path / name)
        assert file.name == f"damper_{model.name}.m"
        check_matlab_reads(file)
        script += [
            f"addpath('{name}'); clear damper_{model.name}; F = damper_{model.name}(u, v, a, c, 1e-3);",
            f"[A, d] = damper_{model.name}(u(1:h), v(1:h), a(1:h), c(1:h), 1e-3);",  # in two pieces: the same
            f"B = damper_{model.name}(u(h+1:end), v(h+1:end), a(h+1:end), c(h+1:end), 1e-3, d);",
            f"F(:,2) = [A; B]; fid = fopen('{name}.txt', 'w'); fprintf(fid, '%.17g %.17g\\n', F'); fclose(fid);",
            f"rmpath('{name}');",
        ]
    (tmp_path / "compare.m").write_text("\n".join(script))
    ran = subprocess.run([octave, "--norc", "compare.m"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    for name, model in zip(NAMED, CATALOGUE, strict=True):
        whole, pieces = np.loadtxt(tmp_path / f"{name}.txt").T
        as_close_as_required(model, whole, expected(model)[:200])
        assert np.array_equal(whole, pieces)


def test_the_python_module_needs_nothing_else_and_its_force_is_the_models(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "motion.txt", np.column_stack(motion()), fmt="%.17g")
    program = (
        "import importlib, json, sys\n"
        "rows = [[float(x) for x in line.split()] for line in open('motion.txt')]\n"
        "told = {}\n"
        "for folder, name in json.loads(sys.argv[1]):\n"
        "    sys.path.insert(0, folder)\n"
        "    sys.modules.pop(name, None)\n"
        "    module = importlib.import_module(name)\n"
        "    told[folder] = [module.force(*zip(*rows), 1e-3), module.PARAMETERS, module.FIT_SHA256]\n"
        "    sys.path.pop(0)\n"
        "json.dump(told, open('told.json', 'w'))\n"
    )
    required = []
    for name, model in zip(NAMED, CATALOGUE, strict=True):
        export(written(model, tmp_path / name), "python", tmp_path / name)
        required.append((name, f"damper_{model.name}"))
    subprocess.run(
        [sys.executable, "-I", "-S", "-W", "error", "-c", "import sys; sys.path.insert(0, '.')\n" + program,
         json.dumps(required)], cwd=tmp_path, check=True, timeout=120,
    )  # fmt: skip
    reported = json.loads((tmp_path / "told.json").read_text())
    for name, model in zip(NAMED, CATALOGUE, strict=True):
        force, parameters, digest = reported[name]
        as_close_as_required(model, np.array(force), expected(model))
        assert parameters == values_of(model)
        assert digest == hashlib.sha256((tmp_path / name / "fit.json").read_bytes()).hexdigest()


BEHIND_A_LAW = {"asymmetric+saturating": {"k_sat": 0.9}, "lugre+per-current@0,1,2": {"x at 1 A": 1.2}}


def test_models_behind_a_current_law_are_what_they_are_in_c_octave_and_python(tmp_path: Path) -> None:
    gcc, octave = tool("gcc", "C compiler"), tool("octave-cli", "Octave")
    rows = "\n".join(" ".join(repr(float(x)) for x in row) for row in zip(*motion(), strict=True))
    (tmp_path / "motion.txt").write_text(rows)
    script, expected = ["x = load('motion.txt');"], {}
    for text, law in BEHIND_A_LAW.items():
        lawed = damper_model(text)
        values = {**damper_model(text.partition("+")[0]).demonstration, **law}
        parameters = {name: ENOUGH | {"value": value, "unit": ""} for name, value in values.items()}
        (tmp_path / "fit.json").write_text(json.dumps(
            {"model": text, "hysteresis": lawed.hysteresis, "parameters": parameters,
             "tested": {"displacement_m": [-0.03, 0.03], "velocity_m_s": [-0.3, 0.3], "current_A": [0.0, 2.0]}}))
        (file,) = export(tmp_path / "fit.json", "octave", tmp_path)
        check_matlab_reads(file)
        stem = file.stem
        expected[stem] = lawed, np.asarray(lawed.force(values, *motion(), DT_S))
        script.append(f"F = {stem}(x(:,1), x(:,2), x(:,3), x(:,4), 1e-3);")
        script.append(f"save('-ascii', '-double', '{stem}.txt', 'F');")
        _, source = export(tmp_path / "fit.json", "c", tmp_path)
        name = stem.removeprefix("damper_")
        (tmp_path / "main.c").write_text(MAIN.format(name=name, upper=name.upper()))
        build = [gcc, "-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "main.c", source.name, "-lm"]
        subprocess.run([*build, "-o", stem], cwd=tmp_path, check=True, timeout=60)
        reported = subprocess.run([tmp_path / stem], input=rows, capture_output=True, text=True, check=True, timeout=60)
        as_close_as_required(lawed, np.array(reported.stdout.split(), dtype=float), expected[stem][1])
        (module,) = export(tmp_path / "fit.json", "python", tmp_path)
        spec = importlib.util.spec_from_file_location(stem, module)
        assert spec is not None
        assert spec.loader is not None
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)
        as_close_as_required(
            lawed, np.array(loaded.force(*(part.tolist() for part in motion()), DT_S)), expected[stem][1]
        )
    (tmp_path / "compare.m").write_text("\n".join(script))
    ran = subprocess.run([octave, "--norc", "compare.m"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert ran.returncode == 0, ran.stderr
    for stem, (lawed, force) in expected.items():
        as_close_as_required(lawed, np.loadtxt(tmp_path / f"{stem}.txt"), force)


def test_the_files_say_equation_units_ranges_covariance_and_the_hash_of_the_fit(tmp_path: Path) -> None:
    model = next(model for model in CATALOGUE if model.name == "bingham")
    file = written(model, tmp_path)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    for target in ("c", "octave", "python", "table"):
        text = export(file, target, tmp_path / target)[0].read_text()
        assert f"SHA-256 of the fit: {digest}" in text
        assert "F = fc sgn(v) + c0 v + f0 (Stanway 1987, as in Spencer 1997)" in text
        assert "fc_b = 238.0 N/A, +- 2" in text
        assert "velocity_m_s -0.3 to 0.3, current_A 0 to 2. The force outside it is an extrapolation." in text
        assert "fc_b: 1 4" in text  # standard errors 2 and 2, correlation 0.25: covariance 1, variance 4


def test_the_table_is_the_force_at_each_speed_and_current(tmp_path: Path) -> None:
    import pandas as pd

    model = next(model for model in CATALOGUE if model.name == "bingham")
    (file,) = export(written(model, tmp_path), "table", tmp_path / "table")
    table = pd.read_csv(file, comment="#", index_col="velocity_m_s")
    assert table.shape == (61, 11)
    assert (table.index[0], table.index[-1], table.columns[-1]) == (-0.3, 0.3, "force_N at 2 A")
    for speed, row in table.iterrows():
        for current, force in zip(np.linspace(0.0, 2.0, 11), row, strict=True):
            by_hand = (60.0 + 238.0 * current) * np.sign(float(speed)) + (700.0 + 110.0 * current) * speed - 270.0
            assert force == pytest.approx(by_hand, rel=1e-9, abs=1e-9)


def test_everything_that_a_fit_does_not_have_is_reported_at_once(tmp_path: Path) -> None:
    model = next(model for model in CATALOGUE if model.name == "asymmetric")
    fit = fit_of(model)
    fit["parameters"]["Ka"] |= {"value": None, "reason": "no stroke"}
    fit["parameters"]["beta"]["value"] = "50"
    fit["parameters"]["eta"]["value"] = None  # the coil's, not the force's
    fit["parameters"]["m"]["low"] = "0"
    fit["tested"]["current_A"] = [2.0, 0.0]
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    with pytest.raises(FileProblem) as caught:
        export(tmp_path / "fit.json", "c", tmp_path / "out")
    assert caught.value.exit_code == EXIT_USAGE
    assert list(caught.value.problems) == [
        "parameters.m.low: got '0', expected a number",
        "parameters.beta.value: got '50', expected a number",
        "tested.current_A: got list [2.0, 0.0], expected the lowest and the highest value",
        FIX,
    ]
    fit["parameters"]["beta"]["value"], fit["parameters"]["m"]["low"] = 50.0, 0.0
    fit["tested"]["current_A"] = [0.0, 2.0]
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    with pytest.raises(FileProblem, match=r"no value for Ka \(no stroke\)\n"):
        export(tmp_path / "fit.json", "c", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_fit_for_each_current_is_refused_with_the_way_out_and_leaves_what_was_there(tmp_path: Path) -> None:
    fit = fit_of(CATALOGUE[0]) | {"current": {"dependence": "per-current-affine"}}
    (tmp_path / "fit.json").write_text(json.dumps(fit))
    (tmp_path / "mine").mkdir()
    for out in ("out/of/mine", "mine/new", "mine"):
        with pytest.raises(FileProblem, match="--current affine"):
            export(tmp_path / "fit.json", "octave", tmp_path / out)
    assert sorted(tmp_path.rglob("*")) == [tmp_path / "fit.json", tmp_path / "mine"]


ASYMMETRIC = next(model for model in CATALOGUE if model.name == "asymmetric")
CHOSEN = [model for model in CATALOGUE if model.name in {"digressive_bilinear", "modified_bouc_wen", "lugre"}]
INPUTS = ("u", "v", "a", "current")


def unit_of(model: DamperModel, folder: Path) -> Path:
    tool("gcc", "C compiler")
    (file,) = export(written(model, folder), "fmi", folder / "out")
    return file


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """That of the asymmetric model."""
    return unit_of(ASYMMETRIC, tmp_path_factory.mktemp("unit"))


def test_fmpy_finds_no_fault_and_the_unit_holds_its_sources(unit: Path, tmp_path: Path) -> None:
    from fmpy import read_model_description
    from fmpy.validation import validate_fmu

    file = unit
    assert file.name == "damper_asymmetric.fmu"
    assert validate_fmu(str(file)) == []
    description = read_model_description(str(file))
    assert description.fmiVersion == "2.0"
    constants = {one.name: float(one.start) for one in description.modelVariables if one.name.startswith("p.")}
    assert constants == {f"p.{name}": value for name, value in values_of(ASYMMETRIC).items()}
    units = {one.name: one.unit for one in description.modelVariables}
    assert [units[name] for name in (*INPUTS, "force")] == ["m", "m/s", "m/s2", "A", "N"]
    names = zipfile.ZipFile(file).namelist()
    sources = ("fmu.c", "model.h", "damper_asymmetric.c", "damper_asymmetric.h")
    assert {f"sources/{name}" for name in sources} < set(names)
    assert file.read_bytes() == unit_of(ASYMMETRIC, tmp_path / "again").read_bytes()


@pytest.mark.parametrize("model", CHOSEN, ids=lambda model: f"{model.name}-{model.hysteresis}")
def test_a_simulation_gives_the_force_of_the_inputs_at_the_beginning_of_each_step(
    model: DamperModel, tmp_path: Path
) -> None:
    from fmpy import simulate_fmu

    samples = motion()
    t = np.arange(len(samples[0])) * DT_S
    signals = np.array(list(zip(t, *samples, strict=True)), dtype=[(name, np.float64) for name in ("time", *INPUTS)])
    result = simulate_fmu(
        str(unit_of(model, tmp_path)), stop_time=t[-1] + DT_S, step_size=DT_S, output_interval=DT_S, input=signals,
        output=["force"],
    )  # fmt: skip
    as_close_as_required(model, np.asarray(result["force"][1 : len(t) + 1]), expected(model))


def test_read_after_setting_the_inputs_the_force_is_theirs_and_a_state_can_be_taken_back(
    unit: Path, tmp_path: Path
) -> None:
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    description = read_model_description(str(unit))
    place = {one.name: one.valueReference for one in description.modelVariables}
    slave = FMU2Slave(guid=description.guid, unzipDirectory=extract(str(unit), str(tmp_path / "unit")),
                      modelIdentifier="damper_asymmetric", instanceName="one")  # fmt: skip
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    forces = []
    for k, sample in enumerate(zip(*motion(), strict=True)):
        slave.setReal([place[name] for name in INPUTS], [9.0, 9.0, 9.0, 9.0])  # tried, and read, and set again
        slave.getReal([place["force"]])
        slave.setReal([place[name] for name in INPUTS], list(sample))
        forces.append(slave.getReal([place["force"]])[0])
        if k == 100:
            state = slave.getFMUState()
            for size in (DT_S, 3.0 * DT_S):
                slave.doStep(k * DT_S, size)
            slave.setFMUState(state)
            slave.freeFMUState(state)
        slave.doStep(k * DT_S, DT_S)
    slave.terminate()
    slave.freeInstance()
    as_close_as_required(ASYMMETRIC, np.array(forces), expected(ASYMMETRIC))


def test_the_sources_compile_without_a_warning(unit: Path, tmp_path: Path) -> None:
    compiler = tool("gcc", "C compiler")
    zipfile.ZipFile(unit).extractall(tmp_path / "unit")
    strict = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-fsyntax-only"]
    subprocess.run([compiler, *strict, "fmu.c"], cwd=tmp_path / "unit/sources", check=True, timeout=60)


CROSS = "x86_64-w64-mingw32-gcc"
WINDOWS_MAIN = """#include <stdio.h>
#include <windows.h>
typedef void *C;
typedef const char *S;
int main(int argc, char **argv) {
    HMODULE library = LoadLibraryA(argv[1]);
    if (argc < 3 || !library) { return 2; }
    C (*begin)(S, int, S, S, void *, int, int) = (void *)GetProcAddress(library, "fmi2Instantiate");
    int (*set)(C, const unsigned *, size_t, const double *) = (void *)GetProcAddress(library, "fmi2SetReal");
    int (*get)(C, const unsigned *, size_t, double *) = (void *)GetProcAddress(library, "fmi2GetReal");
    int (*step)(C, double, double, int) = (void *)GetProcAddress(library, "fmi2DoStep");
    int (*ready)(C) = (void *)GetProcAddress(library, "fmi2ExitInitializationMode");
    void *callbacks[5] = {0};
    const unsigned inputs[] = {0, 1, 2, 3}, force = 4;
    double x[4], value, t = 0.0;
    C unit = begin("one", 1, argv[2], "", callbacks, 0, 0);
    if (!unit || ready(unit)) { return 3; }
    while (scanf("%lf %lf %lf %lf", x, x + 1, x + 2, x + 3) == 4) {
        if (set(unit, inputs, 4, x) || get(unit, &force, 1, &value) || step(unit, t, 1e-3, 1)) { return 4; }
        printf("%.17g\\n", value);
        t += 1e-3;
    }
    return 0;
}
"""


def windows_library(unit: Path, folder: Path) -> tuple[Path, str]:
    """The library for Windows in a unit, and the unit's GUID; skipped where there is no cross compiler."""
    if shutil.which(CROSS) is None:
        pytest.skip(f"{CROSS} (mingw-w64) is not installed")
    zipfile.ZipFile(unit).extractall(folder / "unit")
    guid = (folder / "unit/modelDescription.xml").read_text().split('guid="')[1].split('"')[0]
    return folder / "unit/binaries/win64/damper_asymmetric.dll", guid


def test_the_library_for_windows_has_the_functions_of_that_for_linux_and_needs_only_the_system(
    unit: Path, tmp_path: Path
) -> None:
    library, _ = windows_library(unit, tmp_path)
    dump = subprocess.run(
        [tool("x86_64-w64-mingw32-objdump", "binutils"), "-p", library], capture_output=True, text=True, check=True
    ).stdout
    other = tmp_path / "unit/binaries/linux64/damper_asymmetric.so"
    listed = subprocess.run(
        [tool("nm", "binutils"), "-D", "--defined-only", other], capture_output=True, text=True, check=True
    ).stdout
    assert "pei-x86-64" in dump
    assert set(re.findall(r"\bfmi2\w+", dump)) == set(re.findall(r"\bfmi2\w+", listed))
    assert len(set(re.findall(r"\bfmi2\w+", dump))) == 34
    assert {name.lower() for name in re.findall(r"DLL Name: (\S+)", dump)} == {"kernel32.dll", "msvcrt.dll"}


@pytest.mark.nightly
def test_the_library_for_windows_gives_the_force_under_wine(unit: Path, tmp_path: Path) -> None:
    library, guid = windows_library(unit, tmp_path)
    wine = shutil.which("wine64") or shutil.which("wine") or "/usr/lib/wine/wine64"
    if not Path(wine).is_file():
        pytest.skip("wine is not installed")
    (tmp_path / "main.c").write_text(WINDOWS_MAIN)
    subprocess.run([CROSS, "-O1", "main.c", "-o", "main.exe"], cwd=tmp_path, check=True, timeout=120)
    lines = "\n".join(" ".join(repr(float(x)) for x in row) for row in zip(*motion(), strict=True))
    surroundings = {**os.environ, "WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "DISPLAY": ""}
    reported = subprocess.run(
        [wine, "main.exe", f"Z:{library}", guid], cwd=tmp_path, input=lines, capture_output=True, text=True,
        timeout=300, env=surroundings,
    )  # fmt: skip
    assert reported.returncode == 0, reported.stderr
    as_close_as_required(ASYMMETRIC, np.array(reported.stdout.split(), dtype=float), expected(ASYMMETRIC))


def test_without_a_cross_compiler_the_unit_says_what_it_lacks_and_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    which = shutil.which
    monkeypatch.setattr("shutil.which", lambda name: None if "mingw" in name else which(name))
    tool("gcc", "C compiler")
    with pytest.warns(DataWarning, match=r"only linux64.*gcc-mingw-w64-x86-64"):
        (file,) = export(written(ASYMMETRIC, tmp_path), "simulink", tmp_path / "out")
    assert not [name for name in zipfile.ZipFile(file).namelist() if "win64" in name]


def test_without_a_compiler_it_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda name: None)
    with pytest.raises(FileProblem, match="no C compiler"):
        export(written(ASYMMETRIC, tmp_path), "fmi", tmp_path / "out")
