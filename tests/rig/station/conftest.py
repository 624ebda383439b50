"""Makes what the station's tests share, and the devices of the driver tests, importable by them."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "drivers")]
