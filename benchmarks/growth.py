"""How processor time and memory grow with the work: samples, points, currents, models, runs, a plan, a campaign.

    python benchmarks/growth.py                          every kind of work, as a table
    python benchmarks/growth.py --only report --only runs
    python benchmarks/growth.py --against FOLDER         also another checkout, in turns, on the same machine
    python benchmarks/growth.py --largest                the sizes that take minutes and gigabytes, too
    python benchmarks/growth.py --write                  write the table to docs/benchmarks.md

Each size is one command in a process of its own; its CPU time and largest resident memory are those that the kernel
counted for it. The smallest size tells what the command takes whatever it is about, and is taken off the others: the
exponent is the slope of log(CPU) over log(size) of what is left, fitted to all other sizes. 1 is proportional.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from campaign_process import machine
from many_runs import make as make_runs

from rig.clock import utc_now
from rig.dampers import model, parameter_set
from rig.results.run_index import NAME, SETTLED_NS

ROOT = Path(__file__).resolve().parent.parent
DOCUMENT = ROOT / "docs" / "benchmarks.md"
BEGIN, END = "<!-- growth.py begins -->", "<!-- growth.py ends -->"
RIG = "from rig.cli.main import run; run()"
COLUMNS = [f"--column={quantity}={quantity}:{unit}" for quantity, unit in (
    ("time", "s"), ("displacement", "mm"), ("force", "N"), ("current", "A"),
)]  # fmt: skip
RATE_Hz, CYCLES = 250.0, 10
HOURS_POINTS, LINES_OF_A_POINT = 120, 12
"""Of a campaign: points in an hour, lines of its journal for each."""


@dataclass(frozen=True)
class Cost:
    """CPU time (s), largest resident memory (MB), and what was written (MB) if that is part of the work."""

    cpu_s: float
    memory_MB: float
    written_MB: float = math.nan


@dataclass(frozen=True)
class Work:
    """One kind of work.

    Attributes:
        name: what a row of the table is called.
        unit: what the sizes count.
        sizes: growing; the first one tells what every size takes.
        command: makes the input of a size in the laboratory's folder, and gives the arguments of Python.
        larger: sizes of `--largest`.
        written: the file whose size is reported, in the folder of the input.
        remark: why it grows as it does, where it is not proportional.
        rival: whether pandas reads the same file, for comparison.
    """

    name: str
    unit: str
    sizes: tuple[int, ...]
    command: Callable[[Lab, int], list[str]]
    larger: tuple[int, ...] = ()
    written: Callable[[Lab, int], Path] | None = None
    remark: str = ""
    rival: bool = False


@dataclass
class Lab:
    """The inputs, each made once.

    Attributes:
        folder: in which they are.
        code: checkout that is measured.
    """

    folder: Path
    code: Path
    made: dict[str, Path] = field(default_factory=dict)

    def once(self, name: str, make: Callable[[Path], None]) -> Path:
        """A folder that was filled the first time it was named."""
        place = self.folder / name
        if name not in self.made:
            place.mkdir()
            make(place)
            self.made[name] = place
        return place

    def record(self, rows: int) -> Path:
        """A CSV file of one test at 1 kHz and 1 Hz."""
        return self.once(f"record-{rows}", lambda place: record(place / "record.csv", rows)) / "record.csv"

    def files(self, points: int, currents: int = 5) -> list[str]:
        """CSV files of tests of four frequencies and so many currents."""
        place = self.once(f"files-{points}-{currents}", lambda place: tests(place, points, currents))
        return sorted(map(str, place.glob("*.csv")))

    def run(self, points: int, currents: int = 5, *, fitted: bool = False) -> Path:
        """A run of these tests, made by the code that is measured; a fresh copy each time."""
        def fill(place: Path) -> None:
            self.rig("import", *self.files(points, currents), *COLUMNS, f"--out={place}")
            if fitted:
                self.rig("identify", str(next(place.iterdir())), "--model=asymmetric")

        name = f"{self.code.name}-run-{points}-{currents}{'-fitted' if fitted else ''}"
        return self.fresh(next(self.once(name, fill).iterdir()))

    def long_run(self, rows: int) -> Path:
        """A run of one test of so many rows; a fresh copy each time."""
        def fill(place: Path) -> None:
            self.rig("import", str(self.record(rows)), *COLUMNS, f"--out={place}")

        return self.fresh(next(self.once(f"{self.code.name}-long-{rows}", fill).iterdir()))

    def fresh(self, run: Path) -> Path:
        """A copy of a run, without what is kept beside its points."""
        copy = Path(tempfile.mkdtemp(prefix="copy-", dir=self.folder)) / run.name
        shutil.copytree(run, copy)
        shutil.rmtree(copy / "cache", ignore_errors=True)
        return copy

    def rig(self, *arguments: str) -> str:
        """What a command of the measured code printed."""
        return subprocess.run(
            [sys.executable, "-c", RIG, *arguments], cwd=self.folder, env=self.environment, check=True,
            stdout=subprocess.PIPE, text=True,
        ).stdout  # fmt: skip

    @property
    def environment(self) -> dict[str, str]:
        """In which this checkout's packages are found first."""
        return {**os.environ, "PYTHONPATH": str(self.code)}

    def cost(self, arguments: Sequence[str]) -> Cost:
        """What a process of Python takes.

        Raises:
            RuntimeError: it failed; with the end of what it said.
        """
        with tempfile.TemporaryFile("w+") as said:
            process = subprocess.Popen(
                [sys.executable, *arguments], cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL,
                stderr=said,
            )  # fmt: skip
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode not in {0, 5}:
                said.seek(0)
                raise RuntimeError(f"{' '.join(arguments)[:200]}: exit {process.returncode}\n{said.read()[-2000:]}")
        return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss * 1024e-6)


