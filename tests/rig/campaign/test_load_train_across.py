"""The watch over the load train at weak settings, beside sensors that stand still, and from one point to the next."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.ring import Channel
from rig import dampers
from rig.campaign.execution.observer import LoadTrainWatch
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE

RATE_HZ = 250.0
OVERSAMPLED = 8
RAMPS = 2
REST_S = 3.0
SET = dampers.parameter_set("demo")
DAMPER = dampers.model(SET.model)
Values = NDArray[np.float64]


@dataclass
class Bench:
    """A default damper in a joint with `play_m`; its sensors have the simulated rig's noise and resolution."""

    seed: int
    resolution_N: float = 0.05
    play_m: float = 0.0
    plain: bool = False
    """A damper of friction and viscosity in place of the default one."""
    held: dict[Channel, int] = field(default_factory=dict)
    """Sensors whose value stands from that sample of the next program on."""
    time_s: float = 0.0
    pulses: int = 0

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)

    def program(
        self, amplitude_m: float, frequency_Hz: float, current_A: float, cycles: int = 10, *, triangle: bool = False
    ) -> NDArray[Any]:
        """Records of one program with a ramp at either end, from the change of the current on."""
        whole = cycles + RAMPS
        t_s = np.arange(int(whole / frequency_Hz * RATE_HZ) * OVERSAMPLED) / (RATE_HZ * OVERSAMPLED)
        phase = t_s * frequency_Hz
        # Samples never meet the cycle's beginning exactly.
        shape = np.sin(2 * np.pi * phase + 0.01)
        shape = np.arcsin(shape) / (0.5 * np.pi) if triangle else shape
        x_m = amplitude_m * np.clip(np.minimum(phase, whole - phase), 0.0, 1.0) * shape
        force_N = self._force(x_m, current_A)
        samples = {Channel.FORCE: force_N + 5.0 * self.random.standard_normal(len(t_s))}
        samples[Channel.DISPLACEMENT] = x_m + 5e-6 * self.random.standard_normal(len(t_s))
        steps = {Channel.FORCE: self.resolution_N, Channel.DISPLACEMENT: 1e-6}
        parts = [self._records(np.array([-2.0]), current_A, Channel.COMMANDED_CURRENT, np.array([0]))]
        parts.append(self._records(np.arange(-1.0, t_s[-1], 0.01), current_A, Channel.COIL_CURRENT, np.array([0])))
        for channel, values in samples.items():
            taken = np.round(values[::OVERSAMPLED] / steps[channel]) * steps[channel]
            taken[self.held.get(channel, len(taken)) :] = taken[self.held.get(channel, 0)]
            parts.append(self._records(t_s[::OVERSAMPLED], taken, channel, np.arange(len(taken))))
        pulse = self.pulses + np.arange(whole + 1)
        for channel in (Channel.FORCE_EDGE, Channel.DISPLACEMENT_EDGE, Channel.PULSE):
            parts.append(self._records(np.arange(whole + 1) / frequency_Hz, pulse % 65536, channel, pulse))
        self.pulses += len(pulse)
        self.time_s += t_s[-1] + REST_S
        records = np.concatenate(parts)
        return records[np.argsort(records["host_ns"], kind="stable")]

    def _force(self, x_m: Values, current_A: float) -> Values:
        """Force (N) of the damper behind the joint; none while it is crossed."""
        u_m, half_m, at_m = x_m.copy(), 0.5 * self.play_m, 0.0
        for i, rod_m in enumerate(x_m.tolist() if self.play_m else []):
            at_m = min(max(at_m, rod_m - half_m), rod_m + half_m)
            u_m[i] = at_m
        dt_s = 1.0 / (RATE_HZ * OVERSAMPLED)
        v_m_s = np.gradient(u_m, dt_s)
        a_m_s2 = np.clip(np.gradient(v_m_s, dt_s), -60.0, 60.0)
        if self.plain:
            force_N = (1.0 + current_A) * (300.0 * np.tanh(v_m_s / 0.01) + 500.0 * v_m_s)
            return np.where((np.abs(x_m - u_m) < 0.999 * half_m) & (v_m_s == 0.0), 0.0, force_N)
        currents = np.full(len(x_m), current_A)
        force_N = np.asarray(DAMPER.force(SET.values, u_m, v_m_s, a_m_s2, currents, dt_s))
        crossed = (np.abs(x_m - u_m) < 0.999 * half_m) & (v_m_s == 0.0)
        return np.where(crossed, 0.0, force_N)

    def _records(self, t_s: Values, values: Any, channel: Channel, count: NDArray[Any]) -> NDArray[Any]:  # noqa: ANN401
        records = np.zeros(len(t_s), RECORD_DTYPE)
        us = np.round(1e6 * (self.time_s + REST_S + t_s)).astype(np.int64)
        records["host_ns"], records["device_us"], records["value"] = 1000 * us, us, values
        records["sequence"], records["channel"] = count, channel
        if channel == Channel.COMMANDED_CURRENT:
            records["device_us"] = -1
        return records


