"""The functions of a program as syntax trees, with everything they call and every constant they name."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import RigError

COLUMNS = 4
"""Of every constant array of two dimensions."""
CALLED_BY_NAME = ("abs", "min", "max", "float", "int", "range", "bool")
MATHEMATICS = (
    "tanh", "asinh", "exp", "log", "ceil", "floor", "sqrt", "hypot", "sinh", "cosh", "sin", "cos", "atan", "pow",
)  # fmt: skip
"""Functions of `math` that every target language has under the same name."""


class NotTranslatable(RigError):
    """A model's kernel says something that the translation does not know; the message names the function and what."""

    slug = "export-not-translatable"


@dataclass(frozen=True)
class Function:
    """One function to be translated.

    Attributes:
        name: in every target, unique.
        tree: its definition.
        known: what names outside of it stand for.
    """

    name: str
    tree: ast.FunctionDef
    known: dict[str, Any] = field(repr=False)

    @cached_property
    def parameters(self) -> list[str]:
        """Names of the parameters."""
        return [argument.arg for argument in self.tree.args.args]

    @cached_property
    def body(self) -> list[ast.stmt]:
        """The statements, without the docstring."""
        return self.tree.body[1:] if self.about else self.tree.body

    @cached_property
    def about(self) -> str:
        """First line of the docstring; empty where there is none."""
        return (ast.get_docstring(self.tree) or "").split("\n")[0]

    @cached_property
    def assigned(self) -> list[str]:
        """Names that are assigned, in order of their first place."""
        nodes = [node for node in ast.walk(self.tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
        return list(dict.fromkeys(node.id for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset))))

    @cached_property
    def read(self) -> set[str]:
        """Names that are read."""
        names = (node for node in ast.walk(self.tree) if isinstance(node, ast.Name))
        return {node.id for node in names if isinstance(node.ctx, ast.Load)}

    @cached_property
    def arity(self) -> int:
        """How many numbers it returns as a tuple; 0 for a plain number or nothing."""
        returned = [node.value for node in ast.walk(self.tree) if isinstance(node, ast.Return)]
        return max((len(value.elts) for value in returned if isinstance(value, ast.Tuple)), default=0)

    @cached_property
    def arrays(self) -> set[str]:
        """Parameters that are arrays or tuples."""
        plain = ("float", "int", "bool")
        return {
            argument.arg
            for argument in self.tree.args.args
            if argument.annotation is not None and ast.unparse(argument.annotation).strip("'\"") not in plain
        }

    def refused(self, node: ast.AST, what: str) -> NotTranslatable:
        """The error for what cannot be translated."""
        return NotTranslatable(f"{self.name}, `{ast.unparse(node)}` cannot be translated: {what}")


def _python(function: Callable[..., Any]) -> Callable[..., Any]:
    return getattr(function, "py_func", function)


def _tree(function: Callable[..., Any]) -> ast.FunctionDef:
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, TypeError, SyntaxError) as error:
        raise NotTranslatable(f"the source of {function!r} cannot be read: {error}") from error
    if not isinstance(tree, ast.FunctionDef):
        raise NotTranslatable(f"{function!r} is not a plain function")
    _WholeArrays().visit(tree)
    return tree


class _WholeArrays(ast.NodeTransformer):
    """`array[:n]` as the array itself: a function that gets it writes to its first elements alone."""

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        self.generic_visit(node)
        first = isinstance(node.slice, ast.Slice) and node.slice.lower is None and node.slice.step is None
        return node.value if first else node


class Library:
    """All functions that some functions need, those that are called first.

    Args:
        wanted: functions, compiled by numba or plain.
        states: length of a state array that asks; there is always room for two, and what is not used stays zero.

    Attributes:
        functions: in an order in which each comes behind all that it calls.
        arrays: constant arrays by name.

    Raises:
        NotTranslatable: something in them is not known here.
    """

    def __init__(self, chosen: Sequence[Callable[..., Any]], states: int = 2) -> None:
        self.states = states
        self.functions: list[Function] = []
        self.arrays: dict[str, FloatArray] = {}
        self._of: dict[Callable[..., Any], Function] = {}
        for function in chosen:
            self._add(function)

    def function(self, within: Function, name: str) -> Function | None:
        """The function that a name stands for; None where it is none of these."""
        value = within.known.get(name)
        return self._of.get(_python(value)) if callable(value) else None

    def changes(self, function: Function) -> list[str]:
        """Array parameters into which it writes, itself or by what it calls."""
        written = {
            node.value.id
            for node in ast.walk(function.tree)
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name)
        }
        for call in (node for node in ast.walk(function.tree) if isinstance(node, ast.Call)):
            called = self.function(function, call.func.id) if isinstance(call.func, ast.Name) else None
            if called is None:
                continue
            handed = dict(zip(called.parameters, call.args, strict=False))
            written |= {
                node.id for name in self.changes(called) if isinstance(node := handed.get(name), ast.Name)
            }
        return [name for name in function.parameters if name in written]

    def _add(self, function: Callable[..., Any]) -> Function:
        plain = _python(function)
        if plain in self._of:
            return self._of[plain]
        outside = inspect.getclosurevars(plain)
        made = Function(self._named(plain.__name__), _tree(plain), {**outside.globals, **outside.nonlocals})
        self._of[plain] = made
        for name in sorted(made.read - set(made.parameters) - set(made.assigned)):
            self._resolve(made, name)
        self.functions.append(made)
        return made

    def _named(self, name: str) -> str:
        taken = {function.name for function in self._of.values()}
        base = f"mr_{name.strip('_')}"
        return next(n for n in (base, *(f"{base}_{k}" for k in range(2, 99))) if n not in taken)

    def _resolve(self, function: Function, name: str) -> None:
        value = function.known.get(name)
        if value is math or (name in CALLED_BY_NAME and hasattr(builtins, name)):
            return
        if isinstance(value, np.ndarray):
            if value.ndim > 2 or (value.ndim == 2 and value.shape[1] != COLUMNS):
                raise function.refused(ast.Name(name), f"an array of shape {value.shape} is not supported")
            self.arrays[name] = value
        elif callable(value):
            self._add(value)
        elif name in function.known and not isinstance(value, int | float | np.integer | np.floating):
            raise function.refused(ast.Name(name), f"a value of type {type(value).__name__} is not supported")
