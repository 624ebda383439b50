"""The house's own rules: names and imports. No file or class is split to satisfy a number."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ("protocols", "drivers", "rig", "simulators")
NO_NOUNS = {"found", "each"}

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
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = {f"{node.module}.{alias.name}" for alias in node.names} & modules().keys()
            names |= submodules or {node.module}
    return (names & modules().keys()) - {name}


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
        for imported in sorted(graph[name]):
            if state.get(imported) == 1:
                circles.append([*trail[trail.index(imported) :], imported])
            elif imported not in state:
                visit(imported, [*trail, imported])
        state[name] = 2

    for name in graph:
        if name not in state:
            visit(name, [name])
    assert circles == []


def test_child_processes_import_nothing_from_the_working_folder() -> None:
    """`python -m` alone imports a `click.py` or `queue.py` of the folder that the user works in."""
    texts = {name: path.read_text(encoding="utf-8") for name, (path, _) in modules().items()}
    assert [name for name, text in texts.items() if 'sys.executable, "-m"' in text] == []
