"""The site of the documentation is built without a warning, and every licence and package is told."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    build = [sys.executable, ROOT / "docs/build_site.py", "--without-reference", "--out", tmp_path / "site"]
    done = subprocess.run(build, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    front = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert "A test-rig controller for magneto-rheological dampers" in front
    assert 'href="docs/how-to/import-tests.html"' in front
    assert (tmp_path / "site/docs/files.html").is_file()
    assert (tmp_path / "site/search/search_index.json").is_file()


def test_every_package_that_is_asked_for_has_its_licence_in_the_table() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"].values()
    wanted = [*project["dependencies"], *(name for extra in extras for name in extra)]
    names = {re.split(r"[<>=!~\[; ]", one, maxsplit=1)[0].lower() for one in wanted} - {"mr-damper-rig"}
    table = (ROOT / "docs/licences.md").read_text(encoding="utf-8").lower()
    rows = re.findall(r"^\| (`[^|]+) \|", table, re.MULTILINE)
    listed = {name for row in rows for name in re.findall(r"`([^`]+)`", row)}
    assert sorted(names - listed) == []
