"""The documentation as a site of plain files, to read from disk or to put on any server: `python3 dev.py docs`.

Its pages are README.md, CHANGELOG.md, CONTRIBUTING.md, SECURITY.md, `docs/` and `examples/`, copied beside each other
as they lie in the project, so that every link leads where it leads there; and a reference of every name in
`docs/python.md`, made of the docstrings. Any warning ends it: a link or heading that is not there, a docstring that
cannot be read.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "LICENSE", "CITATION.cff")
NAME = re.compile(r"`((?:rig|drivers|protocols|simulators)(?:\.\w+)+)")


def lay_out(tree: Path, *, reference: bool) -> None:
    """Copy all pages; with `reference` write a page a room for the names in `docs/python.md`."""
    tree.mkdir()
    for name in PAGES:
        shutil.copy(ROOT / name, tree / name)
    for name in ("docs", "examples"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__", "*.pyc", "mkdocs.yml"))
    if not reference:
        return
    names = set(NAME.findall((ROOT / "docs" / "python.md").read_text(encoding="utf-8")))
    rooms: dict[str, list[str]] = defaultdict(list)
    for name in sorted(names):
        if not any(name.startswith(f"{other}.") for other in names):
            parts = name.split(".")
            rooms[".".join(parts[:2] if parts[0] == "rig" else parts[:1])].append(name)
    (tree / "reference").mkdir()
    for room, listed in rooms.items():
        lines = [f"# {room}", "", *(f"::: {name}\n" for name in listed)]
        (tree / "reference" / f"{room}.md").write_text("\n".join(lines), encoding="utf-8")


def build(out: Path, *, reference: bool) -> int:
    """Build the site into a folder; returns MkDocs' exit code, not 0 where anything is wrong."""
    with tempfile.TemporaryDirectory(prefix="site-") as folder:
        place = Path(folder)
        lay_out(place / "tree", reference=reference)
        settings = (ROOT / "docs" / "mkdocs.yml").read_text(encoding="utf-8")
        settings = settings.replace("        python:\n", f"        python:\n          paths: [{ROOT}]\n")
        if not reference:
            settings = re.sub(r"  - mkdocstrings:\n(?: {6,}.*\n)+", "", settings)
        (place / "mkdocs.yml").write_text(settings, encoding="utf-8")
        command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(out.resolve())]
        return subprocess.call(command, cwd=place, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"})


def main() -> int:
    """Build it where the command line says."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--out", type=Path, default=ROOT / "site")
    arguments.add_argument("--without-reference", action="store_true", help="the pages alone, in a few seconds")
    given = arguments.parse_args()
    return build(given.out, reference=not given.without_reference)


if __name__ == "__main__":
    sys.exit(main())
