"""Worlds of a user's own bench and matrix: what the file says is what the simulated rig is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest
from matrices import matrix_text

from drivers import catalogue
from rig.bench.model import Bench
from rig.errors import FileProblem, Refused
from rig.matrix.model import load_matrix
from rig.recording.recorded_point import RecordedPoint
from simulators.scenarios.plan import Given, drawn
from simulators.scenarios.request import LARGEST_DRAWN, Files, request_for
from simulators.scenarios.runs import live
from simulators.scenarios.user_bench import UserBench

ROOT = Path(__file__).resolve().parents[3]
DEMO = (ROOT / "examples/demo-bench.toml").read_text(encoding="utf-8")
MATRIX = matrix_text("0.5 A", amplitude="6 mm", frequency="4 Hz").replace(
    'serial_number = "MR-001"\nstroke = "170 mm"\n', 'serial_number = "MR-7"\nstroke = "120 mm"\nmid_stroke = "10 mm"\n'
)
OWN = {
    'url = "modbus-tcp://192.168.0.10:502"': 'url = "modbus-rtu:/dev/ttyUSB0"',
    "device_id = 1": "device_id = 9",
    'poll = "10 ms"': 'poll = "20 ms"',
    'timeout = "40 ms"': 'timeout = "60 ms"\nstale_after = "300 ms"',
    'format = "frame16"\nrate = "250 Hz"\nrange = "10 kN"': 'format = "laumas-fast"\nrate = "200 Hz"\nrange = "20 kN"',
    'stale_after = "20 ms"\ndelay = "0.2 ms"': 'stale_after = "40 ms"\ndelay = "1.5 ms"',
    "sensitivity = 1.0 ": 'polarity = "reversed"\nsensitivity = 0.5 ',
    'offset = "0 N"': 'offset = "120 N"',
    'rate = "250 Hz"\nrange = "100 mm"': 'rate = "500 Hz"\nrange = "110 mm"',
    "sensitivity = 0.001": "sensitivity = 0.01",
}
PRESSURE = """
[[auxiliary]]
name = "oil_pressure"
unit = "bar"
url = "/dev/ttyUSB7"
rate = "50 Hz"
range = "250 bar"
stale_after = "200 ms"
format = {pattern = 'P(?P<value>[+-]\\d{4}\\.\\d)', template = "P{value:+07.1f}", unit = "bar"}
[auxiliary.calibration]
sensitivity = 1e5
serial_number = "OP-1"
"""


def files(folder: Path, bench: str, matrix: str = MATRIX) -> Files:
    (folder / "my-bench.toml").write_text(bench, encoding="utf-8")
    (folder / "my-matrix.toml").write_text(matrix, encoding="utf-8")
    return Files(folder / "my-matrix.toml", folder / "my-bench.toml")


def own(changes: dict[str, str]) -> str:
    """The example's bench file with other entries."""
    text = DEMO
    for before, after in changes.items():
        assert before in text, before
        text = text.replace(before, after, 1)
    return text


def test_a_scenario_has_the_sensors_that_the_bench_file_describes(tmp_path: Path) -> None:
    """Formats, rates, ranges, calibration, polarity, delay: what is recorded is what the rod really did."""
    given = files(tmp_path, own(OWN) + PRESSURE)
    request = request_for(given, (), None)
    (tmp_path / "world").mkdir()
    plan = replace(request.plan(3), events=())
    scenario, ended = live(plan, tmp_path / "world")
    assert (ended.failed, plan.actuator) == ((), "rtu")
    assert scenario.folder is not None
    (path,) = scenario.folder.glob("points/*.h5")
    point, truth = RecordedPoint.open(path), scenario.sessions[0].truth.arrays
    force = point.force_samples
    assert 1.0 / np.median(np.diff(force.time_s)) == pytest.approx(200.0, rel=0.02)
    assert 1.0 / np.median(np.diff(point.time_s)) == pytest.approx(500.0, rel=0.02)
    for end, position_m in ((np.nanmin, 0.004), (np.nanmax, 0.016)):
        assert end(force.force_N) == pytest.approx(end(truth[:, 4]), abs=45.0), "in SI, with its sign and zero"
        assert end(point.displacement_m) == pytest.approx(position_m, abs=3e-4), "6 mm about the specimen's middle"
    written, expected = Bench.load(scenario.folder / "bench.toml"), Bench.load(given.bench or tmp_path)
    assert written.limits == expected.limits
    assert written.load_cell.calibration == expected.load_cell.calibration
    assert [channel.name for channel in written.auxiliary] == ["oil_pressure"]


