"""The notebooks run from top to bottom in a kernel of their own, in an empty folder, and show what they promise."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from nbformat import NotebookNode

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> NotebookNode:
    """The notebook with its outputs."""
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    monkeypatch.setenv("JUPYTER_PREFER_ENV_PATH", "1")  # this environment's kernel, whatever the user has installed
    for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
        monkeypatch.setenv(variable, str(folder / "ipython"))
    book = nbformat.read(NOTEBOOKS / f"{name}.ipynb", as_version=4)
    place = {"metadata": {"path": str(folder)}}
    NotebookClient(book, timeout=600, startup_timeout=300, kernel_name="python3", resources=place).execute()
    return book


def output_of(book: NotebookNode) -> str:
    """All that its cells printed and showed, as text."""
    outputs = [output for cell in book.cells for output in cell.get("outputs", ())]
    return "\n".join(output.get("text") or output["data"]["text/plain"] for output in outputs)


def pictures(book: NotebookNode) -> int:
    return sum("image/svg+xml" in output.get("data", {}) for cell in book.cells for output in cell.get("outputs", ()))


def test_the_notebook_of_imported_files_finds_the_damper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    book = run("from-files-to-a-model", tmp_path, monkeypatch)
    text = output_of(book)
    row = next(line for line in text.split("\n") if line.startswith("Fyb") and "238.0" in line)
    _, value, low, high, truth = row.split()
    assert float(low) < float(truth) < float(high)
    assert float(value) == pytest.approx(238.0, rel=0.01)
    assert re.search(r"True\s+current_A", text)  # 3 A was not tested
    assert pictures(book) == 1


def test_the_notebook_of_two_campaigns_does_not_accept_the_worn_damper(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    book = run("before-and-after", tmp_path, monkeypatch)
    assert "not accepted" in output_of(book)
    assert output_of(book).count("fail") == 2
    assert pictures(book) == 1
    assert (tmp_path / "comparison.html").stat().st_size > 10_000
    assert {path.name for path in tmp_path.iterdir()} - {"ipython"} == {
        "before", "after", "logs", "bands.toml", "comparison.html"}  # fmt: skip


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs_and_are_named_in_the_readme(path: Path) -> None:
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert cells
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    assert f"docs/notebooks/{path.name}" in (NOTEBOOKS.parents[1] / "README.md").read_text(encoding="utf-8")
