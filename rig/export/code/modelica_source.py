"""Functions printed as Modelica: a model's force, and the rates of its internal states, which the tool integrates."""

from __future__ import annotations

import ast

from rig.export.code.functions import Function, Library
from rig.export.code.printer import AND, ATOM, COMPARED, OR, Printer

CLOSED = "end"
CALLED = {"int": "integer", "asinh": "mr_asinh"}
PROVED = frozenset((
    "asymmetric_bouc_wen", "bouc_wen", "dahl", "lost_motion", "lugre", "modified_bouc_wen", "normalized_bouc_wen",
    "thinning_bouc_wen",
))  # fmt: skip
"""Models with internal states that a Modelica tool integrates to 1e-6 of our own force: a test runs every one."""
ASINH = """  function mr_asinh "Inverse hyperbolic sine without the Modelica Standard Library"
    input Real x;
    output Real result;
  algorithm
    result := (if x < 0.0 then -1.0 else 1.0)*log(abs(x) + sqrt(x*x + 1.0));
  end mr_asinh;"""


class ModelicaPrinter(Printer):
    """A function as Modelica. Numbers are all Real; what is used as an index is made an Integer there."""

    reserved = frozenset((
        "algorithm", "and", "annotation", "block", "break", "class", "connect", "constant", "der", "discrete", "each",
        "else", "elseif", "elsewhen", "encapsulated", "end", "enumeration", "equation", "expandable", "extends",
        "external", "false", "final", "flow", "for", "function", "if", "import", "impure", "in", "initial", "inner",
        "input", "loop", "model", "not", "operator", "or", "outer", "output", "package", "parameter", "partial",
        "protected", "public", "pure", "record", "redeclare", "replaceable", "return", "stream", "then", "time", "true",
        "type", "when", "while", "within", "result", "sign",
    ))  # fmt: skip
    infinity = "1e300"
    not_equal = "<>"
    closing = CLOSED

    def __init__(self, function: Function, library: Library) -> None:
        super().__init__(function, library)
        self._open: list[str] = []
        self._counters: set[str] = set()

    def printed(self) -> str:
        """See `Printer.printed`.

        Raises:
            NotTranslatable: it changes an array, which an input of a function cannot be, or ends inside of a loop.
        """
        function = self.function
        if self.library.changes(function):
            raise function.refused(ast.Name(function.name), "the function modifies an array argument")
        loops = [node for node in ast.walk(function.tree) if isinstance(node, ast.For | ast.While)]
        if any(isinstance(node, ast.Return) for loop in loops for node in ast.walk(loop)):
            raise function.refused(ast.Name(function.name), "the function returns inside a loop")
        self.indent = 1
        self.block(_returning_last(function.body))
        changed = [name for name in function.parameters if name in function.assigned]
        inputs = [
            f"input Real {self.named(name)}{'_given' if name in changed else ''}{'[:]' if name in self.arrays else ''};"
            for name in function.parameters
        ]
        own = [name for name in function.assigned if name not in function.parameters and name not in self._counters]
        held = [f"Real {self.named(name)}{f'[{self.arrays[name]}]' if self.arrays.get(name) else ''};" for name in own]
        held += [f"Real {self.named(name)} := {self.named(name)}_given;" for name in changed]
        held += [f"Real {name}{f'[{size}]' if size else ''};" for name, size in self.temporaries]
        about = ' "{}"'.format(function.about.replace("\\", "/").replace('"', "'")) if function.about else ""
        return "\n".join([
            f"  function {function.name}{about}", *(f"    {line}" for line in inputs),
            f"    output Real result{f'[{function.arity}]' if function.arity else ''};",
            *(["  protected", *(f"    {line}" for line in held)] if held else []),
            "  algorithm", *(line[4:] for line in self.lines), f"  end {function.name};",
        ])  # fmt: skip

    def line(self, text: str) -> None:
        """See `Printer.line`; what is closed is named."""
        super().line(f"end {self._open.pop()};" if text == CLOSED else text)

    def call_name(self, name: str) -> str:
        """See `Printer.call_name`."""
        return CALLED.get(name, name)

    def conditional(self, test: str, then: str, otherwise: str) -> str:
        """See `Printer.conditional`."""
        return f"(if {_truth(test)} then {then} else {otherwise})"

    def operation(self, node: ast.expr) -> tuple[str, int]:
        """See `Printer.operation`."""
        match node:
            case ast.UnaryOp(op=ast.Not()):
                return f"not ({self.text(node.operand)})", ATOM
            case ast.BoolOp():
                binds, sign = (AND, " and ") if isinstance(node.op, ast.And) else (OR, " or ")
                return sign.join(self.text(value, COMPARED) for value in node.values), binds
            case _:
                return super().operation(node)

    def comparison(self, node: ast.Compare) -> tuple[str, int]:
        """See `Printer.comparison`."""
        text, binds = super().comparison(node)
        return text.replace(" && ", " and "), binds

    def element(self, array: str, places: list[ast.expr]) -> str:
        """See `Printer.element`."""
        shown = [
            str(place.value + 1) if isinstance(place, ast.Constant) and isinstance(place.value, int)
            else f"integer({self.text(place)}) + 1"
            for place in places
        ]  # fmt: skip
        return f"{array}[{', '.join(shown)}]"

    def alone(self, node: ast.Call) -> None:
        """See `Printer.alone`; a call that changes nothing has nothing to say."""

    def let(self, target: str, value: str) -> str:
        """See `Printer.let`."""
        return f"{target} := {value};"

    def opened(self, kind: str, condition: str) -> str:
        """See `Printer.opened`."""
        if kind == "else":
            return "else"
        self._open += [kind] if kind in {"if", "while"} else []
        return f"{kind} {_truth(condition)} {'loop' if kind == 'while' else 'then'}"

    def counted(self, name: str, first: str, stop: str) -> str:
        """See `Printer.counted`."""
        self._open.append("for")
        self._counters.add(name)
        return f"for {name} in integer({first}):integer({stop}) - 1 loop"

    def returned(self, node: ast.Return) -> None:
        """See `Printer.returned`."""
        if isinstance(node.value, ast.Tuple):
            self.line(f"result := {{{', '.join(self.text(element) for element in node.value.elts)}}};")
        elif node.value is not None:
            self.line(f"result := {self.text(node.value)};")


def _returning_last(body: list[ast.stmt]) -> list[ast.stmt]:
    """The same statements, every return the last thing that is done: what followed an `if` that returns is its `else`.

    Not every Modelica tool knows `return`.
    """
    for k, node in enumerate(body):
        if isinstance(node, ast.Return):
            return body[: k + 1]
        if isinstance(node, ast.If) and any(isinstance(inner, ast.Return) for inner in ast.walk(node)):
            branches = [
                _returning_last([*branch, *([] if branch and isinstance(branch[-1], ast.Return) else body[k + 1 :])])
                for branch in (node.body, node.orelse)
            ]
            return [*body[:k], ast.If(node.test, *branches)]
    return body


def _truth(condition: str) -> str:
    """A condition; a number that stands for one as `true` or `false`."""
    try:
        return "true" if float(condition) else "false"
    except ValueError:
        return condition


def modelica_functions(library: Library) -> str:
    """All functions of a library, as they stand in a Modelica class; constant arrays are not among them."""
    printed = [ModelicaPrinter(function, library).printed() for function in library.functions]
    used = [ASINH] if any("mr_asinh(" in text for text in printed) else []
    return "\n\n".join((*used, *printed))
