"""A fit as the assumed damper of a matrix: what it forecasts, what is kept of it, and what is no such fit."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from rig import dampers
from rig.bench.model import Bench
from rig.campaign.file_copies import keep_matrix
from rig.campaign.preflight.proof_move import expected_signature
from rig.campaign.results import CampaignOptions
from rig.campaign.resume import same_matrix
from rig.campaign.setup import write_description
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan
from rig.vehicle.fitted_damper import fitted_damper
from simulators.plant.plant import specimen_model
from simulators.scenarios.user_bench import UserBench

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = (ROOT / "examples" / "hybrid-quarter.toml").read_text(encoding="utf-8")
TEXT = EXAMPLE.replace('prior = "demo"', 'prior = "fit.json"').replace('duration = "20 s"', 'duration = "2 s"')
TESTED = {"velocity_m_s": [-0.9, 0.9], "current_A": [0.0, 2.0], "displacement_m": [-0.05, 0.05]}


def a_fit(path: Path, values: dict[str, Any] | None = None, **others: object) -> Path:
    """A `fit.json` with the keys that docs/json.md promises; the damper is the set demo but for `values`."""
    given = {**dampers.parameter_set("demo").values, **(values or {})}
    content = {
        "model": "asymmetric", "hysteresis": "kwok", "method": "separable", "error": {"per_test": []},
        "parameters": {name: {"value": value, "unit": ""} for name, value in given.items()},
        "adequate": True, "current": {"dependence": "affine"}, "tested": TESTED,
    }  # fmt: skip
    path.write_text(json.dumps({**content, **others}), encoding="utf-8")
    return path


def load(folder: Path, text: str = TEXT) -> Matrix:
    (folder / "matrix.toml").write_text(text, encoding="utf-8")
    return load_matrix(folder / "matrix.toml")


def bench_file(folder: Path) -> Path:
    text = (ROOT / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
    text = re.sub(r'(?m)^(register_map|poll) = .*\n', "", text)
    text = text.replace("[actuator]\n", '[actuator]\nregister_map = "demo-streamed"\npoll = "10 ms"\n')
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return folder / "bench.toml"


def bench(folder: Path) -> Bench:
    return Bench.load(bench_file(folder))


def message(folder: Path, text: str = TEXT) -> str:
    with pytest.raises(FileProblem) as refused:
        load(folder, text)
    return "\n".join(refused.value.problems)


def test_a_fit_that_found_a_set_s_numbers_forecasts_what_the_set_does(tmp_path: Path) -> None:
    """Points of all kinds, the order of a hybrid test, and the first slow move: the same numbers either way."""
    a_fit(tmp_path / "fit.json")
    more = '[matrix]\namplitude = ["10 mm"]\nfrequency = ["1 Hz"]\ncurrent = ["1 A"]\n'
    rig = bench(tmp_path)
    found = []
    for text in (TEXT + more, TEXT.replace("fit.json", "demo") + more):
        matrix = load(tmp_path, text)
        planned = plan(matrix, rig)
        assert planned.feasible, planned.points
        assert matrix.hybrid is not None
        assumed = matrix.specimen.assumed
        assert assumed is not None
        (hybrid,) = (item.point for item in planned.points if item.point.id == "hybrid-model")
        order = matrix.hybrid.order(hybrid, assumed, rig, (-0.05, 0.08)).to_json()
        found.append((
            [(item.point, item.predicted_force_N, item.energy_J) for item in planned.points], order,
            expected_signature(matrix.specimen, 2e-3, 0.01), planned.prediction, planned.warnings,
        ))
    assert found[0][:3] == found[1][:3]
    assert [one[3] for one in found] == ["from the fit fit.json", "from the parameter set demo"]
    assert found[0][4] == found[1][4]


def test_another_damper_is_another_forecast(tmp_path: Path) -> None:
    """Twice the damping at 0 A: the test's force is more, the body another."""
    demo = dampers.parameter_set("demo").values
    a_fit(tmp_path / "fit.json")
    usual = plan(load(tmp_path), bench(tmp_path)).points[0]
    a_fit(tmp_path / "fit.json", {name: 2.0 * demo[name] for name in ("Ca_plus", "Ca_minus")})
    stiffer = plan(load(tmp_path), bench(tmp_path)).points[0]
    assert usual.predicted_force_N is not None
    assert stiffer.predicted_force_N is not None
    assert stiffer.predicted_force_N > 1.1 * usual.predicted_force_N