def test_the_example_bench_is_reached_by_other_wires_and_that_is_reported(tmp_path: Path) -> None:
    request = request_for(files(tmp_path, DEMO), (), None)
    assert "over slcan at 500 kbit/s instead of socketcan" in " ".join(request.substitutes)
    assert {request.plan(seed).actuator for seed in range(30)} == {"tcp"}
    assert request.again(7).startswith(f"rig scenarios --seeds 7 --bench {tmp_path}/my-bench.toml --matrix {tmp_path}")


def test_things_happen_all_through_a_long_campaign(tmp_path: Path) -> None:
    long = MATRIX.replace("cycles = 6", "cycles = 2000")
    request = request_for(files(tmp_path, DEMO, long), (), None)
    times_s = [event.at_s or 0.0 for seed in range(100) for event in request.plan(seed).events]
    assert 400.0 < max(times_s) < 520.0, "2000 cycles at 4 Hz"
    assert request.plan(1).lasts_s > 500.0


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ("modbus-tcp://192.168.0.10:502", "tcp://192.168.0.10:502", 'actuator.url = "tcp://192.168.0.10:502"'),
        ('rate = "250 Hz"\nrange = "10', 'rate = "20 kHz"\nrange = "10', "load_cell.rate = 20000 Hz"),
        ('format = "frame16"\nrate = "250 Hz"\nrange = "10 kN"',
         "format = {pattern = '(?P<value>\\d+)'}\nrate = \"250 Hz\"\nrange = \"10 kN\"", "load_cell.format"),
        ('format = "frame16"\nrate = "250 Hz"\nrange = "10 kN"',
         'format = "flintec"\nrate = "250 Hz"\nrange = "10 kN"', "does not fit"),
    ],
)  # fmt: skip
def test_what_no_simulated_rig_can_be_is_refused_by_name(tmp_path: Path, before: str, after: str, says: str) -> None:
    with pytest.raises(FileProblem) as error:
        request_for(files(tmp_path, own({before: after})), (), None)
    assert says in str(error.value)


def test_a_device_of_another_description_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(catalogue._REGISTERED, "ours", lambda _: None)
    with pytest.raises(FileProblem, match=r'actuator.register_map = "ours": there is no simulated controller'):
        request_for(files(tmp_path, own({'register_map = "demo"': 'register_map = "ours"'})), (), None)


def test_a_simulated_rig_at_another_speed_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match=r"clock.device_rate = 10: .*Fix: remove"):
        request_for(files(tmp_path, DEMO + "[clock]\ndevice_rate = 10\n"), (), None)


def test_a_matrix_that_the_bench_cannot_do_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match=r"speed .* is above the bench's limit, 0.1 m/s"):
        request_for(files(tmp_path, own({'speed = "0.8 m/s"': 'speed = "0.1 m/s"'})), (), None)


def test_a_damper_that_the_file_does_not_name_must_fit_as_the_simulated_one(tmp_path: Path) -> None:
    weak = MATRIX.replace('prior = "demo"', 'max_force = "100 N"')
    with pytest.raises(Refused, match="too strong for this bench"):
        request_for(files(tmp_path, own({'force = "5 kN"': 'force = "150 N"'}), weak), (), None)


