"""What must fail at the end of a campaign is refused before its start, by `rig plan` and `rig run`."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.cli.analysis_check import analysis_problems
from rig.cli.main import main
from rig.matrix.methods import METHODS
from rig.matrix.model import load_matrix
from rig.matrix.sections import Identify

EXAMPLES = Path(__file__).parents[3] / "examples"
QUICK = (EXAMPLES / "quick.toml").read_text(encoding="utf-8")
BENCH = str(EXAMPLES / "demo-bench.toml")
POINTS = load_matrix(EXAMPLES / "quick.toml").points()


@pytest.mark.parametrize(
    ("expected", "message"),
    [
        ({"holdout": "waveform=triangle"}, "matches none of the 2 points; they have waveform="),
        ({"holdout": "current_A=7"}, "matches none of the 2 points; they have current_A="),
        ({"holdout": "waveform=sine"}, "matches all 2 points"),
        ({"holdout": "current_A=0.5|1.5"}, "matches all 2 points"),
        ({"holdout": "verdict=valid"}, "matches all 2 points"),
        ({"holdout": "curent_A=1"}, "did you mean current_A"),
        ({"holdout": "current_A"}, "is not a condition"),
        ({"holdout": "current_A=fast"}, "expected a number"),
        ({"holdout": str(EXAMPLES)}, "is not a run"),
        ({"holdout": "last 30 %"}, "not cyclic points (p001, p002)"),
        ({"holdout": "last 95 %"}, "1 to 90 %"),
        ({"method": "zhu_three_step"}, "requires the model normalized_bouc_wen"),
        ({"model": "all", "series_spring": True}, "requires a single model"),
        ({"model": "all", "current": "per-current-affine"}, "requires a single model"),
        ({"holdout": "current_A=1.5", "current": "per-current-affine"}, "at least two different currents"),
        ({"model": "few", "series_spring": True}, "requires a single model"),
        ({"model": "few", "temperature_law": "both"}, "requires a single named model"),
        ({"method": "c_foa", "temperature_law": "viscous"}, 'method = "separable"'),
    ],
)
def test_what_cannot_be_identified_is_reported_with_its_key(expected: dict[str, object], message: str) -> None:
    (problem,) = analysis_problems(Identify.model_validate(expected), POINTS)
    assert message in problem
    assert problem.partition(" ")[0].rstrip(":") in {"holdout", "method", "series_spring", "current", "temperature_law"}


def test_the_end_of_the_time_may_be_held_out_of_signals() -> None:
    signals = [point for point in load_matrix(EXAMPLES / "signals.toml").points() if point.kind == "signal"]
    assert analysis_problems(Identify.model_validate({"holdout": "last 30 %"}), signals) == []
    assert analysis_problems(Identify.model_validate({"holdout": "waveform=road"}), signals) == []


@pytest.mark.parametrize(
    "expected",
    [
        {},
        {"holdout": "current_A=1.5"},
        {"holdout": "id=p002"},
        {"method": "zhu_three_step", "model": "normalized_bouc_wen"},
        {"model": "all"},
        {"current": "per-current-lagrange"},
        *({"method": method} for method in METHODS if method != "zhu_three_step"),
    ],
)
def test_what_can_be_identified_is_not_refused(expected: dict[str, object]) -> None:
    assert analysis_problems(Identify.model_validate(expected), POINTS) == []


@pytest.mark.parametrize("command", [("plan", "--bench", BENCH), ("run", "--simulate")], ids=["plan", "run"])
def test_plan_and_run_refuse_a_holdout_that_matches_nothing_before_anything_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: tuple[str, ...]
) -> None:
    matrix, out = tmp_path / "matrix.toml", tmp_path / "out"
    matrix.write_text(QUICK + '\n[identify]\nholdout = "waveform=triangle"\n', encoding="utf-8")
    arguments = [command[0], str(matrix), *command[1:]]
    assert main([*arguments, *(["--out", str(out)] if command[0] == "run" else [])]) == 2
    assert 'identify.holdout = "waveform=triangle": matches none of the 2 points' in capsys.readouterr().err
    assert not out.exists()
