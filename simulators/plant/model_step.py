"""One step of a damper model by its address, so that the plant's loop is compiled once for all models.

A compiled function that is given as an argument would do the same, but numba looks its address up by a signature that
is unpickled at every call of the loop.
"""

from __future__ import annotations

import zlib
from functools import cache
from types import FunctionType
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]  # it has no types
from numba import carray, types  # type: ignore[attr-defined]  # numba has few annotations
from numba.extending import intrinsic

from rig.dampers.compiled_cache import entry_point
from rig.dampers.integrable import Integrable
from rig.dampers.kernel import Compiled, advance_of, key_of

VECTOR = (types.CPointer(types.float64), types.int64)  # type: ignore[no-untyped-call]  # the same
STEP = types.float64(*VECTOR, *VECTOR, *5 * [types.float64])
"""(p, its length, state, its length, u, v, a, current, dt) -> force (N): `kernel.advance_of` for C."""


def address_of(model: Integrable) -> int:
    """Address of a model's step, for `advance_at`; it is compiled once for each model, and kept for the next process.

    A division by zero gives an infinity or NaN.
    """
    address: int = _entry_of(model).address
    return address


@cache
def _entry_of(model: Integrable) -> Any:  # noqa: ANN401 - numba has no types
    entry = _entry(zlib.crc32(key_of(model).encode()))
    values = {**entry.__globals__, "_advance": advance_of(model)}
    named = FunctionType(entry.__code__, values, entry.__name__, None, entry.__closure__)
    named.__qualname__ = entry.__qualname__
    return entry_point(STEP, error_model="numpy")(named)


def _entry(key: int) -> FunctionType:
    def entry(p, parameters, state, states, u, v, a, current, dt):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202 - see STEP
        return _advance(carray(p, parameters + 0 * key), carray(state, states), u, v, a, current, dt)

    return entry  # type: ignore[return-value]  # a function is one


_advance: Compiled = advance_of
"""The step of the entry's model, once it is compiled."""


def _call(typing: Any, address: Any, p: Any, state: Any, u: Any, v: Any, a: Any, current: Any, dt: Any) -> Any:  # noqa: ANN401 - numba has no types
    del typing, u, v, a, current, dt

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401 - the same
        number, vectors, instant = values[0], values[1:3], values[3:]
        passed = []
        for kind, value in zip(signature.args[1:3], vectors, strict=True):
            array = context.make_array(kind)(context, builder, value)
            passed += [array.data, array.nitems]
        passed += instant
        step = ir.FunctionType(ir.DoubleType(), [value.type for value in passed])
        return builder.call(builder.inttoptr(number, step.as_pointer()), passed)

    return types.float64(address, p, state, *5 * [types.float64]), generate


advance_at: Compiled = intrinsic(_call)
"""A step by its address, within a compiled loop: (address, p, state, u, v, a, current, dt) -> force (N).

As `kernel.advance_of`; p and state are contiguous.
"""
