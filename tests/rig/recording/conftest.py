"""Shared by the recording's tests: a synthetic rig's journals and finished points."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


def _load(name: str) -> ModuleType:
    """Make the module beside this file importable by tests, which live in no package."""
    specification = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module
    specification.loader.exec_module(module)
    return module


_load("synthetic_rig")


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """An empty campaign's directory."""
    folder = tmp_path / "campaign"
    (folder / "points").mkdir(parents=True)
    return folder
