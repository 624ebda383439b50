"""A misfit is explained: each corruption of good data is named first, and good data are not accused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.errors import some
from rig.identification import Fit, Measurement, identify
from rig.identification.diagnosis.stretches import path_since_reversal_m
from rig.identification.diagnosis.trials import is_level_of_current
from rig.identification.runs import write_fit

DEMO = dict(parameter_set("demo").values)
DAMPER = model("asymmetric")
RATE_Hz, AMPLITUDE_m, CYCLES, NOISE_N = 250.0, 0.03, 4, 4.0
CURRENTS_A, FREQUENCIES_Hz = (0.0, 0.5, 1.0, 1.5, 2.0), (0.75, 1.5)


def damper_tests(
    *,
    skew_s: float = 0.0,
    noise_N: float = NOISE_N,
    currents_A: tuple[float, ...] = CURRENTS_A,
    acting: Callable[[float], float] = lambda current_A: current_A,
    values_of: Callable[[int], dict[str, float]] = lambda number: DEMO,
    shown: Callable[[int, np.ndarray, np.ndarray], np.ndarray] = lambda number, share, force_N: force_N,
) -> list[Measurement]:
    """Tests of the demo damper by its equation: sines, white noise, and what a test adds to them."""
    random, tests = np.random.default_rng(3), []
    for current_A in currents_A:
        for frequency_Hz in FREQUENCIES_Hz:
            rate, number = 2.0 * np.pi * frequency_Hz, len(tests)
            time_s = np.arange(round(CYCLES * RATE_Hz / frequency_Hz)) / RATE_Hz + 0.0013

            def motion(at_s: np.ndarray, rate: float = rate) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
                sine, cosine = np.sin(rate * at_s), np.cos(rate * at_s)
                return AMPLITUDE_m * sine, AMPLITUDE_m * rate * cosine, -AMPLITUDE_m * rate**2 * sine

            force_N = DAMPER.force(values_of(number), *motion(time_s - skew_s), acting(current_A), 1.0 / RATE_Hz)
            force_N = shown(number, np.linspace(0.0, 1.0, time_s.size), force_N)
            u_m, v_m_s, a_m_s2 = motion(time_s)
            tests.append(
                Measurement(
                    id=f"p{number + 1:03d}", u_m=u_m, v_m_s=v_m_s, a_m_s2=a_m_s2,
                    force_N=force_N + random.normal(0.0, noise_N, time_s.size),
                    current_A=np.full(time_s.size, current_A), dt_s=1.0 / RATE_Hz, amplitude_m=AMPLITUDE_m,
                    frequency_Hz=frequency_Hz, nominal_current_A=current_A, noise_N=noise_N,
                    samples_per_cycle=round(RATE_Hz / frequency_Hz),
                )
            )  # fmt: skip
    return tests


def loops_of_the_normalised_model(skew_s: float) -> list[Measurement]:
    """The same campaign of a hysteretic damper, each test warmed up by a cycle."""
    damper, random, tests = model("normalized_bouc_wen"), np.random.default_rng(5), []
    for current_A in (0.5, 1.5):
        for frequency_Hz in FREQUENCIES_Hz:
            rate, cycle = 2.0 * np.pi * frequency_Hz, round(RATE_Hz / frequency_Hz)
            time_s = np.arange(-cycle, 3 * cycle) / RATE_Hz + 0.0013
            u_m, v_m_s = AMPLITUDE_m * np.sin(rate * time_s), AMPLITUDE_m * rate * np.cos(rate * time_s)
            early = rate * (time_s - skew_s)
            sine, cosine = AMPLITUDE_m * np.sin(early), AMPLITUDE_m * np.cos(early)
            motion = (sine, rate * cosine, -(rate**2) * sine)
            force_N = damper.force(damper.demonstration, *motion, current_A, 1.0 / RATE_Hz)
            force_N = force_N + random.normal(0.0, 2.0, time_s.size)
            kept, a_m_s2 = slice(cycle, None), -(rate**2) * u_m
            tests.append(
                Measurement(
                    id=f"n{len(tests)}", u_m=u_m[kept], v_m_s=v_m_s[kept], a_m_s2=a_m_s2[kept], force_N=force_N[kept],
                    current_A=np.full(3 * cycle, current_A), dt_s=1.0 / RATE_Hz, amplitude_m=AMPLITUDE_m,
                    frequency_Hz=frequency_Hz, nominal_current_A=current_A, noise_N=2.0, samples_per_cycle=cycle,
                )
            )  # fmt: skip
    return tests


def named_first(fit: Fit) -> str:
    assert fit.diagnosis, "no cause was named"
    shares = [cause.explains for cause in fit.diagnosis]
    assert all(0.0 <= share <= 1.0 for share in shares)
    assert all(cause.text and cause.next for cause in fit.diagnosis)
    return fit.diagnosis[0].slug


def test_a_diagnosis_is_read_back_from_a_fit_file(tmp_path: Path) -> None:
    fit = identify(damper_tests(skew_s=3e-3, currents_A=(0.0, 1.0)))
    write_fit(fit, tmp_path)
    again = Fit.load(tmp_path / "fit.json")
    assert [vars(cause) for cause in again.diagnosis] == [vars(cause) for cause in fit.diagnosis]


def test_good_tests_are_not_accused_even_on_request() -> None:
    fit = identify(damper_tests(), diagnose=True)
    assert fit.adequate
    assert fit.diagnosis == ()


@pytest.mark.parametrize("skew_ms", [0.7, 3.0])
def test_a_delay_is_named_and_measured(skew_ms: float) -> None:
    fit = identify(damper_tests(skew_s=1e-3 * skew_ms))
    assert fit.adequate is False
    assert named_first(fit) == "skew"
    assert fit.diagnosis[0].explains > 0.95
    numbers = fit.diagnosis[0].text.numbers  # type: ignore[attr-defined]  # a Saying, which is a str with numbers
    assert numbers["skew_ms"] == pytest.approx(skew_ms, abs=0.05)


@pytest.mark.parametrize("over", ["test", "campaign"])
def test_a_drift_of_a_quarter_is_named(over: str) -> None:
    def shown(number: int, share: np.ndarray, force_N: np.ndarray) -> np.ndarray:
        return np.asarray(force_N * (1.0 + 0.25 * (share if over == "test" else (number + share) / 10.0)))

    fit = identify(damper_tests(shown=shown))
    assert named_first(fit) == "force-drift"
    assert "+25" in fit.diagnosis[0].text or "+2" in fit.diagnosis[0].text


def test_a_drift_in_some_of_the_tests_is_no_second_damper() -> None:
    def shown(number: int, share: np.ndarray, force_N: np.ndarray) -> np.ndarray:
        return force_N * (1.0 + 0.25 * share) if number in {1, 6} else force_N

    fit = identify(damper_tests(shown=shown))
    assert named_first(fit) == "force-drift"
    assert "(p002, p007; largest +25" in fit.diagnosis[0].text


def test_what_drifts_in_every_test_by_itself_is_not_reported_of_some_tests() -> None:
    def shown(number: int, share: np.ndarray, force_N: np.ndarray) -> np.ndarray:
        return np.asarray(force_N * (1.0 + 0.25 * (-1) ** number * share))

    fit = identify(damper_tests(shown=shown))
    assert named_first(fit) == "force-drift"
    assert "some tests" not in fit.diagnosis[0].text
    assert "(p001, p002, p003 and 7 more; largest" in fit.diagnosis[0].text


def test_outliers_are_named_and_counted() -> None:
    random, tests, hit = np.random.default_rng(5), [], 0
    for test in damper_tests():
        force_N, where = test.force_N.copy(), random.random(test.force_N.size) < 0.005
        force_N[where] += random.choice((-400.0, 400.0), int(where.sum()))
        hit += int(where.sum())
        tests.append(replace(test, force_N=force_N))
    fit = identify(tests)
    assert named_first(fit) == "outliers"
    assert f"samples, {hit} in all)" in fit.diagnosis[0].text


def test_a_force_that_flattens_at_speed_but_goes_on_changing_is_not_clipped() -> None:
    """A digressive, cavitating damper: the channel holds more force than any end that explains the misfit."""
    random, test = np.random.default_rng(1), damper_tests(currents_A=(0.0,))[0]
    force_N = 900.0 * np.tanh(4.0 * test.v_m_s) + 20.0 * np.sign(test.v_m_s)
    force_N = np.where(force_N < 0.0, 0.4 * force_N, force_N) + 150.0 * np.tanh(200.0 * test.u_m)
    fit = identify([replace(test, force_N=force_N + random.normal(0.0, 0.5, force_N.size), noise_N=0.5)])
    assert fit.adequate is False
    assert "clipping" not in {cause.slug for cause in fit.diagnosis}


def test_a_channel_that_ends_on_one_side_is_named_with_that_end_alone() -> None:
    fit = identify(damper_tests(shown=lambda number, share, force_N: np.minimum(force_N, 450.0)))
    assert named_first(fit) == "clipping"
    numbers = fit.diagnosis[0].text.numbers  # type: ignore[attr-defined]  # a Saying, which is a str with numbers
    ends = [numbers[name] for name in ("end_N", "high_N") if name in numbers]
    assert ends == pytest.approx([450.0], abs=2.0)


def test_clipping_under_noise_is_named_with_its_ends() -> None:
    fit = identify(damper_tests(shown=lambda number, share, force_N: np.clip(force_N, -700.0, 450.0)))
    assert named_first(fit) == "clipping"
    numbers = fit.diagnosis[0].text.numbers  # type: ignore[attr-defined]  # a Saying, which is a str with numbers
    assert (numbers["low_N"], numbers["high_N"]) == pytest.approx((-700.0, 450.0), abs=2.0)


def test_a_saturating_current_law_is_named_from_five_currents() -> None:
    fit = identify(damper_tests(acting=lambda current_A: 0.8 * (1.0 - np.exp(-current_A / 0.8))))
    assert named_first(fit) == "current-law"


def test_a_law_drawn_through_two_currents_is_doubted_where_it_leaves_much_at_zero() -> None:
    saturating = damper_tests(currents_A=(1.0, 2.0), acting=lambda current_A: 0.8 * (1.0 - np.exp(-current_A / 0.8)))
    fit = identify(saturating)
    assert fit.adequate  # a line goes through any two currents
    assert (named_first(fit), fit.diagnosis[0].explains) == ("current-law", 0.0)
    assert identify(damper_tests(currents_A=(1.0, 2.0))).diagnosis == ()


def test_tests_of_two_dampers_are_distinguished() -> None:
    other = {**DEMO, "Fyb": 150.0, "Ca_plus": 1500.0}
    fit = identify(damper_tests(values_of=lambda number: other if number in {1, 4, 7, 8} else DEMO))
    assert named_first(fit) == "mixed-specimens"
    assert "p002, p005, p008 and 1 more" in fit.diagnosis[0].text


def test_all_tests_at_one_current_are_no_second_damper() -> None:
    tests = damper_tests()
    zero = np.array([test.nominal_current_A == 0.0 for test in tests])
    part_of_zero = zero & (np.arange(len(tests)) > 0)
    assert [is_level_of_current(tests, second) for second in (zero, ~zero, part_of_zero)] == [True, True, False]
    more = [*tests, *(test for test in tests if test.nominal_current_A == 0.0)]
    zero = np.array([test.nominal_current_A == 0.0 for test in more])
    stray, two_strays = zero.copy(), zero.copy()
    stray[np.flatnonzero(~zero)[0]] = two_strays[np.flatnonzero(~zero)[:2]] = True
    assert [is_level_of_current(more, second) for second in (stray, two_strays, ~stray)] == [True, False, True]


def test_a_model_that_does_not_have_the_amplitude_makes_no_second_damper() -> None:
    """Large and small strokes of a damper whose yield force grows with the stroke, which the model does not know."""
    large = damper_tests(currents_A=(0.0, 1.0), values_of=lambda number: {**DEMO, "Fyb": 300.0, "Fya": 60.0})
    small = [
        replace(test.moved(0.2 * test.u_m, 0.2 * test.v_m_s, 0.2 * test.a_m_s2), id=f"s{test.id}", amplitude_m=6e-3,
                force_N=small_N(test)) for test in damper_tests(currents_A=(0.0, 1.0))
    ]  # fmt: skip
    assert "mixed-specimens" not in {cause.slug for cause in identify([*large, *small]).diagnosis}


def small_N(test: Measurement) -> np.ndarray:
    """The demo damper's force at a fifth of a test's motion, with its noise (N)."""
    motion = (test.u_m, test.v_m_s, test.a_m_s2)
    whole_N = DAMPER.force(DEMO, *motion, test.current_A, test.dt_s)
    fifth_N = DAMPER.force(DEMO, *(0.2 * part for part in motion), test.current_A, test.dt_s)
    return np.asarray(test.force_N - whole_N + fifth_N)


def test_a_recorded_temperature_is_named_before_a_drift() -> None:
    def temperature_degC(number: int, share: np.ndarray) -> np.ndarray:
        return np.asarray(25.0 + 30.0 * (1.0 - np.exp(-0.3 * (number + share))))

    tests = damper_tests(
        shown=lambda number, share, force_N: force_N * (1.0 - 0.005 * (temperature_degC(number, share) - 25.0))
    )
    known = [
        replace(test, temperature_degC=temperature_degC(number, np.linspace(0.0, 1.0, test.u_m.size)))
        for number, test in enumerate(tests)
    ]
    assert named_first(identify(known)) == "temperature"


def test_oil_that_thins_between_cold_and_warm_tests_is_no_second_damper() -> None:
    """Only the viscous force falls, by 1.5 % per kelvin, between all tests at 20 and the same at 50 degC."""
    fall = float(np.exp(-0.015 * 30.0))
    thin = {name: value * (fall if name.startswith("C") else 1.0) for name, value in DEMO.items()}
    cold, warm = damper_tests(), damper_tests(values_of=lambda number: thin)
    known = [
        replace(test, id=f"{test.id} at {at_degC:g}", temperature_degC=np.full(test.u_m.size, at_degC))
        for tests, at_degC in ((cold, 20.0), (warm, 50.0)) for test in tests
    ]  # fmt: skip
    fit = identify(known)
    assert fit.adequate is False
    assert named_first(fit) == "temperature"
    numbers = fit.diagnosis[0].text.numbers  # type: ignore[attr-defined]  # a Saying, which is a str with numbers
    assert (numbers["viscous_percent_K"], numbers["yield_percent_K"]) == pytest.approx((1.5, 0.0), abs=0.15)
    assert "mixed-specimens" not in {cause.slug for cause in fit.diagnosis}


@pytest.mark.parametrize(
    ("slug", "likely", "wrong"),
    [
        ("units-force", "kN", lambda t: replace(t, force_N=1e-3 * t.force_N, noise_N=1e-3 * NOISE_N)),
        ("units-time", "ms", lambda t: replace(t, dt_s=1e3 * t.dt_s, v_m_s=1e-3 * t.v_m_s, a_m_s2=1e-6 * t.a_m_s2)),
        ("units-displacement", "mm", lambda t: t.moved(1e3 * t.u_m, 1e3 * t.v_m_s, 1e3 * t.a_m_s2)),
        ("units-displacement", "in m, not mm", lambda t: t.moved(1e-3 * t.u_m, 1e-3 * t.v_m_s, 1e-3 * t.a_m_s2)),
        ("units-current", "mA", lambda t: replace(t, current_A=1e3 * t.current_A)),
        ("units-velocity", "500 times", lambda t: replace(t, u_m=500.0 * 0.01 * t.u_m, v_m_s=0.01 * t.v_m_s)),
    ],
)
def test_a_wrong_unit_is_named(slug: str, likely: str, wrong: Callable[[Measurement], Measurement]) -> None:
    fit = identify([wrong(test) for test in damper_tests(currents_A=(0.0, 1.0))])
    assert named_first(fit) == slug
    assert likely in fit.diagnosis[0].text


@pytest.mark.parametrize("right", [3, 9])
@pytest.mark.parametrize(
    ("slug", "likely", "wrong"),
    [
        ("units-force", "kN", lambda t: replace(t, force_N=1e-3 * t.force_N, noise_N=1e-3 * NOISE_N)),
        ("units-time", "ms", lambda t: replace(t, dt_s=1e3 * t.dt_s, v_m_s=1e-3 * t.v_m_s, a_m_s2=1e-6 * t.a_m_s2)),
        ("units-displacement", "mm", lambda t: t.moved(1e3 * t.u_m, 1e3 * t.v_m_s, 1e3 * t.a_m_s2)),
        ("units-current", "mA", lambda t: replace(t, current_A=1e3 * t.current_A)),
    ],
)
def test_a_wrong_unit_of_some_tests_is_named_with_the_tests(
    slug: str, likely: str, wrong: Callable[[Measurement], Measurement], right: int
) -> None:
    tests = damper_tests()
    fit = identify([*tests[:right], *map(wrong, tests[right:])])
    assert named_first(fit) == slug
    ids = some([test.id for test in tests[right:]])
    assert fit.diagnosis[0].text.startswith(f"in {ids} only: ")
    assert likely in fit.diagnosis[0].text


@pytest.mark.parametrize(
    ("amplitude_m", "frequency_Hz", "rate_Hz"), [(2e-4, 0.4, RATE_Hz), (1e-2, 0.004, 5.0)], ids=["small", "slow"]
)
@pytest.mark.parametrize("skew_s", [0.0, 3e-3], ids=["adequate", "not adequate"])
def test_a_small_or_slow_test_among_others_is_no_wrong_unit(
    amplitude_m: float, frequency_Hz: float, rate_Hz: float, skew_s: float
) -> None:
    tests = damper_tests(skew_s=skew_s)
    rate, random = 2.0 * np.pi * frequency_Hz, np.random.default_rng(1)
    time_s = np.arange(round(3 * rate_Hz / frequency_Hz)) / rate_Hz + 0.0013
    u_m, v_m_s = amplitude_m * np.sin(rate * time_s), amplitude_m * rate * np.cos(rate * time_s)
    motion = (u_m, v_m_s, -(rate**2) * u_m)
    force_N = DAMPER.force(DEMO, *motion, 1.0, 1.0 / rate_Hz) + random.normal(0.0, NOISE_N, time_s.size)
    fit = identify([*tests, Measurement(
        "slow", *motion, force_N, np.full(time_s.size, 1.0), 1.0 / rate_Hz, amplitude_m=amplitude_m,
        frequency_Hz=frequency_Hz, nominal_current_A=1.0, noise_N=NOISE_N,
        samples_per_cycle=round(rate_Hz / frequency_Hz),
    )], diagnose=True)
    assert fit.adequate is (skew_s == 0.0)
    assert not [cause.slug for cause in fit.diagnosis if cause.slug.startswith("units-")]


def test_both_signs_reversed_are_named() -> None:
    turned = [
        replace(test.moved(-test.u_m, -test.v_m_s, -test.a_m_s2), force_N=-test.force_N) for test in damper_tests()
    ]
    assert named_first(identify(turned)) == "signs-reversed"


def test_reversed_signs_do_not_hide_what_explains_a_misfit() -> None:
    turned = [
        replace(test.moved(-test.u_m, -test.v_m_s, -test.a_m_s2), force_N=-test.force_N)
        for test in damper_tests(skew_s=3e-3)
    ]
    slugs = [cause.slug for cause in identify(turned).diagnosis]
    assert slugs[:2] == ["signs-reversed", "skew"]


def test_an_offset_of_a_damper_that_resists_rebound_more_is_no_reversed_sign() -> None:
    pushed = damper_tests(values_of=lambda number: {**DEMO, "F0": 200.0})
    fit = identify(pushed)
    assert fit.adequate
    assert (named_first(fit), fit.diagnosis[0].explains) == ("force-offset", 0.0)
    assert "Observation: the mean force at low speed is +200 N" in str(fit)
    assert "Probable cause" not in str(fit)
    assert identify(damper_tests(values_of=lambda number: {**DEMO, "F0": 0.0})).diagnosis == ()


def test_an_offset_comes_after_what_explains_a_misfit() -> None:
    fit = identify(damper_tests(skew_s=3e-3, values_of=lambda number: {**DEMO, "F0": 150.0}))
    slugs = [cause.slug for cause in fit.diagnosis]
    assert (slugs[0], slugs[-1]) == ("skew", "force-offset")


def test_a_model_without_hysteresis_names_what_is_missing() -> None:
    fit = identify(damper_tests(), model="bingham")
    assert fit.adequate is False
    assert named_first(fit) in {"missing-hysteresis", "speed-shape"}
    assert "--model all" in fit.diagnosis[0].next


def test_the_path_since_a_reversal_starts_anew_at_every_reversal() -> None:
    test = damper_tests(currents_A=(0.0,))[0]
    since = path_since_reversal_m(test)
    assert float(np.max(since)) == pytest.approx(2.0 * AMPLITUDE_m, rel=0.01)
    slow = np.abs(test.v_m_s) < 0.02 * np.max(np.abs(test.v_m_s))
    assert np.all((since[slow] < 0.001 * AMPLITUDE_m) | (since[slow] > 1.99 * AMPLITUDE_m))


def test_fits_at_each_current_are_diagnosed_where_they_fit_worst() -> None:
    clipped = damper_tests(shown=lambda number, share, force_N: np.clip(force_N, -500.0, 300.0))
    fit = identify(clipped, current="per-current-affine")
    assert named_first(fit) == "clipping"
    assert fit.diagnosis[0].text.startswith("at 2 A: ")
    clean = damper_tests(currents_A=(0.0, 1.0))
    assert identify(clean, current="per-current-affine").diagnosis == ()


def test_a_delay_that_hides_in_the_scatter_is_named_and_the_fit_stays_adequate() -> None:
    hidden = damper_tests(skew_s=0.7e-3, noise_N=12.0)
    fit = identify(hidden)
    assert fit.adequate
    assert named_first(fit) == "skew"
    assert 0.5 < float(fit.diagnosis[0].text.split()[3]) < 1.0  # "a delay of +0.8 ms ..."
    assert identify(damper_tests(skew_s=0.1e-3, noise_N=12.0)).diagnosis == ()  # too short to matter
    known = [replace(test, skew_std_s=0.4e-3) for test in hidden]
    assert identify(known).diagnosis == ()  # it is within what the recording states of itself


def test_a_delay_is_named_though_the_fit_ended_beyond_a_parameters_limit() -> None:
    fit = identify(loops_of_the_normalised_model(skew_s=3e-3), model="normalized_bouc_wen")
    assert fit.values["sigma"] < model("normalized_bouc_wen").parameter("sigma").low
    assert named_first(fit) == "skew"


def test_a_drift_that_hides_in_the_scatter_from_cycle_to_cycle_is_named() -> None:
    def shown(number: int, share: np.ndarray, force_N: np.ndarray) -> np.ndarray:
        return np.asarray(force_N * (1.0 + 0.1 * share))

    masked = [replace(test, noise_N=10.0 * NOISE_N) for test in damper_tests(shown=shown)]
    fit = identify(masked)
    assert fit.adequate
    assert named_first(fit) == "force-drift"
    assert identify([replace(test, noise_N=10.0 * NOISE_N) for test in damper_tests()]).diagnosis == ()


def test_one_sample_that_lies_alone_is_an_outlier() -> None:
    tests = damper_tests(currents_A=(0.0, 1.0))
    force_N = tests[1].force_N.copy()
    force_N[101] += 900.0
    fit = identify([tests[0], replace(tests[1], force_N=force_N), *tests[2:]])
    assert fit.adequate is False
    assert named_first(fit) == "outliers"
    assert "samples, 1 in all)" in fit.diagnosis[0].text


def test_an_end_stop_is_a_shape_over_the_stroke_and_no_second_damper() -> None:
    stopped = []
    for test in damper_tests():
        beyond_m = np.maximum(np.abs(test.u_m) - 0.6 * AMPLITUDE_m, 0.0)
        stopped.append(replace(test, force_N=test.force_N + 2e9 * np.sign(test.u_m) * beyond_m**3))
    fit = identify(stopped)
    assert fit.adequate is False
    assert named_first(fit) == "stroke-shape"
