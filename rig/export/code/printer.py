"""Functions printed in a language whose expressions look like C's: what C, Modelica and Octave have in common."""

from __future__ import annotations

import ast
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from rig.export.code.functions import MATHEMATICS, Function, Library

OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", 5), ast.Sub: ("-", 5), ast.Mult: ("*", 6), ast.Div: ("/", 6),
}  # fmt: skip
COMPARISONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
OR, AND, COMPARED, UNARY, POWER, ATOM = 1, 2, 4, 7, 8, 9


def number(value: float) -> str:
    """A number that reads back as the same double."""
    return repr(float(value))


class Printer(ABC):
    """One function in a language whose expressions look like C's.

    Args:
        function: which.
        library: the functions that it may call.
    """

    reserved: ClassVar[frozenset[str]]
    infinity: ClassVar[str]
    negation: ClassVar[str] = "!"
    not_equal: ClassVar[str] = "!="
    closing: ClassVar[str]

    def __init__(self, function: Function, library: Library) -> None:
        self.function = function
        self.library = library
        self.lines: list[str] = []
        self.indent = 1
        self.temporaries: list[tuple[str, int]] = []
        self.arrays: dict[str, int] = dict.fromkeys(function.arrays, 0)
        """Names that are arrays; their length where they are this function's own."""

    @abstractmethod
    def printed(self) -> str:
        """The whole function."""

    @abstractmethod
    def conditional(self, test: str, then: str, otherwise: str) -> str:
        """`then` where `test` holds, else `otherwise`."""

    @abstractmethod
    def element(self, array: str, places: list[ast.expr]) -> str:
        """An array's element."""

    @abstractmethod
    def alone(self, node: ast.Call) -> None:
        """A call as a statement."""

    @abstractmethod
    def opened(self, kind: str, condition: str) -> str:
        """The line that opens `if`, `elseif`, `else` or `while`."""

    @abstractmethod
    def counted(self, name: str, first: str, stop: str) -> str:
        """The line that opens a loop over whole numbers."""

    @abstractmethod
    def returned(self, node: ast.Return) -> None:
        """Statements that end the function."""

    def power(self, base: ast.expr, exponent: ast.expr) -> tuple[str, int]:
        """A power, and how tightly it binds."""
        return f"{self.text(base, ATOM)} ^ {self.text(exponent, ATOM)}", POWER

    def called(self, function: Function, arguments: list[ast.expr]) -> str:
        """A call whose value is a number."""
        return f"{function.name}({', '.join(self.text(argument) for argument in arguments)})"

    def several(self, function: Function, arguments: list[ast.expr]) -> str:
        """A call whose value is a tuple: made a statement; the name of an array that holds it."""
        held = self.temporary(function.arity)
        self.line(self.let(held, self.called(function, arguments)))
        return held

    def hoisted(self, node: ast.expr) -> str:
        """The value of a call that also changes an array, of any other expression itself."""
        return self.text(node)

    def let(self, target: str, value: str) -> str:
        """An assignment."""
        return f"{target} = {value};"

    def call_name(self, name: str) -> str:
        """How a function of the language is called."""
        return name

    def named(self, name: str) -> str:
        """A name that the language allows."""
        name = name.lstrip("_") or "k"
        return f"{name}_" if name in self.reserved else name

    def line(self, text: str) -> None:
        """One line of code."""
        self.lines.append("    " * self.indent + text)

    def temporary(self, size: int = 0) -> str:
        """A new name; an array of `size`, 0 for a number."""
        name = f"t{len(self.temporaries) + 1}_"
        self.temporaries.append((name, size))
        return name

    # Expressions

    def text(self, node: ast.expr, outer: int = 0) -> str:
        """An expression, in parentheses where it binds less than `outer`."""
        text, binds = self.expression(node)
        return f"({text})" if binds < outer else text

    def expression(self, node: ast.expr) -> tuple[str, int]:
        """An expression and how tightly it binds.

        Raises:
            NotTranslatable: it has no counterpart here.
        """
        match node:
            case ast.Constant(value=int() | float() as value):
                return number(value), ATOM
            case ast.Name():
                return self.name(node), ATOM
            case ast.Attribute():
                return self.attribute(node), ATOM
            case ast.IfExp():
                return self.conditional(*(self.text(part, OR) for part in (node.test, node.body, node.orelse))), ATOM
            case ast.Subscript(value=ast.Name(id=array)):
                places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
                return self.element(self.named(array), places), ATOM
            case ast.Call(func=ast.Name(id="float" | "bool"), args=[inner]):
                return self.expression(inner)
            case ast.Call():
                return self.call(node), ATOM
            case _:
                return self.operation(node)

    def operation(self, node: ast.expr) -> tuple[str, int]:
        """An operation on numbers, and how tightly it binds.

        Raises:
            NotTranslatable: it has no counterpart here.
        """
        match node:
            case ast.UnaryOp(op=ast.USub()):
                return f"-{self.text(node.operand, UNARY)}", UNARY
            case ast.UnaryOp(op=ast.Not()):
                return f"{self.negation}({self.text(node.operand)})", UNARY
            case ast.BinOp(op=ast.Pow()):
                return self.power(node.left, node.right)
            case ast.BinOp(op=ast.FloorDiv()):
                return f"floor({self.text(node.left, 6)} / {self.text(node.right, 7)})", ATOM
            case ast.BinOp() if type(node.op) in OPERATORS:
                sign, binds = OPERATORS[type(node.op)]
                return f"{self.text(node.left, binds)} {sign} {self.text(node.right, binds + 1)}", binds
            case ast.Compare():
                return self.comparison(node)
            case ast.BoolOp():
                binds, sign = (AND, " && ") if isinstance(node.op, ast.And) else (OR, " || ")
                return sign.join(self.text(value, COMPARED) for value in node.values), binds
            case _:
                raise self.function.refused(node, f"{type(node).__name__} is not supported")

    def name(self, node: ast.Name) -> str:
        """A variable, or the value of a constant."""
        local = node.id in self.function.parameters or node.id in self.function.assigned
        if local or node.id in self.library.arrays:
            return self.named(node.id)
        value = self.function.known.get(node.id)
        if isinstance(value, int | float | np.integer | np.floating):
            return f"({number(float(value))})" if value < 0 else number(float(value))
        raise self.function.refused(node, "unknown name")

    def attribute(self, node: ast.Attribute) -> str:
        """`math.inf`, or how long the state is."""
        if ast.unparse(node) == "math.inf":
            return self.infinity
        if node.attr == "size" and isinstance(node.value, ast.Name) and node.value.id in self.arrays:
            return str(self.library.states)
        raise self.function.refused(node, "unknown attribute")

    def comparison(self, node: ast.Compare) -> tuple[str, int]:
        """One comparison, or a chain of them."""
        sides = [node.left, *node.comparators]
        parts = []
        for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
            if type(operator) not in COMPARISONS:
                raise self.function.refused(node, "unknown comparison")
            sign = COMPARISONS[type(operator)].replace("!=", self.not_equal)
            parts.append(f"{self.text(left, 5)} {sign} {self.text(right, 5)}")
        return " && ".join(parts), COMPARED if len(parts) == 1 else AND

    def call(self, node: ast.Call) -> str:
        """A call of one of the library's functions, or of mathematics."""
        match node.func:
            case ast.Name(id="abs" | "min" | "max" | "int" as name):
                return f"{self.call_name(name)}({', '.join(self.text(argument) for argument in node.args)})"
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name in MATHEMATICS:
                return f"{self.call_name(name)}({', '.join(self.text(argument) for argument in node.args)})"
            case ast.Name(id=name) if (function := self.library.function(self.function, name)) is not None:
                return self.called(function, node.args)
        raise self.function.refused(node, "unknown function")

    # Statements

    def block(self, body: list[ast.stmt]) -> None:
        """Statements, one step further in."""
        self.indent += 1
        for statement in body:
            self.statement(statement)
        self.indent -= 1

    def statement(self, node: ast.stmt) -> None:
        """One statement.

        Raises:
            NotTranslatable: it has no counterpart here.
        """
        match node:
            case ast.Assign():
                value = node.value
                for target in node.targets:
                    self.assignment(target, value)
                    value = target if isinstance(target, ast.Name) else value
            case ast.AugAssign():
                self.assignment(node.target, ast.BinOp(_read(node.target), node.op, node.value))
            case ast.If():
                self.condition(node)
            case ast.While():
                self.line(self.opened("while", self.text(node.test)))
                self.block(node.body)
                self.line(self.closing)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=arguments)):
                bounds = [self.text(argument) for argument in arguments]
                first, stop = bounds if len(bounds) == 2 else ("0", bounds[0])
                self.line(self.counted(self.named(name), first, stop))
                self.block(node.body)
                self.line(self.closing)
            case ast.Continue() | ast.Break():
                self.line(f"{type(node).__name__.lower()};")
            case ast.Return():
                self.returned(node)
            case ast.Expr(value=ast.Call() as call):
                self.alone(call)
            case ast.Expr(value=ast.Constant()) | ast.Pass():
                return
            case _:
                raise self.function.refused(node, f"{type(node).__name__} is not supported")

    def condition(self, node: ast.If) -> None:
        """An `if` with all its branches."""
        self.line(self.opened("if", self.hoisted(node.test)))
        self.block(node.body)
        if node.orelse:
            self.line(self.opened("else", ""))
            self.block(node.orelse)
        self.line(self.closing)

    def assignment(self, target: ast.expr, value: ast.expr) -> None:
        """Numbers, tuples, and tuples taken apart."""
        size = self.size_of(value)
        if not size:
            place = self.named(target.id) if isinstance(target, ast.Name) else self.text(_read(target))
            self.line(self.let(place, self.hoisted(value)))
            return
        parts = self.parts(value, size, {node.id for node in ast.walk(target) if isinstance(node, ast.Name)})
        if isinstance(target, ast.Name):
            self.arrays[target.id] = size
        elif not isinstance(target, ast.Tuple) or len(target.elts) != size:
            raise self.function.refused(target, f"the value must be assigned to one name or unpacked into {size} names")
        for k, part in enumerate(parts):
            place = self.part(self.named(target.id), k) if isinstance(target, ast.Name) else self.text(
                _read(target.elts[k]))
            self.line(self.let(place, part))

    def part(self, array: str, k: int) -> str:
        """Element k of an array."""
        return self.element(array, [ast.Constant(k)])

    def parts(self, value: ast.expr, size: int, targets: set[str]) -> list[str]:
        """The elements of a tuple, safe against what the assignment of one of the targets does to the next."""
        if isinstance(value, ast.Tuple):
            if not targets & {node.id for node in ast.walk(value) if isinstance(node, ast.Name)}:
                return [self.text(element) for element in value.elts]
            kept = [self.temporary() for _ in value.elts]
            for name, element in zip(kept, value.elts, strict=True):
                self.line(self.let(name, self.text(element)))
            return kept
        if isinstance(value, ast.Name):
            return [self.part(self.named(value.id), k) for k in range(size)]
        function = self.called_by(value)
        if function is None or not isinstance(value, ast.Call):
            raise self.function.refused(value, "expected a tuple")
        held = self.several(function, value.args)
        return [self.part(held, k) for k in range(size)]

    def called_by(self, value: ast.expr) -> Function | None:
        """The library's function that an expression is a call of."""
        if isinstance(value, ast.Call) and isinstance(value.func, ast.Name):
            return self.library.function(self.function, value.func.id)
        return None

    def size_of(self, value: ast.expr) -> int:
        """Of a tuple, its length; 0 for a number."""
        if isinstance(value, ast.Tuple):
            return len(value.elts)
        if isinstance(value, ast.Name) and value.id in self.arrays:
            return self.arrays[value.id] or self.taken_apart(value.id)
        function = self.called_by(value)
        return 0 if function is None else function.arity

    def taken_apart(self, name: str) -> int:
        """Length of a parameter that is a tuple: by the statement that takes it apart."""
        for node in ast.walk(self.function.tree):
            match node:
                case ast.Assign(targets=[ast.Tuple(elts=parts)], value=ast.Name(id=found)) if found == name:
                    return len(parts)
        return 0


def _read(target: ast.expr) -> ast.expr:
    """A target as the expression that reads it."""
    return ast.parse(ast.unparse(target), mode="eval").body
