"""Causes of a drift are distinguished; rows of the database become series; bad sets of rows are named."""

from __future__ import annotations

import importlib.util
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from in_process import rig

from rig.comparison import load_bands
from rig.display import Display
from rig.document import html
from rig.document.figure import Style
from rig.errors import FileProblem
from rig.process_quality.display_units import in_display
from rig.process_quality.document import blocks_of, chart_figures, document_of
from rig.process_quality.golden import Cause, Key, golden_check
from rig.process_quality.study import Limits, chart_study, gauge_studies, golden_study
from rig.results.reader import ResultRow

BEGIN = datetime(2026, 3, 2, 7, 0, tzinfo=UTC)
DAYS, BASELINE = 32, 25
CURRENTS_A = (0.0, 0.5, 1.0)
REBOUND_N = {0.0: 180.0, 0.5: 340.0, 1.0: 500.0}
COMPRESSION_N = {0.0: -280.0, 0.5: -440.0, 1.0: -600.0}
EXAMPLE = Path(__file__).parents[3] / "examples" / "many_specimens.py"
Change = Callable[[str, float, float], float]
"""Quantity, current, value -> value of a day on which something has drifted."""


def days(change: Change, *, gain: bool = True, spread: float = 0.002) -> dict[Key, np.ndarray]:
    """A golden damper's values; from the last day on something has drifted."""
    random = np.random.default_rng(11)
    truth: dict[Key, float] = {}
    for current_A in CURRENTS_A:
        truth |= {
            Key("rebound_force", "sine", current_A): REBOUND_N[current_A],
            Key("jounce_force", "sine", current_A): COMPRESSION_N[current_A],
            Key("energy", "sine", current_A): 0.1 * (REBOUND_N[current_A] - COMPRESSION_N[current_A]),
            Key("damping", "sine", current_A): 4.0 * (REBOUND_N[current_A] - COMPRESSION_N[current_A]),
            Key("measured_amplitude", "sine", current_A): 0.03,
            Key("measured_current", "sine", current_A): current_A,
            Key("coil_temperature", "sine", current_A): 25.0,
        }
    truth[Key("dynamic_range", "sine", 1.0)] = 2.4
    if gain:
        truth[Key("force_gain")] = 1.0
    values = {}
    for key, value in truth.items():
        size = 0.3 if key.quantity == "coil_temperature" else 0.001 if value == 0.0 else spread * abs(value)
        column = value + size * random.standard_normal(DAYS)
        column[-1] = change(key.quantity, key.current_A or 0.0, value)
        values[key] = column
    return values


FORCES = {"rebound_force", "jounce_force", "energy", "damping"}


def more_current(quantity: str, current_A: float, value: float) -> float:
    """3 % more current: forces follow their slope."""
    forces = {"rebound_force": REBOUND_N, "jounce_force": COMPRESSION_N}
    if quantity in forces:
        table = forces[quantity]
        return value + 0.03 * current_A * (table[1.0] - table[0.0])
    if quantity in {"energy", "damping"}:
        return value * (1.0 + 0.03 * current_A * 640.0 / (460.0 + 640.0 * current_A))
    if quantity == "dynamic_range":
        return value * (1.0 + 0.03 * 320.0 / 500.0)
    return value * 1.03 if quantity == "measured_current" else value


DRIFTS: dict[Cause, tuple[Change, float]] = {
    Cause.FORCE: (lambda name, _, value: 1.02 * value if name in {*FORCES, "force_gain"} else value, 2.0),
    Cause.FORCE_ZERO: (
        lambda name, _, value: value + 12.0 if name in {"rebound_force", "jounce_force"} else value, 12.0
    ),
    Cause.DISPLACEMENT: (
        lambda name, _, value: value * {"measured_amplitude": 1.02, "energy": 1.02, "damping": 0.98}.get(name, 1.0), 2.0
    ),
    Cause.CURRENT: (more_current, 3.0),
    Cause.TEMPERATURE: (
        lambda name, _, value: value + 8.0 if name == "coil_temperature" else 0.96 * value if name in FORCES else value,
        8.0,
    ),
    Cause.SPECIMEN: (lambda name, _, value: 0.98 * value if name in FORCES else value, -2.0),
}


@pytest.mark.parametrize("cause", list(DRIFTS))
def test_what_has_drifted_is_told_apart_with_its_size(cause: Cause) -> None:
    change, size = DRIFTS[cause]
    check = golden_check(days(change), BASELINE)
    assert not check.passed
    finding = check.findings[-1]
    assert [one.cause for one in finding.explanations] == [cause]
    (one,) = finding.explanations
    assert abs(one.size - size) < 4.0 * one.std
    assert one.share > 0.8


def test_without_a_second_instrument_sensor_and_damper_are_not_told_apart() -> None:
    check = golden_check(days(DRIFTS[Cause.FORCE][0], gain=False), BASELINE)
    assert {one.cause for one in check.findings[-1].explanations} == {Cause.FORCE, Cause.SPECIMEN}


