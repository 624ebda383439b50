#!/usr/bin/env python3
"""One entry for a fresh machine: makes .venv, installs the project, runs it. Needs only Python 3.11+.

python3 dev.py demo            the whole story on the simulated rig
python3 dev.py test            every check of a change: static ones, tests, a wheel installed elsewhere
python3 dev.py nightly         all tests: the long searches and every case too, of which `test` runs some
python3 dev.py test tests/rig  some of the tests only
python3 dev.py faults          the fault suite: every row of the matrix in virtual time, some on real processes
python3 dev.py faults --rows   only the rows: exit code, first cause, times, 0 A, standstill and pressure in truth
python3 dev.py faults --mutate [SLUG...]   each detector switched off: its test must fail
python3 dev.py scenarios [--seeds FIRST:END]   whole campaigns in virtual time, drawn from seeds, with checks
python3 dev.py scenarios --planted [NAME...]   planted bugs are searched for in random scenarios (hours)
python3 dev.py coverage        branch coverage of all tests, processes they start included (slower than `test`)
python3 dev.py docs [--out DIR]   the documentation as a site, in site/
python3 dev.py pictures        the pictures in README.md again (wants chromium)
python3 dev.py release [--out DIR]   wheel and sdist, in dist/, both tried in an empty environment
python3 dev.py rig ...         any `rig` command
python3 dev.py install         set up only
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import venv
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import IO

ROOT = Path(__file__).resolve().parent
VENV = ROOT / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
MEALPY = "mealpy==3.0.3"  # asks for numpy 1 and works with 2: installed without what it asks for
PACKAGES = ["rig", "drivers", "protocols", "simulators"]
BRANCHES = {
    "protocols": ("tests/protocols tests/drivers/test_demo_controller.py tests/drivers/test_demo_ecu.py "
                  "tests/drivers/test_devices.py", 95),
    "rig.dampers": ("tests/rig/dampers", 92),
}
"""Package -> its own tests, and the least share of its branches (%) that they take: 100 is what is wanted, and was so
before files of users' formats and the newest models; to be raised, never lowered."""
COMPILED = [
    "rig/identification/models/kernels.py",
    "simulators/frames.py", "simulators/conditioner.py", "simulators/plant/step.py", "simulators/plant/motion.py",
]  # run as machine code, which coverage does not see
LEAST_COVERAGE = 95
UNSWEPT_MYPY = "import gc, mypy.__main__ as mypy; gc.disable(); gc.enable = gc.disable; mypy.console_entry()"
"""mypy without the garbage collector, which it switches on again: 13 of 47 s of processor time, for 0.8 GB more."""
COMMANDS = (
    "demo", "test", "nightly", "faults", "scenarios", "coverage", "rig", "install", "docs", "pictures", "release",
)
OPTIONAL = ("files", "pdf")
TESTED = (*OPTIONAL, "test")
EXTRAS = {
    "demo": (), "release": (), "rig": OPTIONAL, "scenarios": OPTIONAL, "test": (*TESTED, "peers"),
    "nightly": (*TESTED, "peers"),
}
"""Command -> extras of pyproject.toml that it needs; the others need `TESTED`."""
TRIMMED = {
    "tests": ("greenlet", "h5py", "llvmlite", "numba", "numpy", "pandas", "scipy"),
    "__pycache__": ("pip", "pkg_resources", "setuptools"),
}
"""Folders that are removed from these packages: their own tests (80 MB) and the bytecode of the installer (13 MB)."""
SIDE_BY_SIDE = 2
"""Processes among which the tests without real processes and wires are divided."""


def program(name: str) -> str:
    """Path of a program inside the project's own environment."""
    return str(BIN / (name + (".exe" if os.name == "nt" else "")))


def run(*command: str, cwd: Path = ROOT, output: IO[str] | None = None, **environment: str) -> int:
    """Run a command with its output shown, or told to a file, and with these variables set; return its exit code."""
    errors = None if output is None else subprocess.STDOUT
    return subprocess.call(command, cwd=cwd, env={**os.environ, **environment}, stdout=output, stderr=errors)


