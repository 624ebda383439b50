"""The first hour in numbers: set-up and demo on a fresh clone, size of `.venv`, time of `rig --help` and `import rig`.

python3 benchmarks/first_hour.py [FOLDER]     the clone is made in FOLDER (default: a temporary one), and removed

Goals: set-up and demo 100 s where packages are near, `.venv` 400 MB, `import rig` 0.2 s.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def timed(name: str, *command: str, cwd: Path) -> None:
    """Run a command; print its wall time and its processor time (s), those of the processes it started included."""
    before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    print(f"{name:<36} {time.monotonic() - began_s:7.2f} s, {cpu_s:7.2f} s of processor time", flush=True)
    if done.returncode:
        sys.exit(f"{' '.join(command)}: exit {done.returncode}\n{done.stdout[-2000:]}{done.stderr[-2000:]}")


def megabytes(folder: Path) -> float:
    """Room that the files of a folder take on the disk (MB)."""
    blocks = sum(path.lstat().st_blocks for path in folder.rglob("*"))
    return blocks * 512 / 1e6


def main() -> None:
    with tempfile.TemporaryDirectory(dir=sys.argv[1] if sys.argv[1:] else None) as name:
        clone = Path(name) / "clone"
        subprocess.run(("git", "clone", "--quiet", str(ROOT), str(clone)), check=True)
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
        timed("set-up (python3 dev.py demo --help)", sys.executable, "dev.py", "demo", "--help", cwd=clone)
        timed("demo, first time", sys.executable, "dev.py", "demo", cwd=clone)
        timed("demo, second time", sys.executable, "dev.py", "demo", cwd=clone)
        scripts = clone / ".venv" / "bin"
        timed("rig --help", str(scripts / "rig"), "--help", cwd=clone)
        timed("import rig", str(scripts / "python"), "-c", "import rig", cwd=clone)
        packages = sum(1 for _ in clone.glob(".venv/lib/python*/site-packages/*.dist-info"))
        print(f"{'.venv':<36} {megabytes(clone / '.venv'):7.0f} MB, {packages} packages")


if __name__ == "__main__":
    main()
