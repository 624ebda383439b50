"""From a recorded point to a measurement: what is kept, repaired, warned of, refused."""

from dataclasses import replace

import numpy as np
import pytest

from protocols.quality import Quality
from rig.dampers import parameter_set
from rig.errors import IdentificationFailed
from rig.identification import identify, prepare
from rig.identification.points.preparation import prepare_all
from rig.recording.quality.point_quality import PointQuality, TimeQuality
from rig.recording.recorded_point import ForceSamples, RecordedPoint
from rig.signals.cycles import NoCycles

DEMO = dict(parameter_set("demo").values)


def changed(point: RecordedPoint, **arrays: np.ndarray) -> RecordedPoint:
    """The point with other arrays; force samples follow the force."""
    copy = replace(point, arrays={**(point.arrays or {}), **arrays})
    if "force" not in arrays:
        copy.__dict__["force_samples"] = point.force_samples
    return copy


def with_force(point: RecordedPoint, force_N: np.ndarray, flags: np.ndarray | None = None) -> RecordedPoint:
    copy = replace(point)
    samples = point.force_samples
    copy.__dict__["force_samples"] = ForceSamples(samples.time_s, force_N, samples.flags if flags is None else flags)
    return copy


def test_eight_cycles_about_mid_stroke_with_the_noise_of_the_sensor(demo_points: list[RecordedPoint]) -> None:
    measurement = prepare(demo_points[1])
    assert measurement.u_m.size == pytest.approx(2000, abs=2)
    assert measurement.samples_per_cycle == 250
    assert np.mean(measurement.u_m) == pytest.approx(0.0, abs=2e-5)
    assert np.max(np.abs(measurement.v_m_s)) == pytest.approx(2.0 * np.pi * 0.05, rel=0.01)
    assert measurement.noise_N == pytest.approx(5.0, rel=0.1)
    assert measurement.warnings == ()
    assert np.ptp(measurement.current_A) == 0.0


def test_without_a_known_mid_stroke_the_mean_is_taken(demo_points: list[RecordedPoint]) -> None:
    measurement = prepare(changed(replace(demo_points[1], mid_stroke_m=None)))
    assert np.mean(measurement.u_m) == pytest.approx(0.0, abs=1e-6)


def test_flagged_and_lost_samples_do_not_count_and_time_stays_whole(demo_points: list[RecordedPoint]) -> None:
    point = demo_points[1]
    samples = point.force_samples
    keep = np.ones(samples.time_s.size, dtype=bool)
    keep[1000:1020] = False
    flags = samples.flags.copy()
    flags[1500:1505] = int(Quality.SPIKE)
    copy = replace(point)
    copy.__dict__["force_samples"] = ForceSamples(samples.time_s[keep], samples.force_N[keep], flags[keep])
    measurement = prepare(copy)
    whole = prepare(point)
    assert measurement.usable is not None
    assert np.count_nonzero(~measurement.usable) == 25
    assert measurement.dt_s == pytest.approx(whole.dt_s, rel=1e-6)
    assert measurement.u_m == pytest.approx(whole.u_m, abs=1e-6)


def test_a_saturated_force_is_left_out_where_it_stands_and_warned_of(demo_points: list[RecordedPoint]) -> None:
    whole = demo_points[4].force_samples.force_N
    limit_N = float(np.quantile(whole, 0.96))
    clipped = prepare(with_force(demo_points[4], np.minimum(whole, limit_N)))
    assert any(f"{limit_N:.1f} N" in text for text in clipped.warnings)
    assert clipped.usable is not None
    assert 0.02 < np.mean(~clipped.usable) < 0.2
    assert np.count_nonzero(clipped.force_N[clipped.usable] == limit_N) < 20
    points = [with_force(p, np.minimum(p.force_samples.force_N, limit_N)) for p in demo_points]
    fit = identify([p for p in points if p.current_A <= 1.0])
    for name in fit.identifiable:
        each = fit.parameters[name]
        assert each.simultaneous_low < DEMO[name] < each.simultaneous_high, name  # type: ignore[operator] - identifiable


def test_a_force_saturated_in_most_of_the_test_is_refused(demo_points: list[RecordedPoint]) -> None:
    force = np.minimum(demo_points[4].force_samples.force_N, 50.0)
    with pytest.raises(IdentificationFailed, match="saturated or missing, expected at most 20 %"):
        prepare(with_force(demo_points[4], force))


def test_a_missing_current_falls_back_on_the_commanded_one(demo_points: list[RecordedPoint]) -> None:
    point = changed(demo_points[4], current=np.full(demo_points[4].samples, np.nan))
    measurement = prepare(point)
    assert np.all(measurement.current_A == 1.0)
    assert any("no current was measured" in text for text in measurement.warnings)


def test_a_motion_that_fades_is_differentiated_locally(demo_points: list[RecordedPoint]) -> None:
    point = demo_points[1]
    fade = 1.0 - 0.004 * (point.time_s - point.time_s[0])
    measurement = prepare(changed(point, displacement=0.003 + (point.displacement_m - 0.003) * fade))
    assert any("does not repeat" in text for text in measurement.warnings)
    assert np.max(np.abs(measurement.v_m_s)) == pytest.approx(2.0 * np.pi * 0.05, rel=0.02)