def install(*extras: str) -> None:
    """Make .venv and install the project with these extras into it, again after a change of pyproject.toml.

    With `peers` also the libraries our algorithms are tested against, Dask, and a NeXus validator; where those cannot
    be had, their tests say that they were skipped.
    """
    declared = hashlib.sha256((ROOT / "pyproject.toml").read_bytes()).hexdigest()
    stamp = VENV / "installed"
    of, *present = stamp.read_text().split() if stamp.exists() else [""]
    if of != declared:
        present = []
    elif set(extras) <= set(present):
        return
    if not (VENV / "pyvenv.cfg").exists():
        progress("creating .venv")
        started = time.monotonic()
        venv.create(VENV, with_pip=True)
        progress(f"created .venv in {time.monotonic() - started:.0f} s", end="\n")
    requested = [extra for extra in extras if extra != "peers"]
    if code := pip("-e", f".[{','.join(requested)}]" if requested else "."):
        sys.exit(f"dev.py: installation failed (pip exit {code}); its message is above")
    others = (("-e", ".[peers,cluster]"), ("--no-deps", MEALPY), ("-e", ".[nexus]"))
    if "peers" in extras and sum(pip(*packages) != 0 for packages in others):
        print("dev.py: not all peers could be installed; the tests against them will be skipped", flush=True)
    trim()
    stamp.write_text(" ".join([declared, *sorted({*present, *extras})]))


def trim() -> None:
    """Remove what is not needed at run time from the largest packages."""
    for folder, packages in TRIMMED.items():
        for package in packages:
            for place in VENV.glob(f"[Ll]ib/python*/site-packages/{package}"):
                for found in [path for path in place.rglob(folder) if path.is_dir()]:
                    shutil.rmtree(found, ignore_errors=True)


def pip(*packages: str) -> int:
    """Run `pip install` with a line of progress; pip's exit code. What pip wrote is shown if it failed.

    Modules are compiled when they are first imported: compiling all of them takes longer than the rest, and 230 MB.
    """
    command = [
        program("python"), "-m", "pip", "install", "--disable-pip-version-check", "--progress-bar=off", "--no-compile",
    ]
    started, shown_s, collected, installs, written = time.monotonic(), 0.0, 0, False, []
    with subprocess.Popen([*command, *packages], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                          errors="replace") as running:
        for line in running.stdout or ():
            written.append(line)
            collected += line.startswith("Collecting ")
            elapsed_s, begins = time.monotonic() - started, line.startswith("Installing collected packages")
            installs |= begins
            if begins or elapsed_s - shown_s >= (0.2 if sys.stdout.isatty() else 15.0):
                doing = f"installing {collected}" if installs else f"resolving dependencies: {collected}"
                progress(f"{doing} packages, {elapsed_s:.0f} s")
                shown_s = elapsed_s
    code = running.returncode
    elapsed_s = time.monotonic() - started
    progress(f"{' '.join(packages)} {'installed' if code == 0 else 'NOT installed'}, {elapsed_s:.0f} s", end="\n")
    if code:
        print("".join(written[-20:]), end="", flush=True)
    return code


def progress(text: str, end: str = "") -> None:
    """Show a line of progress: on a terminal in place of the one before."""
    if sys.stdout.isatty():
        print(f"\r\033[Kdev.py: {text}", end=end, flush=True)
    else:
        print(f"dev.py: {text}", flush=True)


