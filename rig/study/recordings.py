"""The recordings a study searches over: measurements from runs, or synthetic ones whose truth is known."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rig.dampers import model, parameter_set
from rig.errors import FileProblem
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.points.preparation import prepare_all
from rig.recording.run import Run, Selection
from rig.study.study_file import Data
from rig.test_point import LOOP

TABLE1_CURRENT_A = (0.0, 0.5, 1.0, 1.5, 2.0)
TABLE1_FREQUENCY_HZ = (0.5, 1.0, 1.5, 2.0)
TABLE1_AMPLITUDE_M = 0.05
TABLE1_SAMPLE_RATE_HZ = 250.0
KEPT_CYCLES = 8


PAPER2_FREQUENCY_HZ = 1.0
PAPER2_AMPLITUDE_M = 0.025
PAPER2_SAMPLE_RATE_HZ = 1000.0
PAPER2_CYCLES = 4

BOUC_WEN_TRUTH = {
    "c0": 800.0, "c0_b": 400.0, "k0": 2000.0, "x0": 0.01, "alpha": 20_000.0, "alpha_b": 60_000.0,
    "gamma": 4.0e4, "beta": 4.0e4, "A": 40.0, "n": 2.0,
}  # fmt: skip
"""A Bouc-Wen damper of the size of paper 2's, affine in the current, for studies without recordings."""


def table1(truth: str, noise_N: float, seed: int) -> list[Measurement]:
    """The tests of paper 1's Table 1, synthesised: 5 currents x 4 frequencies, 50 mm, 250 Hz, 8 kept cycles each.

    Args:
        truth: Name of a parameter set of the asymmetric model.
        noise_N: Standard deviation of the white force noise.
        seed: Seed of the noise.

    Returns:
        20 measurements, 41,665 samples together.
    """
    rng = np.random.default_rng(seed)
    values = parameter_set(truth)
    damper = model(values.model, values.hysteresis)
    tests = []
    for current_A in TABLE1_CURRENT_A:
        for frequency_Hz in TABLE1_FREQUENCY_HZ:
            motion = _sine(TABLE1_AMPLITUDE_M, frequency_Hz, TABLE1_SAMPLE_RATE_HZ, KEPT_CYCLES)
            force_N = damper.force(values.values, *motion, current_A, 1.0 / TABLE1_SAMPLE_RATE_HZ)
            noisy_N = force_N + rng.normal(0.0, noise_N, len(force_N))
            tests.append(_measurement(motion, noisy_N, current_A, frequency_Hz, TABLE1_SAMPLE_RATE_HZ))
    return tests


def bouc_wen(currents_A: Sequence[float], noise_N: float, seed: int) -> list[Measurement]:
    """Tests of a Bouc-Wen damper at constant currents: 25 mm, 1 Hz, 1 kHz, 4 cycles after one that settles the loop.

    Args:
        currents_A: One test each, A.
        noise_N: Standard deviation of the white force noise.
        seed: Seed of the noise.

    Returns:
        One measurement for each current, 4,000 samples each.
    """
    rng = np.random.default_rng(seed)
    damper = model("bouc_wen")
    tests = []
    for current_A in currents_A:
        motion = _sine(PAPER2_AMPLITUDE_M, PAPER2_FREQUENCY_HZ, PAPER2_SAMPLE_RATE_HZ, PAPER2_CYCLES + 1)
        force_N = damper.force(BOUC_WEN_TRUTH, *motion, current_A, 1.0 / PAPER2_SAMPLE_RATE_HZ)
        settled = round(PAPER2_SAMPLE_RATE_HZ / PAPER2_FREQUENCY_HZ)
        kept = tuple(channel[settled:] for channel in motion)
        noisy_N = force_N[settled:] + rng.normal(0.0, noise_N, len(force_N) - settled)
        tests.append(_measurement(kept, noisy_N, current_A, PAPER2_FREQUENCY_HZ, PAPER2_SAMPLE_RATE_HZ))
    return tests


def measurements(data: Data, seed: int, currents_A: Sequence[float] = ()) -> tuple[list[Measurement], list[str]]:
    """The recordings a study file names.

    Args:
        data: The file's section.
        seed: Seed of the noise of synthetic recordings.
        currents_A: Currents of synthetic Bouc-Wen tests.

    Returns:
        One measurement for each test, and one line for each recorded point that was left out.

    Raises:
        FileProblem: A run cannot be read, or no point fits the filter.
        IdentificationFailed: No point that fits can be used.
    """
    if data.simulate == "table1":
        return table1(data.truth, data.noise_N, seed), []
    if data.simulate == "bouc_wen":
        return bouc_wen(currents_A or TABLE1_CURRENT_A, data.noise_N, seed), []
    return _recorded(data)


