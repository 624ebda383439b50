"""The notebooks run from top to bottom, each in an empty folder, and show what they promise."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from nbformat import NotebookNode

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"


@dataclass(frozen=True)
class Ran:
    """A notebook with its outputs, and the folder it ran in."""

    book: NotebookNode
    folder: Path


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Ran]:
    """Every notebook, run in one kernel that forgets all names before the next: its start and our imports take 4 s."""
    import nbformat
    from nbclient import NotebookClient

    top, whole, ran, places = tmp_path_factory.mktemp("notebooks"), nbformat.v4.new_notebook(), {}, {}
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        folder = top / path.stem
        folder.mkdir()
        book = nbformat.read(path, as_version=4)
        begin = nbformat.v4.new_code_cell(f"%reset -f\nimport os; os.chdir({str(folder)!r}); del os")
        whole.cells += [begin, *book.cells]
        places[path.stem] = slice(len(whole.cells) - len(book.cells), len(whole.cells))
        ran[path.stem] = Ran(book, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OPENBLAS_NUM_THREADS", "1")
        patch.setenv("JUPYTER_PREFER_ENV_PATH", "1")  # this environment's kernel, whatever the user has installed
        for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
            patch.setenv(variable, str(top / "ipython"))
        place = {"metadata": {"path": str(top)}}
        NotebookClient(whole, timeout=600, startup_timeout=300, kernel_name="python3", resources=place).execute()
    for name, cells in places.items():
        ran[name].book.cells = whole.cells[cells]
    return ran


def output_of(book: NotebookNode) -> str:
    """All that its cells printed and showed, as text."""
    outputs = [output for cell in book.cells for output in cell.get("outputs", ())]
    return "\n".join(output.get("text") or output["data"]["text/plain"] for output in outputs)


def pictures(book: NotebookNode) -> int:
    kinds = {"image/svg+xml", "image/png"}
    return sum(bool(kinds & {*output.get("data", {})}) for cell in book.cells for output in cell.get("outputs", ()))


def test_the_notebook_of_imported_files_finds_the_damper(ran: dict[str, Ran]) -> None:
    book = ran["from-files-to-a-model"].book
    text = output_of(book)
    row = next(line for line in text.split("\n") if line.startswith("Fyb") and "238.0" in line)
    _, value, low, high, truth = row.split()
    assert float(low) < float(truth) < float(high)
    assert float(value) == pytest.approx(238.0, rel=0.01)
    assert re.search(r"True\s+current_A", text)  # 3 A was not tested
    assert pictures(book) == 2
    assert (ran["from-files-to-a-model"].folder / "model" / "damper_asymmetric.py").is_file()


def test_the_notebook_of_two_campaigns_does_not_accept_the_worn_damper(ran: dict[str, Ran]) -> None:
    book, folder = ran["before-and-after"].book, ran["before-and-after"].folder
    assert "not accepted" in output_of(book)
    assert output_of(book).count("fail") == 2
    assert pictures(book) == 1
    assert (folder / "comparison.html").stat().st_size > 10_000
    assert {path.name for path in folder.iterdir()} == {
        "before", "after", "logs", "bands.toml", "comparison.html"}  # fmt: skip


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs_and_are_named_in_the_readme(path: Path) -> None:
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert cells
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in cells)
    assert f"docs/notebooks/{path.name}" in (NOTEBOOKS.parents[1] / "README.md").read_text(encoding="utf-8")
