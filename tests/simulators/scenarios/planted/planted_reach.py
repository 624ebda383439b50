"""Which planted bugs a world without any of them comes by: where the lines that they change matter.

A condition that a bug makes false matters where it was true, one that it makes true where it was false; any other line
matters where it is run. A world that comes by none of a bug's lines is the same with the bug, bit by bit.
"""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import SequenceMatcher

from edits import ROOT, Edit
from planted_patching import swapped

Mark = tuple[str, int]
"""A planted bug and the number of its edit."""
COMES_BY = "_comes_by"
CONSTANT = re.compile(r"\bif (False|True)\b")
ADDED = re.compile(r"^( +)if .+:\n +continue\n", re.MULTILINE)


@contextmanager
def watched(planted: Mapping[str, Sequence[Edit]]) -> Iterator[set[Mark]]:
    """The program as it is, which adds to a set what it comes by.

    Raises:
        NoLongerThere: an edit's text stands in no function.
    """
    marks: set[Mark] = set()
    by_file: dict[str, list[tuple[Mark, Edit]]] = {}
    for name, edits in planted.items():
        for number, edit in enumerate(edits):
            by_file.setdefault(edit.file, []).append(((name, number), edit))
    modules = [importlib.import_module(file.removesuffix(".py").replace("/", ".")) for file in by_file]
    with swapped({file: _marked(file, edits) for file, edits in by_file.items()}):
        for module in modules:
            vars(module)[COMES_BY] = marks.add
        try:
            yield marks
        finally:
            for module in modules:
                del vars(module)[COMES_BY]


def _marked(file: str, edits: Sequence[tuple[Mark, Edit]]) -> tuple[ast.Module, ast.Module]:
    """A file as it is, and with marks where these edits matter."""
    before = after = (ROOT / file).read_text(encoding="utf-8")
    others = []
    for mark, edit in edits:
        added = ADDED.match(edit.new)
        if added and edit.new[added.end() :] == edit.old:
            call = added[0].replace("continue", f"{COMES_BY}({mark!r})")
            after = after.replace(edit.old, call + edit.old)
        else:
            others.append((mark, edit))
    tree = ast.parse(after)
    for mark, edit in others:
        for line, constant in _changed(after, edit):
            _mark(tree, line, constant, mark)
    return ast.parse(before), ast.fix_missing_locations(tree)


def _changed(text: str, edit: Edit) -> Iterator[tuple[int, str]]:
    """Lines of a text that an edit changes, from 1, and what their condition becomes; empty where it stays one."""
    first = text.count("\n", 0, text.index(edit.old)) + 1
    old, new = edit.old.splitlines(), edit.new.splitlines()
    for kind, from_old, to_old, from_new, to_new in SequenceMatcher(None, old, new).get_opcodes():
        constant = CONSTANT.search("\n".join(new[from_new:to_new]))
        if kind == "insert":
            yield first + min(from_old, len(old) - 1), ""
        elif kind != "equal":
            for place in range(from_old, to_old):
                yield first + place, constant[1] if constant else ""


def _mark(tree: ast.Module, line: int, constant: str, mark: Mark) -> None:
    """Have the program tell that it comes by a line, or by what hangs on its condition."""
    blocks = [
        block for node in ast.walk(tree) for name in ("body", "orelse", "finalbody")
        if isinstance(block := getattr(node, name, None), list)
    ]
    places = [
        (statement.lineno, block, statement) for block in blocks for statement in block
        if isinstance(statement, ast.stmt) and statement.lineno <= line <= (statement.end_lineno or 0)
    ]
    _, block, statement = max(places, key=lambda place: place[0])
    call = ast.copy_location(ast.parse(f"{COMES_BY}({mark!r})").body[0], statement)
    if isinstance(statement, ast.If) and constant:
        (statement.body if constant == "False" else statement.orelse).insert(0, call)
    else:
        block.insert(block.index(statement), call)
