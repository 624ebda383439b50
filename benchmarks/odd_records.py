"""Records that are short, rounded, jittered, damaged or hold several motions, from import to export.

    python benchmarks/odd_records.py --records 2000
    python benchmarks/odd_records.py --first 37 --records 1 --show

Each record is a damper with known damping, sampled and printed as test programs do, with what goes wrong: 2 to 12
cycles, any rate, time stamps of few digits, jitter, missing cells, rows and stretches, doubled rows, rests, coarse
position or force, several motions or a sweep in one file. Seeds from 3000 on also have single spikes, a clipped or
drifting force, and files written as laboratories do: decimal commas, a preamble, a row of units, a byte order mark,
text columns, Windows line ends, empty lines at the end. It goes through import, identify, report, compare and export
in this process. Counted: what is no error of ours (a traceback for a user) or a warning of numpy, and wrong damping: a
value of a valid test without any remark that misses the truth by more than three stated standard deviations and 2 %.
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from campaign_process import machine

from rig.clock import utc_now
from rig.comparison import compare
from rig.errors import RigError
from rig.export import export
from rig.identification import identify_run
from rig.recording.importing import import_tests
from rig.recording.run import Run
from rig.report import write_report

COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
EXPORTS = ("csv", "json", "c", "table")
ERRORS, SHARE = 3.0, 0.02
T = TypeVar("T")


@dataclass(frozen=True)
class Damper:
    """F = f0 + c v + fy tanh(beta v) + k u, in SI."""

    f0: float
    c: float
    fy: float
    beta: float
    k: float

    def force_N(self, u_m: np.ndarray, v_m_s: np.ndarray) -> np.ndarray:
        """Force (n,) of a motion (n,)."""
        return self.f0 + self.c * v_m_s + self.fy * np.tanh(self.beta * v_m_s) + self.k * u_m

    def equivalent(self, amplitude_m: float, frequency_Hz: float) -> float:
        """Equivalent damping E / (pi omega X^2) of a sine, N s/m."""
        omega = math.tau * frequency_Hz
        v = amplitude_m * omega * np.cos(math.tau * np.arange(4000) / 4000)
        energy_J = float(np.mean(self.force_N(np.zeros(4000), v) * v)) / frequency_Hz
        return energy_J / (math.pi * omega * amplitude_m**2)


@dataclass
class Record:
    """A file's columns, what is true of it, and what was done to it."""

    time_s: np.ndarray
    x_mm: np.ndarray
    force_N: np.ndarray
    damper: Damper
    motions: list[tuple[float, float]]
    digits: int = 6
    traits: list[str] = field(default_factory=list)
    written: frozenset[str] = frozenset()

    def write(self, file: Path) -> None:
        """As CSV; NaN as an empty cell."""
        comma = "decimal comma" in self.written
        sign, decimal = (";", ",") if comma else (",", ".")
        text = ["ok"] if "text column" in self.written else []
        rows = zip(self.time_s.tolist(), self.x_mm.tolist(), self.force_N.tolist(), strict=True)
        lines = [sign.join(("t_s", "x_mm", "F_N", *(["state"] if text else [])))]
        if "row of units" in self.written:
            lines.append(sign.join(("s", "mm", "N", *(["-"] if text else []))))
        if "preamble" in self.written:
            lines = ["Damper test", "Operator: N.N.", "Date: 2026-03-04", "", *lines]
        for t, x, f in rows:
            cells = (f"{t:.{self.digits}f}", "" if math.isnan(x) else f"{x:.5f}", "" if math.isnan(f) else f"{f:.3f}")
            lines.append(sign.join((*(cell.replace(".", decimal) for cell in cells), *text)))
        lines += ["", ""] * ("empty lines" in self.written)
        end = "\r\n" if "Windows line ends" in self.written else "\n"
        encoding = "utf-8-sig" if "byte order mark" in self.written else "utf-8"
        file.write_bytes((end.join(lines) + end).encode(encoding))


@dataclass
class _Played:
    """A motion on a grid eight times as fine as the samples, its pieces' sizes, and what is special about it."""

    rate_Hz: float
    slowest_m_s: float
    u_m: np.ndarray = field(default_factory=lambda: np.zeros(0))
    motions: list[tuple[float, float]] = field(default_factory=list)
    traits: list[str] = field(default_factory=list)


