"""The container file: what it copies and installs is there; at night, its steps run outside of a container."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import tomllib
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
ABSOLUTE = re.compile(r"(?<![\w.}])/(?=wheels|tmp|var|src|home)")


def steps() -> list[tuple[str, str]]:
    """Instructions and their arguments."""
    lines = (ROOT / "Containerfile").read_text(encoding="utf-8").splitlines()
    return [(name, rest) for name, _, rest in (line.partition(" ") for line in lines) if name and name != "#"]


def test_what_the_container_file_copies_and_installs_is_there() -> None:
    copied = [rest.split()[:-1] for name, rest in steps() if name == "COPY" and not rest.startswith("--from")]
    assert [source for sources in copied for source in sources if not (ROOT / source).exists()] == []
    packages = {source for sources in copied for source in sources}
    assert {"rig", "drivers", "protocols", "simulators", "pyproject.toml", PROJECT["readme"]} <= packages
    (extras,) = re.findall(r"\.whl\)\[([\w,]+)\]", (ROOT / "Containerfile").read_text(encoding="utf-8"))
    assert set(extras.split(",")) <= PROJECT["optional-dependencies"].keys()
    assert dict(steps())["ENTRYPOINT"] == '["rig"]'
    assert "rig" in PROJECT["scripts"]
    (version,) = re.findall(r"ARG PYTHON=(.*)", (ROOT / "Containerfile").read_text(encoding="utf-8"))
    assert f"Programming Language :: Python :: {version}" in PROJECT["classifiers"]


@pytest.mark.nightly
@pytest.mark.wire
def test_the_steps_of_the_container_file_end_in_a_rig_that_runs(tmp_path: Path) -> None:
    """Each stage is an environment of its own, its file system a folder; `useradd` alone is left out."""
    stage, folder, environment = Path(), Path(), dict(os.environ)
    for name, text in steps():
        rest = ABSOLUTE.sub(f"{stage}/", text)
        if name == "FROM":
            before, stage = stage, tmp_path / f"stage-{len(list(tmp_path.iterdir()))}"
            venv.create(stage / "usr", with_pip=True)
            for place in ("tmp", "var/cache", "home/rig", "src"):
                (stage / place).mkdir(parents=True)
            environment["PATH"] = f"{stage / 'usr/bin'}{os.pathsep}{os.environ['PATH']}"
            folder = stage
        elif name == "WORKDIR":
            folder = Path(rest)
        elif name == "COPY" and rest.startswith("--from"):
            shutil.copytree(before / "wheels", stage / "wheels")
        elif name == "COPY":
            *sources, target = rest.split()
            for source in sources:
                place = folder / target if len(sources) == 1 else folder / target / source
                copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copy2
                copy(ROOT / source, place)
        elif name == "ENV":
            environment |= dict([rest.split("=", 1)])
        elif name == "RUN" and not rest.startswith("useradd"):
            subprocess.run(rest, shell=True, cwd=folder, env=environment, check=True)
    entry, command = (shlex.split(dict(steps())[name].strip("[]").replace(",", " ")) for name in ("ENTRYPOINT", "CMD"))
    done = subprocess.run([*entry, *command], cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert list((folder / "logs").glob("*/report.html"))