def test_a_day_like_the_others_passes_and_gaps_are_named() -> None:
    values = days(lambda _name, _current, value: value)
    values[Key("gas_force")] = np.full(DAYS, np.nan)
    check = golden_check(values, BASELINE)
    assert check.passed
    assert check.missing == (Key("gas_force"),)


def test_a_day_without_forces_does_not_end_the_check_of_forces() -> None:
    values = days(DRIFTS[Cause.FORCE][0])
    for key, column in values.items():
        if key.quantity in FORCES | {"dynamic_range", "force_gain"}:
            column[-3] = np.nan
    check = golden_check(values, BASELINE)
    assert [one.cause for one in check.findings[-1].explanations] == [Cause.FORCE]
    assert check.charts[Cause.FORCE].to_json()["values"][-3] is None
    assert any(f"the last of them day {DAYS - 2}" in remark for remark in check.remarks)
    assert check.unchecked == ()


def row(number: int, value: float, **changes: object) -> ResultRow:
    fields: dict[str, object] = {
        "campaign": f"c{number}", "run": f"run{number}", "specimen": f"S{number}", "station": "bench 1",
        "operator": "A", "matrix": "m.toml", "started": BEGIN + timedelta(hours=number), "recorded": None,
        "point": "p001", "repeat": 1, "quantity": "rebound_force", "subject": "specimen",
        "motion": "sine 30 mm 1 Hz", "amplitude_m": 0.03, "frequency_Hz": 1.0, "current_A": 0.5, "value": value,
        "unit": "N", "std": 1.0, "repeatability_std": None, "calibration_std": None, "verdict": "valid",
        "specimen_verdict": "not-tested", "simulated": False,
    }  # fmt: skip
    return ResultRow(**{**fields, **changes})  # type: ignore[arg-type] # each of its own type


def rows(values: Iterable[float], **changes: object) -> list[ResultRow]:
    return [row(number, float(value), **changes) for number, value in enumerate(values)]


