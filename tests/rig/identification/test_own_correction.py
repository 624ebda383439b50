"""A correction of two files: requested by a number with a unit, it corrects the tests to fit and the held-out ones."""

import sys
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

from rig.cli.fit_tables import fit_tables
from rig.dampers import parameter_set
from rig.errors import IdentificationFailed, RigError
from rig.files.quantity import Quantity
from rig.identification import Measurement, identify
from rig.identification import options as fit_options
from rig.identification.fit_state import FitState
from rig.identification.options import FitOptions
from rig.matrix.corrections import CORRECTIONS, Correction
from rig.matrix.sections import entries_of

Make = Callable[..., list[Measurement]]
DEMO = dict(parameter_set("demo").values)
FRICTION_N = 30.0
SEAL = Correction(
    "seal_friction", "own_seal_friction", "Friction of the seal.", quantity=Quantity("force", "0 N", "500 N")
)


def with_friction(test: Measurement, friction_N: float) -> Measurement:
    """The test with a force (N) against the motion in addition."""
    return replace(test, force_N=test.force_N + friction_N * np.sign(test.v_m_s))


@pytest.fixture
def seal(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of the correction, and its entry."""
    module = ModuleType(SEAL.home)

    def refuse(options: FitOptions) -> None:
        del options

    def prepare(state: FitState) -> FitState:
        friction_N = state.options.setting(SEAL.name)
        return state.corrected(lambda tests: [with_friction(test, -friction_N) for test in tests])

    def complete(state: FitState) -> FitState:
        return state

    vars(module).update(refuse=refuse, prepare=prepare, complete=complete)
    monkeypatch.setitem(sys.modules, SEAL.home, module)
    monkeypatch.setattr(fit_options, "CORRECTIONS", (SEAL, *CORRECTIONS))
    monkeypatch.setitem(fit_options.SETTINGS, SEAL.name, SEAL.nothing)
    return module


@pytest.mark.usefixtures("seal")
def test_a_known_effect_is_removed_from_fitted_and_held_out_tests(make_synthetic: Make) -> None:
    tests = make_synthetic(DEMO, (0.0, 2.0), (0.5, 2.0), noise_N=2.0)
    rubbing = [with_friction(test, FRICTION_N) for test in tests]
    clean = identify(tests[:3], holdout=tests[3:], diagnose=False)
    fit = identify(rubbing[:3], holdout=rubbing[3:], diagnose=False, seal_friction=FRICTION_N)
    assert fit.values == pytest.approx(clean.values, rel=1e-6, abs=1e-6)
    assert fit.holdout is not None
    assert clean.holdout is not None
    assert fit.holdout.rmse_N == pytest.approx(clean.holdout.rmse_N, rel=1e-6)
    assert fit.to_json()["corrections"] == {"seal_friction": {"requested_N": FRICTION_N}}
    assert any("seal_friction" in str(block) for block in fit_tables(fit))
    assert "corrections" not in str(fit_tables(clean))


def test_a_correction_that_forgets_the_held_out_tests_is_refused(make_synthetic: Make, seal: ModuleType) -> None:
    def prepare(state: FitState) -> FitState:
        return replace(state, fitted=[with_friction(test, -FRICTION_N) for test in state.fitted])

    vars(seal)["prepare"] = prepare
    tests = make_synthetic(DEMO, (0.0,), (0.5, 2.0))
    with pytest.raises(RigError, match="seal_friction"):
        identify(tests[:1], holdout=tests[1:], seal_friction=FRICTION_N)


@pytest.mark.usefixtures("seal")
@pytest.mark.parametrize("wrong", [-1.0, 501.0, float("nan"), "20 N", True])
def test_a_number_outside_the_range_is_refused(make_synthetic: Make, wrong: object) -> None:
    with pytest.raises(IdentificationFailed, match="seal_friction"):
        identify(make_synthetic(DEMO, (0.0,), (0.5, 2.0)), seal_friction=wrong)


@pytest.mark.usefixtures("seal")
@pytest.mark.parametrize("other", [{"current": "per-current-affine"}, {"temperature_law": "both"}])
def test_a_refused_combination_names_the_correction(make_synthetic: Make, other: dict[str, str]) -> None:
    with pytest.raises(IdentificationFailed, match="seal_friction"):
        identify(make_synthetic(DEMO, (0.0, 2.0), (0.5,)), seal_friction=20.0, **other)


def test_the_matrix_has_a_key_for_each_correction() -> None:
    from rig.files.section import Section, create_model

    table = create_model("Table", __base__=Section, **entries_of((SEAL, *CORRECTIONS)))
    assert table.model_validate({"seal_friction": "20 N"}).model_dump() == {
        "seal_friction": 20.0, "series_spring": False, "temperature_law": "none",
    }  # fmt: skip
    assert table.model_validate({"seal_friction_kN": 0.02}).model_dump()["seal_friction"] == 20.0
    for wrong in ("501 N", "20 mm", 20.0):
        with pytest.raises(ValueError, match="seal_friction"):
            table.model_validate({"seal_friction": wrong})
