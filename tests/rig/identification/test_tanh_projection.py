"""The tanh models' projected objective: moments, compiled or not, streamed or not, say what whole columns say."""

import ast
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.dampers.algebraic import AlgebraicSeparation
from rig.identification import Measurement
from rig.identification.models.projection import Projection, Weighting
from rig.identification.models.separable import solve_separable
from rig.identification.models.tanh_projection import TanhProjection, join, thinned

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
CHANNELS = ("u_m", "v_m_s", "a_m_s2", "current_A", "force_N")
WIDTH = {"kwok": 0.7, "printed": 0.02}


def varying(tests: list[Measurement]) -> list[Measurement]:
    """The same motion with a current that changes from sample to sample in every other test."""
    rng = np.random.default_rng(3)
    changed = [
        replace(test, current_A=test.current_A + rng.uniform(0.0, 0.3, test.u_m.size)) if k % 2 else test
        for k, test in enumerate(tests)
    ]
    return [
        replace(test, force_N=model("asymmetric").force(DEMO, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, 0.004))
        for test in changed
    ]


@pytest.fixture
def tests(make_synthetic: Make) -> list[Measurement]:
    found = varying(make_synthetic(DEMO, (0.0, 1.0, 2.0), (0.5, 2.0), cycles=3))
    centred = found[0].u_m.copy()
    centred[::50] = 0.0  # sgn(0) = 0 is its own case
    rng = np.random.default_rng(4)
    return [
        replace(each, force_N=each.force_N + rng.normal(0.0, 5.0, each.u_m.size))
        for each in (replace(found[0], u_m=centred), *found[1:])
    ]


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("name", "form"), [("asymmetric", "kwok"), ("asymmetric", "printed"), ("symmetric", "printed"), ("kwok", "kwok")]
)
def test_moments_and_whole_columns_give_one_solution(
    name: str, form: str, compiled: bool, tests: list[Measurement]
) -> None:
    damper = model(name, form)
    weighting = Weighting("v", guard_s=2e-3)
    shape = np.array([35.0, WIDTH[form]])
    by_columns = Projection(AlgebraicSeparation(damper), tests, weighting).solve(shape)
    by_moments = TanhProjection(damper, tests, weighting, compiled=compiled).solve(shape)
    assert by_moments.objective == pytest.approx(by_columns.objective, rel=1e-9)
    assert by_moments.linear == pytest.approx(by_columns.linear, rel=1e-8)
    assert by_moments.gradient == pytest.approx(by_columns.gradient, rel=1e-8)
    assert by_moments.curvature == pytest.approx(by_columns.curvature, rel=1e-8)


@pytest.mark.parametrize("compiled", [True, False])
def test_objectives_at_many_shapes_are_the_least_squares_of_each(compiled: bool, tests: list[Measurement]) -> None:
    damper, weighting = model("asymmetric"), Weighting("1")
    shapes = np.array(list(product((5.0, 60.0, 700.0), (0.0, 0.5, 3.0))))
    found = TanhProjection(damper, tests, weighting, compiled=compiled).objectives(shapes)
    for (beta, delta), objective in zip(shapes, found, strict=True):
        columns = np.vstack(
            [
                np.column_stack(
                    (
                        damper.fixed_columns(each.u_m, each.v_m_s, each.a_m_s2, each.current_A),
                        y := np.tanh(beta * each.v_m_s + delta * np.sign(each.u_m)),
                        y * each.current_A,
                    )
                )
                for each in tests
            ]
        )
        force = np.concatenate([each.force_N for each in tests])
        residual = force - columns @ np.linalg.lstsq(columns, force, rcond=None)[0]
        assert objective == pytest.approx(float(residual @ residual), rel=1e-9)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(("name", "form"), [("asymmetric", "kwok"), ("asymmetric", "printed"), ("kwok", "kwok")])