FINER = 8
MORE_KINDS_FROM = 3000
"""Seeds from which records have more kinds of damage; those below stay what they were."""
WRITTEN = (
    "decimal comma", "text column", "row of units", "preamble", "empty lines", "Windows line ends", "byte order mark",
)


def drawn(seed: int) -> Record:
    """The record of a seed."""
    random = np.random.default_rng((seed, 37))
    played = _played(random)
    damper = Damper(  # its knee lies within every test's speeds: a tanh that is a straight line there shows no damping
        random.uniform(-50.0, 50.0), 10.0 ** random.uniform(2.0, 3.3), random.uniform(20.0, 400.0),
        random.uniform(4.0, 30.0) / played.slowest_m_s, random.uniform(0.0, 2000.0),
    )
    record = _sampled(played, damper, random)
    if seed >= MORE_KINDS_FROM:
        record = _of_more_kinds(record, np.random.default_rng((seed, 38)))
    return _damaged(record, random)


def _played(random: np.random.Generator) -> _Played:
    """One to five motions, perhaps with ramps or rests, or a sweep."""
    count = int(random.integers(2, 6)) if random.random() < 0.25 else 1
    frequencies = random.choice([0.3, 0.5, 0.92, 1.0, 1.3, 2.0, 3.0, 5.0], count)
    amplitudes = 1e-3 * random.uniform(3.0, 40.0, count)
    amplitudes = amplitudes if random.random() < 0.5 else np.full(count, amplitudes[0])
    rate_Hz = 10.0 ** random.uniform(1.5, 2.7) * float(np.max(frequencies))
    rate_Hz = float(random.choice([rate_Hz, max(20.0, round(rate_Hz, -1)), round(rate_Hz)]))
    played = _Played(rate_Hz, float(np.min(math.tau * frequencies * amplitudes)))
    if count > 1:
        played.traits.append("several motions")
    for frequency_Hz, amplitude_m in zip(frequencies.tolist(), amplitudes.tolist(), strict=True):
        most = 5 if random.random() < 0.7 else 12
        cycles = int(random.integers(2, most + 1)) + (random.uniform(0.0, 1.0) if count == 1 else 0.0)
        t = np.arange(round(FINER * rate_Hz * cycles / frequency_Hz)) / (FINER * rate_Hz)
        phase = math.tau * frequency_Hz * t + (random.uniform(0.0, math.tau) if count == 1 else 0.0)
        if count == 1 and random.random() < 0.1:
            played.traits.append("sweep")
            phase = math.tau * frequency_Hz * (t + t**2 / t[-1])
        piece = amplitude_m * np.sin(phase)
        if count == 1 and random.random() < 0.3:
            played.traits.append("ramps")
            piece *= np.clip(t * frequency_Hz, 0.0, 1.0) * np.clip((t[-1] - t) * frequency_Hz, 0.0, 1.0)
        played.u_m = np.concatenate((played.u_m, piece))
        played.motions.append((amplitude_m, frequency_Hz))
        if random.random() < 0.15:
            played.traits.append("rest")
            rest = np.full(round(FINER * rate_Hz * random.uniform(0.2, 3.0)), piece[-1])
            played.u_m = np.concatenate((played.u_m, rest))
    return played


