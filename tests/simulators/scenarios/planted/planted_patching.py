"""A changed line of the program, in force for a while: the functions that it changes get other code.

Every module keeps its functions, also where they were imported; so nothing is copied and nothing is loaded anew.
"""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import CodeType, FunctionType, ModuleType
from typing import Any

from edits import Edit, NoLongerThere, edited

FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


@contextmanager
def in_force(edits: tuple[Edit, ...]) -> Iterator[None]:
    """The program with these edits.

    Raises:
        NoLongerThere: one of them cannot be made.
    """
    trees = {}
    for file in dict.fromkeys(edit.file for edit in edits):
        before, after = edited(file, edits)
        trees[file] = ast.parse(before), ast.parse(after)
    with swapped(trees):
        yield


@contextmanager
def swapped(files: Mapping[str, tuple[ast.Module, ast.Module]]) -> Iterator[None]:
    """The functions of these files that differ have the second one's code in place of the first one's.

    Raises:
        NoLongerThere: none differs, or what differs is no function.
    """
    swaps = [swap for file, (before, after) in files.items() for swap in _swaps(file, before, after)]
    before = [(function, function.__code__) for function, _ in swaps]
    try:
        for function, code in swaps:
            function.__code__ = code
        yield
    finally:
        for function, code in before:
            function.__code__ = code


def _swaps(file: str, before: ast.Module, after: ast.Module) -> list[tuple[FunctionType, CodeType]]:
    """Functions of a module that change, and their new code."""
    old, new = dict(_functions(before)), dict(_functions(after))
    changed = [name for name in new if name in old and ast.dump(new[name]) != ast.dump(old[name])]
    if not changed:
        raise NoLongerThere(f"{file}: no function changes")
    module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
    codes = dict(_codes(compile(after, file, "exec", dont_inherit=True)))
    return [(_function(module, name), codes[name]) for name in changed]


def _functions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Functions of a module and methods of its classes by name; what is defined in them belongs to them."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, FUNCTIONS):
            yield prefix + node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from _functions(node, f"{prefix}{node.name}.")


def _codes(code: CodeType) -> Iterator[tuple[str, CodeType]]:
    """Code of functions and methods by name."""
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant.co_qualname, constant
            yield from _codes(constant)


def _function(module: ModuleType, name: str) -> FunctionType:
    owner: Any = module
    for part in name.split("."):
        owner = vars(owner)[part]
    if isinstance(owner, property):
        owner = owner.fget
    function = getattr(owner, "__func__", owner)
    if not isinstance(function, FunctionType):
        raise NoLongerThere(f"{module.__name__}.{name} is no function")
    return function
