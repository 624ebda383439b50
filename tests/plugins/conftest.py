"""Packages installed for a test: a folder on Python's path with the metadata that pip would write beside it."""

from __future__ import annotations

import shutil
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest

from drivers import plugins

MY_LAB = Path(__file__).resolve().parents[2] / "examples" / "my-lab"
Groups = Mapping[str, Mapping[str, str]]
Install = Callable[[str, Groups, str], Path]


def entry_points(groups: Groups) -> str:
    """The file `entry_points.txt` of a package."""
    return "\n".join(
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in entries.items())
        for group, entries in groups.items()
    )


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installs a package of one module: `install("a-lab", {group: {name: target}}, source)`; the module is `a_lab`."""
    loaded = set(sys.modules)
    monkeypatch.syspath_prepend(str(tmp_path))

    def installed(package: str, groups: Groups, source: str) -> Path:
        module = package.replace("-", "_")
        (tmp_path / f"{module}.py").write_text(source, encoding="utf-8")
        about = tmp_path / f"{module}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n", encoding="utf-8")
        (about / "entry_points.txt").write_text(entry_points(groups), encoding="utf-8")
        plugins.found.cache_clear()
        return tmp_path

    yield installed
    for name in set(sys.modules) - loaded:
        if getattr(sys.modules[name], "__file__", None) and str(tmp_path) in str(sys.modules[name].__file__):
            del sys.modules[name]
    plugins.found.cache_clear()


@pytest.fixture
def my_lab(install: Install) -> Path:
    """The example package, installed."""
    project = tomllib.loads((MY_LAB / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    folder = install(project["name"], project["entry-points"], "")
    (folder / "my_lab.py").unlink()
    shutil.copytree(MY_LAB / "my_lab", folder / "my_lab")
    return folder