def normal(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(500.0, 5.0, count)


def test_repeats_are_averaged_and_rows_are_in_the_order_of_time() -> None:
    values = normal(30)
    listed = rows(values)
    listed += [row(3, values[3] + 10.0, point="p002", repeat=2), row(4, 9e9, point="p003", verdict="invalid")]
    study = chart_study(listed[::-1])
    (result,) = study.results
    expected = values.copy()
    expected[3] += 5.0
    assert result.series.values == pytest.approx(expected)
    assert result.chart is not None
    assert result.chart.baseline == 25
    assert any("not valid: 1 of 32" in remark for remark in study.remarks)


def test_capability_uses_the_bands_that_apply(tmp_path: Path) -> None:
    file = tmp_path / "bands.toml"
    file.write_text('format = 1\nname = "x"\n[[rebound_force]]\ncurrent = "0.5 A"\namplitude = "30 mm"\nlow = "470 N"\n'
                    'high = "530 N"\n')
    listed = rows(normal(30)) + rows(normal(30, 1), current_A=1.0)
    near, far = chart_study(listed, limits=Limits(load_bands(file))).results
    assert near.capability is not None
    assert near.capability.cp is not None
    assert near.capability.cp.value == pytest.approx(10.0 / near.capability.within)
    assert near.uncertainty_percent == pytest.approx(100.0 * 4.0 / 60.0)
    assert far.capability is None
    assert far.why == ("no capability: no limit is stated for this value",)
    shown = Display(force_unit="lbf", displacement_unit="in", positive="compression")
    in_lbf = chart_study(in_display(listed, shown), limits=Limits(load_bands(file), display=shown)).results[0]
    assert (in_lbf.series.unit, in_lbf.series.motion) == ("lbf", "sine 1.181 in 1 Hz")
    assert in_lbf.series.values == pytest.approx(-near.series.values / 4.4482216)
    assert in_lbf.capability is not None
    assert (in_lbf.capability.low, in_lbf.capability.high) == pytest.approx((-530.0 / 4.4482216, -470.0 / 4.4482216))
    assert in_lbf.capability.ppk is not None
    assert near.capability.ppk is not None
    assert in_lbf.capability.ppk.value == pytest.approx(near.capability.ppk.value)
    elsewhere = rows(normal(30), amplitude_m=0.05, motion="sine 50 mm 1 Hz")
    for study in (chart_study, gauge_studies):
        with pytest.raises(FileProblem, match=r"no band with limits matches .*at 30 mm, 0.5 A.*at sine 50 mm 1 Hz"):
            study(elsewhere, limits=Limits(load_bands(file)))
    one = chart_study(rows(normal(30), specimen="S"), limits=Limits(low=470.0, high=530.0, reference=500.0)).results[0]
    assert one.measurement is not None
    assert one.measurement.cgk is not None


def test_marked_values_name_their_campaigns_and_every_range_beyond_the_limit_is_marked() -> None:
    values = normal(30)
    values[27] += 60.0
    study = chart_study(rows(values))
    chart = study.results[0].chart
    assert chart is not None
    individual, moving = chart_figures(chart, "N", names=[f"SP-{number}" for number in range(30)])
    assert "28: SP-27" in [trace.name for trace in individual.traces]
    marked = {float(trace.x[0]) for trace in moving.traces if trace.style == Style.POINTS}
    assert marked == {28.0, 29.0}, "the step and the return"
    assert "28: S27" in html.page(document_of(study, simulated=False))


def test_mixed_and_missing_rows_are_named() -> None:
    mixed = chart_study([*rows(normal(20)), *(row(50 + k, 500.0, simulated=True, matrix="n.toml") for k in range(2))])
    assert sum("simulated" in remark or "2 matrices" in remark for remark in mixed.remarks) == 2
    assert chart_study(rows(normal(4))).results[0].why[0].startswith("no control chart: got 4 values")
    bad: tuple[tuple[Callable[[Sequence[ResultRow]], object], list[ResultRow], str], ...] = (
        (golden_study, rows(normal(12)), "12 specimens"),
        (golden_study, rows(normal(5), specimen="G"), "got 5 days, expected at least 9: 8 in phase I"),
        (chart_study, [], "no value matches"), (chart_study, rows(normal(9), verdict="invalid"), "valid point"),
        (golden_study, [*rows(normal(12), specimen="G"), row(99, 500.0, specimen="G", verdict="invalid")],
         "last run .run99. cannot be checked: no point is valid"),
        (gauge_studies, rows(normal(6)), "trials: got 1"), (gauge_studies, rows(normal(6), specimen=""), "no specimen"),
    )  # fmt: skip
    for study, listed, message in bad:
        with pytest.raises(FileProblem, match=message):
            study(listed)


def test_specimens_are_parts_and_campaigns_or_repeats_are_trials() -> None:
    random = np.random.default_rng(8)
    listed, number = [], 0
    for part in range(5):
        for operator in "AB":
            for _ in range(3):
                number += 1
                value = 500.0 + 20.0 * part + random.normal(0.0, 1.0)
                listed.append(row(number, value, specimen=f"P{part}", operator=operator))
    studies = gauge_studies(listed, limits=Limits(low=400.0, high=600.0))
    study = studies.results[0].study
    assert study is not None
    assert (study.parts, study.operators, study.trials, study.tolerance) == (5, 2, 3, 200.0)
    assert study.components["repeatability"].std == pytest.approx(1.0, rel=0.3)
    missing = [one for one in listed if (one.specimen, one.operator) != ("P2", "B")]
    with pytest.raises(FileProblem, match="P2 by B"):
        gauge_studies(missing)
    repeats = [row(part, 500.0 + part + random.normal(), specimen=f"P{part}", point=f"p{k}", repeat=k)
               for part in range(4) for k in range(1, 4)]  # fmt: skip
    alone = gauge_studies(repeats).results[0]
    assert alone.study is not None
    assert alone.study.trials == 3
    assert "mounting" in alone.why[0]
    for one in (studies, chart_study(listed)):
        page = html.page(document_of(one, simulated=False))
        assert "Force at peak velocity, rebound" in page
        assert blocks_of(one, 5)


def test_the_command_names_the_specimen_that_differs(tmp_path: Path) -> None:
    specification = importlib.util.spec_from_file_location("many_specimens", EXAMPLE)
    assert specification is not None
    assert specification.loader is not None
    example = importlib.util.module_from_spec(specification)
    sys.modules["many_specimens"] = example
    specification.loader.exec_module(example)
    random = np.random.default_rng(0)
    for number in range(12):
        example.write_run(tmp_path / "runs", BEGIN + timedelta(hours=number), f"SP-{number:03d}", random,
                          force=1.08 if number == 10 else 1.0 + 0.01 * random.standard_normal())  # fmt: skip
    page = tmp_path / "page.html"
    newest = max((tmp_path / "runs").iterdir())
    (newest / "bench.toml").write_text('[display]\nforce = "lbf"\n')
    done = rig("quality", "--in", tmp_path / "runs", "--baseline", "8", "--out", page, "--json")
    assert done.returncode == 8, done.stderr
    answer = json.loads(done.stdout)
    force = next(one for one in answer["series"] if one["quantity"] == "rebound_force" and one["current_A"] == 1.0)
    assert (force["specimens"][10], force["unit"]) == ("SP-010", "N")
    assert {one["index"] for one in force["chart"]["violations"] if one["rule"] == "beyond-3-sigma"} == {10}
    assert all(word in page.read_text(encoding="utf-8") for word in ("SP-010", "lbf"))
    unknown = rig("quality", "golden", "--in", tmp_path / "runs", "--station", "bench 1")
    assert (unknown.returncode, "got 'bench 1', known: 'simulated bench'" in unknown.stderr) == (2, True)
    for words in (("--pdf",), ("--low", "3", "--high", "2"), ("golden", "--in", tmp_path / "runs")):
        refused = rig("quality", "--in", tmp_path / "runs", *words)
        assert refused.returncode == 2
        assert "Fix:" in refused.stderr
