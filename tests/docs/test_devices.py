"""Every device that ships stands in the table that says how far it was tried."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from drivers import catalogue

DEVICES = (Path(__file__).resolve().parents[2] / "docs" / "devices.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `([\w-]+)`(?: \([^|]*\))? \|(.*)\|$", re.MULTILINE)
SECTIONS = dict(re.findall(r"^## (\w+)[^\n]*\n(.*?)(?=^## |\Z)", DEVICES, re.MULTILINE | re.DOTALL))


@pytest.mark.parametrize(
    ("section", "names"),
    [
        ("Controllers", catalogue.actuator_names()),
        ("Current", (*catalogue.known_current_source_names(), *catalogue.supply_names())),
        ("Sensors", catalogue.sensor_format_names()),
    ],
)
def test_every_preset_has_a_row_in_docs_devices_md(section: str, names: tuple[str, ...]) -> None:
    rows = dict(ROW.findall(SECTIONS[section]))
    assert set(names) - rows.keys() == set(), "add a row to docs/devices.md: golden bytes, simulated, real"


def test_no_row_claims_a_real_device() -> None:
    assert [name for name, cells in ROW.findall(DEVICES) if cells.split("|")[-1].strip() != "no"] == []