def _sampled(played: _Played, damper: Damper, random: np.random.Generator) -> Record:
    """The motion and the damper's force as sensors and a printing program give them."""
    rate_Hz, traits, u_fine = played.rate_Hz, played.traits, played.u_m
    fine_s = np.arange(u_fine.size) / (FINER * rate_Hz)
    force_fine = damper.force_N(u_fine, np.gradient(u_fine, 1.0 / (FINER * rate_Hz)))
    true_s = stamps_s = np.arange(0.0, fine_s[-1], 1.0 / rate_Hz)
    if random.random() < 0.15:
        moved_s = np.sort(true_s + random.normal(0.0, random.uniform(0.02, 0.3) / rate_Hz, true_s.size))
        if random.random() < 0.5:
            traits.append("jittered stamps")
            stamps_s = moved_s
        else:
            traits.append("jittered samples")
            true_s = stamps_s = np.clip(moved_s, 0.0, fine_s[-1])
    digits = 6
    if random.random() < 0.5:
        digits = int(random.choice([2, 3, 3, 3, 4]))
        traits.append(f"{digits} digits")
    u, force = np.interp(true_s, fine_s, u_fine), np.interp(true_s, fine_s, force_fine)
    x_mm = 1e3 * u + random.normal(0.0, 10.0 ** random.uniform(-3.0, -1.5), u.size)
    force = force + random.normal(0.0, float(np.ptp(force)) * 10.0 ** random.uniform(-4.0, -2.0), u.size)
    if random.random() < 0.2:
        step = float(np.ptp(x_mm)) * 10.0 ** random.uniform(-3.5, -2.0)
        x_mm = step * np.round(x_mm / step)
        traits.append("coarse position")
    if random.random() < 0.2:
        step = float(np.ptp(force)) * 10.0 ** random.uniform(-3.5, -2.0)
        force = step * np.round(force / step)
        traits.append("coarse force")
    stamps_s = stamps_s - stamps_s[0] + float(random.choice([0.0, 0.0, 3.217, 1000.5]))
    return Record(stamps_s, x_mm + random.uniform(-30.0, 30.0), force, damper, played.motions, digits, traits)


