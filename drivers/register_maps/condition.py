"""Conditions on quantities: what makes a state, a fault, an input; what a recipe waits for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.register_maps.quantity import Quantity, Value, same

Values = Mapping[str, Value]

COMPARISONS = ("equals", "not_equals", "at_least", "at_most", "one_of")


@dataclass(frozen=True)
class Test:
    """One comparison.

    Attributes:
        quantity: what is looked at.
        comparison: one of `COMPARISONS`.
        expected: numbers (SI), or the names of a recipe's values with their "$"; one but for "one_of".
        bit: of the quantity's whole number; None: all of it.
    """

    quantity: Quantity
    comparison: str = "not_equals"
    expected: tuple[Value, ...] = (0,)
    bit: int | None = None

    def holds(self, values: Values, given: Values) -> bool:
        """Whether it is so.

        Args:
            values: what the device shows (SI), by quantity.
            given: a recipe's values by name.
        """
        shown = values[self.quantity.name]
        if self.bit is not None:
            shown = int(shown) >> self.bit & 1
        requested = [given[name[1:]] if isinstance(name, str) else name for name in self.expected]
        first, step = requested[0], self.quantity.step if self.bit is None else 1.0
        if self.comparison == "at_least":
            return float(shown) >= float(first)
        if self.comparison == "at_most":
            return float(shown) <= float(first)
        equal = any(same(shown, one, 0.0 if self.quantity.whole else step) for one in requested)
        return equal is (self.comparison != "not_equals")


@dataclass(frozen=True)
class Condition:
    """All of its tests hold; one without tests always does."""

    tests: tuple[Test, ...] = ()

    def holds(self, values: Values, given: Values | None = None) -> bool:
        """Whether all hold, for what the device shows and a recipe's values."""
        return all(test.holds(values, given or {}) for test in self.tests)

    @property
    def quantities(self) -> frozenset[Quantity]:
        """What it looks at."""
        return frozenset(test.quantity for test in self.tests)
