"""Functions printed as Octave, in what MATLAB reads too."""

from __future__ import annotations

import ast

from rig.export.code.functions import Function, Library
from rig.export.code.printer import Printer, number


class OctavePrinter(Printer):
    """A function as Octave. Arrays are values here: a function gives those back that it changes."""

    reserved = frozenset((
        "break", "case", "catch", "continue", "do", "else", "elseif", "end", "endfor", "endfunction", "endif",
        "endwhile", "for", "function", "global", "if", "otherwise", "persistent", "return", "switch", "try", "until",
        "while", "i", "j", "e", "pi", "result",
    ))  # fmt: skip
    infinity = "Inf"
    negation = "~"
    not_equal = "~="
    closing = "end"

    def printed(self) -> str:
        """See `Printer.printed`."""
        self.indent = 0
        self.block(self.function.body)
        constants = sorted((self.function.read & set(self.library.arrays)) - set(self.function.parameters))
        about = [f"    % {self.function.about}"] if self.function.about else []
        head = [f"    {self.named(name)} = mr_array_{self.named(name)}();" for name in constants]
        outputs = [*(self.named(name) for name in self.library.changes(self.function)), "result"]
        arguments = ", ".join(self.named(name) for name in self.function.parameters)
        line = f"function [{', '.join(outputs)}] = {self.function.name}({arguments})"
        return "\n".join([line, *about, *head, "    result = 0;", *self.lines, "end"])

    def call_name(self, name: str) -> str:
        """See `Printer.call_name`."""
        return "fix" if name == "int" else name

    def conditional(self, test: str, then: str, otherwise: str) -> str:
        """See `Printer.conditional`."""
        return f"mr_choose({test}, {then}, {otherwise})"

    def element(self, array: str, places: list[ast.expr]) -> str:
        """See `Printer.element`."""
        shown = [
            str(place.value + 1) if isinstance(place, ast.Constant) and isinstance(place.value, int)
            else f"{self.text(place, 5)} + 1"
            for place in places
        ]  # fmt: skip
        return f"{array}({', '.join(shown)})"

    def called(self, function: Function, arguments: list[ast.expr]) -> str:
        """See `Printer.called`.

        Raises:
            NotTranslatable: it changes an array inside of an expression.
        """
        if self.library.changes(function):
            raise self.function.refused(ast.Name(function.name), "the function modifies an array inside an expression")
        return super().called(function, arguments)

    def hoisted(self, node: ast.expr) -> str:
        """See `Printer.hoisted`; a conversion around the call says nothing in a language with one kind of number."""
        while isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CONVERSIONS:
            node = node.args[0]
        function = self.called_by(node)
        if function is None or not isinstance(node, ast.Call) or not self.library.changes(function):
            return self.text(node)
        handed = dict(zip(function.parameters, node.args, strict=True))
        value = self.temporary()
        outputs = [*(self.text(handed[name]) for name in self.library.changes(function)), value]
        arguments = ", ".join(self.text(argument) for argument in node.args)
        self.line(f"[{', '.join(outputs)}] = {function.name}({arguments});")
        return value

    def alone(self, node: ast.Call) -> None:
        """See `Printer.alone`; a call that changes nothing has nothing to say."""
        self.hoisted(node)

    def opened(self, kind: str, condition: str) -> str:
        """See `Printer.opened`."""
        return f"{kind} {condition}".rstrip()

    def counted(self, name: str, first: str, stop: str) -> str:
        """See `Printer.counted`."""
        return f"for {name} = {first}:({stop}) - 1"

    def returned(self, node: ast.Return) -> None:
        """See `Printer.returned`."""
        if isinstance(node.value, ast.Tuple):
            self.line(f"result = [{', '.join(self.text(element) for element in node.value.elts)}];")
        elif node.value is not None:
            self.line(f"result = {self.hoisted(node.value)};")
        self.line("return;")


CONVERSIONS = frozenset(("bool", "float"))
CHOOSE = """function result = mr_choose(test, then, other)
    if test
        result = then;
    else
        result = other;
    end
end"""


def octave_functions(library: Library) -> str:
    """All functions and constant arrays of a library as functions of an Octave file."""
    arrays = []
    for name, values in library.arrays.items():
        rows = values if values.ndim == 2 else [values]
        text = "; ...\n        ".join(", ".join(number(value) for value in row) for row in rows)
        name = name.lstrip("_")
        arrays.append(
            f"function result = mr_array_{name}()\n    persistent kept\n    if isempty(kept)\n"
            f"        kept = [{text}];\n    end\n    result = kept;\nend"
        )
    functions = [OctavePrinter(function, library).printed() for function in library.functions]
    return "\n\n".join([*functions, *arrays, CHOOSE]) + "\n"