def test_the_plain_sum_of_squares_is_that_of_the_models_own_force(
    name: str, form: str, compiled: bool, tests: list[Measurement]
) -> None:
    damper = model(name, form)
    projection = TanhProjection(damper, tests, Weighting("v"), compiled=compiled)
    shape = np.array([35.0, WIDTH[form]])
    linear = projection.solve(shape).linear
    values = dict.fromkeys(damper.names, 1.0) | dict(
        zip((*damper.fixed_names, *damper.yield_names, *damper.shape_names), (*linear, *shape), strict=True)
    )
    expected = 0.0
    for each in tests:
        force = damper.force(values, each.u_m, each.v_m_s, each.a_m_s2, each.current_A, each.dt_s)
        expected += float(np.sum(((each.force_N - force) * each.v_m_s) ** 2))
    assert projection.plain(shape, linear) == pytest.approx(expected, rel=1e-10)
    assert projection.solve(shape).objective == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("form", ["kwok", "printed"])
def test_the_fit_does_not_depend_on_whether_it_was_compiled(
    form: str, tests: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    damper = model("asymmetric", form)
    fits = []
    for compiled in (True, False):
        monkeypatch.setattr(
            "rig.identification.models.tanh_projection.compiled_pays", lambda _, chosen=compiled: chosen
        )
        fits.append(solve_separable(tests, damper, Weighting("v")))
    assert fits[0].values == pytest.approx(fits[1].values, rel=1e-7)
    assert fits[0].objective == pytest.approx(fits[1].objective, rel=1e-10)
    assert fits[0].evaluations == fits[1].evaluations


@pytest.mark.parametrize("compiled", [True, False])
def test_streamed_pieces_add_up_to_the_whole(
    compiled: bool, tests: list[Measurement], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.identification.models.tanh_projection.compiled_pays", lambda _: compiled)
    damper = model("asymmetric")
    whole = solve_separable(tests, damper)
    monkeypatch.setattr("rig.identification.models.tanh_projection.PIECE", 257)
    monkeypatch.setattr("rig.identification.models.tanh_projection.KEEP_BELOW", 0)
    pieces = solve_separable(tests, damper)
    assert pieces.values == pytest.approx(whole.values, rel=1e-7)


def test_steep_slopes_are_found_where_few_samples_lie_on_them(make_synthetic: Make) -> None:
    truth = {**DEMO, "beta": 2500.0, "delta": 20.0}
    tests = make_synthetic(truth, (0.0, 1.0, 2.0), (0.5, 1.0, 2.0), noise_N=0.0)
    found = solve_separable(tests, model("asymmetric"))
    assert found.values["delta"] / found.values["beta"] == pytest.approx(0.008, rel=1e-3)
    assert found.objective < 1e-9 * sum(float(each.force_N @ each.force_N) for each in tests)


FRESH = """
import sys, numpy as np
from rig.dampers import model
from rig.identification import Measurement, Weighting, solve_separable
u, v, a, current, force = np.load(sys.argv[1])
test = Measurement(id="one", u_m=u, v_m_s=v, a_m_s2=a, current_A=current, force_N=force, dt_s=0.004)
found = solve_separable([test], model("asymmetric"), Weighting("v"))
print(repr(found.values))
print("numba" in sys.modules, "scipy" in sys.modules, "rig.recording.run" in sys.modules)
"""


def test_a_fresh_process_loads_only_what_a_fit_needs_and_finds_the_same(
    make_synthetic: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (1.0,), cycles=2)
    channels = [np.concatenate([getattr(test, name) for test in tests]) for name in CHANNELS]
    np.save(tmp_path / "channels.npy", np.array(channels))
    command = [sys.executable, "-c", FRESH, str(tmp_path / "channels.npy")]
    printed = subprocess.run(command, check=True, capture_output=True, text=True, timeout=120).stdout.splitlines()
    assert printed[1] == "False False False"
    monkeypatch.setattr("rig.identification.models.tanh_projection.compiled_pays", lambda _: True)
    one = Measurement(**{**dict(zip(CHANNELS, channels, strict=True)), "id": "one", "dt_s": 0.004})
    here = solve_separable([one], model("asymmetric"), Weighting("v"))
    assert ast.literal_eval(printed[0]) == pytest.approx(here.values, rel=1e-6)


def test_joined_samples_thinned_are_the_thinned_tests_joined(tests: list[Measurement]) -> None:
    weighting = Weighting("v")
    short, whole = join(tests, weighting, 7), thinned(join(tests, weighting), 7)
    assert whole.ends.tolist() == short.ends.tolist()
    assert all(np.array_equal(*pair) for pair in zip(whole.arrays, short.arrays, strict=True))
