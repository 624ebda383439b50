"""The pytest plug-in: fixtures with which a lab tests its bench, matrix, drivers and models on the simulated rig.

It is known to pytest wherever this program is installed, and loads nothing of it before a fixture is used.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from rig.faults.matrix import MATRIX as ROWS

if TYPE_CHECKING:
    from rig.bench.model import Bench
    from rig.faults.row import FaultRow
    from rig.matrix.model import Matrix
    from simulators.testing.campaigns import CampaignEnd, ScenarioEnd
    from simulators.testing.rehearsal import RigProcess

CONFORMANCE = "rig.conformance"
CONFORMANCE_OPTIONS = {
    "driver": ("NAME", "driver to test: a name as in `register_map`, `dbc` or `format`, or ROLE:NAME"),
    "model": ("NAME", "damper model to test"),
    "method": ("NAME", "identification method to test"),
    "peer": ("URL", "address of the driver's physical device, which will move"),
}
BENCH, MATRIX = "rig_bench", "rig_matrix"
QUICK = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["0.5 A", "1 A"]
cycles = 5
"""
"""The matrix where none is named: two points, 7 s."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """The files of the lab: options, and entries of the ini file."""
    group = parser.getgroup("rig", "the damper rig's controller")
    for name, what in ((BENCH, "bench file"), (MATRIX, "matrix file")):
        option = "--" + name.replace("_", "-")
        group.addoption(option, dest=name, metavar="FILE", help=f"{what} for the fixtures; overrides the ini entry")
        parser.addini(
            name, f"{what} for the fixtures `bench`, `matrix`, `campaign` and `scenario`; path relative to the ini file"
        )


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(parser: pytest.Parser, args: list[str]) -> None:
    """The options of the conformance suite, where it is asked for: their short names may be another plug-in's."""
    if not any(argument.startswith(CONFORMANCE) for argument in args):
        return
    group = parser.getgroup("rig conformance", "requirements for a driver, a damper model or a method")
    for name, what in CONFORMANCE_OPTIONS.items():
        group.addoption(f"--{name}", dest=f"rig_{name}", metavar=what[0], help=what[1])


def pytest_configure(config: pytest.Config) -> None:
    """Refuse unknown names before anything is collected."""
    if hasattr(config.option, "rig_driver"):
        # loads pyserial: only when needed
        from rig.conformance.choice import chosen_files

        chosen_files(config)


def _file(config: pytest.Config, name: str) -> Path | None:
    """The user's file; None where none is named."""
    given = config.getoption(name)
    if given:
        return Path(config.invocation_params.dir) / str(given)
    entry = str(config.getini(name) or "")
    home = config.rootpath if config.inipath is None else config.inipath.parent
    return home / entry if entry else None


@pytest.fixture(scope="session")
def bench_path(request: pytest.FixtureRequest) -> Path | None:
    """The lab's bench file (`rig_bench`); None where none is named: the rig is then the usual simulated one."""
    return _file(request.config, BENCH)


@pytest.fixture(scope="session")
def matrix_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lab's matrix file (`rig_matrix`); where none is named, one of two short points."""
    named = _file(request.config, MATRIX)
    if named is not None:
        return named
    path = tmp_path_factory.mktemp("rig") / "matrix.toml"
    path.write_text(QUICK, encoding="utf-8")
    return path


@pytest.fixture
def bench(bench_path: Path | None) -> Bench:
    """The lab's bench file, read and checked; every problem of it fails the test, with file and line."""
    # loads pyserial and pydantic: only when needed
    from rig.bench.model import Bench

    if bench_path is None:
        pytest.fail("the fixture `bench` requires a bench file. Fix: specify the file in pytest's ini file, "
            f"{BENCH} = FILE")
    return Bench.load(bench_path)


@pytest.fixture
def matrix(matrix_path: Path) -> Matrix:
    """The lab's matrix file, read and checked."""
    # loads numpy and pyserial: only when needed
    from rig.matrix.model import load_matrix

    return load_matrix(matrix_path)


@pytest.fixture(scope="session")
def faults() -> Mapping[str, FaultRow]:
    """The fault matrix: slug -> row, with what must follow (`exit_code`, `stop`, `limit`, `resume`)."""
    return ROWS


Given = Path | str | None
"""A file, the text of one, or None for the lab's own."""
RunCampaign = Callable[..., "CampaignEnd"]
RunScenario = Callable[..., "ScenarioEnd"]
StartRig = Callable[..., "RigProcess"]