def test_drawn_matrices_run_on_a_user_s_bench_that_can_do_them(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(DEMO, encoding="utf-8")
    request = request_for(Files(bench=tmp_path / "bench.toml"), (), None)
    assert len({request.plan(seed).matrix for seed in range(5)}) > 1
    (tmp_path / "bench.toml").write_text(own({'speed = "0.8 m/s"': 'speed = "0.1 m/s"'}), encoding="utf-8")
    with pytest.raises(Refused, match="specify a matrix with --matrix"):
        request_for(Files(bench=tmp_path / "bench.toml"), (), None)


def test_the_largest_matrix_that_is_drawn_is_the_one_that_is_tried(tmp_path: Path) -> None:
    """A bench that is found good for it is good for every one."""
    path = tmp_path / "matrix.toml"
    path.write_text(LARGEST_DRAWN, encoding="utf-8")
    largest = load_matrix(path).points()
    for seed in range(200):
        path.write_text(drawn(seed, Given(usual=True)).matrix, encoding="utf-8")
        for point in load_matrix(path).points():
            assert point.amplitude_m <= largest[0].amplitude_m
            assert point.frequency_Hz <= largest[0].frequency_Hz
            assert point.current_A <= largest[0].current_A


POLLED = """
pattern = '#{address},(?P<value>[+-]\\d{2}\\.\\d{4}) kN'
request = "?{address}\\r"
address = "07"
terminator = "\\r"
answer_timeout_ms = 20
"""
PACKED = """
packed = ["00vvvvvv", "01vvvvvv", "10nnvvvv"]
order = "little"
fields = { value = { valid = [100, 65000] }, sequence = {} }
"""


def test_a_campaign_runs_on_a_polled_load_cell_and_a_packed_stream_described_by_files(tmp_path: Path) -> None:
    """Formats as a stranger writes them; recorded is what the rod really did, when it did it."""
    (tmp_path / "cell.toml").write_text(POLLED, encoding="utf-8")
    (tmp_path / "laser.toml").write_text(PACKED, encoding="utf-8")
    bench = own({
        'format = "frame16"\nrate = "250 Hz"\nrange = "10': 'format = "cell.toml"\nrate = "200 Hz"\nrange = "10',
        "sensitivity = 1.0 ": "sensitivity = 1000.0 ",
        'stale_after = "20 ms"\ndelay = "0.2 ms"': 'stale_after = "60 ms"',
        'format = "frame16"\nrate = "250 Hz"\nrange = "100': 'format = "laser.toml"\nrate = "500 Hz"\nrange = "100',
        'sensitivity = 0.001                # m per unit on the wire: the sensor sends millimetres\noffset = "0 mm"':
        'points = [[500, "-105 mm"], [64500, "105 mm"]]',
    })  # fmt: skip
    request = request_for(files(tmp_path, bench, MATRIX.replace("mid_stroke", "# mid_stroke")), (), None)
    (tmp_path / "world").mkdir()
    scenario, ended = live(replace(request.plan(3), events=()), tmp_path / "world")
    assert ended.failed == ()
    assert scenario.folder is not None
    (path,) = scenario.folder.glob("points/*.h5")
    point, truth = RecordedPoint.open(path), scenario.sessions[0].truth.arrays
    assert np.ptp(point.displacement_m) == pytest.approx(2 * 6e-3, rel=0.02)
    assert 1.0 / np.median(np.diff(point.force_samples.time_s)) == pytest.approx(200.0, rel=0.02)
    for end in (np.nanmin, np.nanmax):
        assert end(point.force_samples.force_N) == pytest.approx(end(truth[:, 4]), abs=45.0)


def test_nobody_turns_the_knobs_of_a_program_where_set_points_are_streamed(tmp_path: Path) -> None:
    slow = matrix_text("0.5 A", amplitude="6 mm", frequency="1 Hz")
    given = files(tmp_path, DEMO.replace('register_map = "demo"', 'register_map = "demo-streamed"'), slow)
    plans = [request_for(given, (), None).plan(seed) for seed in range(200)]
    happened = {event.what for made in plans for event in made.events}
    assert happened >= {"second-master", "actuator-frozen:slips"}
    assert not happened & {"second-master:span", "second-master:offset", "second-master:jumps"}
    with pytest.raises(click.BadParameter, match="this bench streams set-points"):
        request_for(given, ("second-master:span@1",), None)
    assert request_for(given, ("setpoints-lost@1",), None).plan(0).events


def test_a_specimen_that_is_installed_away_from_the_middle_is_not_at_its_end_stop(tmp_path: Path) -> None:
    """17 mm about -55.5 mm of a damper of 40 mm: at 0 mm it would carry 12 kN before anything moves."""
    matrix = MATRIX.replace('"120 mm"', '"40 mm"').replace('"10 mm"', '"-55.5 mm"')
    given = files(tmp_path, DEMO, matrix)
    assert given.matrix is not None
    assert given.bench is not None
    options = UserBench.load(given.bench, load_matrix(given.matrix)).options
    assert options.servo.start_position_m == -0.0555
    given = files(tmp_path, DEMO)
    assert given.bench is not None
    assert UserBench.load(given.bench, load_matrix(tmp_path / "my-matrix.toml")).options.servo.start_position_m == 0.0
