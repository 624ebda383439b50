"""The matrix file: expansion, order, identity, and refusals."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from rig.errors import FileProblem
from rig.identification.models.solving import known_methods
from rig.matrix.methods import METHODS
from rig.matrix.model import Matrix, load_matrix

EXAMPLES = Path(__file__).parents[3] / "examples"
HEAD = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
"""
SWEEP = """
[matrix]
amplitude = ["50 mm"]
frequency = ["0.5 Hz", "1 Hz"]
current = ["0 A", "0.5 A", "1 A"]
"""


def load(tmp_path: Path, text: str) -> Matrix:
    path = tmp_path / "matrix.toml"
    path.write_text(text)
    return load_matrix(path)


def problems(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, text)
    return caught.value.problems


def test_table_1_is_twenty_sines_with_current_outermost() -> None:
    points = load_matrix(EXAMPLES / "table1.toml").points()
    assert [point.id for point in points] == [f"p{number:03d}" for number in range(1, 21)]
    assert [point.frequency_Hz for point in points[:4]] == [0.5, 1.0, 1.5, 2.0]
    assert [point.current_A for point in points[::4]] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert {(point.waveform, point.amplitude_m, point.cycles) for point in points} == {("sine", 0.05, 10)}


@pytest.mark.parametrize("name", ["table1", "triangle", "quick"])
def test_every_example_is_a_good_file(name: str) -> None:
    assert load_matrix(EXAMPLES / f"{name}.toml").points()


def test_the_quick_example_has_two_points_and_at_least_eight_seconds_of_motion() -> None:
    points = load_matrix(EXAMPLES / "quick.toml").points()
    assert len(points) == 2
    assert sum(point.motion_s for point in points) >= 8.0


def test_the_unit_may_stand_in_the_key(tmp_path: Path) -> None:
    text = HEAD + "[matrix]\namplitude_mm = [50]\nfrequency_Hz = [0.5, 1]\ncurrent_A = [0, 0.5, 1.0]"
    assert load(tmp_path, text).points() == load(tmp_path, HEAD + SWEEP).points()


def test_a_random_order_is_the_same_for_the_same_seed_and_keeps_the_points_names(tmp_path: Path) -> None:
    written = load(tmp_path, HEAD + SWEEP).points()
    first = load(tmp_path, HEAD + SWEEP + 'order = "random"\nseed = 7').points()
    again = load(tmp_path, HEAD + SWEEP + 'order = "random"\nseed = 7').points()
    other = load(tmp_path, HEAD + SWEEP + 'order = "random"\nseed = 8').points()
    assert first == again != other
    assert first != written
    assert sorted(first, key=lambda point: point.id) == list(written)


def test_extra_points_follow_and_repeats_come_round_again(tmp_path: Path) -> None:
    extra = """
repeats = 2
[[point]]
id = "slow"
waveform = "triangle"
amplitude = "10 mm"
frequency = "0.1 Hz"
current = "0 A"
cycles = 4
"""
    points = load(tmp_path, HEAD + SWEEP + extra).points()
    assert len(points) == 14
    assert [points[6].id, points[13].id] == ["slow", "slow-2"]
    assert [points[6].repeat, points[13].repeat] == [1, 2]
    assert (points[6].waveform, points[6].cycles, points[6].amplitude_m) == ("triangle", 4, 0.01)
    assert points[7].id == "p008"
    assert points[7].amplitude_m == points[0].amplitude_m


def test_extra_points_alone_are_a_matrix(tmp_path: Path) -> None:
    (point,) = load(tmp_path, HEAD + '[[point]]\namplitude = "5 mm"\nfrequency = "3 Hz"\ncurrent = "1 A"').points()
    assert (point.id, point.waveform, point.cycles) == ("p001", "sine", 10)


def test_points_are_centred_on_the_specimens_mid_stroke(tmp_path: Path) -> None:
    text = HEAD + 'mid_stroke = "-12 mm"\n' + SWEEP + 'rest = "3 s"\nramp_in_cycles = 2.0'
    (point, *_) = load(tmp_path, text).points()
    assert (point.centre_m, point.rest_s, point.ramp_in_cycles) == (-0.012, 3.0, 2.0)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (HEAD, "no test point"),
        (HEAD + "[matrix]\nwaveform = []", "matrix.waveform = []: is empty"),
        (HEAD + '[matrix]\namplitude = ["50 mm"]', "missing: frequency (or speed) and current"),
        (HEAD + SWEEP + 'waveform = ["sinus"]', 'matrix.waveform[1] = "sinus": must be \'sine\', \'triangle\', '),
        (HEAD + SWEEP.replace('"0 A"', '"-1 A"'), "too small (allowed: 0 A to 20 A)"),
        (HEAD + SWEEP.replace('"0 A"', "1"), "the number 1 has no unit"),
        (HEAD + SWEEP.replace('["50 mm"]', '"50 mm"'), "must be a list in [ ]"),
        (HEAD + SWEEP.replace("50 mm", "0 mm"), "allowed: more than 0 mm to 1 m"),
        (HEAD + SWEEP.replace('"0.5 A"', '"0 A"'), "duplicate value 0 A; to repeat points, set `repeats = N`"),
        (HEAD + SWEEP + "cycles = 2", "too small (allowed: 3 to 10000)"),
        (HEAD + SWEEP + "cycles = 10.0", "must be a whole number"),
        (HEAD + SWEEP + 'order = "random"', "requires a seed"),
        (HEAD + SWEEP + 'order = "backwards"', "matrix.order"),
        (HEAD + SWEEP + "repeats = 1000\n" + 'rest = "-1 s"', "matrix.rest"),
        (HEAD + SWEEP + "amplitudes = 3", "unknown key; did you mean amplitude?"),
        (HEAD + 'prior = "demon"\n' + SWEEP, "unknown parameter set; did you mean demo?; known: "),
        (HEAD + 'prior = "demo"\nmax_force = "2 kN"\n' + SWEEP, "prior or max_force, not both"),
        (HEAD.replace("MR-001", "../evil") + SWEEP, "specimen.serial_number"),
        (HEAD + SWEEP + '[identify]\nmodel = "asymmetrical"', "did you mean asymmetric?; known: all, "),
        (HEAD + SWEEP + '[identify]\nmethod = "separably"', "did you mean separable?"),
        (HEAD + SWEEP + "[campaign]\nretries = 3", "too large (allowed: 0 to 2)"),
        (HEAD + SWEEP + "[identifi]\nmodel = 1", "unknown key; did you mean identify?"),
    ],
)
def test_a_wrong_entry_is_refused_with_its_place_and_what_would_fit(tmp_path: Path, text: str, expected: str) -> None:
    found = problems(tmp_path, text)
    assert any(expected in problem for problem in found), found


