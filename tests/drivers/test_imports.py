"""The process that owns the ports stays small: no numpy, no pandas, whatever python-can would like to load."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = """
import sys
import drivers.catalogue, drivers.modbus_actuator, drivers.can_current_source, drivers.serial_sensor, drivers.ring
from drivers.can_port import CanPort
from drivers.connection import CanAddress
import drivers.can_port
port = CanPort(CanAddress("virtual", "imports"))
port.open()
port.close()
import drivers.slcan_bus
from drivers.devices.source import current_source
current_source("demo")
heavy = {"numpy", "pandas", "h5py", "scipy", "numba", "matplotlib", "asammdf"} & set(sys.modules)
assert not heavy, heavy
rss_kB = int(next(line for line in open("/proc/self/status") if line.startswith("VmRSS")).split()[1])
assert rss_kB < 45 * 1024, rss_kB
try:
    import asammdf
except ImportError:
    pass
else:
    assert asammdf.__file__, "as before"
"""


def run(path: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PYTHONPATH": path}
    return subprocess.run(
        [sys.executable, "-c", SCRIPT],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=60,
    )


def test_drivers_load_no_numeric_package_and_stay_small() -> None:
    done = run(str(ROOT))
    assert done.returncode == 0, done.stderr


def test_neither_do_they_with_python_cans_mf4_extra_installed(tmp_path: Path) -> None:
    (tmp_path / "asammdf").mkdir()
    (tmp_path / "asammdf" / "__init__.py").write_text("marker = True\n")
    (tmp_path / "asammdf" / "mdf.py").write_text("import numpy\n")
    done = run(f"{tmp_path}{os.pathsep}{ROOT}")
    assert done.returncode == 0, done.stderr
