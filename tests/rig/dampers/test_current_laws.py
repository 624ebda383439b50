"""What a fluid feels of the current, by hand; a model behind a law is the model at that current."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.dampers import UnknownName, model, parameter_set
from rig.dampers.current_law import UnknownLaw, current_law
from rig.dampers.current_law_model import with_law
from rig.dampers.separation import MotionScale
from simulators.options import DamperOptions
from simulators.plant.plant import specimen_model

TABLE = "per-current@0,1,2"


def felt(law: str, values: dict[str, float], *currents_A: float) -> list[float]:
    made = current_law(law)
    assert made is not None
    return made.felt_A(values, np.array(currents_A)).tolist()


def test_a_saturating_law_is_straight_at_first_and_ends_at_its_current_of_saturation() -> None:
    # (1 - exp(-1)) / 0.5 = 1.2642411...
    assert felt("saturating", {"k_sat": 0.5}, 0.0, 2.0, -2.0) == pytest.approx([0.0, 1.2642411, -1.2642411])
    assert felt("saturating", {"k_sat": 0.5}, 1e4) == pytest.approx([2.0])
    assert felt("saturating", {"k_sat": 0.0}, 1.5, -0.3) == pytest.approx([1.5, -0.3])
    assert felt("saturating", {"k_sat": 1e-8}, 1.0) == pytest.approx([1.0 - 0.5e-8], abs=1e-12)


def test_a_polynomial_law_has_the_slope_of_the_current_at_zero() -> None:
    # 2 + 0.1 x 4 - 0.05 x 8 = 2, and -2 + 0.4 + 0.4
    assert felt("polynomial", {"q2": 0.1, "q3": -0.05}, 2.0, -2.0) == pytest.approx([2.0, -1.2])
    assert felt("polynomial", {"q2": 0.1, "q3": -0.05}, 1e-6)[0] == pytest.approx(1e-6, rel=1e-6)


def test_a_table_goes_by_straight_lines_and_on_beyond_its_ends() -> None:
    values = {"x at 1 A": 1.5}
    assert felt(TABLE, values, 0.0, 0.5, 1.0, 1.5, 2.0) == pytest.approx([0.0, 0.75, 1.5, 1.75, 2.0])
    assert felt(TABLE, values, -1.0, 3.0) == pytest.approx([-1.5, 2.5])


@pytest.mark.parametrize(
    ("law", "values"),
    [("saturating", {"k_sat": 0.6}), ("polynomial", {"q2": 0.2, "q3": -0.1}), (TABLE, {"x at 1 A": 1.4})],
)
def test_a_compiled_law_is_the_law(law: str, values: dict[str, float]) -> None:
    made = current_law(law)
    assert made is not None
    compiled = made.compiled(2)
    vector = np.array([7.0, 8.0, *(values[name] for name in made.names)])
    currents = np.array([-1.0, 0.0, 1e-8, 0.3, 1.0, 1.7, 2.0, 2.6])
    assert [compiled(vector, float(x)) for x in currents] == pytest.approx(made.felt_A(values, currents).tolist())


def test_a_models_force_behind_a_law_is_its_force_at_what_the_fluid_feels() -> None:
    lawed, bare = model("asymmetric+saturating"), model("asymmetric")
    values = dict(parameter_set("demo").values)
    u, v, a = np.array([0.01, -0.02]), np.array([0.2, -0.1]), np.array([1.0, -3.0])
    x = (1.0 - math.exp(-0.6 * 1.5)) / 0.6
    behind = lawed.force({**values, "k_sat": 0.6}, u, v, a, 1.5, 1e-3)
    assert behind.tolist() == pytest.approx(bare.force(values, u, v, a, x, 1e-3).tolist())
    assert behind[0] < bare.force(values, u, v, a, 1.5, 1e-3)[0] - 50.0  # 0.51 A less are felt: 121 N less yield force
    at = lawed.force_at({**values, "k_sat": 0.6}, 0.2, 1.5)
    assert float(at) == pytest.approx(float(bare.force_at(values, 0.2, x)))


@pytest.mark.nightly
def test_kernels_behind_a_law_see_what_the_fluid_feels() -> None:
    bare, lawed = model("lugre"), model("lugre+saturating")
    kernel, own = lawed.kernel(), bare.kernel()
    p = bare.vector(bare.demonstration)
    longer, x = np.append(p, 0.6), (1.0 - math.exp(-0.6 * 1.5)) / 0.6
    assert kernel.force(longer, 0.3, 0.0, 0.01, 0.1, 0.0, 1.5) == pytest.approx(
        own.force(p, 0.3, 0.0, 0.01, 0.1, 0.0, x)
    )
    assert kernel.rates(longer, 0.3, 0.0, 0.01, 0.1, 1.5) == pytest.approx(own.rates(p, 0.3, 0.0, 0.01, 0.1, x))
    assert kernel.fastest_rate(longer, 0.1, 1.5) == pytest.approx(own.fastest_rate(p, 0.1, x))
    assert (lawed.states, lawed.positions, lawed.jumps_at) == (bare.states, bare.positions, bare.jumps_at)


def test_a_law_is_part_of_a_models_name_and_of_its_equation() -> None:
    lawed = model("kwok+polynomial")
    assert lawed is model("kwok+polynomial")  # one object: compiled once
    assert lawed.name == "kwok+polynomial"
    assert lawed.names == (*model("kwok").names, "q2", "q3")
    assert "x = I + q2 I^2 + q3 I^3" in lawed.equation
    assert model("kwok+affine") is model("kwok")
    assert with_law(lawed, "saturating") is model("kwok+saturating")  # another law takes the place of the first
    assert lawed.initial_state(0.2).tolist() == model("kwok").initial_state(0.2).tolist()
    assert lawed.separation(MotionScale(0.02, 0.2, 1.0, 0.0, 2.0, 0.002)) is None
    with pytest.raises(NotImplementedError, match="the current law is determined by a search"):
        lawed.search()
    assert set(lawed.demonstration) == set(lawed.names)


@pytest.mark.parametrize("law", ["saturated", "per-current", "per-current@0,1", "per-current@0,2,1", "per-current@a,b"])
def test_an_unknown_law_is_refused_and_what_is_known_is_reported(law: str) -> None:
    with pytest.raises(UnknownLaw, match="per-current@"):
        model(f"asymmetric+{law}")
    with pytest.raises(UnknownName, match="asymetric"):
        model(f"asymetric+{law}")


def test_the_simulated_damper_takes_a_law() -> None:
    lawed, values = specimen_model(DamperOptions(model="lost_motion+saturating", values={"k_sat": 0.9}))
    assert lawed.name == "lost_motion+saturating"
    assert values["k_sat"] == 0.9
    assert values["rho"] == model("lost_motion").demonstration["rho"]
