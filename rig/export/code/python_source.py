"""Functions printed as Python that needs `math` alone."""

from __future__ import annotations

import ast
from typing import cast

import numpy as np

from rig.export.code.functions import Function, Library


class _Renamed(ast.NodeTransformer):
    """Outside names as what they stand for; annotations, which need other packages, left away."""

    def __init__(self, function: Function, library: Library) -> None:
        self.function = function
        self.library = library

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """A called function by its new name, a constant by its value."""
        if node.id in self.function.parameters or node.id in self.function.assigned:
            return node
        called = self.library.function(self.function, node.id)
        if called is not None:
            return ast.Name(called.name)
        value = self.function.known.get(node.id)
        if isinstance(value, int | float | np.integer | np.floating):
            whole = isinstance(value, int | np.integer)
            return ast.parse(repr(int(value) if whole else float(value)), mode="eval").body
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        """`a[j, k]` as `a[j][k]`."""
        if not isinstance(node.slice, ast.Tuple):
            return cast(ast.expr, self.generic_visit(node))
        row, column = (cast(ast.expr, self.visit(place)) for place in node.slice.elts)
        return ast.Subscript(ast.Subscript(cast(ast.expr, self.visit(node.value)), row), column)

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """The length of a state."""
        if node.attr == "size":
            return ast.Constant(self.library.states)
        return node


def _printed(function: Function, library: Library) -> str:
    arguments = ast.arguments([], [ast.arg(name) for name in function.parameters], None, [], [], None, [])
    documented = [ast.Expr(ast.Constant(function.about))] if function.about else []
    body = [*documented, *(_Renamed(function, library).visit(ast.parse(ast.unparse(line)).body[0]) for line in
                           function.body)]  # fmt: skip
    made = ast.FunctionDef(function.name, arguments, body, [])
    return ast.unparse(ast.fix_missing_locations(made))


def python_functions(library: Library) -> str:
    """All functions and constant arrays of a library as Python."""
    arrays = [f"{name} = {values.tolist()!r}" for name, values in library.arrays.items()]
    return "\n\n\n".join([*arrays, *(_printed(function, library) for function in library.functions)]) + "\n"
