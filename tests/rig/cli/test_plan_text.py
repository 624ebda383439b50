"""`rig plan` as text: verdict last, nothing lost at any width, long plans by groups."""

from __future__ import annotations

import io
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from rig.bench.model import Bench
from rig.cli.main import main
from rig.cli.tables import PlanText, energy
from rig.display import Display
from rig.errors import EXIT_DONE, EXIT_REFUSED
from rig.jobs.time_left import duration
from rig.matrix.feasibility import Reason
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import Plan, plan

EXAMPLES = Path(__file__).parents[3] / "examples"
DEMO = Bench.load(EXAMPLES / "demo-bench.toml")
REFUSED = plan(load_matrix(EXAMPLES / "table1.toml"), Bench.load(EXAMPLES / "paper-bench.toml"))
WIDTHS = [40, 57, 80, 132]


def long_matrix(**changes: object) -> Matrix:
    """1,200 sines: 20 amplitudes, 20 frequencies, 3 currents; some too fast."""
    sweep = {
        "amplitude": tuple(f"{2 * number} mm" for number in range(1, 21)),
        "frequency": tuple(f"{0.25 * number:g} Hz" for number in range(1, 21)),
        "current": tuple(f"{number} A" for number in range(3)),
        "cycles": 25,
    }
    specimen = {"serial_number": "MR-001", "stroke": "170 mm", "max_force": "3 kN"}
    return Matrix.model_validate({"format": 1, "specimen": specimen, "matrix": {**sweep, **changes}})


@pytest.fixture(scope="module")
def long_plan() -> Plan:
    return plan(long_matrix(), DEMO)


def words(text: str) -> str:
    return " ".join(text.split())


@pytest.mark.parametrize("width", WIDTHS)
def test_the_verdict_comes_last_and_no_value_is_lost_and_a_reason_is_one_line(width: int) -> None:
    lines = [text for text, _ in PlanText(REFUSED).lines(width)]
    assert lines[-1] == "20 of 20 points outside limits"
    assert max(map(len, lines)) <= width
    text = words("\n".join(lines))
    assert "MR-001 on paper bench, 0.15 m/s; 4 min 20 s of rig time; 21 kJ of heat" in text
    assert text.count("is above the bench's limit") == 1
    worst = REFUSED.points[3]
    assert f"speed (20 points, p001 to p020): worst point p004: {worst.reasons[0]}" in text
    for item in REFUSED.points:
        fits = f"{1e3 * (item.would_fit_m or 0.0):.4g}"
        for value in (fits, f"{item.predicted_force_N:.4g}", f"{item.point.peak_speed_m_s:.3g}"):
            assert value in text


@pytest.mark.parametrize("width", WIDTHS)
def test_names_as_long_as_they_may_be_fit_at_every_width(width: int) -> None:
    item = replace(REFUSED.points[0], point=replace(REFUSED.points[0].point, id="p" * 32))
    lines = [text for text, _ in PlanText(replace(REFUSED, points=(item,), bench_name="b" * 64)).lines(width)]
    assert max(map(len, lines)) <= max(width, 67)  # no name is broken: it could not be copied
    assert "".join(lines).replace(" ", "").count("b" * 64) == 1


@pytest.mark.parametrize("width", WIDTHS)
def test_a_long_plan_is_shown_by_groups_with_its_hours(width: int, long_plan: Plan) -> None:
    lines = [text for text, _ in PlanText(long_plan).lines(width)]
    bad = sum(not item.feasible for item in long_plan.points)
    assert 0 < bad < 1200
    assert lines[-1] == f"{bad} of 1200 points outside limits"
    assert len(lines) < 100
    assert max(map(len, lines)) <= width
    text = words("\n".join(lines))
    assert long_plan.duration_s is not None
    assert f"{int(long_plan.duration_s / 3600)} h {round(long_plan.duration_s / 60) % 60} min of rig time" in text
    assert f"within limits: {1200 - bad} points, 2 to 40 mm, 0.25 to 5 Hz, 0 to 2 A" in text
    for group in {item.causes[0].slug for item in long_plan.points if item.causes}:
        assert f"outside limits ({group}" in text
    assert "rows shown; use --all to show all rows, or --json for the data" in text


