"""Every message is used somewhere, and each use gives the values that it needs."""

from __future__ import annotations

import ast
import string
from collections.abc import Iterator
from pathlib import Path

import pytest

import rig.campaign
from rig.campaign import words
from rig.campaign.stop_cause import because

ROOM = Path(rig.campaign.__file__).parent
SAYS = {"say": 0, "because": 1, "_stops": 2}
"""Function -> which of its arguments names the message."""


def calls() -> Iterator[tuple[str, ast.Call, int]]:
    for path in ROOM.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in SAYS:
                yield f"{path.name}:{node.lineno}", node, SAYS[node.func.id]


def numbers_of(name: str) -> set[str]:
    fields = {field for _, field, _, _ in string.Formatter().parse(words.MESSAGES[name]) if field}
    return fields - {"advice"}


def names(argument: ast.expr) -> list[str]:
    """The names an argument can have: a text, or one of two; a variable's are looked up by nobody."""
    if isinstance(argument, ast.IfExp):
        return [*names(argument.body), *names(argument.orelse)]
    return [argument.value] if isinstance(argument, ast.Constant) and isinstance(argument.value, str) else []


def test_who_says_something_gives_what_its_message_needs() -> None:
    for place, call, position in calls():
        given = {keyword.arg for keyword in call.keywords}
        for name in names(call.args[position]):
            assert name in words.MESSAGES, place
            assert None in given or numbers_of(name) <= given, (place, name, numbers_of(name) - given)


def test_no_message_is_left_over() -> None:
    texts = "".join(path.read_text(encoding="utf-8") for path in ROOM.rglob("*.py") if path.name != "words.py")
    assert [name for name in words.MESSAGES if f'"{name}"' not in texts] == []


@pytest.mark.parametrize("name", words.ADVICE)
def test_an_explanation_takes_the_place_of_the_advice(name: str) -> None:
    values = dict.fromkeys(numbers_of(name), 1.0)
    cause = because("not-tared", name, **values)
    exchanged = cause.explained("sensors-swapped", "plugs")
    assert words.ADVICE[name] in cause.detail
    assert words.ADVICE[name] not in exchanged.detail
    assert exchanged.detail.endswith(words.EXCHANGED["plugs"])
    assert (exchanged.slug, exchanged.blamed) == ("sensors-swapped", "bench")
