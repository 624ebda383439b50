"""What a fit needs to know of each model: its split into shape and linear rest, or its search of everything."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import pytest

from rig.dampers import MODELS, Hysteresis, model
from rig.dampers.algebraic import ColumnModel, TanhModel, general_coefficients
from rig.dampers.bouc_wen import LOWEST_EXPONENT
from rig.dampers.catalogue import KINDS
from rig.dampers.kernel import advance_of, travel
from rig.dampers.model import HystereticModel
from rig.dampers.parameter import Parameter, linear_parameter, shape_parameter
from rig.dampers.separation import MotionScale, Search, Separation

if TYPE_CHECKING:
    from rig.dampers.arrays import FloatArray
    from rig.dampers.kernel import Kernel

SCALE = MotionScale(0.02, 0.2, 1.0, 0.0, 2.0, 0.002)
OMEGA = 2.0 * np.pi * 1.5


@dataclass
class Sine:
    """A sampled test."""

    u_m: np.ndarray
    v_m_s: np.ndarray
    a_m_s2: np.ndarray
    current_A: np.ndarray
    dt_s: float = 0.002
    samples_per_cycle: int = 0


@pytest.fixture
def sine() -> Sine:
    t = 0.002 * np.arange(700) + 1e-4
    u, v, a = 0.02 * np.sin(OMEGA * t), 0.02 * OMEGA * np.cos(OMEGA * t), -0.02 * OMEGA**2 * np.sin(OMEGA * t)
    return Sine(u, v, a, np.full(t.size, 0.8))


SPLIT = [name for name, damper in MODELS.items() if damper.separation(SCALE) is not None]


def form_of(name: str) -> Separation:
    form = model(name).separation(SCALE)
    assert form is not None
    return form


def columns(form: Separation, shape: np.ndarray, sine: Sine) -> np.ndarray:
    fixed = form.fixed_columns(sine.u_m, sine.v_m_s, sine.a_m_s2, sine.current_A)
    yielding = form.yielding(sine, slice(None), shape, slope=False)
    powers = [
        column * sine.current_A**power
        for column, count in zip(yielding, form.powers, strict=True)
        for power in range(count)
    ]
    return np.column_stack([fixed, *powers])


def some_shape(form: Separation) -> np.ndarray:
    return np.asarray(form.starts[0]) if len(form.starts) else np.array([40.0, 0.5][: len(form.shape_names)])


@pytest.mark.few(1)
@pytest.mark.parametrize("name", SPLIT)
def test_a_split_model_is_its_force(name: str, sine: Sine) -> None:
    form = form_of(name)
    shape = some_shape(form)
    linear = np.linspace(1.0, 2.0, len(form.fixed_names) + len(form.yield_names))
    values = form.values(linear, shape)
    complete = {**values, **({"eta": 25.0} if "eta" in model(name).names else {})}
    force = model(name).force(complete, sine.u_m, sine.v_m_s, sine.a_m_s2, sine.current_A, sine.dt_s)
    assert columns(form, shape, sine) @ linear == pytest.approx(force, rel=1e-6, abs=1e-6)
    assert form.shape_of(values) == pytest.approx(shape, rel=1e-9)


@pytest.mark.few(5)
@pytest.mark.parametrize("name", [name for name in SPLIT if name != "bingham"])
def test_slopes_of_a_split_model_are_its_differences(name: str, sine: Sine) -> None:
    form = form_of(name)
    shape = some_shape(form)
    count = len(form.powers)
    slopes = form.yielding(sine, slice(None), shape, slope=True)[count:]
    bent = [(k, place) for k, places in enumerate(form.bends) for place in places]
    assert len(form.bends) == len(form.shape_names)
    for (k, place), slope in zip(bent, slopes, strict=True):
        step = np.zeros(shape.size)
        step[k] = 1e-5 * (shape[k] or 1e-2)
        above, below = (
            form.yielding(sine, slice(None), shape + sign * step, slope=False)[place] for sign in (1.0, -1.0)
        )
        difference = (above - below) / (2.0 * step[k])
        assert np.max(np.abs(slope - difference)) <= 2e-2 * np.max(np.abs(difference))


def test_a_bingham_split_has_no_slopes(sine: Sine) -> None:
    assert len(form_of("bingham").yielding(sine, slice(None), np.zeros(0), slope=True)) == 1
    assert model("bingham").argument_slopes({}, sine.u_m, sine.v_m_s) == ()  # type: ignore[attr-defined] - algebraic


def test_limits_and_held_parameters_have_the_models_own_names() -> None:
    loop = form_of("bouc_wen")
    assert loop.held_here(frozenset({"c0_b", "alpha_b"})) == {"kv_b", "kw_b"}
    assert loop.at_limit({"n - 1": 15.0, "rho": 1.0}) == {"n": LOWEST_EXPONENT + 15.0, "rho": 1.0}
    assert form_of("normalized_bouc_wen").at_limit({"sigma": 50.0}) == {"sigma": 50.0}
    assert form_of("lost_motion").at_limit({"vt": 1e-3}) == {"vt": 1e-3}
    assert form_of("lost_motion").held_here(frozenset({"kg_c"})) == {"kg_c"}
    tanh = form_of("asymmetric")
    assert (tanh.held_here(frozenset({"m"})), tanh.at_limit({"beta": 1e-3})) == ({"m"}, {"beta": 1e-3})
    without_spring = form_of("bouc_wen").values(np.zeros(6), some_shape(loop))
    assert without_spring["x0"] == 0.0


def test_a_model_that_splits_has_no_search() -> None:
    with pytest.raises(NotImplementedError, match="asymmetric is separable"):
        model("asymmetric").search()


SIMPLE = {
    "bingham": {"fc": 60.0, "fc_b": 200.0, "c0": 700.0, "c0_b": 100.0, "f0": -100.0},
    "normalized_bouc_wen": {
        "kx": 300.0, "kv": 700.0, "kv_b": 100.0, "kw": 80.0, "kw_b": 200.0, "f0": -100.0, "rho": 900.0, "sigma": 0.7,
        "n": 1.8,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", ["modified_bouc_wen", "viscoelastic_plastic"])
def test_a_search_starts_from_the_simpler_model_and_its_unknowns_lead_back(name: str) -> None:
    damper, search = model(name), model(name).search()
    starts = search.starts(SIMPLE[search.simpler], SCALE)
    unknowns = search.unknowns(starts[0], frozenset())
    for start in starts:
        values = damper.values(unknowns.vector(unknowns.theta(start)))
        assert search.admissible(values, SCALE)
        assert unknowns.theta(search.named(values)) == pytest.approx(unknowns.theta(start), rel=1e-9)
    assert search.at_limit(unknowns, unknowns.theta(starts[0])) == {}


def test_what_cannot_be_integrated_is_not_admissible() -> None:
    modified, plastic = model("modified_bouc_wen"), model("viscoelastic_plastic")
    values = dict(modified.demonstration)
    assert modified.search().admissible(values, SCALE)
    assert not modified.search().admissible(values | {"c1a": -1e5}, SCALE)
    assert not modified.search().admissible(values | {"alpha_a": 1e12}, SCALE)
    assert not modified.search().admissible(values | {"gamma": 1e9, "beta": -9.99e8}, SCALE)
    values = dict(plastic.demonstration)
    assert plastic.search().admissible(values, SCALE)
    assert not plastic.search().admissible(values | {"fc": -1e3}, SCALE)
    assert not plastic.search().admissible(values | {"k2": 1e9}, SCALE)


def test_the_exponent_at_its_limit_is_named_and_a_held_yield_force_is_left_out() -> None:
    search = model("modified_bouc_wen").search()
    start = search.starts(SIMPLE["normalized_bouc_wen"], SCALE)[0]
    unknowns = search.unknowns(start, frozenset({"alpha_b"}))
    assert "kw_b" not in unknowns.names
    theta = unknowns.theta({**start, "n - 1": 1e-4})
    assert search.at_limit(unknowns, theta) == {"n": LOWEST_EXPONENT}
    rigid = unknowns.vector(unknowns.theta({**start, "k1": 0.0}))
    assert model("modified_bouc_wen").values(rigid)["x0"] == 0.0
    without_loop = search.unknowns({name: value for name, value in start.items() if name != "n - 1"}, frozenset())
    assert search.at_limit(without_loop, np.zeros(len(without_loop.names))) == {}


class Dahl(HystereticModel):
    """A model as a user would add it: equation, parameters, kernel, nothing else."""

    name: ClassVar[str] = "dahl"
    states: ClassVar[int] = 1
    equation: ClassVar[str] = "F = kv v + kw w + f0, w' = rho (v - |v| w) (Dahl 1968)"
    demonstration: ClassVar[Mapping[str, float]] = {"kv": 700.0, "kw": 80.0, "f0": -150.0, "rho": 800.0, "eta": 25.0}
    parameters: tuple[Parameter, ...] = (
        linear_parameter("kv", "N s/m", 500.0, "viscous damping"),
        linear_parameter("kw", "N", 50.0, "friction"),
        linear_parameter("f0", "N", 0.0, "force offset"),
        shape_parameter("rho", "1/m", 500.0, 1e-2, 1e6, "inverse of the travel over which the friction reverses"),
        shape_parameter("eta", "1/s", 25.0, 0.1, 1e4, "rate of the coil current's lag"),
    )

    def kernel(self) -> Kernel:
        """See `DamperModel.kernel`."""
        from numba import njit

        from rig.dampers.kernel import Kernel

        @njit()
        def force(p: FloatArray, s0: float, s1: float, u: float, v: float, a: float, current: float) -> float:
            return float(p[0] * v + p[1] * s0 + p[2])

        @njit()
        def rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
            return p[3] * (v - abs(v) * s0), 0.0

        @njit()
        def fastest_rate(p: FloatArray, v: float, current: float) -> float:
            return float(p[3] * abs(v))

        return Kernel(force, rates, fastest_rate)


def test_a_model_of_one_file_is_integrated_and_searched(sine: Sine) -> None:
    damper = Dahl()
    assert damper.separation(SCALE) is None
    vector, state = damper.vector(damper.demonstration), damper.initial_state()
    advance = advance_of(damper)
    motion = zip(sine.u_m, sine.v_m_s, sine.a_m_s2, sine.current_A, strict=True)
    last = [advance(vector, state, u, v, a, amps, sine.dt_s) for u, v, a, amps in motion][-1]
    assert last == pytest.approx(700.0 * sine.v_m_s[-1] + 80.0 * state[0] - 150.0)
    search = damper.search()
    assert isinstance(search, Search)
    starts = search.starts({}, SCALE)
    assert [start["rho"] for start in starts] == pytest.approx([50.0, 500.0, 5000.0])
    unknowns = search.unknowns(starts[1], frozenset({"f0"}))
    assert unknowns.names == ("kv", "kw", "rho")
    values = damper.values(unknowns.vector(unknowns.theta(starts[1])))
    assert values == pytest.approx({**starts[1], "eta": 25.0})
    assert search.named(values) == values
    assert search.admissible(values, SCALE)
    assert not search.admissible(values | {"rho": 1e9}, SCALE)
    assert search.at_limit(unknowns, unknowns.theta(starts[1])) == {}
    assert search.at_limit(unknowns, unknowns.theta({**starts[1], "rho": 1e6})) == {"rho": 1e6}


def test_a_loop_travels_both_ways() -> None:
    assert travel(0.0, 0.5, 0.6, 2.0) == pytest.approx(-travel(0.0, -0.5, 0.6, 2.0))
    assert travel(0.0, 50.0, 0.6, 2.0) == pytest.approx(1.0)


@pytest.mark.parametrize(("name", "form"), [("asymmetric", "kwok"), ("asymmetric", "printed"), ("kwok", "kwok")])
def test_the_general_coefficients_are_the_models_force(name: str, form: Hysteresis, sine: Sine) -> None:
    damper = model(name, form)
    assert isinstance(damper, ColumnModel)
    values = {key: 0.02 if key == "lambda" else 1.0 + k for k, key in enumerate(damper.names)}
    candidates = damper.vector(values)[None, :]
    m, f0, beta, delta, fya, fyb, *viscous, ka, kb = general_coefficients(damper, damper.names, candidates)[0]
    up, down = viscous[0] + 0.8 * viscous[2], viscous[1] + 0.8 * viscous[3]
    yielding = (fya + 0.8 * fyb) * np.tanh(beta * sine.v_m_s + delta * np.sign(sine.u_m))
    steady = m * sine.a_m_s2 + f0 + np.where(sine.v_m_s > 0.0, up, down) * sine.v_m_s + (ka + 0.8 * kb) * sine.u_m
    force = damper.force(values, sine.u_m, sine.v_m_s, sine.a_m_s2, sine.current_A, sine.dt_s)
    assert steady + yielding == pytest.approx(force, rel=1e-9)


def test_a_tanh_search_starts_on_a_grid_that_grows_with_the_speed() -> None:
    for form in ("kwok", "printed"):
        damper = model("asymmetric", form)  # type: ignore[arg-type] - of a tuple
        assert isinstance(damper, TanhModel)
        grid = damper.start_grid(0.5)
        assert grid.shape[2] == 2
        assert grid[0, 0, 0] == pytest.approx(3.0)


def test_a_kernel_without_states_has_none_that_move() -> None:
    kernel = model("bingham").kernel()
    assert kernel.rates(np.zeros(5), 0.0, 0.0, 0.0, 0.1, 1.0) == (0.0, 0.0)
    assert kernel.fastest_rate(np.zeros(5), 0.1, 1.0) == 0.0


def test_kinds_are_places_in_the_catalogue_and_terms_name_parameters() -> None:
    assert [KINDS[name, "kwok"] for name in ("asymmetric", "kwok", "thinning_bouc_wen", "lost_motion")] == [
        0, 4, 10, 11,
    ]  # fmt: skip
    assert KINDS["asymmetric", "printed"] == 1
    assert model("asymmetric").of_term("stiffness") == ("Ka", "Kb")
    assert form_of("normalized_bouc_wen").held_here(frozenset({"kw_b"})) == {"kw_b"}