def test_what_cannot_be_used_is_refused_by_name(demo_points: list[RecordedPoint]) -> None:
    point = demo_points[1]
    with pytest.raises(IdentificationFailed, match="recording is invalid \\(lost 12 samples\\)"):
        prepare(replace(point, verdict="invalid", reasons=("lost 12 samples",)))
    force = point.force_samples.force_N.copy()
    force[::3] = np.nan
    with pytest.raises(IdentificationFailed, match="33 % of the force samples"):
        prepare(with_force(point, force))
    with pytest.raises(IdentificationFailed, match="0 usable force samples"):
        prepare(with_force(point, np.full_like(force, np.nan)))
    with pytest.raises(NoCycles, match="usable displacement samples"):
        prepare(changed(point, displacement=np.full(point.samples, np.nan)))
    with pytest.raises(IdentificationFailed, match="no point can be used for identification: t1 not used"):
        prepare_all([replace(point, id="t1", verdict="invalid", reasons=("x",))])
    with pytest.raises(IdentificationFailed, match="contains no points"):
        prepare_all([])


def test_one_bad_point_does_not_keep_the_others_from_being_used(demo_points: list[RecordedPoint]) -> None:
    measurements, warnings = prepare_all(
        [demo_points[1], replace(demo_points[2], verdict="invalid", reasons=("tripped",))]
    )
    assert len(measurements) == 1
    assert warnings == [f"{demo_points[2].id} not used: the recording is invalid (tripped)"]


def test_two_cycles_are_used_whole_with_a_warning(
    demo_points: list[RecordedPoint],
) -> None:
    point = demo_points[0]
    inside = point.time_s < 0.5 + 2.0 * 3.2
    arrays = {name: values[inside] for name, values in (point.arrays or {}).items()}
    measurement = prepare(replace(point, arrays=arrays))
    assert any("no cycle was discarded" in text for text in measurement.warnings)
    assert measurement.u_m.size == pytest.approx(1000, abs=4)


@pytest.mark.parametrize("rate_Hz", [99.1, 100.0, 137.3, 400.0])
def test_the_single_cycle_left_of_three_holds_no_more_samples_than_there_are(rate_Hz: float) -> None:
    """Its length over the interval rounds to one sample more than there are, at some phases and rates."""
    for phase in np.linspace(0.15, 0.95, 12):
        time_s = np.arange(0.0, 3.9 / 0.92, 1.0 / rate_Hz)
        u_m = 0.02 * np.sin(2.0 * np.pi * (0.92 * time_s + phase))
        force_N = 400.0 * np.gradient(u_m, time_s)
        described = {"id": "p1", "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 0.92, "current_A": 0.0}
        point = RecordedPoint.from_arrays(time_s=time_s, displacement_m=u_m, force_N=force_N, **described)
        test = prepare(point)
        assert test.u_m.size - 1 <= test.samples_per_cycle <= test.u_m.size


@pytest.mark.parametrize("quality", [
    PointQuality(), PointQuality(time=TimeQuality("irregular", None, 1e-3, 2.9e-4, 2.9e-4)),
])
def test_a_rounding_of_the_times_that_repeats_every_cycle_is_no_motion_and_enters_the_errors(
    quality: PointQuality
) -> None:
    """At 400 Hz printed to a millisecond it lies in orders 99 and 101 of a 2 Hz sine: a third more speed."""
    random, t = np.random.default_rng(1), np.arange(0.0, 3.4, 1.0 / 400.0)
    phase = 4.0 * np.pi * t + 0.3
    u_m, v_m_s = 0.02 * np.sin(phase), 0.08 * np.pi * np.cos(phase)
    point = RecordedPoint.from_arrays(
        time_s=np.round(t, 3), displacement_m=u_m + random.normal(0.0, 1e-6, t.size), quality=quality, id="p",
        force_N=400.0 * v_m_s + 130.0 * np.tanh(50.0 * v_m_s) + random.normal(0.0, 0.5, t.size), waveform="sine",
        amplitude_m=0.02, frequency_Hz=2.0, current_A=0.0,
    )
    test = prepare(point)
    assert np.max(np.abs(test.v_m_s)) == pytest.approx(0.251, rel=0.01)
    assert any(warning.slug == "time-errors" for warning in test.warnings)
    assert (test.noise_N, test.skew_std_s) > (1.0, 1e-5)
    found = identify([test], diagnose=False).parameters["Ca_plus"]
    assert found.value == pytest.approx(400.0, abs=3.0 * (found.standard_error or 0.0))
    assert found.standard_error is not None
    assert found.standard_error < 10.0


def test_data_that_break_an_assumption_leave_out_their_own_test_only(
    demo_points: list[RecordedPoint], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(values: np.ndarray) -> float:
        raise np.linalg.LinAlgError("Singular matrix")

    good = prepare(demo_points[1])
    monkeypatch.setattr("rig.identification.points.preparation.quantisation_step", broken)
    with pytest.raises(IdentificationFailed, match="cannot be evaluated: LinAlgError: Singular matrix"):
        prepare(demo_points[1])
    monkeypatch.setattr("rig.identification.points.preparation._prepared", lambda point, skew: good if point.id == "p1"
                        else broken(point.time_s))  # fmt: skip
    kept, (warning,) = prepare_all([replace(demo_points[1], id="p1"), replace(demo_points[2], id="p2")])
    assert kept == [good]
    assert warning.startswith("p2 not used: it cannot be evaluated")


def test_a_drift_is_no_scatter_from_cycle_to_cycle(demo_points: list[RecordedPoint]) -> None:
    point = demo_points[1]
    samples = point.force_samples
    growing = 1.0 + 0.25 * np.linspace(0.0, 1.0, samples.time_s.size)
    noise_N = prepare(point).noise_N
    assert prepare(with_force(point, samples.force_N * growing)).noise_N == pytest.approx(1.1 * noise_N, rel=0.15)
    zero_N = 400.0 * np.linspace(0.0, 1.0, samples.time_s.size)
    assert prepare(with_force(point, samples.force_N + zero_N)).noise_N == pytest.approx(noise_N, rel=0.1)