def wheel_smoke_test(output: IO[str]) -> int:
    """Build the wheel, unpack it into a folder elsewhere, import the four packages from there."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        build = run(
            program("python"), "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps",
            "--wheel-dir", str(place), str(ROOT), output=output,
        )
        if build != 0:
            return build
        (wheel,) = place.glob("*.whl")
        target = place / "site"
        shutil.unpack_archive(wheel, target, "zip")
        return run(program("python"), "-P", "-c", imports_from(target), cwd=place, output=output)


def imports_from(site: Path) -> str:
    """A program that imports the four packages from this folder, with their data files."""
    return (
        f"import sys; from pathlib import Path; site = {str(site)!r}; sys.path.insert(0, site)\n"
        "import rig, drivers, protocols, simulators\n"
        "for package in (rig, drivers, protocols, simulators):\n"
        "    folder = Path(package.__file__).resolve().parent\n"
        "    assert folder.is_relative_to(Path(site).resolve()) and (folder / 'py.typed').exists(), folder\n"
        "import rig.cli.main, simulators.__main__\n"
        "from drivers.register_maps.map_file import controller\n"
        "from drivers.devices.source import current_source\n"
        "controller('demo'), current_source('demo')\n"
    )


def release(arguments: list[str]) -> int:
    """Build the sdist, from it the wheel, and try both in an empty environment; both are put into dist/.

    The wheel is tried as its user would: installed with its dependencies, it plans, runs and reports a campaign on the
    simulated rig in an empty folder. The sdist is then installed in its place, and identifies the same run.
    """
    out = Path(arguments[1]).resolve() if arguments[:1] == ["--out"] and len(arguments) == 2 else ROOT / "dist"
    if arguments and out == ROOT / "dist":
        print("dev.py: usage: release [--out DIR]")
        return 2
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        built = place / "built"
        if code := pip("build>=1.2") or run(program("python"), "-m", "build", "--outdir", str(built), str(ROOT)):
            return code
        (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
        environment, empty = place / "environment", place / "empty"
        empty.mkdir()
        progress(f"testing {wheel.name} in an empty environment", end="\n")
        venv.create(environment, with_pip=True)
        scripts = environment / BIN.name
        python, rig = str(scripts / Path(program("python")).name), str(scripts / Path(program("rig")).name)
        (site,) = environment.glob("[Ll]ib/python*/site-packages")
        steps = (
            (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-compile", str(wheel)),
            (python, "-P", "-c", imports_from(site)),
            (rig, "--version"),
            (rig, "demo"),
            (rig, "report", "last"),
            (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-compile", "--no-deps",
             "--force-reinstall", str(sdist)),
            (python, "-P", "-c", imports_from(site)),
            (rig, "identify", "last", "--model", "asymmetric"),
        )
        for step in steps:
            if code := run(*step, cwd=empty):
                print(f"dev.py: FAILED (exit {code}): {' '.join(step)}")
                return code
        out.mkdir(parents=True, exist_ok=True)
        for file in (sdist, wheel):
            shutil.copy2(file, out)
            print(f"dev.py: {out / file.name}, {hashlib.sha256(file.read_bytes()).hexdigest()}")
    return 0


def checks(arguments: list[str]) -> int:
    """Run all checks, or only the named tests; the first failing check decides the exit code.

    Types and wheel are checked beside the first tests.
    """
    if arguments:
        return run(program("python"), "-m", "pytest", *arguments)
    packages = [*PACKAGES, "tests", "docs", "examples", "README.md", "CHANGELOG.md"]
    static = {
        "ruff": (program("ruff"), "check", "."),
        "codespell": (program("codespell"), *packages),
        "import-linter": (program("lint-imports"), "--no-cache"),
    }
    started, spent_s = time.perf_counter(), processor_s()
    with ThreadPoolExecutor(SIDE_BY_SIDE) as pool:
        codes = [pool.submit(checked, name, partial(run, *command)) for name, command in static.items()]
    tests_started = time.perf_counter()
    code = max((future.result() for future in codes), key=abs) or beside_tests()
    ended, spent_s = time.perf_counter(), processor_s() - spent_s
    print("dev.py: all checks passed" if code == 0 else f"dev.py: FAILED (exit {code})", end=", ")
    print(f"tests {ended - tests_started:.0f} s, all {ended - started:.0f} s", end=", ")
    print(f"processor time {spent_s:.0f} s", flush=True)
    return code


def processor_s() -> float:
    """Processor time (s), user and system, of the processes that have been started and have ended."""
    spent = os.times()
    return spent.children_user + spent.children_system


def beside_tests() -> int:
    """All tests by day, and beside them what waits for nothing. Returns the first exit code that is not 0."""
    with ThreadPoolExecutor(1) as beside:
        types = beside.submit(checked, "mypy", partial(run, program("python"), "-c", UNSWEPT_MYPY))
        wheel = beside.submit(checked, "wheel smoke test", wheel_smoke_test)
        return all_tests("--short") or types.result() or wheel.result()


def nightly() -> int:
    """All tests, and the branches that packages' own tests take."""
    branches = [
        checked(f"branches of {package} by {tests}", partial(branches_taken, package, tests, least))
        for package, (tests, least) in BRANCHES.items()
    ]
    return max([*branches, all_tests()], key=abs)


def checked(name: str, work: Callable[..., int]) -> int:
    """Run a check and show what it says in one piece when it ends. Returns its exit code."""
    started = time.perf_counter()
    with tempfile.TemporaryFile("w+") as output_file:
        code = work(output=output_file)
        output_file.seek(0)
        end = "ok" if code == 0 else f"FAILED (exit {code})"
        print(f"{output_file.read()}dev.py: {name} {end}, {time.perf_counter() - started:.0f} s", flush=True)
    return code


def all_tests(*options: str) -> int:
    """Run what waits for nothing real in several processes, then alone what needs real processes and wires.

    The names of all tests that failed are shown at the end. Returns the first exit code that is not 0. Options are
    those of pytest, `--short` for all but the nightly ones.
    """
    with tempfile.TemporaryDirectory() as name:
        failures = Path(name) / "failures"
        code = side_by_side([program("python"), "-m", "pytest", "tests", f"--failures={failures}", *options])
        if failures.exists() and failures.read_text(encoding="utf-8"):
            print(f"dev.py: these tests failed:\n{failures.read_text(encoding='utf-8')}", end="", flush=True)
    return code


