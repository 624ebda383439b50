"""Preparation of long tests and of many: CPU and memory of each stage, each in a fresh process.

    python benchmarks/preparation.py                 a million rows: noise only, hundreds of harmonics; 200 points
    python benchmarks/preparation.py --only triangle

A test of a million rows is 1,000 cycles of 1 Hz at 1 kHz, imported from CSV: `sine` with 5 um of noise, `triangle` with
rounded corners (150 harmonics), `digits` without noise, printed with six digits (200 harmonics of rounding). `points`
are 200 tests of ten cycles at 250 Hz. The damper is the demo damper at its true parameters, with 5 N of noise; how far
the fitted parameters are from the true ones in standard errors is printed too.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from campaign_process import machine

from rig.clock import utc_now
from rig.dampers import model, parameter_set
from rig.recording.importing import import_tests

RIG = (sys.executable, "-m", "rig.cli.main")
NOISE_N, NOISE_M, STEEPNESS = 5.0, 5e-6, 0.98
COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N", "current": "I_A"}
CPU_S = {"asymmetric": 4.0, "default": 8.0, "points": 10.0}
MEMORY_MB = 400.0
STAGE = """
import resource, sys, time
began = time.process_time()
def stage(name):
    global began
    peak_MB = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"  {name:28} {time.process_time() - began:6.2f} s {peak_MB:6.0f} MB")
    began = time.process_time()
from rig.identification import identify
from rig.identification.points.inputs import fit_inputs
from rig.identification.points.preparation import _usable_cycles, prepare
from rig.recording.run import Run
stage("interpreter and imports")
run = Run.open(sys.argv[1])
for point in run.points:
    point.time_s, point.displacement_m, point.force_samples, point.current_measured_A
stage("recordings read")
for point in run.points:
    _usable_cycles(point)
stage("cycles (again in the next)")
tests = [prepare(point) for point in run.points]
stage("prepared")
tests = fit_inputs(tests, None, ()).fitted
stage("mean cycles")
fit = identify(tests, model="asymmetric")
stage("fit, errors, diagnosis")
from rig.dampers import parameter_set
true = parameter_set("demo").values
known = {name: one for name, one in fit.parameters.items() if one.standard_error}
off = {name: (one.value - true[name]) / one.standard_error for name, one in known.items()}
print("  from the truth (standard errors): " + ", ".join(f"{name} {value:+.1f}" for name, value in off.items()))
"""


def write(
    path: Path, seconds: float, rate_Hz: float, kind: str, motion: tuple[float, float, float], seed: int = 1
) -> None:
    """A CSV file of one test: amplitude (m), frequency (Hz) and current (A); its noise is that of the seed."""
    amplitude_m, frequency_Hz, current_A = motion
    random, time_s = np.random.default_rng(seed), np.arange(round(seconds * rate_Hz)) / rate_Hz
    omega = 2.0 * np.pi * frequency_Hz
    sine, cosine = np.sin(omega * time_s), np.cos(omega * time_s)
    u, v, a = amplitude_m * sine, amplitude_m * omega * cosine, -amplitude_m * omega**2 * sine
    if kind == "triangle":
        scale, root = amplitude_m / np.arcsin(STEEPNESS), np.sqrt(1.0 - (STEEPNESS * sine) ** 2)
        u, v = scale * np.arcsin(STEEPNESS * sine), scale * STEEPNESS * omega * cosine / root
        a = -scale * STEEPNESS * omega**2 * sine * (1.0 - STEEPNESS**2) / root**3
    force = model("asymmetric").force(
        parameter_set("demo").values, u, v, a, np.full(time_s.size, current_A), 1.0 / rate_Hz
    )
    force += random.normal(0.0, NOISE_N, time_s.size)
    measured_m = u if kind == "digits" else u + random.normal(0.0, NOISE_M, time_s.size)
    columns = (time_s, 1e3 * measured_m, force, current_A + random.normal(0.0, 2e-3, time_s.size))
    np.savetxt(path, np.column_stack(columns), ["%.4f", "%.6g" if kind == "digits" else "%.4f", "%.1f", "%.4f"],
               delimiter=",", header=",".join(COLUMNS.values()), comments="")  # fmt: skip


def imported(kind: str, folder: Path) -> Path:
    """The run of one kind of test."""
    files = folder / kind
    files.mkdir()
    if kind == "points":
        frequencies_Hz = np.linspace(0.25, 2.5, 10).tolist()
        motions = [(u, f, i) for i in np.linspace(0.0, 2.0, 10).tolist() for f in frequencies_Hz for u in (0.01, 0.02)]
        for number, motion in enumerate(motions):
            write(files / f"t{number:03}.csv", 10.1 / motion[1], 250.0, "sine", motion, number)
    else:
        write(files / "long.csv", 1000.0, 1000.0, kind, (0.02, 1.0, 0.5))
    began_s = time.process_time()
    run = import_tests(sorted(files.glob("*.csv")), columns=COLUMNS, out=folder / f"run-{kind}")
    print(f"  {'imported':28} {time.process_time() - began_s:6.2f} s", flush=True)
    return run


def spent(*command: str) -> tuple[float, float]:
    """CPU (s) and peak memory (MB) of a command."""
    code = (
        "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, capture_output=True); "
        "used = resource.getrusage(resource.RUSAGE_CHILDREN); "
        "print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024.0)"
    )
    answer = subprocess.run([sys.executable, "-c", code, *command], check=True, capture_output=True, text=True)
    cpu_s, peak_MB = map(float, answer.stdout.split())
    return cpu_s, peak_MB


def main() -> int:
    kinds = ("sine", "triangle", "digits", "points")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=kinds)
    given = parser.parse_args()
    print(f"{utc_now().date()}, {machine()}")
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        for kind in (given.only,) if given.only else kinds:
            print(kind, flush=True)
            run = imported(kind, Path(folder))
            subprocess.run([sys.executable, "-c", STAGE, str(run)], check=True)
            for name, options in (("asymmetric", ["--model", "asymmetric"]), ("default", [])):
                shutil.rmtree(run / "cache", ignore_errors=True)  # what the commands before stored there
                cpu_s, peak_MB = spent(*RIG, "identify", *options, str(run))
                goal_s = CPU_S["points" if kind == "points" else name]
                print(f"  rig identify, {name:14} {cpu_s:6.2f} s {peak_MB:6.0f} MB (goal {goal_s:g} s)")
                missed += cpu_s > goal_s or (name == "asymmetric" and peak_MB > MEMORY_MB)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