def kept(folder: Path, text: str = TEXT) -> tuple[Path, Matrix]:
    """A campaign's directory with the matrix and its description, and the matrix as it was given."""
    run = folder / "run"
    run.mkdir()
    matrix = load(folder, text)
    keep_matrix(folder / "matrix.toml", run / "matrix.toml")
    write_description(run, None, matrix, CampaignOptions(folder / "matrix.toml", folder))
    return run, matrix


def test_the_fit_is_kept_with_the_campaign_which_goes_on_without_the_original(tmp_path: Path) -> None:
    (tmp_path / "fits").mkdir()
    original = a_fit(tmp_path / "fits" / "front left.json")
    content = original.read_bytes()
    run, given = kept(tmp_path, TEXT.replace('"fit.json"', "'fits/front left.json'"))
    original.unlink()
    assert (run / "records" / "front left.json").read_bytes() == content
    again = load_matrix(run / "matrix.toml")
    assert again.digest == given.digest
    assert again.points() == given.points()
    same_matrix(run, again)


def test_a_changed_copy_is_refused_by_its_name(tmp_path: Path) -> None:
    a_fit(tmp_path / "fit.json")
    run, _ = kept(tmp_path)
    a_fit(run / "records" / "fit.json", {"Ca_plus": 900.001})
    with pytest.raises(Refused, match=r"changed is records/fit\.json; no motion was started") as refused:
        same_matrix(run, load_matrix(run / "matrix.toml"))
    assert refused.value.slug == "matrix-changed"
    (run / "records" / "fit.json").unlink()
    with pytest.raises(FileProblem, match=r"specimen\.prior.*fit\.json: there is no such file"):
        load_matrix(run / "matrix.toml")


def test_the_place_of_a_fit_does_not_count_its_content_does(tmp_path: Path) -> None:
    a_fit(tmp_path / "fit.json")
    a_fit(tmp_path / "other.json")
    a_fit(tmp_path / "changed.json", {"F0": 1.5})
    names = ("fit.json", "other.json", str(tmp_path / "other.json"), "changed.json", "demo")
    digests = [load(tmp_path, TEXT.replace("fit.json", name)).digest for name in names]
    assert len({*digests[:3]}) == 1
    assert len({*digests}) == 3


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        ({"parameters": None}, "parameters: got None, expected an object"),
        ({"parameters": {"Ca_plus": 3.0}}, "parameters.Ca_plus: got 3.0, expected an object"),
        ({"model": "asimmetric"}, "unknown damper model 'asimmetric'.*did you mean 'asymmetric'"),
        ({"hysteresis": "round"}, "hysteresis: got 'round', expected 'kwok' or 'printed'"),
        ({"model": "asymmetric+bent"}, "bent"),
        ({"model": "lugre"}, "no value for "),
        ({"current": {"dependence": "per-current-affine"}, "parameters": {}}, "identify the run again with --current"),
    ],
)
def test_what_is_no_damper_is_refused_with_line_and_reason(
    tmp_path: Path, changes: dict[str, Any], reported: str
) -> None:
    a_fit(tmp_path / "fit.json", **changes)
    found = message(tmp_path)
    line = TEXT.splitlines().index(next(line for line in TEXT.splitlines() if "prior =" in line)) + 1
    assert re.search(rf"line {line}: specimen\.prior.*fit\.json: .*{reported}", found), found


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff\xfe", b'{"model": 1}', b"time_s,force_N\n0,1\n"])
def test_what_is_no_fit_file_at_all_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "fit.json").write_bytes(content)
    assert "specimen.prior" in message(tmp_path)
    with pytest.raises(FileProblem):
        fitted_damper(str(tmp_path / "fit.json"), 0)


