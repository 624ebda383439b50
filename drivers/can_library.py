"""python-can without what it loads beside: the process that owns the ports stays free of numpy."""

from __future__ import annotations

import importlib
import logging
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import types


def import_can() -> types.ModuleType:
    """python-can without its MF4 log reader, which would load numpy and pandas into the process that owns the ports."""
    absent = "asammdf" not in sys.modules
    if absent:
        sys.modules["asammdf"] = None  # type: ignore[assignment]  # None makes the import fail, as python-can expects
    try:
        import can
    finally:
        if absent:
            del sys.modules["asammdf"]
    return can


ALWAYS_THERE = frozenset({"socketcan", "slcan", "virtual", "serial", "socketcand"})
"""Interfaces that need nothing beside python-can and pyserial."""


def missing_for(interface: str) -> str:
    """Why one of python-can's own interfaces cannot be used on this machine; empty where its package is installed.

    Whether its adapter and driver are there shows when it is opened.
    """
    if interface in ALWAYS_THERE:
        return ""
    can = import_can()
    module = can.interfaces.BACKENDS.get(interface, ("", ""))[0]
    if not module:
        return ""
    chatty = logging.getLogger("can")
    before, chatty.level = chatty.level, logging.CRITICAL
    try:
        importlib.import_module(module)
    except (ImportError, can.CanError, OSError, AttributeError) as error:
        return str(error)
    finally:
        chatty.level = before
    return ""
