"""What the documents promise is there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.cli.main import COMMANDS, EXIT_CODES
from rig.files.section import Section
from rig.files.toml_source import frozen
from rig.matrix.model import Matrix
from rig.units import ALIASES, UNITS

ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text()
FILES = (ROOT / "docs" / "files.md").read_text()


def keys_of(section: type[Section]) -> set[str]:
    """Every key of a file, the sections' own names left out."""
    definitions = [section.model_json_schema(by_alias=True)]
    definitions += definitions[0].get("$defs", {}).values()
    keys: set[str] = set()
    for definition in definitions:
        for key, entry in definition["properties"].items():
            inner = entry.get("items", entry)
            if "$ref" not in inner and not any("$ref" in option for option in inner.get("anyOf", [])):
                keys.add(key)
    return keys


@pytest.mark.parametrize("section", [Bench, Matrix])
def test_every_key_of_the_files_is_in_their_reference(section: type[Section]) -> None:
    documented = set(re.findall(r"[a-z_A-Z]+", FILES))
    assert keys_of(section) - documented == set()


def test_every_unit_is_in_the_reference() -> None:
    (table,) = re.findall(r"\| quantity \| units \|\n(.*?)\n\n", FILES, re.DOTALL)
    listed = {unit.strip() for unit in re.split(r"[\n,|()]+", table)}
    assert set(UNITS) - listed == set()
    assert {"°C", "µm", "µs", "Ω", "m/s2", "m/s²"} <= listed & set(ALIASES)


def test_every_command_and_exit_code_is_in_its_reference() -> None:
    page = (ROOT / "docs" / "commands.md").read_text()
    assert [name for name in COMMANDS if f"`rig {name}" not in page] == []
    assert [code for code, text in EXIT_CODES if f"| {code} | {text} |" not in page] == []


def test_the_readme_is_read_in_a_few_minutes() -> None:
    assert len(README.splitlines()) <= 120


def test_the_readmes_matrix_is_table_1() -> None:
    (snippet,) = re.findall(r"```toml\n(.*?)```", README, re.DOTALL)
    head = 'format = 1\n[specimen]\nserial_number = "MR-001"\nstroke = "170 mm"\nprior = "demo"\n'
    shown = Matrix.model_validate(frozen(tomllib.loads(head + snippet)))
    table1 = Matrix.model_validate(frozen(tomllib.loads((ROOT / "examples" / "table1.toml").read_text())))
    assert shown.points() == table1.points()


def test_every_file_the_readme_names_is_there() -> None:
    named = set(re.findall(r"(?:examples|docs)/[\w./-]*\w", README))
    assert len(named) > 4
    assert [name for name in named if not (ROOT / name).is_file()] == []