def test_two_points_of_one_name_are_refused(tmp_path: Path) -> None:
    extra = '[[point]]\nid = "P003"\namplitude = "5 mm"\nfrequency = "3 Hz"\ncurrent = "1 A"\n'
    (found,) = problems(tmp_path, HEAD + SWEEP + extra)
    assert "duplicate point ID: p003" in found


def test_a_list_entry_is_named_by_its_number(tmp_path: Path) -> None:
    extra = '[[point]]\namplitude = "5 mm"\nfrequency = "3 Hz"\ncurrent = "1 A"\n'
    (found,) = problems(tmp_path, HEAD + extra + extra.replace("3 Hz", "3 N"))
    assert found.startswith('line 12: point[2].frequency = "3 N": 3 N is a force')


def test_absurdly_many_points_are_refused_before_they_are_made(tmp_path: Path) -> None:
    many = ", ".join(f'"{number / 1000} A"' for number in range(1000))
    (found,) = problems(tmp_path, HEAD + SWEEP.replace('"0 A", "0.5 A", "1 A"', many) + "repeats = 1000")
    assert "2000000 test points" in found


def test_the_digest_follows_the_points_and_the_specimen_only(tmp_path: Path) -> None:
    reference = load(tmp_path, HEAD + SWEEP).digest
    assert load(tmp_path, "# comment\n" + HEAD + SWEEP + '[identify]\nmodel = "kwok"').digest == reference
    assert load(tmp_path, HEAD + SWEEP.replace("50 mm", "49 mm")).digest != reference
    assert load(tmp_path, HEAD.replace("170", "160") + SWEEP).digest != reference


def test_the_methods_a_file_may_name_are_those_there_are() -> None:
    assert known_methods() == METHODS


def test_stroke_and_peak_speed_give_amplitude_and_frequency_of_each_waveform(tmp_path: Path) -> None:
    text = '[matrix]\nwaveform = ["sine", "triangle"]\nstroke = ["2 in"]\nspeed = ["10 in/s", "1 ft/s"]\n'
    both = load(tmp_path, HEAD + text + 'current = ["0 A"]').points()
    assert [point.peak_speed_m_s for point in both] == pytest.approx([0.254, 0.3048] * 2)
    assert [point.amplitude_m for point in both] == pytest.approx([0.0254] * 4)
    assert both[0].frequency_Hz == pytest.approx(0.254 / (math.tau * 0.0254))
    assert both[2].frequency_Hz == pytest.approx(0.254 / (4.0 * 0.0254))
    (point,) = load(tmp_path, HEAD + '[[point]]\nspeed = "0.131 m/s"\nfrequency = "90 rpm"\ncurrent = "1 A"').points()
    assert (point.amplitude_m, point.frequency_Hz) == pytest.approx((0.131 / (math.tau * 1.5), 1.5))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('amplitude = ["20 mm"]\nfrequency = ["1 Hz"]\nspeed = ["0.1 m/s"]', "line 10: matrix.speed"),
        ('amplitude = ["20 mm"]\nstroke = ["40 mm"]\nspeed = ["0.1 m/s"]', "line 9: matrix.stroke"),
        ('speed = ["0.1 m/s"]', "missing: amplitude, stroke or frequency"),
        ('amplitude = ["20 mm"]\nstroke_mm = [40]\nspeed = ["0.1 m/s"]', "line 9: matrix.stroke_mm = [40]"),
        ('stroke_mm = [0.0002]\nspeed = ["0.1 m/s"]', "1.592e+05 Hz for this speed (allowed: 0.001 Hz to 100 Hz)"),
        ('frequency_Hz = [0.001]\nspeed = ["40 m/s"]', "6.366e+06 mm for this speed (allowed: up to 1 m)"),
        ('stroke = ["2 in"]\nspeed = ["0.254 m/s", "10 in/s"]', "duplicate value 0.254 m/s"),
        ('stroke = ["2 in"]\nvelocity = ["10 in/s"]', "did you mean speed"),
    ],
)
def test_a_motion_that_is_stated_twice_or_not_at_all_is_refused(tmp_path: Path, text: str, expected: str) -> None:
    (problem,) = problems(tmp_path, f'{HEAD}[matrix]\ncurrent = ["0 A"]\n{text}\n')
    assert expected in problem