def record(file: Path, rows: int) -> None:
    """One test at 1 kHz, 20 mm, 1 Hz, 0.5 A, printed as usual."""
    write_test(file, np.arange(rows) / 1000.0, 20e-3, 1.0, 0.5, 3)


def tests(place: Path, points: int, currents: int) -> None:
    """Tests of ten cycles at 250 Hz: four frequencies, so many currents, amplitudes between 10 and 50 mm."""
    levels_A = np.linspace(0.0, 2.0, currents)
    amplitudes = -(-points // (4 * currents))
    for k in range(points):
        frequency_Hz = (0.5, 1.0, 1.5, 2.0)[k % 4]
        current_A = float(levels_A[k // 4 % currents])
        amplitude_m = 0.05 - 0.04 * (k // (4 * currents)) / max(1, amplitudes - 1)
        time_s = np.arange(int(RATE_Hz * CYCLES / frequency_Hz)) / RATE_Hz
        write_test(place / f"p{k:05d}.csv", time_s, amplitude_m, frequency_Hz, current_A, k)


def write_test(
    file: Path, time_s: np.ndarray, amplitude_m: float, frequency_Hz: float, current_A: float, seed: int
) -> None:
    """A test of the demo damper with noise, as CSV."""
    random, omega = np.random.default_rng(seed), 2.0 * np.pi * frequency_Hz
    damper, values, dt_s = model("asymmetric"), parameter_set("demo").values, float(time_s[1] - time_s[0])
    with file.open("w", encoding="ascii") as written:
        written.write("time,displacement,force,current\n")
        for start in range(0, time_s.size, 1_000_000):
            t = time_s[start : start + 1_000_000]
            u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
            current = np.full(t.size, current_A)
            force = damper.force(values, u, v, -(omega**2) * u, current, dt_s) + random.normal(0.0, 5.0, t.size)
            columns = (t, 1e3 * u + random.normal(0.0, 2e-3, t.size), force, current + random.normal(0.0, 2e-3, t.size))
            np.savetxt(written, np.column_stack(columns), fmt=("%.9g", "%.5f", "%.3f", "%.4f"), delimiter=",")


MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = {amplitudes}
frequency = ["0.5 Hz", "1 Hz"]
current = ["0 A", "0.5 A", "1 A", "1.5 A", "2 A"]
cycles = 10
[identify]
enabled = false
"""


def matrix(lab: Lab, points: int) -> Path:
    """A matrix file of so many points."""
    amplitudes = [f"{10.0 + 30.0 * k / (points // 10):.4g} mm" for k in range(points // 10)]
    place = lab.once(f"matrix-{points}", lambda _: None) / "matrix.toml"
    place.write_text(MATRIX.format(amplitudes=json.dumps(amplitudes)), encoding="utf-8")
    return place


def indexed(lab: Lab, runs: int, *, again: bool = True) -> Path:
    """A folder of so many runs with five points each; with its index unless the index is to be made."""
    def fill(place: Path) -> None:
        make_runs(place, runs, 5)
        time.sleep(1e-9 * SETTLED_NS + 0.1)

    place = lab.once(f"{lab.code.name}-many-{runs}", fill) / "runs"
    if again and not (place / NAME).exists():
        command = [sys.executable, "-c", INDEX, str(ROOT / "benchmarks"), str(place)]
        subprocess.run(command, env=lab.environment, check=True)
    if not again:
        (place / NAME).unlink(missing_ok=True)
    return place


INDEX = """
import sys
from pathlib import Path
sys.path.append(sys.argv[1])
from many_runs import summary
from rig.results.run_index import RunFilter, listed
listed(Path(sys.argv[2]), lambda place: {**summary(place), "planned": 5}, RunFilter())
"""
"""Fills the index without reading the points: 15 ms of CPU for each run, which another row tells."""
CAMPAIGN = """
import sys
from pathlib import Path
from rig.page.watched_run import WatchedRun
run = WatchedRun(Path(sys.argv[1]))
sizes = [len(repr(part)) for part in (run.description(), run.results(), run.state(), run.news())]
sys.stderr.write(f"{sizes}")
"""
RESUME = """
import sys
from pathlib import Path
from rig.campaign.confirmation import open_stops
from rig.recording.journal.campaign_log import CampaignLog
folder = Path(sys.argv[1])
stops = open_stops(folder)
CampaignLog(folder).close()
"""
"""What `rig run --resume` does with a journal: look for stops that were not confirmed, then open it to append."""
LAST = "import sys; from rig.campaign_folder import run_path; run_path(sys.argv[1])"
HISTORY = """
import sys
from pathlib import Path
from rig.page.history import History
history = History(Path(sys.argv[1]), simulated=False)
history.look()
history.look()
"""


def campaign_of(lab: Lab, hours: int) -> Path:
    """The folder of a campaign of so many hours that has ended: its journal, verdicts and events."""
    def fill(place: Path) -> None:
        (place / "points").mkdir()
        points = [f"p{k:05d}" for k in range(hours * HOURS_POINTS)]
        (place / "campaign.json").write_text(json.dumps({"id": place.name, "specimen": "MR-001", "points": points}))
        with (place / "journal.jsonl").open("w", encoding="utf-8") as journal:
            journal.write(json.dumps({"utc": "2026-01-01T00:00:00+00:00", "event": "connected"}) + "\n")
            for name in points:
                entry = {"utc": "2026-01-01T00:00:00+00:00", "event": "station", "what": "sent", "id": name}
                journal.writelines(json.dumps(entry) + "\n" for _ in range(LINES_OF_A_POINT - 2))
                journal.write(json.dumps({**entry, "event": "warning", "text": f"{name}: the room is warm"}) + "\n")
                judged = {"event": "judged", "verdict": "valid", "reasons": [], "file": f"points/{name}.h5"}
                journal.write(json.dumps({**entry, **judged, "peak_force_rebound_N": 1.0}) + "\n")

    return lab.once(f"campaign-{hours}", fill)


def report_of(lab: Lab, points: int) -> list[str]:
    """`rig report` of a fresh fitted run."""
    run = lab.run(points, fitted=True)
    lab.made[f"report-{points}"] = run / "report.html"
    return ["-c", RIG, "report", str(run)]


def report_again(lab: Lab, points: int) -> list[str]:
    """`rig report` of a run that was reported on before."""
    command = report_of(lab, points)
    lab.rig("report", command[-1])
    return command


WORKS = (
    Work("`rig import`, rows of one file", "rows", (1_000, 100_000, 1_000_000),
         lambda lab, n: ["-c", RIG, "import", str(lab.record(n)), *COLUMNS, f"--out={lab.folder / 'imported'}"],
         (10_000_000,), rival=True),
    Work("`rig import`, files", "files", (2, 20, 200),
         lambda lab, n: ["-c", RIG, "import", *lab.files(n), *COLUMNS, f"--out={lab.folder / 'imported'}"], (2_000,)),
    Work("`rig identify --model asymmetric`, rows of one test", "rows", (10_000, 100_000, 1_000_000),
         lambda lab, n: ["-c", RIG, "identify", str(lab.long_run(n)), "--model=asymmetric"], (10_000_000,)),
    Work("`rig identify` (five models), points", "points", (4, 20, 200),
         lambda lab, n: ["-c", RIG, "identify", str(lab.run(n))], (2_000,)),
    Work("`rig identify --model asymmetric`, points", "points", (4, 20, 200),
         lambda lab, n: ["-c", RIG, "identify", str(lab.run(n)), "--model=asymmetric"], (2_000,)),
    Work("`rig identify --model asymmetric`, currents of 100 points", "currents", (1, 5, 25),
         lambda lab, n: ["-c", RIG, "identify", str(lab.run(100, n)), "--model=asymmetric"]),
    Work("`rig identify`, models on 20 points", "models", (1, 5, 18),
         lambda lab, n: ["-c", RIG, "identify", str(lab.run(20)),
                         f"--model={ {1: 'asymmetric', 5: 'few', 18: 'all'}[n]}"],
         remark="the models differ; those with states are integrated"),
    Work("`rig report`, points", "points", (4, 20, 200), report_of, (2_000,),
         lambda lab, n: lab.made[f"report-{n}"]),
    Work("`rig report` again, points", "points", (4, 20, 200), report_again, (2_000,)),
    Work("`rig compare` of two runs, points of each", "points", (4, 20, 200),
         lambda lab, n: ["-c", RIG, "compare", str(lab.run(n)), str(lab.run(n))], (2_000,)),
    Work("`rig export --to csv`, points", "points", (4, 20, 200),
         lambda lab, n: ["-c", RIG, "export", str(lab.run(n)), "--to=csv", f"--out={tempfile.mkdtemp(dir=lab.folder)}"],
         (2_000,)),
    Work("`rig plan`, points", "points", (10, 50, 500, 5_000),
         lambda lab, n: ["-c", RIG, "plan", str(matrix(lab, n)),
                         f"--bench={ROOT / 'examples' / 'demo-bench.toml'}"]),
    Work("`rig runs --json` without its index", "runs", (10, 100, 500),
         lambda lab, n: ["-c", RIG, "runs", f"--in={indexed(lab, n, again=False)}", "--json"], (10_000,),
         remark="first use; five points of each run are opened"),
    Work("`rig runs --json`", "runs", (10, 100, 1_000, 10_000),
         lambda lab, n: ["-c", RIG, "runs", f"--in={indexed(lab, n)}", "--json"]),
    Work("`rig runs`", "runs", (10, 100, 1_000, 10_000), lambda lab, n: ["-c", RIG, "runs", f"--in={indexed(lab, n)}"]),
    Work("path of the last run", "runs", (10, 100, 1_000, 10_000),
         lambda lab, n: ["-c", LAST, str(indexed(lab, n) / "last")]),
    Work("history on the page, shown twice", "runs", (10, 100, 1_000, 10_000),
         lambda lab, n: ["-c", HISTORY, str(indexed(lab, n))]),
    Work("page of a finished campaign", "hours", (1, 5, 10, 20),
         lambda lab, n: ["-c", CAMPAIGN, str(campaign_of(lab, n))]),
    Work("journal of a campaign that is resumed", "hours", (1, 10, 100, 1_000),
         lambda lab, n: ["-c", RESUME, str(campaign_of(lab, n))], remark="1,440 lines per hour"),
)


def exponent(sizes: Sequence[int], values: Sequence[float]) -> float:
    """Slope of log(value) over log(size), the smallest size's value taken off; NaN where nothing grows measurably."""
    grown = [(size - sizes[0], value - values[0]) for size, value in zip(sizes[1:], values[1:], strict=True)]
    known = [(math.log(size), math.log(more)) for size, more in grown if more > 0.03]
    if len(known) < 2:
        return math.nan
    return float(np.polyfit(*zip(*known, strict=True), 1)[0])


def rows_of(work: Work, codes: Sequence[tuple[str, Lab]], sizes: Sequence[int], repeats: int) -> list[str]:
    """Rows of the table: one for each code, measured in turns."""
    costs: dict[str, list[Cost]] = {name: [] for name, _ in codes}
    for size in sizes:
        found: dict[str, list[Cost]] = {name: [] for name, _ in codes}
        for _ in range(repeats):
            for name, lab in codes:
                cost = lab.cost(work.command(lab, size))
                written = work.written(lab, size).stat().st_size * 1e-6 if work.written else math.nan
                found[name].append(Cost(cost.cpu_s, cost.memory_MB, written))
                for copy in lab.folder.glob("copy-*"):
                    shutil.rmtree(copy)
        for name, _ in codes:
            best = min(found[name], key=lambda cost: cost.cpu_s)
            costs[name].append(best)
            line = f"{work.name} [{name}] {size}: {best.cpu_s:.2f} s, {best.memory_MB:.0f} MB"
            print(line, file=sys.stderr, flush=True)
    shown = []
    for name, _ in codes:
        cpu = " / ".join(f"{cost.cpu_s:.2f}" for cost in costs[name])
        memory = " / ".join(f"{cost.memory_MB:.0f}" for cost in costs[name])
        slope = exponent(sizes, [cost.cpu_s for cost in costs[name]])
        grows = "-" if math.isnan(slope) else f"{slope:.2f}"
        remarks = [work.remark] if work.remark else []
        if work.written:
            remarks.append(f"file {' / '.join(f'{cost.written_MB:.1f}' for cost in costs[name])} MB")
        if work.rival and sizes[-1] >= 1_000_000:
            remarks.append(compared(codes[0][1], costs[name], sizes))
        which = f" ({name})" if len(codes) > 1 else ""
        shown.append(
            f"| {work.name}{which} | {' / '.join(f'{size:,}' for size in sizes)} {work.unit} | {cpu} | {grows} | "
            f"{memory} | {'; '.join(remarks)} |"
        )
    return shown


def compared(lab: Lab, costs: Sequence[Cost], sizes: Sequence[int]) -> str:
    """How many times the CPU of pandas reading the same file, in a process of its own and within one."""
    place = sizes.index(1_000_000)
    read = f"import pandas; pandas.read_csv({str(lab.record(1_000_000))!r})"
    alone = lab.cost(["-c", read]).cpu_s
    timed = f"import time, pandas; t = time.process_time(); {read}; print(time.process_time() - t)"
    said = subprocess.run([sys.executable, "-c", timed], check=True, stdout=subprocess.PIPE, text=True).stdout
    within = float(said)
    rows = costs[place].cpu_s - costs[0].cpu_s
    return (
        f"1,000,000 rows: {costs[place].cpu_s / alone:.1f} times a process that reads them with pandas "
        f"({alone:.2f} s); without the start of both {rows / within:.1f} times ({within:.2f} s)"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="work whose name contains this")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="another checkout, measured in alternation")
    parser.add_argument("--largest", action="store_true", help="also measure the largest sizes")
    parser.add_argument("--repeats", type=int, default=1, help="of each size; the best one counts")
    parser.add_argument("--write", action="store_true", help="write the table to docs/benchmarks.md")
    given = parser.parse_args()
    head = "| work | sizes | CPU, s | exponent | memory, MB | remark |\n|---|---|---|---|---|---|"
    rows = []
    with tempfile.TemporaryDirectory(prefix="growth-") as folder:
        codes = [("now", Lab(Path(folder) / "now", ROOT))]
        if given.against is not None:
            codes.insert(0, ("before", Lab(Path(folder) / "before", given.against.resolve())))
        for _, lab in codes:
            lab.folder.mkdir()
            lab.rig("report", str(lab.run(20, fitted=True)))  # compiles what is compiled once
        for work in WORKS:
            if not given.only or any(text in work.name for text in given.only):
                sizes = (*work.sizes, *(work.larger if given.largest else ()))
                rows += rows_of(work, codes, sizes, given.repeats)
    load = os.getloadavg()[0]
    table = "\n".join((f"{utc_now().date()}, {machine()}, load {load:.0f}.", "", head, *rows))
    print(table)
    if given.write:
        before, _, rest = DOCUMENT.read_text(encoding="utf-8").partition(BEGIN)
        after = rest.partition(END)[2]
        DOCUMENT.write_text(f"{before}{BEGIN}\n{table}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
