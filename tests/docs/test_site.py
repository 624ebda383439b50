"""The site of the documentation is built without a warning."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    build = [sys.executable, ROOT / "docs/build_site.py", "--without-reference", "--out", tmp_path / "site"]
    done = subprocess.run(build, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    front = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert "a test-rig controller for magneto-rheological dampers" in front
    assert 'href="docs/how-to/import-tests.html"' in front
    assert (tmp_path / "site/docs/files.html").is_file()
    assert (tmp_path / "site/search/search_index.json").is_file()