def side_by_side(command: list[str]) -> int:
    """Run pytest's command in several processes, each of which takes the next tests that are free.

    The others begin when the first one has collected, and find all test files compiled. When the others run none that
    looks at a clock any more, the first one runs the tests on real processes and wires. Its output is shown at once,
    the others' when all have ended. Returns the first exit code that is not 0.
    """
    import fcntl  # not on Windows, where the rest of this file works

    with tempfile.TemporaryDirectory() as name, ExitStack() as files:
        folder = Path(name)
        # A cache would know only what one of them saw.
        command = [*command, f"--shared={folder}", "-p", "no:cacheprovider"]
        outputs = [files.enter_context(tempfile.TemporaryFile("w+")) for _ in range(SIDE_BY_SIDE - 1)]
        locks = [files.enter_context((folder / "others").open("w")) for _ in outputs]
        for lock in locks:
            fcntl.flock(lock, fcntl.LOCK_SH)
        running = [subprocess.Popen([*command, "--then-wires"], cwd=ROOT)]
        try:
            while not (folder / "collected").exists() and running[0].poll() is None:
                time.sleep(0.1)
            for output_file, lock in zip(outputs, locks, strict=True):
                running.append(subprocess.Popen(
                    [*command, "-m", "not wire", f"--lock={lock.fileno()}"], cwd=ROOT, pass_fds=[lock.fileno()],
                    stdout=output_file, stderr=subprocess.STDOUT,
                ))
                lock.close()
            codes = [process.wait() for process in reversed(running)]
        finally:
            for process in running:
                process.terminate()
        for output_file in outputs:
            output_file.seek(0)
            print(output_file.read(), flush=True)
    return next((code for code in codes if code), 0)


def branches_taken(package: str, tests: str, least: int, output: IO[str]) -> int:
    """Run a package's own tests; fail unless they take so many of its branches (%). Compiled kernels run as Python."""
    with tempfile.TemporaryDirectory() as folder:
        return run(
            program("python"), "-m", "pytest", *tests.split(), "-q", f"--cov={package}", f"--cov-fail-under={least}",
            "--cov-report=term-missing:skip-covered", "-p", "no:cacheprovider", output=output, NUMBA_DISABLE_JIT="1",
            COVERAGE_FILE=str(Path(folder) / "coverage"),
        )


def coverage() -> int:
    """Measure branch coverage of the whole suite, of the processes it starts too; compiled kernels are left out."""
    measure = program("coverage")
    run(measure, "erase")
    code = run(measure, "run", "-m", "pytest", "-q")
    run(measure, "combine", "--quiet")
    least, left_out = f"--fail-under={LEAST_COVERAGE}", f"--omit={','.join(COMPILED)}"
    return run(measure, "report", "--sort=cover", "--skip-covered", least, left_out) or code


def faults(arguments: list[str]) -> int:
    """Run the fault suite and the injectors' own tests, the rows' scenarios alone, or the mutation check."""
    if arguments[:1] == ["--mutate"]:
        return run(program("python"), "tests/faults/mutation.py", *arguments[1:])
    if arguments[:1] == ["--rows"]:
        rows = [program("python"), "-m", "pytest", "tests/faults/test_every_row.py", "-v", "--durations=5"]
        return side_by_side([*rows, *arguments[1:]])
    return run(
        program("python"), "-m", "pytest", "tests/faults", "tests/simulators/test_faults.py", "-q", *arguments
    )


def main(arguments: list[str]) -> int:
    """Dispatch the command named first."""
    if sys.version_info < (3, 11):  # noqa: UP036 - this file is what tells an older Python so
        sys.exit(f"dev.py: needs Python 3.11 or newer, this is {sys.version.split()[0]}")
    command, rest = (arguments[0], arguments[1:]) if arguments else ("help", [])
    command = "scenarios" if command == "worlds" else command  # its name until 2.0
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # each process would compile all modules again: 8 s for the tests'
    if command == "clean":
        shutil.rmtree(VENV, ignore_errors=True)
        return 0
    if command not in COMMANDS:
        print(__doc__)
        return 0 if command in {"help", "-h", "--help"} else 2
    install(*EXTRAS.get(command, TESTED))
    if command == "scenarios" and "--planted" in rest:
        rest.remove("--planted")
        script = "tests/simulators/scenarios/planted/planted_search.py"
        return run(program("python"), script, *rest, PYTHONPATH=str(ROOT / "tests" / "faults"))
    works: dict[str, Callable[[], int]] = {
        "demo": lambda: run(program("rig"), "demo", *rest),
        "docs": lambda: run(program("python"), "docs/build_site.py", *rest),
        "pictures": lambda: run(program("python"), "docs/make_pictures.py", *rest),
        "rig": lambda: run(program("rig"), *rest),
        "scenarios": lambda: run(program("rig"), "scenarios", *rest),
        "faults": lambda: faults(rest),
        "release": lambda: release(rest),
        "nightly": nightly,
        "coverage": coverage,
        "test": lambda: checks(rest),
        "install": lambda: 0,
    }
    return works[command]()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