def test_every_wrong_number_of_a_fit_is_reported_together_with_what_else_is_wrong(tmp_path: Path) -> None:
    a_fit(tmp_path / "fit.json", {"Ca_plus": "900", "F0": float("nan"), "Ka": True})
    found = message(tmp_path, TEXT.replace('mass = "600 kg"', 'mass = "-6 kg"'))
    for key in ("parameters.Ca_plus.value", "parameters.F0.value", "parameters.Ka.value", "hybrid.car.body.mass"):
        assert key in found, found
    a_fit(tmp_path / "fit.json", {"Ca_minus": None})
    assert "Ca_minus" in message(tmp_path, TEXT)


def test_an_unknown_name_says_that_a_file_ends_in_json(tmp_path: Path) -> None:
    found = message(tmp_path, TEXT.replace("fit.json", "demmo"))
    assert "did you mean demo?" in found
    assert ".json" in found


def test_the_law_inverse_wants_a_damper_whose_force_rises_with_the_current(tmp_path: Path) -> None:
    demo = dampers.parameter_set("demo").values
    text = TEXT.replace("[hybrid]\n", '[hybrid]\nlaw = ["inverse"]\nmost_current = "0.5 A"\n')
    a_fit(tmp_path / "fit.json")
    assert load(tmp_path, text).points()[0].id == "hybrid-model-inverse"
    of_current = [name for name in demo if name.removesuffix("_plus").removesuffix("_minus") in {"Cb", "Kb", "Fyb"}]
    assert len(of_current) == 4
    a_fit(tmp_path / "fit.json", dict.fromkeys(of_current, 0.0))
    found = message(tmp_path, text)
    assert re.search(r"hybrid\.law.*inverse.*the fit fit\.json.*at 0\.1 m/s", found), found
    assert load(tmp_path, TEXT).points(), "a passive test needs no current"


def test_the_plan_says_where_a_fit_is_requested_beyond_its_tests(tmp_path: Path) -> None:
    a_fit(
        tmp_path / "fit.json", adequate=False,
        tested=TESTED | {"displacement_m": [-0.001, 0.0005], "velocity_m_s": [-0.05, 0.04], "current_A": [0.0, 0.5]},
    )
    warnings = plan(load(tmp_path, TEXT.replace('current = "0 A"', 'current = "1 A"')), bench(tmp_path)).warnings
    assert any(re.search(r"fit\.json was fitted to tests up to 0\.05 m/s; the points reach 0\.\d+ m/s", warning)
               for warning in warnings), warnings  # fmt: skip
    assert any("up to 0.5 A; the points reach 1 A" in warning for warning in warnings), warnings
    assert any(re.search(r"up to 0\.001 m; the points reach 0\.\d+ m,", warning) for warning in warnings), warnings
    assert any("does not fit its own tests" in warning for warning in warnings), warnings


def test_a_scenario_s_damper_is_the_fitted_one(tmp_path: Path) -> None:
    own = {**dampers.parameter_set("demo-lugre").values, "kv": 777.0}
    (tmp_path / "fit.json").write_text(json.dumps({
        "model": "lugre", "hysteresis": "kwok", "parameters": {name: {"value": value} for name, value in own.items()},
    }), encoding="utf-8")
    text = 'format = 1\n[specimen]\nserial_number = "MR-001"\nstroke = "170 mm"\nprior = "fit.json"\n[matrix]\n'
    text += 'amplitude = ["10 mm"]\nfrequency = ["1 Hz"]\ncurrent = ["1 A"]\n'
    made = UserBench.load(bench_file(tmp_path), load(tmp_path, text))
    model, values = specimen_model(made.options.damper)
    assert (model.name, dict(values)) == ("lugre", own)
