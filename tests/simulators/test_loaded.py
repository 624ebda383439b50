"""A simulated rig is there soon: it loads what its own devices need."""

from __future__ import annotations

import subprocess
import sys

LOADED = """
import sys
import simulators.rig
unused = {"asammdf", "can", "cantools", "h5py", "matplotlib", "pandas", "pydantic", "scipy.linalg", "scipy.signal"}
print(sorted(unused & set(sys.modules)))
"""


def test_the_usual_rig_loads_neither_a_can_library_nor_tables_nor_scipys_rooms() -> None:
    assert subprocess.check_output([sys.executable, "-c", LOADED], text=True).strip() == "[]"
