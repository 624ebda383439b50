"""The models on a real damper: what they predict of motions they were not fitted to."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model
from rig.identification import Measurement, Method, identify
from rig.identification.models.solving import solve
from rig.identification.models.undetermined import examine
from rig.identification.points.preparation import prepare_all
from rig.identification.uncertainty.scoring import score
from rig.recording.importing import import_tests
from rig.recording.run import Run

MEASURED = Path(os.environ.get("RIG_MEASURED_DATA", Path(__file__).parents[4] / "shared/data/utfsm"))
COLUMNS = {"time": "t_s", "displacement": "x_m", "force": "force_N"}

pytestmark = [
    pytest.mark.measured,
    pytest.mark.skipif(not MEASURED.is_dir(), reason=f"the measured UTFSM tests are not in {MEASURED}"),
]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> list[Measurement]:
    """Twenty tests: four motions at five currents."""
    folder = tmp_path_factory.mktemp("measured")
    run = import_tests(
        sorted(MEASURED.glob("*.csv")), columns=COLUMNS, current_from_name=r"_(?P<current>[0-9.]+)A", out=folder
    )
    return prepare_all(Run.open(run).valid)[0]


def one_motion_out(tests: list[Measurement]) -> Iterator[tuple[list[Measurement], list[Measurement]]]:
    """Each amplitude and frequency left out in turn."""
    motions = sorted({(round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) for each in tests})
    for motion in motions:
        out = [each for each in tests if (round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) == motion]
        yield [each for each in tests if not any(each is other for other in out)], out


@pytest.mark.nightly
def test_thinning_bouc_wen_foretells_unseen_motions_to_a_tenth_of_the_peak(measured: list[Measurement]) -> None:
    assert len(measured) == 20
    errors = []
    for kept, out in one_motion_out(measured):
        fit = identify(kept, model="thinning_bouc_wen", holdout=out)
        assert fit.holdout is not None
        errors.append(fit.holdout.nrmse_percent_of_peak)
    assert len(errors) == 4
    assert np.mean(errors) < 8.5
    assert max(errors) < 11.0


def unseen_errors(name: str, tests: list[Measurement]) -> list[float]:
    """Error (% of peak) of each motion left out, each test alike, as `identify` weighs them where no model fits."""
    damper, errors, method = model(name), [], Method(weight="relative")
    for kept, out in one_motion_out(tests):
        solution = solve(damper, kept, method, examine(damper, kept))
        errors.append(score(damper, solution.values, out).nrmse_percent_of_peak)
    return errors


def test_lost_motion_foretells_unseen_motions_to_seven_per_cent_of_the_peak(measured: list[Measurement]) -> None:
    errors = unseen_errors("lost_motion", measured)
    assert np.mean(errors) < 7.0
    assert max(errors) < 9.0


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["sprung_bouc_wen", "thixotropic_bouc_wen"])
def test_a_spring_and_a_mass_predict_unseen_motions_to_six_per_cent_of_the_peak(
    measured: list[Measurement], name: str
) -> None:
    errors = unseen_errors(name, measured)
    assert np.mean(errors) < 6.0
    assert max(errors) < 8.0


def test_a_fluid_that_remembers_its_speed_describes_the_tests_at_0_A_better(measured: list[Measurement]) -> None:
    """Those of short fast strokes above all: over speed they rise from less than the slow ones."""
    errors = []
    for name in ("sprung_bouc_wen", "thixotropic_bouc_wen"):
        damper = model(name)
        fitted = solve(damper, measured, Method(weight="relative"), examine(damper, measured))
        reported = {each.id: each.nrmse_percent_of_peak for each in score(damper, fitted.values, measured).per_test}
        errors.append([reported[f"{motion}_0.00A"] for motion in ("2mm5Hz", "5mm3Hz", "25mm0x25Hz", "25mm0x5Hz")])
    assert np.mean(errors[1]) < 0.92 * np.mean(errors[0])
    assert errors[1][1] < errors[0][1] - 1.2


def test_the_step_after_a_reversal_is_a_third_of_a_millimetre_long(measured: list[Measurement]) -> None:
    """Read off the loops by eye: the force rises again 0.35 to 0.45 mm after each reversal, at every current."""
    fit = identify(measured, model="lost_motion")
    assert fit.weight == "relative"  # all models leave far more than the scatter
    assert 0.3e-3 < 2.0 / fit.values["rho"] < 0.45e-3
    assert fit.error.nrmse_percent_of_peak < 5.8


@pytest.mark.nightly
def test_the_data_choose_the_model_made_for_real_dampers(measured: list[Measurement]) -> None:
    kept, out = list(one_motion_out(measured))[1]
    fit = identify(kept, model="all", holdout=out)
    assert fit.model == "thixotropic_bouc_wen"
    assert not fit.adequate  # two to seven per cent of the peak remain, far more than the scatter
    unseen = {each.model: each.holdout_nrmse_percent_of_peak for each in fit.selection}
    better = ("asymmetric", "lost_motion", "sprung_bouc_wen", "thixotropic_bouc_wen")
    errors = [unseen[name] for name in better]
    assert errors == sorted(errors, reverse=True)  # type: ignore[type-var]  # tests were held out


@pytest.mark.nightly
def test_what_the_best_model_does_not_have_is_no_second_damper(measured: list[Measurement]) -> None:
    fit = identify(measured, model="thixotropic_bouc_wen")
    assert fit.adequate is False
    assert {cause.slug for cause in fit.diagnosis} <= {"unexplained", "force-offset"}
    few = identify(measured[1::2], model="lost_motion")
    assert few.diagnosis[0].slug != "mixed-specimens"


def test_no_sign_is_doubted_in_the_tests_without_current_whose_zeros_differ(measured: list[Measurement]) -> None:
    without = [test for test in measured if test.nominal_current_A == 0.0]
    slugs = [cause.slug for cause in identify(without).diagnosis]
    assert len(without) == 4
    assert "signs-reversed" not in slugs
    assert "force-offset" in slugs


@pytest.mark.nightly  # by day on synthetic tests: `test_odd_tests.py`
@pytest.mark.parametrize(("id_", "gain"), [("25mm0x25Hz_0.25A", 10.0), ("2mm5Hz_0.00A", 0.1), ("5mm3Hz_1.00A", 2.0)])
def test_one_wrong_gain_among_twenty_is_named_with_its_test(
    measured: list[Measurement], id_: str, gain: float
) -> None:
    altered = [replace(test, force_N=gain * test.force_N) if test.id == id_ else test for test in measured]
    first = identify(altered, model="lost_motion").diagnosis[0]
    assert first.slug == "odd-test"
    assert first.text.startswith(f"{id_} is inconsistent")


@pytest.mark.nightly
def test_one_current_stated_wrongly_among_twenty_is_named_and_the_others_are_not(measured: list[Measurement]) -> None:
    altered = [
        replace(test, current_A=np.full(test.u_m.size, 0.75)) if test.id == "25mm0x25Hz_0.25A" else test
        for test in measured
    ]
    first = identify(altered, model="lost_motion").diagnosis[0]
    assert first.slug == "odd-test"
    assert first.text.startswith("25mm0x25Hz_0.25A")
    assert "0.25 A instead of 0.75 A" in first.text
    slugs = [cause.slug for cause in identify(measured, model="lost_motion").diagnosis]
    assert "odd-test" not in slugs