def test_with_all_every_row_and_every_reason_is_shown(long_plan: Plan) -> None:
    text = "\n".join(line for line, _ in PlanText(long_plan, everything=True).lines(132))
    assert all(f"\n{item.point.id} " in text for item in long_plan.points)
    bad = sum(not item.feasible for item in long_plan.points)
    assert text.count("largest amplitude that fits: ") + text.count("no amplitude fits") == bad


def test_points_of_a_cause_are_named_in_runs_of_neighbours_and_in_the_units_of_the_display() -> None:
    points = [replace(item, causes=() if place in {2, 5, 6} else item.causes) for place, item in enumerate(
        REFUSED.points[:9])]  # fmt: skip
    shown = Display.of({"displacement": "in", "force": "lbf"})
    text = words(str(PlanText(replace(REFUSED, points=tuple(points), display=shown))))
    assert "speed (6 points, p001, p002, p004, p005, p008, p009): worst point p004" in text
    assert "within limits" not in text
    assert f"{(points[0].would_fit_m or 0.0) / 0.0254:.4g}"[:4] in text
    assert f"{(points[0].predicted_force_N or 0.0) / 4.4482216:.4g}" in text


def test_piped_output_does_not_depend_on_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ["plan", str(EXAMPLES / "table1.toml"), "--bench", str(EXAMPLES / "paper-bench.toml")]
    shown = []
    for columns, terminal in (("40", "dumb"), ("200", "xterm-256color")):
        monkeypatch.setenv("COLUMNS", columns)
        monkeypatch.setenv("TERM", terminal)
        assert main(arguments) == EXIT_REFUSED
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1]
    assert shown[0].isascii()
    assert "\x1b" not in shown[0]


def test_a_console_prints_the_plan_at_its_own_width() -> None:
    file = io.StringIO()
    Console(file=file, width=47, force_terminal=True, color_system="truecolor").print(PlanText(REFUSED))
    assert "20 of 20 points outside limits" in file.getvalue()
    assert "\x1b[31m" in file.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0.0 s"), (9.94, "9.9 s"), (9.96, "10 s"), (99.4, "99 s"), (99.6, "1 min 40 s"), (3599.6, "1 h 0 min"),
     (34 * 3600 + 12 * 60, "34 h 12 min"), (7199.9, "2 h 0 min"), (400 * 3600, "400 h 0 min")],
)  # fmt: skip
def test_durations_are_written_as_people_write_them(seconds: float, text: str) -> None:
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("joule", "text"), [(0.0172, "0.0172 J"), (613.4, "613 J"), (999.7, "1 kJ"), (35_200.0, "35.2 kJ"), (2e6, "2 MJ")]
)
def test_energies_are_reported_in_short(joule: float, text: str) -> None:
    assert energy(joule) == text


def hints(amplitude: str, frequency: str, waveform: str = "sine", bench: Bench = DEMO) -> Plan:
    changes = {"amplitude": (amplitude,), "frequency": (frequency,), "current": ("0 A",), "waveform": (waveform,)}
    return plan(long_matrix(**changes), bench)


@pytest.mark.parametrize(
    ("frequency", "waveform", "warned"),
    [("5 Hz", "sine", False), ("5.2 Hz", "sine", True), ("3.1 Hz", "triangle", False), ("3.2 Hz", "triangle", True)],
)
def test_too_few_samples_for_identification_are_a_warning_with_the_limit(
    frequency: str, waveform: str, warned: bool
) -> None:
    result = hints("2 mm", frequency, waveform)
    assert result.feasible
    assert bool(result.warnings) is warned
    needed = {"sine": 50, "triangle": 80}[waveform]
    for warning, sensor in zip(result.warnings, ("load cell", "LVDT"), strict=False):
        fewest = 250 / float(frequency.split()[0])
        assert warning.startswith(f"p001: only {fewest:.3g} samples per cycle from the {sensor}")
        assert f" {needed} (here: a rate of {needed * float(frequency.split()[0]):.3g} Hz" in warning


