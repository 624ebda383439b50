"""The command that installs an extra names the pip of the environment in which the program runs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from rig.extras import how_to_install


def test_the_pip_of_an_environment_that_is_not_activated_is_named_with_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs = tmp_path / "my rig" / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "pip").touch()
    monkeypatch.setattr(sys, "prefix", str(programs.parent))
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    monkeypatch.chdir(tmp_path)
    assert how_to_install("pdf") == "'my rig/.venv/bin/pip' install 'mr-damper-rig[pdf]'"
    monkeypatch.chdir(tmp_path / "my rig")
    assert how_to_install("pdf") == ".venv/bin/pip install 'mr-damper-rig[pdf]'"
    monkeypatch.setenv("VIRTUAL_ENV", str(programs.parent))
    assert how_to_install("pdf") == "pip install 'mr-damper-rig[pdf]'"
    monkeypatch.delenv("VIRTUAL_ENV")
    (programs / "pip").unlink()  # made without pip
    assert how_to_install("pdf").startswith("pip ")
