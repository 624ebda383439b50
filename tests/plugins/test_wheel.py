"""The example project beside the wheel, both installed elsewhere: its tests pass there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MY_LAB = ROOT / "examples" / "my-lab"

LEFT_OUT = shutil.ignore_patterns(".[!b]*", "logs", "tests", "docs", "benchmarks", "__pycache__")


def wheel(project: Path, into: Path) -> Path:
    """The wheel of a project, built without anything from elsewhere."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(into)]
    subprocess.run(command, cwd=project, check=True, capture_output=True)
    (built,) = into.glob("*.whl")
    return built


def keep_compiled(site: Path) -> None:
    """Let numba find what it has compiled of the same files here; without it the test compiles for half a minute."""
    for package in ("rig", "simulators"):
        for source in (ROOT / package).rglob("*.py"):
            copied, written = site / source.relative_to(ROOT), source.stat()
            os.utime(copied, ns=(written.st_atime_ns, written.st_mtime_ns))
        for compiled in (ROOT / package).rglob("__pycache__/*.nb?"):
            place = site / compiled.relative_to(ROOT)
            place.parent.mkdir(exist_ok=True)
            shutil.copy2(compiled, place)


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Python of a new environment with both wheels; what they need is taken from this one, but for the editable one."""
    place = tmp_path_factory.mktemp("elsewhere")
    venv.create(place / "venv")
    python = place / "venv" / "bin" / "python"
    (site,) = (place / "venv").glob("lib/python*/site-packages")
    for number, project in enumerate((ROOT, MY_LAB)):
        source = place / f"source{number}"
        shutil.copytree(project, source, ignore=LEFT_OUT)
        with zipfile.ZipFile(wheel(source, place / f"wheel{number}")) as built:
            built.extractall(site)
    keep_compiled(site)
    (site / "needed.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return python


def ran(python: Path, *arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A program of the new environment."""
    command = [str(python), "-P", "-m", *arguments]
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "PYTEST"))}
    return subprocess.run(command, cwd=cwd, env=surroundings, capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.nightly
def test_the_wheel_brings_its_pytest_plug_in_and_finds_the_labs_plug_ins(installed: Path, tmp_path: Path) -> None:
    listed = ran(installed, "rig.cli.main", "plugins", cwd=tmp_path)
    assert listed.returncode == 0, listed.stdout + listed.stderr
    assert len(re.findall(r" ok *$", listed.stdout, re.MULTILINE)) == 5
    where = ran(installed, "pytest", "--fixtures", "-q", cwd=tmp_path)
    for fixture in ("simulated_rig", "bench", "campaign", "world", "faults", "matrix"):
        assert f"\n{fixture} " in where.stdout or f"\n{fixture}\n" in where.stdout, fixture
    assert f"{ROOT}/simulators" not in where.stdout


@pytest.mark.nightly
def test_the_labs_own_tests_pass_beside_the_wheel(installed: Path, tmp_path: Path) -> None:
    """A fault in a campaign on its bench: its driver in the station, its model in the plant."""
    lab = tmp_path / "my-lab"
    shutil.copytree(MY_LAB, lab, ignore=shutil.ignore_patterns("my_lab", "__pycache__"))
    tested = ran(installed, "pytest", "-q", "-k", "estop", "-p", "no:cacheprovider", cwd=lab)
    assert tested.returncode == 0, tested.stdout + tested.stderr
    assert "1 passed" in tested.stdout