class Folders:
    """Folders of a test, and the user's files for what happens in them."""

    def __init__(self, root: Path, matrix_path: Path, bench_path: Path | None) -> None:
        self._root, self._given = root, {"matrix.toml": matrix_path, "bench.toml": bench_path}
        self._number = itertools.count(1)

    def new(self, name: str) -> Path:
        """The next empty folder of that name."""
        folder = self._root / f"{name}{next(self._number)}"
        folder.mkdir()
        return folder

    def file(self, folder: Path, name: str, given: Given) -> Path | None:
        """The file to use: the one that is given, a text written beside `folder`, or the lab's own."""
        if given is None:
            return self._given[name]
        if isinstance(given, Path):
            return given
        path = folder.with_name(f"{folder.name}-{name}")
        path.write_text(given, encoding="utf-8")
        return path


@pytest.fixture
def _rig_folders(tmp_path: Path, matrix_path: Path, bench_path: Path | None) -> Folders:
    return Folders(tmp_path, matrix_path, bench_path)


@pytest.fixture
def campaign(_rig_folders: Folders) -> RunCampaign:
    """The lab's matrix run on the simulated rig of its bench, in virtual time, such as `campaign("estop@3", seed=1)`.

    Arguments are faults by slug, `SLUG[:VARIANT][@T[+D]]`; `matrix` and `bench` are files, or texts, in place of the
    lab's. Gives a `simulators.testing.campaigns.CampaignEnd`.
    """

    def ran(*faults: str, matrix: Given = None, bench: Given = None, seed: int = 1) -> CampaignEnd:
        # loads numba and numpy: only when needed
        from simulators.scenarios.request import Files
        from simulators.testing.campaigns import run_campaign

        folder = _rig_folders.new("campaign")
        files = Files(
            _rig_folders.file(folder, "matrix.toml", matrix), _rig_folders.file(folder, "bench.toml", bench)
        )
        return run_campaign(files, faults, seed, folder)

    return ran


@pytest.fixture
def scenario(_rig_folders: Folders) -> RunScenario:
    """The lab's matrix in the scenario of a seed, with its drawn events; `passed` states whether all checks passed.

    Further arguments are events instead of the drawn ones. Returns a `simulators.testing.campaigns.ScenarioEnd`.
    """

    def ran(seed: int, *events: str, matrix: Given = None, bench: Given = None) -> ScenarioEnd:
        # loads numba and numpy: only when needed
        from simulators.scenarios.request import Files
        from simulators.testing.campaigns import run_scenario

        folder = _rig_folders.new("scenario")
        files = Files(
            _rig_folders.file(folder, "matrix.toml", matrix), _rig_folders.file(folder, "bench.toml", bench)
        )
        return run_scenario(files, events, seed, folder)

    return ran


@pytest.fixture
def world(scenario: RunScenario) -> RunScenario:
    """The name of `scenario` until 2.0."""
    return scenario


@pytest.fixture(scope="session")
def simulated_rigs(
    tmp_path_factory: pytest.TempPathFactory, matrix_path: Path, bench_path: Path | None
) -> Iterator[StartRig]:
    """As `simulated_rig`, for all tests of a session."""
    yield from _started(Folders(tmp_path_factory.mktemp("rigs"), matrix_path, bench_path))


@pytest.fixture
def simulated_rig(_rig_folders: Folders) -> Iterator[StartRig]:
    """A simulated rig on real wires: started by a call, it has `bench_path`, `bench` and `stop()`.

    It is the rig of the lab's bench file, drivers included; without one, or with `usual=True`, the usual one, which
    takes the arguments of `python -m simulators`. What still runs at the end of the test is ended.
    """
    yield from _started(_rig_folders)


def _started(folders: Folders) -> Iterator[StartRig]:
    begun: list[RigProcess] = []

    def started(*arguments: str, usual: bool = False, matrix: Given = None, bench: Given = None) -> RigProcess:
        # loads pyserial and pydantic: only when needed
        from simulators.testing.rehearsal import start

        folder = folders.new("rig")
        bench_file = None if usual else folders.file(folder, "bench.toml", bench)
        log, out = folder / "simulator.log", folder / "bench.toml"
        if bench_file is None:
            command = ["simulators", "--no-real-time", "--exit-when-idle", "--bench", str(out), *arguments]
        elif arguments:
            pytest.fail("arguments require the default simulated rig: simulated_rig(..., usual=True)")
        else:
            matrix_file = folders.file(folder, "matrix.toml", matrix)
            command = ["simulators.testing.rehearsal", str(bench_file), str(matrix_file), str(out)]
        begun.append(start(["-m", *command], log))
        return begun[-1]

    yield started
    for rig in begun:
        rig.stop()
