"""Random motion under a random voltage: fitted and scored on the end of the time, which no fit has seen."""

from dataclasses import replace

import numpy as np
import pytest

from rig.dampers import model
from rig.errors import IdentificationFailed
from rig.identification import identify
from rig.identification.points.preparation import prepare
from rig.identification.points.whole_record import cut_in_time, last_share
from rig.recording.recorded_point import RecordedPoint

RATE_HZ, SECONDS, ETA_1_S, NOISE_N = 1000.0, 12.0, 60.0, 5.0


def noise_up_to(top_Hz: float, seed: int) -> np.ndarray:
    """Random values of unit RMS whose spectrum ends at `top_Hz`."""
    count = int(SECONDS * RATE_HZ)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    rng = np.random.default_rng(seed)
    lines = (rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)) * (
        (frequency > 0.5) & (frequency < top_Hz)
    )
    values = np.fft.irfft(lines, count)
    return np.asarray(values / values.std())


def recorded(plant: str = "modified_bouc_wen") -> RecordedPoint:
    """A test on another plant than is fitted: a switched command that the coil follows at 60 1/s, sensor noise.

    The lag is integrated here, sample by sample, by its own formula.
    """
    time_s = np.arange(int(SECONDS * RATE_HZ)) / RATE_HZ
    u_m = 0.01 * noise_up_to(8.0, 1)
    v_m_s = np.gradient(u_m, time_s)
    command_A = np.where(noise_up_to(5.0, 2) > 0.0, 1.0, 0.1)
    coil_A, stays = np.empty_like(command_A), np.exp(-ETA_1_S / RATE_HZ)
    coil_A[0] = command_A[0]
    for k in range(1, command_A.size):
        coil_A[k] = command_A[k - 1] + (coil_A[k - 1] - command_A[k - 1]) * stays
    damper = model(plant)
    force_N = damper.force(damper.demonstration, u_m, v_m_s, np.gradient(v_m_s, time_s), coil_A, 1.0 / RATE_HZ)
    rng = np.random.default_rng(5)
    point = RecordedPoint.from_arrays(
        id="random", time_s=time_s, displacement_m=0.1 + u_m + rng.normal(0.0, 2e-6, u_m.size),
        force_N=force_N + rng.normal(0.0, NOISE_N, u_m.size), current_measured_A=np.full(u_m.size, np.nan),
        waveform="random", amplitude_m=0.03, frequency_Hz=4.0, current_A=0.5,
    )  # fmt: skip
    assert isinstance(point.arrays, dict)
    point.arrays["commanded_current"] = command_A
    return point


def test_the_unseen_end_of_a_random_test_is_forereported_and_the_lag_found() -> None:
    fit = identify([recorded()], model="thinning_bouc_wen", holdout="last 30 %")
    assert fit.holdout is not None
    assert fit.holdout.r_squared > 0.97
    assert fit.coil_eta_1_s == pytest.approx(ETA_1_S, rel=0.15)
    samples = fit.holdout.per_test[0].samples
    assert samples == pytest.approx(0.3 * (samples + fit.error.per_test[0].samples), abs=1)
    assert fit.to_json()["coil_eta_1_s"] == fit.coil_eta_1_s


def test_the_plant_itself_is_described_down_to_its_noise() -> None:
    fit = identify([recorded("asymmetric")], model="asymmetric", holdout="last 30 %")
    assert fit.holdout is not None
    assert fit.holdout.rmse_N < 3.0 * NOISE_N
    assert fit.values["Fyb"] == pytest.approx(model("asymmetric").demonstration["Fyb"], rel=0.05)


def test_no_measured_force_of_the_end_gets_into_the_fit() -> None:
    point = recorded("asymmetric")
    honest = identify([point], model="asymmetric", holdout="last 30 %")
    assert isinstance(point.arrays, dict)
    spoilt = point.arrays["force"].copy()
    spoilt[int(0.71 * spoilt.size) :] = 1e3 * np.sign(point.arrays["velocity"][int(0.71 * spoilt.size) :])
    changed = replace(point, arrays={**point.arrays, "force": spoilt})
    other = identify([changed], model="asymmetric", holdout="last 30 %")
    assert other.values == pytest.approx(honest.values)
    assert honest.holdout is not None
    assert other.holdout is not None
    assert other.holdout.rmse_N > 5.0 * honest.holdout.rmse_N


def test_the_end_of_a_test_is_scored_after_running_freely_through_its_beginning() -> None:
    whole = prepare(recorded())
    (beginning,), (end,) = cut_in_time([whole], 0.3)
    assert end.u_m.size == whole.u_m.size
    assert np.count_nonzero(end.scored) == whole.u_m.size - beginning.u_m.size
    assert not np.any(end.scored[: beginning.u_m.size])


def test_the_end_of_a_test_with_cycles_says_nothing_new_and_is_refused() -> None:
    time_s = np.arange(8000) / RATE_HZ
    u_m = 0.02 * np.sin(2.0 * np.pi * time_s)
    cyclic = RecordedPoint.from_arrays(
        id="sine", time_s=time_s, displacement_m=u_m, force_N=500.0 * np.gradient(u_m, time_s), waveform="sine",
        amplitude_m=0.02, frequency_Hz=1.0, current_A=0.5,
    )  # fmt: skip
    with pytest.raises(IdentificationFailed, match="sine repeats its beginning"):
        identify([cyclic], holdout="last 30 %")


def test_a_share_of_the_time_is_read_and_an_absurd_one_refused() -> None:
    assert last_share("last 30 %") == pytest.approx(0.3)
    assert last_share(" last 12.5%") == pytest.approx(0.125)
    assert last_share("frequency_Hz=2") is None
    with pytest.raises(IdentificationFailed, match="1 to 90 %"):
        last_share("last 99 %")