def test_the_limit_of_fifty_samples_is_where_the_recorded_velocity_loses_three_percent() -> None:
    def loss(samples: int) -> float:
        step = math.tau / samples
        return 1.0 - sum(k * math.sin(k * step) for k in range(-4, 5)) / (60.0 * step)

    assert loss(51) < 0.031 < loss(49) + 0.001


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"bandwidth_Hz": 60.0}, "p001: the load cell (declared bandwidth 60 Hz) passes only 15 harmonics of 4 Hz"),
        ({"delay_s": 0.00225}, None),
        ({"delay_s": 0.0045}, "(declared delay 4.5 ms, about 50 Hz) passes only 12 harmonics of 4 Hz; the shape of"),
        ({"bandwidth_Hz": 1000.0}, "the declared bandwidth, 1000 Hz, is above the Nyquist frequency, 125 Hz"),
        ({"bandwidth_Hz": 110.0, "delay_s": 0.1}, None),
    ],
)
def test_a_declared_bandwidth_is_compared_with_the_points_and_the_rate(
    changes: dict[str, float], expected: str | None
) -> None:
    bench = DEMO.model_copy(update={"load_cell": replace(DEMO.load_cell, **changes)})
    warnings = hints("2 mm", "4 Hz", bench=bench).warnings
    assert len(warnings) == (expected is not None)
    if expected is not None:
        assert expected in warnings[0]


def test_warnings_refuse_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES / "quick.toml").read_text().replace('"2 Hz"', '"5.5 Hz"').replace('"30 mm"', '"5 mm"')
    (tmp_path / "m.toml").write_text(text)
    assert main(["plan", str(tmp_path / "m.toml"), "--bench", str(EXAMPLES / "demo-bench.toml")]) == EXIT_DONE
    assert "warning: p001, p002: only 45.5 samples per cycle" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("bench", "entry", "slug"),
    [
        ("by_hand = true\n", '[[current_step]]\ncurrent = ["0 A", "1 A"]\n', "by-hand-without-steps"),
        ("by_hand = true\n", '[temperature]\nwindow = ["25 degC", "40 degC"]\n', "source-without-temperature"),
        ("", "[campaign]\nrequire_skew = true\n", "format-without-clock"),
    ],
)
def test_what_a_run_refuses_before_connecting_the_plan_refuses_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bench: str, entry: str, slug: str
) -> None:
    """`rig plan` and `rig run` give the same answer for everything that the two files determine."""
    text = (EXAMPLES / "demo-bench.toml").read_text().replace('format = "frame16"', 'format = "signed-decimal"', 1)
    if bench:
        text = f"{text[: text.index('[ecu]')]}[ecu]\n{bench}\n{text[text.index('[load_cell]') :]}"
    quick = (EXAMPLES / "quick.toml").read_text()
    (tmp_path / "b.toml").write_text(text)
    (tmp_path / "m.toml").write_text(quick[: quick.index("[campaign]")] + entry)
    arguments = ["plan", str(tmp_path / "m.toml"), "--bench", str(tmp_path / "b.toml"), "--json"]
    assert main(arguments) == EXIT_REFUSED
    assert json.loads(capsys.readouterr().out)["slug"] == slug


def test_two_causes_of_one_kind_at_a_point_have_a_line_each() -> None:
    causes = (Reason("sampling", "20 set-points", 2.0), Reason("sampling", "25 samples", 1.0))
    points = tuple(replace(item, causes=causes) for item in REFUSED.points)
    text = words(str(PlanText(replace(REFUSED, points=points))))
    assert "sampling (20 points, p001 to p020): 20 set-points" in text
    assert "sampling (20 points, p001 to p020): 25 samples" in text
