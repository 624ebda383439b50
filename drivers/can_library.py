"""python-can without what it loads beside: the process that owns the ports stays free of numpy."""

from __future__ import annotations

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