def _damaged(record: Record, random: np.random.Generator) -> Record:
    """The record with cells and rows missing, doubled or standing still."""
    size = record.time_s.size
    kept = np.ones(size, bool)
    if random.random() < 0.15:
        record.traits.append("empty cells")
        record.force_N[random.random(size) < random.uniform(0.0, 0.03)] = np.nan
        record.x_mm[random.random(size) < random.uniform(0.0, 0.03)] = np.nan
    if random.random() < 0.1:
        record.traits.append("standing")
        first = int(random.integers(0, size))
        column = record.force_N if random.random() < 0.5 else record.x_mm
        column[first : first + int(random.integers(1, max(2, size // 5)))] = column[first]
    if random.random() < 0.1:
        record.traits.append("missing rows")
        kept &= random.random(size) > random.uniform(0.0, 0.02)
    if random.random() < 0.1:
        record.traits.append("dropout")
        first = int(random.integers(0, size))
        kept[first : first + int(random.integers(1, max(2, size // 6)))] = False
    rows = np.flatnonzero(kept)
    if random.random() < 0.05:
        record.traits.append("doubled row")
        rows = np.sort(np.append(rows, random.choice(rows)))
    record.time_s, record.x_mm, record.force_N = (each[rows] for each in (record.time_s, record.x_mm, record.force_N))
    return record


def _of_more_kinds(record: Record, random: np.random.Generator) -> Record:
    """The record with spikes, a clipped or drifting force, and written in another way."""
    span_N = float(np.nanmax(record.force_N) - np.nanmin(record.force_N))
    if random.random() < 0.2:
        record.traits.append("drift")
        record.force_N = record.force_N + np.linspace(0.0, random.uniform(-0.3, 0.3) * span_N, record.force_N.size)
    if random.random() < 0.2:
        record.traits.append("clipped")
        middle = float(np.nanmean(record.force_N))
        record.force_N = np.minimum(record.force_N, middle + random.uniform(0.3, 0.49) * span_N)
    if random.random() < 0.3:
        record.traits.append("spike")
        column = record.force_N if random.random() < 0.5 else record.x_mm
        span = float(np.nanmax(column) - np.nanmin(column))
        at = random.integers(0, column.size, random.integers(1, 4))
        column[at] += random.choice((-1.0, 1.0)) * span * 10.0 ** random.uniform(-1.0, 1.0)
    record.written = frozenset(name for name in WRITTEN if random.random() < 0.25)
    record.traits += sorted(record.written)
    return record


@dataclass
class Outcome:
    """What became of a record: how far it came, and what must not be."""

    seed: int
    traits: list[str]
    ended: str = "through"
    crashes: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)
    compared: int = 0
    fitted: int = 0


def outcome_of(seed: int, folder: Path) -> Outcome:
    """One record, from import to export."""
    record = drawn(seed)
    outcome = Outcome(seed, record.traits)
    file = folder / f"r{seed}.csv"
    record.write(file)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = _tried(outcome, "import", lambda: import_tests([file], columns=COLUMNS, out=folder, current_A=0.0))
        if run is None:
            return outcome
        fit = _tried(outcome, "identify", lambda: identify_run([run]))
        _tried(outcome, "report", lambda: write_report(run))
        _tried(outcome, "compare", lambda: compare([run, run]).to_json())
        for kind in EXPORTS:
            _tried(outcome, f"export {kind}", lambda kind=kind: export(run, kind, folder / "out"))
    _check_standard_tests(outcome, run, record)
    if fit is not None and not fit.warnings:
        for name in ("Ca_plus", "Ca_minus"):
            each = fit.parameters[name]
            if each.identifiable and each.value is not None:
                outcome.fitted += 1
                _check(outcome, f"fitted {name}", each.value, each.standard_error, record.damper.c)
    return outcome


def _tried(outcome: Outcome, what: str, step: Callable[[], T]) -> T | None:
    """What a step gives; None where it refuses, or raises what a user would see as a traceback."""
    try:
        return step()
    except RigError as error:
        if outcome.ended == "through":
            outcome.ended = f"{what}: {str(error).splitlines()[0]}"
    except Exception:  # noqa: BLE001 - what is counted here
        outcome.crashes.append(f"{what}\n" + traceback.format_exc(limit=-4))
    return None


def _check_standard_tests(outcome: Outcome, run: Path, record: Record) -> None:
    """Compare the equivalent damping of each valid test without a remark with the truth."""
    file = run / "characteristics.json"
    if not file.is_file():
        return
    entry = json.loads(file.read_text(encoding="utf-8"))
    remarked = [line.partition(":")[0] for line in (*entry["left_out"], *entry["remarks"])]
    points = {point.id: point for point in Run.open(run).points}
    for loop in entry["loops"]:
        point = points[loop["id"]]
        damping, motion = loop["equivalent_damping_N_s_m"], point.quality.motion
        if point.verdict != "valid" or point.id in remarked or damping["value"] is None:
            continue
        outcome.compared += 1
        measured = (motion.amplitude_m or math.nan, motion.frequency_Hz or math.nan)
        nearest = min(record.motions, key=lambda one: sum(
            abs(math.log(true / found)) for true, found in zip(one, measured, strict=True)
        ))
        true = record.damper.equivalent(*(measured if "sweep" in record.traits else nearest))
        _check(outcome, f"{point.id} standard test", damping["value"], damping["std"], true)


def _check(outcome: Outcome, what: str, value: float, std: float | None, true: float) -> None:
    left = abs(value - true)
    if left > SHARE * abs(true) and left > ERRORS * (std or 0.0):
        outcome.wrong.append(f"{what}: {value:.4g} +- {std or 0.0:.2g}, true {true:.4g} ({100 * left / true:.1f} %)")


def main() -> None:
    """Draw, run and count."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--records", type=int, default=200)
    arguments.add_argument("--first", type=int, default=0, help="first seed")
    arguments.add_argument("--show", action="store_true", help="every record")
    chosen = arguments.parse_args()
    begun, ended = time.monotonic(), Counter[str]()
    crashed: list[Outcome] = []
    wrong: list[Outcome] = []
    compared = fitted = 0
    for seed in range(chosen.first, chosen.first + chosen.records):
        with tempfile.TemporaryDirectory(prefix="odd-records-") as folder:
            outcome = outcome_of(seed, Path(folder))
        ended[outcome.ended.split(":")[0]] += 1
        compared, fitted = compared + outcome.compared, fitted + outcome.fitted
        if outcome.crashes:
            crashed.append(outcome)
        if outcome.wrong:
            wrong.append(outcome)
        if chosen.show or outcome.crashes or outcome.wrong:
            print(seed, outcome.traits, outcome.ended, *outcome.crashes, *outcome.wrong, sep="\n  ", flush=True)
    print(f"\n{utc_now():%Y-%m-%d}, {machine()}\n")
    print("| records | through | import refuses | no fit | standard tests | fitted values | tracebacks | wrong | s |")
    print("|---|---|---|---|---|---|---|---|---|")
    print(
        f"| {chosen.records} | {ended['through']} | {ended['import']} | {ended['identify']} | {compared} | {fitted} | "
        f"{len(crashed)} | {len(wrong)} | {time.monotonic() - begun:.0f} |"
    )


if __name__ == "__main__":
    main()
