"""The house's own rules, counted: sizes, names, imports. An exception stands in a list here, with its reason."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("protocols", "drivers", "rig", "simulators")
LONGEST_FILE = 400
LONGEST_FUNCTION = 60
MOST_PARAMETERS = 6
NO_NOUNS = {"found", "each"}

LONG_FILES: dict[str, str] = {}

DOCUMENTED = "a public call; its docstring is longer than its code"
LONG_FUNCTIONS = {
    "rig.dampers.modified_bouc_wen:_own_step": "one integration step, compiled: its stages share all values",
    "rig.identification.fitting:identify": DOCUMENTED,
    "rig.identification.runs:identify_run": DOCUMENTED,
    "rig.identification.uncertainty.assessment:judged": "one field of the fit after the other",
    "rig.optimisers.search:make_search": DOCUMENTED,
}

OPTIONS = "one parameter for each option of the command"
PUBLIC = "a public call whose arguments all have defaults"
COMPILED = "machine code, or what it is called by: flat arguments"
EQUATION = "the signature of every model's equation: parameters, u, v, a, current, dt"
MANY_PARAMETERS = {
    "rig.cli.hybrid:command": OPTIONS,
    "rig.cli.identify:command": OPTIONS,
    "rig.cli.importing:command": OPTIONS,
    "rig.cli.ride:command": OPTIONS,
    "rig.cli.run:command": OPTIONS,
    "rig.recording.importing:import_tests": OPTIONS,
    "rig.identification.fitting:identify": PUBLIC,
    "rig.identification.runs:identify_run": PUBLIC,
    "rig.optimisers.methods:minimise": PUBLIC,
    "rig.optimisers.search:make_search": PUBLIC,
}
MANY_PARAMETERS_WHERE = {
    "rig.dampers.": COMPILED,
    "rig.export.code.program:": COMPILED,
    "rig.identification.models.kernels:": COMPILED,
    "simulators.conditioner:": COMPILED,
    "simulators.plant.": COMPILED,
}
"""Modules whose functions may take more."""

CATALOGUES = {
    "drivers.catalogue": "the one place that names the drivers",
    "rig.dampers.catalogue": "the one place that names the models",
    "rig.export.exporter": "the one place that names the formats",
    "rig.faults.matrix": "puts together the rows of each device",
    "rig.optimisers.methods": "the one place that names the algorithms",
    "rig.recording.foreign.formats": "the one place that names the formats that are read",
    "rig.page.server": "puts together the page, its rights, its commands and its samples",
    "rig.report.document": "puts together the parts of a page",
    "simulators.rig": "puts together the devices",
}
"""What they import are topics of their own, each of the same kind, that nobody else has to know."""
ONE_IMPORTER = {
    "rig.campaign.live_display": "what is shown, beside what may be asked for: a display like the terminal's",
    "rig.page.server": "answers and sends; signals, sockets and the end of the process are its process's",
    "rig.matrix.record_file": "lines and columns of a file; the tables know of none",
    "rig.page.ended_run": "files of a run that is over; what watches one that lives reads none of them",
    "rig.hybrid.delay_margin": "of any linear structure with a specimen, whatever is run with it",
    "drivers.slcan_bus": "loaded only where the bus is a serial adapter: it needs python-can to define its class",
    "rig.cli.comparison_tables": "loads rich and numpy, and only where a comparison is shown",
    "drivers.stamp_clock": "a clock without a bus, beside the port's I/O",
    "simulators.ecu_protection": "the peer of protocols.e2e: what both compute is compared",
    "simulators.testing.rehearsal": "a process of its own; loaded when a fixture is used",
    "rig.vehicle.comfort": "the weightings of a standard, whatever is weighted",
    "rig.dampers.leaning_loop": "compiled: loads numba, and only where its model is integrated",
    "rig.dampers.sprung_slopes": "compiled: loads numba, and only where its model is fitted",
    "rig.identification.diagnosis.groups": "the search for the best parting; the trials only ask it",
    "rig.identification.points.faint_orders": "its own estimate of weak harmonics; the motion only asks it",
}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@cache
def modules() -> dict[str, tuple[Path, ast.Module]]:
    """Every module of the product by its dotted name."""
    paths = [path for room in ROOMS for path in sorted((ROOT / room).rglob("*.py"))]
    return {dotted(path): (path, ast.parse(path.read_text(encoding="utf-8"))) for path in paths}


def dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def functions() -> Iterator[tuple[str, Function]]:
    """Every function as `module:function`."""
    for name, (_path, tree) in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, Function):
                yield f"{name}:{node.name}", node


def imports_of(name: str, tree: ast.Module) -> set[str]:
    """Modules of the product that a module imports, wherever the import stands."""
    wanted: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            wanted |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & modules().keys()
            wanted |= submodules or {node.module}
    return (wanted & modules().keys()) - {name}


@cache
def importers() -> dict[str, set[str]]:
    """Who imports a module."""
    of: dict[str, set[str]] = defaultdict(set)
    for name, (_path, tree) in modules().items():
        for wanted in imports_of(name, tree):
            of[wanted].add(name)
    return of


def unlisted(broken: dict[str, str], listed: dict[str, str]) -> tuple[dict[str, str], set[str]]:
    """What breaks the rule without a reason, and the reasons that nothing needs any more."""
    return {name: why for name, why in broken.items() if name not in listed}, listed.keys() - broken.keys()


def test_a_file_fits_a_head() -> None:
    lengths = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, (path, _tree) in modules().items()}
    broken = {name: f"{length} lines" for name, length in lengths.items() if length > LONGEST_FILE}
    assert unlisted(broken, LONG_FILES) == ({}, set())


def test_a_function_fits_a_screen() -> None:
    lengths = {name: (node.end_lineno or node.lineno) - node.lineno + 1 for name, node in functions()}
    broken = {name: f"{length} lines" for name, length in lengths.items() if length > LONGEST_FUNCTION}
    assert unlisted(broken, LONG_FUNCTIONS) == ({}, set())


def test_a_function_takes_few_parameters() -> None:
    broken = {}
    for name, node in functions():
        given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        count = len([one for one in given if one.arg not in {"self", "cls"}])
        if count > MOST_PARAMETERS and not name.startswith(tuple(MANY_PARAMETERS_WHERE)):
            broken[name] = f"{count} parameters"
    assert unlisted(broken, MANY_PARAMETERS) == ({}, set())


def test_a_local_is_called_by_a_noun() -> None:
    broken = {
        name: node.id
        for name, function in functions()
        for node in ast.walk(function)
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id in NO_NOUNS
    }
    assert broken == {}


def test_imports_make_no_circle() -> None:
    graph = {name: imports_of(name, tree) for name, (_path, tree) in modules().items()}
    state: dict[str, int] = {}
    circles: list[list[str]] = []

    def visit(name: str, trail: list[str]) -> None:
        state[name] = 1
        for wanted in sorted(graph[name]):
            if state.get(wanted) == 1:
                circles.append([*trail[trail.index(wanted) :], wanted])
            elif wanted not in state:
                visit(wanted, [*trail, wanted])
        state[name] = 2

    for name in graph:
        if name not in state:
            visit(name, [name])
    assert circles == []


def test_a_file_is_a_topic_not_a_page_of_its_neighbour() -> None:
    """A module with one importer, in the same folder, that together with it would still fit a head, belongs into it."""
    broken = {}
    for name, (path, _tree) in modules().items():
        users = importers()[name]
        if len(users) != 1 or path.name in {"__init__.py", "__main__.py"}:
            continue
        (user,) = users
        user_path = modules()[user][0]
        if user_path.parent != path.parent or user_path.name in {"__init__.py", "__main__.py"} or user in CATALOGUES:
            continue
        together = sum(len(one.read_text(encoding="utf-8").splitlines()) for one in (path, user_path))
        if together <= LONGEST_FILE:
            broken[name] = f"only {user} imports it; together {together} lines"
    assert unlisted(broken, ONE_IMPORTER) == ({}, set())