def one_a_current(tests: Sequence[Measurement], currents_A: Sequence[float]) -> dict[float, Measurement]:
    """The test of each current, for a study that fits one loop a current.

    Args:
        tests: At constant currents.
        currents_A: Wanted, A.

    Returns:
        Current -> its test.

    Raises:
        FileProblem: There is no test at a current, or more than one.
    """
    problems, chosen, levels = [], {}, set_of(tests).currents
    for current_A in currents_A:
        level = levels.named(current_A)
        there = [] if level is None else [tests[number] for number in levels.members(level)]
        if len(there) == 1:
            chosen[current_A] = there[0]
        elif there:
            names = ", ".join(f"{test.id} ({test.amplitude_m:g} m, {test.frequency_Hz:.4g} Hz)" for test in there)
            problems.append(
                f"{current_A:g} A: {len(there)} tests ({names}), expected one. Fix: choose a test with `select` in "
                '[per_current.data], such as select = "frequency_Hz=1"'
            )
        else:
            known = ", ".join(f"{name_A:g} A" for name_A in levels.names_A)
            problems.append(f"{current_A:g} A: no test at this current; the tested currents are {known}")
    if problems:
        raise FileProblem("[per_current] current", problems)
    return chosen


def content_hash(tests: Sequence[Measurement]) -> str:
    """Hash of what the objective sees, so that results of other recordings are not taken for these.

    Args:
        tests: The measurements.

    Returns:
        Eight hexadecimal digits.
    """
    checksum = 0
    for test in tests:
        sampling = np.array([test.dt_s, test.samples_per_cycle])
        for channel in (test.u_m, test.v_m_s, test.a_m_s2, test.force_N, test.current_A, test.scored, sampling):
            checksum = zlib.crc32(np.ascontiguousarray(channel).tobytes(), checksum)
    return f"{checksum:08x}"


def _recorded(data: Data) -> tuple[list[Measurement], list[str]]:
    runs = [Run.open(Path(folder)) for folder in data.runs]
    specimens = {str(run.campaign["specimen"]) for run in runs if run.campaign.get("specimen") is not None}
    if len(specimens) > 1:
        raise FileProblem(
            "[data] runs", [f"got specimens {', '.join(sorted(specimens))}, expected one: a study describes one damper"]
        )
    fitting = [point for run in runs for point in (run.select(data.select) if data.select else run.points)]
    if not fitting:
        every = [point for run in runs for point in run.points]
        values_text = f"; {Selection.parse(data.select).values_of(every)}" if data.select else ""
        raise FileProblem("[data] select", [f"{data.select!r} matches none of the "
                                            f"{len(every)} points of "
                                            f"{', '.join(data.runs)}{values_text}"])  # fmt: skip
    loops = [point for point in fitting if point.kind == LOOP]
    if not loops:
        raise FileProblem("[data] runs", [f"none of the {len(fitting)} points contains loops; expected at least one"])
    left_out = [line for run in runs for line in run.unreadable]
    left_out += [
        f"{point.id} not used: {point.verdict} ({'; '.join(point.reasons)})"
        for point in loops
        if point.verdict != "valid"
    ]
    points = [point for point in loops if point.verdict == "valid"]
    if not points:
        raise FileProblem("[data] runs", [f"no point is valid: {'; '.join(left_out)}"])
    tests, refused = prepare_all(points)
    return tests, [*left_out, *refused]


def _sine(
    amplitude_m: float, frequency_Hz: float, rate_Hz: float, cycles: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    count = round(cycles / frequency_Hz * rate_Hz)
    omega = 2.0 * np.pi * frequency_Hz
    phase = omega * (np.arange(count) / rate_Hz + 1.0 / frequency_Hz)
    u_m = amplitude_m * np.sin(phase)
    return u_m, omega * amplitude_m * np.cos(phase), -(omega**2) * u_m


def _measurement(
    motion: tuple[np.ndarray, ...], force_N: np.ndarray, current_A: float, frequency_Hz: float, rate_Hz: float
) -> Measurement:
    u_m, v_m_s, a_m_s2 = motion
    return Measurement(
        id=f"{frequency_Hz:g} Hz {current_A:g} A",
        u_m=u_m,
        v_m_s=v_m_s,
        a_m_s2=a_m_s2,
        force_N=force_N,
        current_A=np.full(len(u_m), current_A),
        dt_s=1.0 / rate_Hz,
        amplitude_m=float(np.max(np.abs(u_m))),
        frequency_Hz=frequency_Hz,
        nominal_current_A=current_A,
        samples_per_cycle=round(rate_Hz / frequency_Hz),
    )
