"""Options of an earlier import for files of the same layout: what is taken, what is not, and what is named."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from in_process import rig

from rig.errors import FileProblem
from rig.recording.import_preset import ImportPreset
from rig.recording.importing import import_tests
from rig.recording.run import Run

T = np.arange(400) * 0.01
X, F = 20.0 * np.sin(2.0 * np.pi * T), -900.0 * np.cos(2.0 * np.pi * T)
COLUMNS = {"time": "Zeit", "displacement": "Weg:mm", "force": "Kraft"}


def table(path: Path, names: str = "Zeit;Weg;Kraft", units: str = "s;mm;N", size: float = 1.0) -> Path:
    rows = "".join(f"{t:.3f};{x:.4f};{size * f:.4f}\n" for t, x, f in zip(T, X, F, strict=True))
    path.write_text(f"{names}\n{units}\n{rows}")
    return path


@pytest.fixture(scope="module")
def earlier(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("earlier")
    file = table(folder / "first.csv")
    return import_tests([file], columns=COLUMNS, scales={"force": -1}, current_A=0.5, out=folder)


def force_N(run: Path) -> Sequence[float]:
    return [float(np.max(point.force_N)) for point in Run.open(run).points]


def test_columns_units_and_scales_are_those_of_the_earlier_import(earlier: Path, tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = import_tests([table(tmp_path / "a.csv", size=0.5)], like=earlier, current_A=1.0, out=tmp_path)
    (point,) = Run.open(run).points
    assert (point.current_A, point.verdict) == (1.0, "valid")
    assert "force Kraft (N, from the file, times -1)" in str(point.provenance["read_as"])
    assert force_N(run) == pytest.approx([450.0])
    held = json.loads((run / "campaign.json").read_text())
    assert held["like"] == {"run": earlier.name, "differences": []}
    assert held["import"]["settings"]["columns"] == COLUMNS
    words = (run / "campaign.json").read_text().replace("from the file", "the file says")
    (run / "campaign.json").write_text(words)  # of an earlier version
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = import_tests([tmp_path / "a.csv"], like=run, current_A=1.0, out=tmp_path)
    assert force_N(again) == force_N(run)


def test_a_fixed_current_belongs_to_the_test_and_is_not_taken(earlier: Path, tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match=r"with the coil current 0\.5 A, which may not apply to these files"):
        import_tests([table(tmp_path / "a.csv")], like=earlier, out=tmp_path)


def test_a_unit_by_the_file_is_read_rightly_and_its_change_is_named(earlier: Path, tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    file.write_text("Zeit;n;Weg;Kraft\ns;-;mm;kN\n" + "".join(
        f"{t:.3f};1;{x:.4f};{1e-3 * f:.7f}\n" for t, x, f in zip(T, X, F, strict=True)
    ))
    with pytest.warns(UserWarning, match="differs from") as caught:
        run = import_tests([file], like=earlier, current_A=1.0, out=tmp_path)
    texts = [str(one.message).split(f"{file}: ")[1] for one in caught]
    assert texts == [
        "displacement in column 3 instead of 2",
        "force in kN (from the file, times -1) instead of N (from the file, times -1)",
        "force in column 4 instead of 3", "new column(s): n",
    ]  # fmt: skip
    assert force_N(run) == pytest.approx([900.0])


@pytest.mark.parametrize(("columns", "scales", "names", "units", "problem"), [
    (COLUMNS, {}, "Zeit;Weg;Kraft", "s;in;N", "displacement: the file states the unit 'in' for 'Weg'"),
    ({**COLUMNS, "displacement": "Weg"}, {"force": 2.5}, "Zeit;Weg;Kraft", "s;mm;daN",
     "force: the file states the unit 'daN'.*read the numbers as daN"),
    ({**COLUMNS, "force": "#3"}, {}, "Zeit;Weg;Sollkraft", "s;mm;N", "column #3 is 'Sollkraft'.*it was 'Kraft'"),
    (COLUMNS, {}, "t;Weg;Kraft", "s;mm;N", "no column 'Zeit'; columns: t, Weg, Kraft(.|\n)*options of"),
])  # fmt: skip
def test_a_file_that_contradicts_the_options_is_refused(  # unless the user states the column anew
    columns: dict[str, str], scales: dict[str, float], names: str, units: str, problem: str, tmp_path: Path
) -> None:
    first = table(tmp_path / "first.csv")
    earlier = import_tests([first], columns=columns, scales=scales, current_A=0.5, out=tmp_path / "first")
    file = table(tmp_path / "a.csv", names, units, size=0.1)
    with pytest.raises(FileProblem, match=problem):
        import_tests([file], like=earlier, current_A=0.5, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()
    if "Zeit" in names:
        quantity = problem.split(":", 1)[0] if ":" in problem else "force"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            import_tests([file], like=earlier, columns={quantity: {"displacement": "Weg", "force": "#3"}[quantity]},
                         scales={"force": 1.0}, current_A=0.5, out=tmp_path / "out")  # fmt: skip


def test_new_options_replace_those_that_exclude_them(earlier: Path, tmp_path: Path) -> None:
    result = rig("import", str(table(tmp_path / "a_0.7A.csv")), "--like", str(earlier), "--rate", "200 Hz",
                 "--current-from-name", r"_(?P<current>[0-9.]+)A", "--dry-run", "--json")  # fmt: skip
    (point,) = json.loads(result.stdout)["points"]
    assert (point["current_A"], "Zeit" in point["read_as"]) == (0.7, False)


@pytest.mark.parametrize(("changed", "problem"), [
    ({"imported": False}, "this run was recorded, not imported"), ({"import": None}, "import: "),
    ({"import": {"settings": {"columns": {"force": 3}}, "waveform": "sine"}}, r"import\.settings\.columns\.force"),
])  # fmt: skip
def test_runs_without_usable_options_are_named(
    changed: dict[str, object], problem: str, earlier: Path, tmp_path: Path
) -> None:
    held = json.loads((earlier / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps({**held, **changed}))
    with pytest.raises(FileProblem, match=problem):
        ImportPreset.of_run(tmp_path)
