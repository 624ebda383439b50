"""Every list of the export formats names the exporters there are."""

from __future__ import annotations

import re
from pathlib import Path

from in_process import rig

from rig.export.exporter import OWN

DOCS = Path(__file__).resolve().parents[3] / "docs"
NAMES = {one.name for one in OWN}


def test_the_help_lists_every_format() -> None:
    listed = rig("export", "--help").stdout.split("Formats of a run", 1)[1]
    assert set(re.findall(r"^ +(\w+) {2,}\S", listed, re.MULTILINE)) >= NAMES


def test_the_page_of_the_formats_lists_every_format_with_what_it_exports() -> None:
    text = (DOCS / "how-to/plug-in-an-export.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`[^|]+) \| (run|fit) \|", text, re.MULTILINE)
    listed = {(name, takes) for names, takes in rows for name in re.findall("`([^`]+)`", names)}
    assert listed == {(one.name, one.takes) for one in OWN}


def test_the_page_of_the_commands_lists_every_format() -> None:
    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    (row,) = [line for line in text.splitlines() if line.startswith("| `rig export ")]
    assert set(re.findall("`([^`]+)`", row)[1:]) == NAMES