def watched(watch: LoadTrainWatch, records: NDArray[Any], chunk: int = 60) -> str | None:
    watch.begin()
    causes = (watch.watch(RecordBlock(records[at : at + chunk])) for at in range(0, len(records), chunk))
    return next((change for change in causes if change is not None), None)


WEAK = tuple(itertools.product((0.5, 1.0, 2.0, 5.0), (0.4, 1.0, 5.0), (0.0, 0.5, 2.0)))


@pytest.mark.parametrize(("amplitude_mm", "frequency_Hz", "current_A"), WEAK)
def test_a_weak_motion_is_no_loose_joint(amplitude_mm: float, frequency_Hz: float, current_A: float) -> None:
    for seed in range(3):
        records = Bench(seed).program(1e-3 * amplitude_mm, frequency_Hz, current_A, 6)
        assert watched(LoadTrainWatch(), records) is None


def test_a_coarse_load_cell_is_no_loose_joint() -> None:
    for seed, amplitude_m in itertools.product(range(3), (2e-3, 20e-3)):
        assert watched(LoadTrainWatch(), Bench(seed, resolution_N=20.0).program(amplitude_m, 1.0, 0.5)) is None


def test_points_in_any_order_of_currents_and_motions_are_no_loose_joint() -> None:
    settings = list(itertools.product((1e-3, 5e-3, 20e-3), (0.5, 2.0), (0.0, 1.0, 2.0)))
    for seed in range(2):
        watch, bench = LoadTrainWatch(), Bench(seed)
        for at in bench.random.permutation(len(settings)).tolist():
            assert watched(watch, bench.program(*settings[at], cycles=5)) is None, settings[at]


@pytest.mark.parametrize("triangle", [False, True])
def test_a_program_that_is_run_again_is_no_loose_joint(triangle: bool) -> None:
    for seed, amplitude_m, frequency_Hz in itertools.product(range(2), (2e-3, 8e-3), (1.0, 3.0)):
        watch, bench = LoadTrainWatch(), Bench(seed)
        for _ in range(3):
            assert watched(watch, bench.program(amplitude_m, frequency_Hz, 1.0, 5, triangle=triangle)) is None


@pytest.mark.parametrize("channel", [Channel.FORCE, Channel.DISPLACEMENT])
@pytest.mark.parametrize("frequency_Hz", [0.2, 1.0])
def test_a_sensor_that_stalls_is_not_the_load_train(channel: Channel, frequency_Hz: float) -> None:
    for sample in (4.3, 4.9, 5.6):
        bench = Bench(1, held={channel: round(sample / frequency_Hz * RATE_HZ)})
        assert watched(LoadTrainWatch(), bench.program(2e-3, frequency_Hz, 0.5, 8)) is None


@pytest.mark.parametrize(("before_A", "after_A"), [(0.5, 1.5), (2.0, 0.0), (0.0, 1.0)])
def test_a_joint_that_came_loose_before_a_point_at_a_new_current_is_seen_in_its_first_cycles(
    before_A: float, after_A: float
) -> None:
    watch, bench = LoadTrainWatch(), Bench(2, plain=True)
    assert watched(watch, bench.program(20e-3, 1.0, before_A, 6)) is None
    bench.play_m = 2e-3
    begun_s = bench.time_s + REST_S
    records = bench.program(20e-3, 1.0, after_A, 10)
    seen = str(watched(watch, records[records["device_us"] < 1e6 * (begun_s + 4.1)]))
    assert re.search(r"at zero over 1\.\d mm .* 0 mm", seen), seen


def test_a_joint_that_lets_go_of_the_damper_between_points_is_seen_at_a_stronger_one() -> None:
    watch, bench = LoadTrainWatch(), Bench(3)
    assert watched(watch, bench.program(5e-3, 1.0, 0.5, 6)) is None
    bench.play_m = 50e-3
    cause = watched(watch, bench.program(5e-3, 1.0, 1.0, 6))
    assert cause is not None
    assert "mean force" in cause
