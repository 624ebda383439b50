"""Functions printed as C99."""

from __future__ import annotations

import ast

from rig.export.code.functions import COLUMNS, Function, Library
from rig.export.code.printer import ATOM, Printer, number


class CPrinter(Printer):
    """A function as C99, every number a double."""

    reserved = frozenset((
        "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum", "extern",
        "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict", "return", "short", "signed",
        "sizeof", "static", "struct", "switch", "typedef", "union", "unsigned", "void", "volatile", "while", "result",
    ))  # fmt: skip
    infinity = "INFINITY"
    closing = "}"

    def printed(self) -> str:
        """See `Printer.printed`."""
        self.indent = 0
        self.block(self.function.body)
        own = [name for name in self.function.assigned if name not in self.function.parameters]
        plain = [self.named(name) for name in own if name not in self.arrays]
        plain += [name for name, size in self.temporaries if not size]
        arrays = [(self.named(name), self.arrays[name]) for name in own if name in self.arrays]
        arrays += [(name, size) for name, size in self.temporaries if size]
        head = [f"    double {', '.join(plain)};"] if plain else []
        head += [f"    double {name}[{size}];" for name, size in arrays]
        unused = [name for name in self.function.parameters if name not in self.function.read]
        head += [f"    (void){self.named(name)};" for name in unused if name not in self.function.assigned]
        about = [f"/* {self.function.about} */"] if self.function.about else []
        return "\n".join([*about, self.signature() + " {", *head, *self.lines, "}"])

    def signature(self) -> str:
        """The line that declares the function."""
        changed = self.library.changes(self.function)
        parameters = []
        for name in self.function.parameters:
            shown = self.named(name)
            if name not in self.arrays:
                parameters.append(f"double {shown}")
            else:
                parameters.append(f"double *{shown}" if name in changed else f"const double *{shown}")
        if self.function.arity:
            parameters.append("double *result")
        kind = "double" if self.gives() else "void"
        return f"static {kind} {self.function.name}({', '.join(parameters)})"

    def gives(self) -> bool:
        """Whether the function's value is a number."""
        returns = [node for node in ast.walk(self.function.tree) if isinstance(node, ast.Return)]
        return not self.function.arity and any(node.value is not None for node in returns)

    def call(self, node: ast.Call) -> str:
        """See `Printer.call`.

        Raises:
            NotTranslatable: it has no counterpart here, or its value is a tuple, which no expression of C holds.
        """
        function = self.called_by(node)
        if function is not None and function.arity:
            raise self.function.refused(node, "a tuple must be assigned to a name (`name = ...`)")
        return super().call(node)

    def call_name(self, name: str) -> str:
        """See `Printer.call_name`."""
        return {"abs": "fabs", "min": "fmin", "max": "fmax", "int": "trunc"}.get(name, name)

    def conditional(self, test: str, then: str, otherwise: str) -> str:
        """See `Printer.conditional`."""
        return f"({test} ? {then} : {otherwise})"

    def power(self, base: ast.expr, exponent: ast.expr) -> tuple[str, int]:
        """See `Printer.power`."""
        return f"pow({self.text(base)}, {self.text(exponent)})", ATOM

    def element(self, array: str, places: list[ast.expr]) -> str:
        """See `Printer.element`."""
        shown = [
            str(place.value) if isinstance(place, ast.Constant) else f"(int)({self.text(place)})" for place in places
        ]
        return f"{array}[{shown[0]}]" if len(shown) == 1 else f"{array}[{COLUMNS} * {shown[0]} + {shown[1]}]"

    def several(self, function: Function, arguments: list[ast.expr]) -> str:
        """See `Printer.several`."""
        held = self.temporary(function.arity)
        self.line(f"{function.name}({', '.join([*(self.text(argument) for argument in arguments), held])});")
        return held

    def alone(self, node: ast.Call) -> None:
        """See `Printer.alone`."""
        self.line(f"{self.text(node)};")

    def opened(self, kind: str, condition: str) -> str:
        """See `Printer.opened`."""
        return "} else {" if kind == "else" else f"{kind} ({condition}) {{"

    def counted(self, name: str, first: str, stop: str) -> str:
        """See `Printer.counted`."""
        return f"for ({name} = {first}; {name} < {stop}; {name} += 1.0) {{"

    def returned(self, node: ast.Return) -> None:
        """See `Printer.returned`."""
        if isinstance(node.value, ast.Tuple):
            for k, element in enumerate(node.value.elts):
                self.line(f"result[{k}] = {self.text(element)};")
            self.line("return;")
        else:
            self.line("return;" if node.value is None else f"return {self.text(node.value)};")


def c_functions(library: Library) -> str:
    """All functions and constant arrays of a library as C99, those that are called first."""
    arrays = [
        f"static const double {name}[] = {{{', '.join(number(value) for value in values.ravel())}}};"
        for name, values in library.arrays.items()
    ]
    functions = [CPrinter(function, library).printed() for function in library.functions]
    return "\n\n".join([*arrays, *functions]) + "\n"
