"""The documentation's links lead to files and headings that exist, and the names it writes are those of the code."""

from __future__ import annotations

import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
READER = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
REFERENCE = [path for path in READER if path.parent.name not in {"decisions"} and path.name != "CHANGELOG.md"]
"""Decisions and the changelog tell of names as they were."""
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
NAME = re.compile(r"`((?:rig|drivers|protocols|simulators)(?:\.\w+)+)(?=[`(])")
ROOMS = "rig|drivers|protocols|simulators|tests|docs|examples|benchmarks"
PATH = re.compile(rf"`(?:[\w./-]+ )*((?:{ROOMS})/[\w./-]+)(?=[` ])")
SOURCES = sorted(path for room in ("rig", "drivers", "protocols", "simulators") for path in (ROOT / room).rglob("*.py"))
IMPORT = re.compile(r"^[ +]*from ((?:rig|drivers|protocols|simulators)[\w.]*) import (.+)$", re.MULTILINE)
TRIALS = {"rig/dampers/dahl.py", "protocols/counted_format.py"}
"""Files that a how-to adds and takes out again."""
FILE_ENDS = ("toml", "dbc", "py", "md")


def prose(path: Path) -> str:
    """A page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def headings(path: Path) -> set[str]:
    """Anchors of a page's headings, as a forge makes them."""
    lines = [line.lstrip("#").strip().lower() for line in prose(path).splitlines() if line.startswith("#")]
    return {re.sub(r"[^\w\- ]", "", line).replace(" ", "-") for line in lines}


def broken_links(path: Path) -> Iterator[str]:
    for target in LINK.findall(prose(path)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        file = path.parent / name if name else path
        if not file.exists() or (anchor and anchor not in headings(file)):
            yield target


def resolves(name: str) -> bool:
    """Whether a dotted name is a module, or something in one, or in a class of one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            thing = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for attribute in parts[length:]:
            if not hasattr(thing, attribute):
                return False
            thing = getattr(thing, attribute)
        return True
    return False


def annotations_of(name: str) -> dict[str, object]:
    """Annotations of a class by its dotted name; none where there is no such class."""
    module, _, thing = name.rpartition(".")
    try:
        return dict(getattr(getattr(import_module(module), thing, None), "__annotations__", {}))
    except ModuleNotFoundError:
        return {}


def page(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", READER, ids=page)
def test_every_relative_link_leads_to_a_file_and_a_heading(path: Path) -> None:
    assert list(broken_links(path)) == []


@pytest.mark.parametrize("path", REFERENCE, ids=page)
def test_every_dotted_name_imports(path: Path) -> None:
    names = [name for name in NAME.findall(prose(path)) if not name.endswith(FILE_ENDS)]
    assert [name for name in names if not resolves(name)] == []


def test_every_dotted_name_in_a_docstring_imports() -> None:
    """Fields of a class without a default are no attributes of it: what they belong to is looked up."""
    wrong = []
    for path in SOURCES:
        for name in NAME.findall(path.read_text(encoding="utf-8")):
            owner, _, field = name.rpartition(".")
            if name.endswith(FILE_ENDS) or resolves(name):
                continue
            if field not in annotations_of(owner):
                wrong.append(f"{page(path)}: {name}")
    assert wrong == []


@pytest.mark.parametrize("path", REFERENCE, ids=page)
def test_every_path_is_that_of_a_file(path: Path) -> None:
    paths = [name for name in PATH.findall(prose(path)) if "NAME" not in name]
    assert [name for name in paths if not (ROOT / name).exists() and name not in TRIALS] == []


@pytest.mark.parametrize("path", REFERENCE, ids=page)
def test_every_import_in_an_example_works(path: Path) -> None:
    trials = {name.removesuffix(".py").replace("/", ".") for name in TRIALS}
    expected = [
        f"{module}.{name.strip()}"
        for module, names in IMPORT.findall(path.read_text(encoding="utf-8")) if module not in trials
        for name in names.split(",")
    ]
    assert [name for name in expected if not resolves(name)] == []


def test_a_wrong_name_is_noticed() -> None:
    assert resolves("rig.recording.run.Run.open")
    assert not resolves("rig.recording.run.Walk")
    assert not resolves("rig.nowhere.Run")
