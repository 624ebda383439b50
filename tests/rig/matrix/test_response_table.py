"""`[[response]]`: its points and steps, what it refuses, and what a plan says of its currents."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.bench.model import Bench
from rig.campaign.setup import check_source
from rig.errors import FileProblem, Refused
from rig.files.toml_source import frozen
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan
from rig.matrix.response_table import BASELINE_S, STAGGER_S, START_S
from rig.signals.waveform import TRIANGLE
from rig.test_point import RESPONSE

EXAMPLES = Path(__file__).parents[3] / "examples"
DEMO = Bench.load(EXAMPLES / "demo-bench.toml")
TABLE = 'stroke = "80 mm"\nspeed = ["0.1 m/s", "0.2 m/s"]\ncurrent = ["1 A", "2 A"]\nrepeats = 3\nwindow = "250 ms"'


def matrix(table: str = TABLE, specimen: str = "", tail: str = "") -> Matrix:
    head = f'format = 1\n[specimen]\nserial_number = "A"\nstroke = "170 mm"\n{specimen}\n'
    off = "[identify]\nenabled = false\n"
    return Matrix.model_validate(frozen(tomllib.loads(f"{head}{off}[[response]]\n{table}\n{tail}")))


def test_each_repeat_steps_the_current_up_and_down_once_in_each_direction() -> None:
    points = matrix().points()
    assert [point.id for point in points] == [f"response1-{n}" for n in range(1, 5)]
    assert {(round(point.peak_speed_m_s, 9), point.current_A) for point in points} == {
        (0.1, 1.0), (0.1, 2.0), (0.2, 1.0), (0.2, 2.0)
    }
    for point in points:
        assert point.kind == RESPONSE
        assert point.steps_s[0] == 0.0
        assert point.motion_s > point.steps_s[-1]
        phase = np.array(point.steps_s[1:]) * point.frequency_Hz
        _, slope, _ = TRIANGLE.shape(phase)
        rises = np.diff(point.steps_A) > 0.0
        for way in (1.0, -1.0):
            for up in (True, False):
                assert np.count_nonzero((np.sign(slope) == way) & (rises == up)) == 3
        half_s = 0.5 / point.frequency_Hz
        after_corner_s = (phase + 0.25) % 0.5 / point.frequency_Hz
        assert np.min(after_corner_s) >= 0.05 + BASELINE_S + START_S - 1e-6, "run-in and baseline"
        assert np.max(after_corner_s) <= half_s - 0.25 - START_S + 1e-6, "window"
        assert np.ptp(after_corner_s) <= STAGGER_S
        assert len(np.unique(np.round(after_corner_s, 5))) == 3, "staggered between the samples of the repeats"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"0.2 m/s"', '"0.3 m/s"'),
         r"speed\[2\].* lasts 267 ms; required: 360 ms .* speed of at most 0.2222 m/s, a stroke of at least 108 mm"),
        (('stroke = "80 mm"', 'stroke = "80 mm"\namplitude = "40 mm"'), "specify amplitude or stroke"),
        (('stroke = "80 mm"\n', ""), "specify amplitude or stroke"),
        (('"1 A"', '"0 A"'), "too small; required: at least 0.05 A"),
        (('"1 A"', '"2 A"'), "duplicate value 2 A"),
        (('repeats = 3', 'repeats = 0'), "allowed: 1 to 100"),
        (('window = "250 ms"', 'window = "1 ms"'), "5 ms"),
        (('window', 'low = "0.2 A"\nwindow'), "low"),
    ],
)  # fmt: skip
def test_what_cannot_be_measured_names_the_entry_and_what_would_fit(change: tuple[str, str], message: str,
                                                                    tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    text = (EXAMPLES / "response.toml").read_text().partition("[[response]]")[0]
    path.write_text(f"{text}[[response]]\n{TABLE.replace(*change)}\n[identify]\nenabled = false\n")
    with pytest.raises(FileProblem, match=message):
        load_matrix(path)


def slugs(bench: Bench, of: Matrix) -> list[list[str]]:
    return [[cause.slug for cause in item.causes] for item in plan(of, bench).points]


def test_the_plan_judges_every_current_of_a_program_and_the_speeds() -> None:
    assert slugs(DEMO, matrix()) == [[], [], [], []]
    limits = replace(DEMO.limits, current_A=1.5, speed_m_s=0.15)
    small = DEMO.model_copy(update={"limits": limits})
    assert slugs(small, matrix()) == [[], ["current"], ["speed"], ["speed", "current"]]
    fast = plan(matrix(), small).points[2]
    assert fast.would_fit_m is None, "a smaller stroke has no room for the steps"
    assert fast.would_fit_m_s is not None
    assert 0.1 < fast.would_fit_m_s <= 0.15
    assert slugs(DEMO, matrix(specimen='max_current = "1 A"')) == [[], ["specimen-current"], [], ["specimen-current"]]


def test_steps_that_the_supply_cannot_make_are_refused() -> None:
    """At 0.2 m/s, 0.3 s until the rod reverses: 2 A at 4 A/s takes 0.5 s; 0.8 H and 5 ohm fall to 5 % in 0.48 s."""
    slow = DEMO.model_copy(update={"ecu": replace(DEMO.ecu, slew_limit_A_s=4.0)})
    assert slugs(slow, matrix()) == [[], [], [], ["current-settling"]]
    supply = DEMO.model_copy(update={"ecu": replace(DEMO.ecu, voltage_limit_V=12.0)})
    coil = 'coil_resistance = "5 ohm"\ncoil_inductance = "0.8 H"'
    assert slugs(supply, matrix(specimen=coil)) == [[], [], ["current-settling"], ["current-settling"]]
    reason = plan(matrix(specimen=coil), supply).points[2].reasons[0]
    assert f"{1e3 * 0.16 * math.log(20.0):.0f} ms to complete 95 %" in reason
    assert "the rod reverses after" in reason
    weak = DEMO.model_copy(update={"ecu": replace(DEMO.ecu, voltage_limit_V=9.0)})
    assert slugs(weak, matrix(specimen='coil_resistance = "5 ohm"')) == [[], ["current"], [], ["current"]]


def test_a_current_that_is_set_manually_cannot_be_stepped() -> None:
    by_hand = DEMO.model_copy(update={"ecu": replace(DEMO.ecu, interface=None, channel=None, by_hand=True)})
    with pytest.raises(Refused, match="exact times") as refused:
        check_source(by_hand, matrix())
    assert refused.value.slug == "by-hand-without-steps"


def test_the_example_is_feasible_and_described_by_its_currents() -> None:
    planned = plan(load_matrix(EXAMPLES / "response.toml"), DEMO)
    assert planned.feasible
    assert planned.points[1].point.described == "triangle 40 mm 0.1 m/s 0 to 2 A"


def test_an_unused_entry_changes_no_digest() -> None:
    """As of the release before `[[response]]` and the coil's inductance."""
    quick = load_matrix(EXAMPLES / "quick.toml")
    assert quick.digest == "a00ecbc94393f97d89fd9118652dba5f2167483f9f64e264ad264408659198a6"
    assert DEMO.digest == Bench.load(EXAMPLES / "demo-bench.toml").digest
    assert matrix().digest != matrix(TABLE.replace('"250 ms"', '"240 ms"')).digest
