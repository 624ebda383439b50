"""One file among good ones is wrong: it is named, with what would make it fit, and no model is blamed for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Fit, Measurement, identify

DEMO = dict(parameter_set("demo").values)
DAMPER = model("asymmetric")
RATE_Hz, AMPLITUDE_m, CYCLES, NOISE_N = 250.0, 0.03, 3, 4.0
CURRENTS_A, FREQUENCIES_Hz = (0.0, 0.5, 1.0, 1.5), (0.75, 1.25, 2.0)
ODD = 7  # 1 A at 1.25 Hz


def campaign(
    *, currents_A: tuple[float, ...] = CURRENTS_A, offset_N: float = 0.0, rebound: float = 1.0,
    acting: Callable[[float], float] = lambda current_A: current_A,
    zero_N: Callable[[int], float] = lambda number: 0.0,
    gain: Callable[[int, np.ndarray], np.ndarray] = lambda number, share: np.ones_like(share),
) -> list[Measurement]:
    """The demo damper at every current and frequency; `offset_N` instead of gas, `rebound` times its viscous force."""
    random, tests = np.random.default_rng(3), []
    values = {key: value * (rebound if key.endswith("_plus") else 1.0) for key, value in DEMO.items()}
    if offset_N:
        values["F0"] = offset_N
    for current_A in currents_A:
        for frequency_Hz in FREQUENCIES_Hz:
            rate, number = 2.0 * np.pi * frequency_Hz, len(tests)
            time_s = np.arange(round(CYCLES * RATE_Hz / frequency_Hz)) / RATE_Hz + 0.0013
            sine, cosine = np.sin(rate * time_s), np.cos(rate * time_s)
            motion = AMPLITUDE_m * sine, AMPLITUDE_m * rate * cosine, -AMPLITUDE_m * rate**2 * sine
            force_N = DAMPER.force(values, *motion, acting(current_A), 1.0 / RATE_Hz) + zero_N(number)
            force_N = force_N * gain(number, np.linspace(0.0, 1.0, time_s.size))
            tests.append(Measurement(
                f"p{number:03d}", *motion, force_N + random.normal(0.0, NOISE_N, time_s.size),
                np.full(time_s.size, current_A), 1.0 / RATE_Hz, amplitude_m=AMPLITUDE_m, frequency_Hz=frequency_Hz,
                nominal_current_A=current_A, noise_N=NOISE_N, samples_per_cycle=round(RATE_Hz / frequency_Hz),
            ))  # fmt: skip
    return tests


def times(gain: float) -> Callable[[Measurement], Measurement]:
    return lambda test: replace(test, force_N=gain * test.force_N, noise_N=gain * test.noise_N)


def with_current(current_A: float) -> Callable[[Measurement], Measurement]:
    return lambda test: replace(test, current_A=np.full(test.u_m.size, current_A), nominal_current_A=current_A)


def moved(factor: float) -> Callable[[Measurement], Measurement]:
    return lambda test: test.moved(factor * test.u_m, factor * test.v_m_s, factor * test.a_m_s2)


def odd_in(fit: Fit) -> dict[str, str]:
    """What is said of each test that is named."""
    return {c.text.numbers["test"]: str(c.text) for c in fit.diagnosis if c.slug == "odd-test"}  # type: ignore[attr-defined]  # a Saying


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (times(10.0), "its force were multiplied by 0.1"), (times(0.1), "its force were multiplied by 10"),
        (times(2.0), "its force were multiplied by 0.5"), (times(0.5), "its force were multiplied by 2"),
        (times(0.8), "its force were multiplied by 1.25"),
        (with_current(0.0), "its current were 1.00 A instead of 0.00 A"),
        (with_current(1.5), "its current were 1.00 A instead of 1.50 A"),
        (moved(0.1), "its motion were multiplied by 10"),
    ],
)  # fmt: skip
def test_one_wrong_file_among_good_ones_is_named_first_and_alone(
    wrong: Callable[[Measurement], Measurement], message: str
) -> None:
    tests = campaign()
    fit = identify([wrong(test) if k == ODD else test for k, test in enumerate(tests)])
    assert [cause.slug for cause in fit.diagnosis] == ["odd-test"]
    assert list(odd_in(fit)) == ["p007"]
    assert message in fit.diagnosis[0].text
    assert fit.diagnosis[0].explains > 0.9


def test_every_one_of_several_wrong_files_is_named() -> None:
    tests = campaign(currents_A=(0.0, 0.5, 1.0, 1.5, 2.0))
    wrong = {4: times(0.1), 7: with_current(0.0), 13: times(2.0)}
    fit = identify([wrong[k](test) if k in wrong else test for k, test in enumerate(tests)])
    assert set(odd_in(fit)) == {"p004", "p007", "p013"}
    assert sum(cause.explains for cause in fit.diagnosis) == pytest.approx(1.0, abs=0.02)


def test_a_file_of_another_damper_is_named_though_nothing_makes_it_fit() -> None:
    tests = campaign()
    noisy = np.random.default_rng(0).normal(0.0, 1.0 * tests[ODD].peak_force_N, 40)
    rough_N = np.interp(np.arange(tests[ODD].u_m.size), np.linspace(0.0, tests[ODD].u_m.size, 40), noisy)
    fit = identify([*tests[:ODD], replace(tests[ODD], force_N=tests[ODD].force_N + rough_N), *tests[ODD + 1 :]])
    assert list(odd_in(fit)) == ["p007"]
    assert "neither a gain error in its force" in fit.diagnosis[0].text


def test_a_law_of_the_current_that_the_model_does_not_have_makes_no_test_odd() -> None:
    fit = identify(campaign(acting=lambda current_A: 0.6 * (1.0 - float(np.exp(-current_A / 0.6)))))
    assert fit.diagnosis[0].slug == "current-law"
    assert not odd_in(fit)


def test_a_test_alone_at_its_current_is_not_odd_for_what_the_law_may_lack() -> None:
    tests = campaign()
    kept = [test for k, test in enumerate(tests) if test.current_A[0] < 1.4 or k == len(tests) - 1]
    fit = identify([*kept[:-1], times(1.6)(kept[-1])], diagnose=True)
    assert not odd_in(fit)


def reversed_middle(test: Measurement) -> Measurement:
    return replace(test.moved(-test.u_m, -test.v_m_s, -test.a_m_s2), force_N=-test.force_N)


def test_zeros_that_differ_from_test_to_test_decide_no_sign() -> None:
    """Four tests without current, rebound a little the weaker one by chance: as measured, with true signs."""
    tests = campaign(currents_A=(0.0,), offset_N=60.0, zero_N=lambda number: (12.0, -6.0, -4.0)[number])
    slugs = [cause.slug for cause in identify(tests, diagnose=True).diagnosis]
    assert "signs-reversed" not in slugs
    assert "force-offset" in slugs


def test_reversed_signs_without_current_are_named_where_rebound_is_clearly_weaker() -> None:
    tests = [reversed_middle(test) for test in campaign(currents_A=(0.0,), offset_N=-60.0, rebound=1.5)]
    cause = identify(tests, diagnose=True).diagnosis[0]
    assert (cause.slug, cause.explains) == ("signs-reversed", 0.0)


def test_a_drift_in_some_tests_is_reported_among_a_hundred_as_among_twenty() -> None:
    """Under the misfit of a model that does not know rebound from jounce."""
    slugs = {}
    for count in (6, 34):
        tests = campaign(
            currents_A=tuple(np.linspace(0.0, 2.0, count).tolist()),
            gain=lambda number, share: 1.0 + 0.4 * share * (number % 5 == 2),
        )
        slugs[count] = {cause.text.slug for cause in identify(tests, model="symmetric").diagnosis}  # type: ignore[attr-defined]  # a Saying, which is a str with numbers
    assert "force-drift-some" in slugs[6]
    assert "force-drift-some" in slugs[34]
