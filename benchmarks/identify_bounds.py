"""Bounds of `identify`: all models on a 20-point campaign, and judging six million samples.

    python benchmarks/identify_bounds.py             both
    python benchmarks/identify_bounds.py --samples 600000

Prints CPU time, and the largest resident memory with and without the recordings themselves; exits 1 beyond a limit
(10 s of CPU each; 500 MB).
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from campaign_process import machine

from rig.clock import utc_now
from rig.dampers import model, parameter_set
from rig.identification import Measurement, identify

CPU_S, MEMORY_MB = 10.0, 500.0
NOISE_N = 5.0


def recordings(rate_Hz: float, samples: int) -> list[Measurement]:
    """Twenty sines of the demo damper (five currents, four frequencies), so many samples together."""
    random, damper, values = np.random.default_rng(0), model("asymmetric"), parameter_set("demo").values
    tests = []
    for current_A in (0.0, 0.5, 1.0, 1.5, 2.0):
        for frequency_Hz in (0.5, 1.0, 1.5, 2.0):
            count, omega = samples // 20, 2.0 * np.pi * frequency_Hz
            phase = omega / rate_Hz * np.arange(count)
            u, v, a = 0.05 * np.sin(phase), 0.05 * omega * np.cos(phase), -0.05 * omega**2 * np.sin(phase)
            current = np.full(count, current_A)
            force = damper.force(values, u, v, a, current, 1.0 / rate_Hz)
            force += random.normal(0.0, NOISE_N, count)
            tests.append(Measurement(
                id=f"p{len(tests) + 1:03}", u_m=u, v_m_s=v, a_m_s2=a, force_N=force, current_A=current,
                dt_s=1.0 / rate_Hz, amplitude_m=0.05, frequency_Hz=frequency_Hz, nominal_current_A=current_A,
                noise_N=NOISE_N, samples_per_cycle=round(rate_Hz / frequency_Hz),
            ))  # fmt: skip
    return tests


def memory_MB(name: str) -> float:
    """`VmHWM` (largest since it was reset) or `VmRSS` of this process (MB)."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(status.split(f"{name}:")[1].split()[0]) * 1024e-6


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=6_000_000)
    given = parser.parse_args()
    print(f"{utc_now().date()}, {machine()}")
    tests = recordings(10_000.0, given.samples)
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before_MB, started = memory_MB("VmRSS"), time.process_time()
    fit = identify(tests)
    evaluated_s, peak_MB = time.process_time() - started, memory_MB("VmHWM")
    print(f"{given.samples} samples judged: {evaluated_s:.1f} s of CPU, {peak_MB:.0f} MB at the most, of which "
          f"{before_MB:.0f} MB before; adequate {fit.adequate}")  # fmt: skip
    del tests
    short, started = recordings(250.0, 40_000), time.process_time()
    best = identify(short, model="all")
    all_s = time.process_time() - started
    given_up = [each.model for each in best.selection if each.reason]
    print(f"all models on 20 points: {all_s:.1f} s of CPU; {best.model} of {len(best.selection)}; given up: {given_up}")
    return 0 if max(evaluated_s, all_s) <= CPU_S and peak_MB <= MEMORY_MB else 1


if __name__ == "__main__":
    sys.exit(main())
