"""Makes what this folder shares importable, by the processes of a pool too."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
