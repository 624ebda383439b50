"""Every snippet of the documentation: TOML that can be read, Python that compiles and whose imports are there.

What a page promises of them is run by the page's own test, where it has one.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
import textwrap
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "how-to").glob("*.md")])
OURS = ("rig", "drivers", "protocols", "simulators")


def snippets(language: str) -> list[tuple[str, str]]:
    """Where each begins (page and line), and its text."""
    listed = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        for match in re.finditer(rf"^[ ]*```{language}\n(.*?)^[ ]*```", text, re.DOTALL | re.MULTILINE):
            line = text.count("\n", 0, match.start()) + 1
            listed.append((f"{page.relative_to(ROOT)}:{line}", textwrap.dedent(match[1])))
    return listed


def test_every_toml_snippet_can_be_read() -> None:
    wrong = {}
    for place, text in snippets("toml"):
        try:
            tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            wrong[place] = str(error)
    assert len(snippets("toml")) > 20
    assert wrong == {}


def test_every_python_snippet_compiles_and_what_it_imports_of_ours_is_there() -> None:
    wrong = {}
    for place, text in snippets("python"):
        try:
            tree = ast.parse(text)
        except SyntaxError as error:
            wrong[place] = str(error)
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OURS:
                module = importlib.import_module(str(node.module))
                missing = [name.name for name in node.names if not hasattr(module, name.name) and not submodule(
                    f"{node.module}.{name.name}")]  # fmt: skip
                wrong |= {place: f"{node.module} has no {missing}"} if missing else {}
    assert len(snippets("python")) > 20
    assert wrong == {}


def submodule(name: str) -> bool:
    return importlib.util.find_spec(name) is not None


@pytest.fixture
def two_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`logs/BEFORE` and `logs/AFTER`: a sine of 20 mm at 1 Hz, the damping a tenth less afterwards."""
    import numpy as np

    from rig.recording.importing import import_tests

    monkeypatch.chdir(tmp_path)
    t = np.arange(1500) * 0.004
    for name, share in (("BEFORE", 1.0), ("AFTER", 0.9)):
        x, force = 20.0 * np.sin(2.0 * np.pi * t), share * 800.0 * np.cos(2.0 * np.pi * t)
        rows = "\n".join(f"{a:.4f},{b:.6f},{c:.4f}" for a, b, c in zip(t, x, force, strict=True))
        Path(f"{name}.csv").write_text(f"t_s,x_mm,F_N\n{rows}\n")
        columns = {"time": "t_s", "displacement": "x_mm", "force": "F_N"}
        import_tests([Path(f"{name}.csv")], columns=columns, out=Path(name), current_A=1.0)
        Path("logs").mkdir(exist_ok=True)
        next(Path(name).iterdir()).rename(Path("logs") / name)


@pytest.mark.usefixtures("two_runs")
def test_the_recipe_of_the_page_on_comparing_runs() -> None:
    here = "docs/how-to/compare-dampers.md"
    (bands,) = [text for place, text in snippets("toml") if place.startswith(here)]
    (recipe,) = [text for place, text in snippets("python") if place.startswith(here)]
    Path("bands.toml").write_text(bands)
    names: dict[str, object] = {}
    exec(recipe, names)
    assert ">FAIL<" not in str(names["page"])
    assert ">PASS<" in str(names["page"])
    changes = {result.quantity: result.value for result in names["compared"].judgement.results}
    assert changes == pytest.approx({"rebound_force": -10.0, "energy": -10.0}, abs=0.05)
