"""`waveform = "sweep" | "road" | "file"`: the points they make, what is wrong with them, and what a rig cannot do."""

from __future__ import annotations

import math
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.bench.model import Bench
from rig.campaign.execution.action_executor import signal_order
from rig.campaign.file_copies import keep_drives, keep_matrix
from rig.cli.run import following
from rig.cli.tables import PlanText
from rig.errors import FileProblem
from rig.matrix.command_limits import SignalLimits
from rig.matrix.forecast import forecaster
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import Plan, plan
from rig.station.signal_source import signal_order as station_order

ROOT = Path(__file__).resolve().parents[3]
HEAD = 'format = 1\n[specimen]\nserial_number = "MR-001"\nstroke = "170 mm"\nmax_force = "1 kN"\n'
SWEEP = (
    '[matrix.sweep]\nfirst_frequency = "1 Hz"\nlast_frequency = "4 Hz"\nfirst_amplitude = "10 mm"\nduration = "10 s"\n'
)
ROAD = '[matrix.road]\nroad = ["bump", "paper-sweep"]\namplitude = "10 mm"\nduration = "6 s"\n'
FILE = '[matrix.file]\nfile = ["drive.csv"]\n'


def matrix_of(*waveforms: str, more: str = 'current = ["0 A", "1 A"]\n') -> str:
    listed = ", ".join(f'"{name}"' for name in waveforms)
    return f"{HEAD}[matrix]\nwaveform = [{listed}]\n{more}"


def rows(count: int = 501, amplitude_mm: float = 12.0, step_s: float = 0.01) -> str:
    lines = [f"{k * step_s:.4f},{amplitude_mm * math.sin(math.tau * k * step_s):.6f}" for k in range(count)]
    return "time_s,displacement_mm\n" + "\n".join(lines) + "\n"


def load(folder: Path, text: str, drive: str | None = None) -> Matrix:
    (folder / "matrix.toml").write_text(text, encoding="utf-8")
    if drive is not None:
        (folder / "drive.csv").write_text(drive, encoding="utf-8")
    return load_matrix(folder / "matrix.toml")


def bench(folder: Path, **changes: str) -> Bench:
    text = (ROOT / "examples" / "streamed-bench.toml").read_text(encoding="utf-8")
    for key, value in changes.items():
        text = re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", text, count=1)
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return Bench.load(folder / "bench.toml")


def planned(folder: Path, text: str, drive: str | None = None, **of_bench: str) -> Plan:
    return plan(load(folder, text, drive), bench(folder, **of_bench))


def test_a_signal_is_reported_by_its_name_its_reach_and_its_time_not_by_a_frequency(tmp_path: Path) -> None:
    more = 'current = ["1 A"]\namplitude = ["5 mm"]\nfrequency = ["1 Hz"]\n'
    text = matrix_of("sine", "sweep", "road", "file", more=more) + SWEEP + ROAD + FILE
    reported = [point.described for point in load(tmp_path, text, rows()).points()]
    assert reported == [
        "sine 5 mm 1 Hz 1 A", "sweep up to 10 mm for 10 s, 1 A", "road bump up to 10 mm for 6 s, 1 A",
        "road paper-sweep up to 10 mm for 6 s, 1 A", "file drive up to 12 mm for 5 s, 1 A",
    ]  # fmt: skip
    table = str(PlanText(planned(tmp_path, text, rows())))
    rows_of = {line.split()[1]: line.split()[2:5] for line in table.splitlines() if line.startswith("p0")}
    assert rows_of["sine"] == ["5", "1", "1"]
    assert rows_of["sweep"][1:] == ["-", "1"], "no frequency beside it"


def test_each_signal_is_run_at_every_current_beside_points_with_cycles(tmp_path: Path) -> None:
    more = 'current = ["0 A", "1 A"]\namplitude = ["5 mm"]\nfrequency = ["1 Hz", "2 Hz"]\n'
    text = matrix_of("sine", "sweep", "road", "file", more=more) + SWEEP + ROAD + FILE
    points = load(tmp_path, text, rows()).points()
    shown = [(point.id, point.waveform, point.current_A, point.record.name if point.record else "") for point in points]
    assert shown == [
        ("p001", "sine", 0.0, ""), ("p002", "sine", 0.0, ""), ("p003", "sine", 1.0, ""), ("p004", "sine", 1.0, ""),
        ("p005", "sweep", 0.0, "sweep"), ("p006", "sweep", 1.0, "sweep"),
        ("p007", "road", 0.0, "bump"), ("p008", "road", 0.0, "paper-sweep"),
        ("p009", "road", 1.0, "bump"), ("p010", "road", 1.0, "paper-sweep"),
        ("p011", "file", 0.0, "drive"), ("p012", "file", 1.0, "drive"),
    ]  # fmt: skip
    assert [point.motion_s for point in points[4:6]] == pytest.approx([10.0, 10.0])
    assert {point.kind for point in points[4:]} == {"signal"}
    assert points[10].amplitude_m == pytest.approx(0.012, rel=1e-4), "as written"


def test_the_plan_knows_peaks_energy_and_duration(tmp_path: Path) -> None:
    (item,) = planned(tmp_path, matrix_of("file", more='current = ["0 A"]\n') + FILE, rows()).points
    assert item.feasible
    # 12 mm at 1 Hz: 2 pi 0.012 = 75.4 mm/s, (2 pi)^2 0.012 = 0.474 m/s^2.
    assert item.point.peak_speed_m_s == pytest.approx(0.0754, rel=2e-3)
    assert 0.474 <= item.point.peak_acceleration_m_s2 < 1.1 * 0.474, "the fade adds a little"
    # At most 1 kN along its way: 48 mm a cycle, three whole cycles and two that a raised cosine fades, half of each.
    assert item.energy_J == pytest.approx(1000.0 * 0.048 * 4.0, rel=0.03)
    assert item.predicted_force_N == 1000.0
    assert item.duration_s == pytest.approx(5.5)


def test_a_known_damper_says_force_and_heat(tmp_path: Path) -> None:
    text = matrix_of("sweep", more='current = ["0 A"]\n').replace('max_force = "1 kN"', 'prior = "demo"') + SWEEP
    (item,) = planned(tmp_path, text).points
    assert item.predicted_force_N is not None
    assert 100.0 < item.predicted_force_N < 1000.0
    assert item.energy_J is not None
    way_J = item.predicted_force_N * 0.01 * 4.0 * 25.0
    assert 0.1 * way_J < item.energy_J < 0.9 * way_J


@pytest.mark.parametrize(
    ("text", "of_bench", "slug", "message"),
    [
        (SWEEP, {"speed": '"0.2 m/s"'}, "speed", r"speed 0\.\d+ m/s at \d\.\d+ s is above the bench's limit, 0.2 m/s"),
        (SWEEP, {"acceleration": '"3 m/s^2"'}, "acceleration", r"acceleration \d\.\d+ m/s\^2 at \d\.\d+ s is above"),
        (SWEEP.replace("10 mm", "90 mm"), {}, "stroke", "exceeds the specimen's stroke, 170 mm"),
        (SWEEP, {"register_map": '"demo"'}, "waveform", "no generator for this waveform"),
        (SWEEP.replace('"4 Hz"', '"6 Hz"'), {}, "sampling", "16.7 set-points per cycle"),
        (SWEEP.replace('"4 Hz"', '"12 Hz"'), {}, "sampling", "20.8 samples per cycle"),
    ],
)  # fmt: skip
def test_what_the_rig_cannot_do_is_refused_with_numbers(
    tmp_path: Path, text: str, of_bench: dict[str, str], slug: str, message: str
) -> None:
    (item,) = planned(tmp_path, matrix_of("sweep", more='current = ["0 A"]\n') + text, **of_bench).points
    assert slug in {cause.slug for cause in item.causes}
    assert re.search(message, "; ".join(item.reasons)), item.reasons


def test_the_amplitude_that_would_fit_is_reported(tmp_path: Path) -> None:
    text = matrix_of("sweep", more='current = ["0 A"]\n') + SWEEP
    (item,) = planned(tmp_path, text, speed='"0.1 m/s"').points
    share = 0.1 / item.peaks.speed_m_s
    assert item.would_fit_m == pytest.approx(share * item.point.amplitude_m, abs=1e-5)


def test_a_jump_in_a_file_is_faster_than_the_rig_and_reported_where(tmp_path: Path) -> None:
    drive = rows().replace("\n2.5000,0.000000", "\n2.5000,30.000000")
    assert "30.0" in drive
    (item,) = planned(tmp_path, matrix_of("file", more='current = ["0 A"]\n') + FILE, drive).points
    assert {"speed", "acceleration"} <= {cause.slug for cause in item.causes}
    assert re.search(r"speed [\d.]+ m/s at 2\.(49|50|51) s", item.reasons[0]), item.reasons


@pytest.mark.parametrize(
    ("drive", "message"),
    [
        ("", "is empty"),
        ("t,x\n0,1\n", "no column for time"),
        ("time_s,displacement\n0,1\n", "displacement_mm"),
        (rows().replace("\n1.0000,", "\n1.0000,nan,").replace("nan,", "nan#", 1), "line 102"),
        (rows().replace("\n1.0000,-0.000000", "\n1.0000,nan"), "line 102: '1.0000,nan' is not a row"),
        (rows().replace("\n1.0000,", "\n0.9800,"), "line 102: time 0.98 is not after 0.99"),
        (rows(4), "0.03 s long; allowed 3 s"),
        (rows(3), "3 rows; a motion requires"),
        (rows(62_000), "619.99 s long|620 s long"),
        ("time_h,displacement_mm\n0,0\n1e6,1\n2e6,3\n3e6,0\n", r"1\.08e\+10 s long; allowed: at most 600 s"),
        ("time_s,displacement_mm\n0,0\n1e300,1\n2e300,3\n3e300,0\n", "line 3: '1e300,1' is not a row"),
        ("time_us,displacement_mm\n0,0\n1e-310,1\n2e-310,3\n3e-310,0\n", "rows 1 and 2 are less than 1e-09 s apart"),
        ("time_s;displacement_mm\n0,00;0,0\n0,01;1,5\n", "line 2: .*; the decimal separator must be a point"),
        ("time_s,displacement_mm\n" + "".join(f"{k / 10},5\n" for k in range(50)), "motion between the ramps"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_motion_is_refused_with_its_line(tmp_path: Path, drive: str, message: str) -> None:
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, matrix_of("file") + FILE, drive)
    reported = "\n".join(caught.value.problems)
    assert re.search(message, reported), reported
    assert "matrix.file.file[1]" in reported


def test_other_columns_may_hold_anything_that_stands_in_quotes(tmp_path: Path) -> None:
    plain = rows().splitlines()
    noted = [f'{plain[0]},note'] + [f'{line},"cold, new oil"' for line in plain[1:]]
    text = matrix_of("file") + FILE
    reported = [load(tmp_path, text, "\n".join(lines)).points()[0].record for lines in (plain, noted)]
    assert reported[0] is not None
    assert reported[1] is not None
    assert reported[0].mark == reported[1].mark


@pytest.mark.parametrize(("made", "message"), [("nothing", "no such file"), ("pipe", "is a pipe, not a file")])
def test_a_road_whose_record_is_missing_or_a_pipe_is_refused_at_its_line(
    tmp_path: Path, made: str, message: str
) -> None:
    if made == "pipe":
        os.mkfifo(tmp_path / "track.csv")
    (tmp_path / "own.toml").write_text('format = 1\nspeed = "9 m/s"\nname = "x"\n[profile]\nfile = "track.csv"\n')
    with pytest.raises(FileProblem, match=rf"matrix\.road\.road\[2\].*{message}"):
        load(tmp_path, matrix_of("road") + ROAD.replace("paper-sweep", "own.toml"))


def test_an_obstacle_that_is_passed_in_the_ramp_is_no_motion(tmp_path: Path) -> None:
    # It begins at 10 m: after 0.1 s at 100 m/s.
    with pytest.raises(FileProblem, match=r"road\[1\].*too little motion between the ramps.* within a ramp of 1 s"):
        load(tmp_path, matrix_of("road") + ROAD.replace(', "paper-sweep"', "") + 'speed = "100 m/s"\n')


def test_a_file_that_is_named_as_another_entry_spoils_no_copy(tmp_path: Path) -> None:
    (tmp_path / "demo").write_text(rows(), encoding="utf-8")
    text = matrix_of("file").replace('max_force = "1 kN"', 'prior = "demo"') + FILE.replace("drive.csv", "demo")
    load(tmp_path, text)
    with pytest.raises(FileProblem, match="a name that is not also another value"):
        keep_matrix(tmp_path / "matrix.toml", tmp_path / "kept.toml")


@pytest.mark.parametrize("length_ms", [6000, 6001, 6002, 6003])
def test_whatever_the_plan_allows_begins_and_ends_at_rest_at_the_station(tmp_path: Path, length_ms: int) -> None:
    # 40 mm off the centre at both ends, faded in 0.2 s: without its last sample 0.02 mm and 15 mm/s are left.
    lines = [f"{k * length_ms / 5e5:.6f},{40 + 2 * math.sin(k / 20):.6f}" for k in range(501)]
    drive = "time_s,displacement_mm\n" + "\n".join(lines) + "\n"
    text = matrix_of("file", more='current = ["0 A"]\n') + FILE + 'ramp = "200 ms"\n'
    (item,) = planned(tmp_path, text, drive).points
    assert item.feasible
    assert item.point.record is not None
    order = station_order(signal_order(item.point, item.point.record), bench(tmp_path).limits, 20.0)
    assert [values[end] for values in (order.position_m, order.velocity_m_s) for end in (0, -1)] == [0.0] * 4


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match=r"matrix\.file\.file\[1\].*drive\.csv"):
        load(tmp_path, matrix_of("file") + FILE)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (matrix_of("sweep"), r"matrix.waveform.* requires a table \[matrix.sweep\]"),
        (matrix_of("sine") + SWEEP, "matrix.sweep: the table is not used"),
        (matrix_of("sweep", more="") + SWEEP, "matrix.current: is missing"),
        (matrix_of("sweep", more='current = ["0 A"]\nfrequency = ["1 Hz"]\n') + SWEEP, "frequency.*applies only to"),
        (matrix_of("sweep") + SWEEP.replace('"4 Hz"', '"1 Hz"'), "matrix.sweep.last_frequency"),
        (matrix_of("sweep") + SWEEP.replace('"10 s"', '"2 s"'), "matrix.sweep.duration.*2 s long"),
        (matrix_of("road") + ROAD.replace("bump", "bumpp"), r"matrix.road.road\[1\].*known: bump"),
        (matrix_of("road") + ROAD.replace('"bump"', '"paper-sweep"'), "paper-sweep is specified twice"),
        (matrix_of("sweeps"), "did you mean sweep"),
    ],
)  # fmt: skip
def test_every_wrong_entry_has_its_place_and_a_way_out(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, text)
    assert re.search(message, "\n".join(caught.value.problems)), caught.value.problems


def test_the_copy_in_a_campaign_needs_nothing_beside_it_and_is_the_same_matrix(tmp_path: Path) -> None:
    own, run = tmp_path / "own", tmp_path / "run"
    (own / "deep").mkdir(parents=True)
    run.mkdir()
    (own / "deep" / "drive.csv").write_text(rows(), encoding="utf-8")
    (own / "track.csv").write_text("distance_m,height\n0,0\n100,0.01\n200,0\n", encoding="utf-8")
    (own / "own.toml").write_text(
        'format = 1\nname = "own"\nspeed = "20 m/s"\n[profile]\nfile = "track.csv"\n', encoding="utf-8"
    )
    text = matrix_of("road", "file") + ROAD.replace('"paper-sweep"', '"own.toml"') + FILE.replace(
        '"drive.csv"', f"'{own}/deep/drive.csv'"
    )
    written = load(own, text)
    keep_matrix(own / "matrix.toml", run / "matrix.toml")
    assert sorted(path.name for path in (run / "records").iterdir()) == ["drive.csv", "own.toml", "track.csv"]
    for path in (own / "deep" / "drive.csv", own / "own.toml", own / "track.csv"):
        path.unlink()
    kept = load_matrix(run / "matrix.toml")
    assert kept.digest == written.digest
    assert [point.record for point in kept.points()] == [point.record for point in written.points()]
    copy = run / "records" / "drive.csv"
    copy.write_text(rows(amplitude_mm=11.0), encoding="utf-8")
    assert load_matrix(run / "matrix.toml").digest != written.digest, "a changed copy is another matrix"


def test_the_example_fits_the_bench_that_follows(tmp_path: Path) -> None:
    planned = plan(load_matrix(ROOT / "examples" / "signals.toml"), bench(tmp_path))
    assert planned.feasible
    assert [item.point.waveform for item in planned.points] == ["sine"] * 2 + ["sweep"] * 2 + ["road"] * 2 + [
        "file"
    ] * 2


@pytest.mark.parametrize(
    ("matrix", "given", "usual", "reported"),
    [
        ("signals.toml", (), True, ("--actuator=setpoints",)),
        ("signals.toml", ("--actuator", "rtu"), True, ("--actuator", "rtu")),
        ("signals.toml", (), False, ()),
        ("quick.toml", (), True, ()),
    ],
)
def test_the_usual_simulated_rig_follows_set_points_where_there_are_signals(
    matrix: str, given: tuple[str, ...], *, usual: bool, reported: tuple[str, ...]
) -> None:
    assert following(load_matrix(ROOT / "examples" / matrix), given, usual=usual) == reported


ITERATE = '[matrix.iterate]\ntolerance = "1.5 %"\niterations = 4\n'


def test_the_iteration_has_defaults_and_changes_the_digest_only_where_it_is_used(tmp_path: Path) -> None:
    plain, iterated, default = (
        load(tmp_path, f"{matrix_of('sweep')}{SWEEP}{more}") for more in ("", ITERATE, "[matrix.iterate]\n")
    )
    assert plain.sweep.iterate is None
    assert '"iterate"' not in plain.model_dump_json()
    assert len({plain.digest, iterated.digest, default.digest}) == 3
    assert iterated.sweep.iterate is not None
    settings = iterated.sweep.iterate.settings
    assert (settings.tolerance, settings.most, settings.gain, settings.least_coherence) == (0.015, 4, 0.8, 0.8)


@pytest.mark.parametrize(
    ("waveform", "table", "message"),
    [
        ("sweep", '[matrix.iterate]\ntolerance = "30 %"\n', "tolerance = \"30 %\": too large"),
        ("sweep", "[matrix.iterate]\ngian = 0.5\n", "did you mean gain"),
        ("sweep", "[matrix.iterate]\ngain = 1.5\n", "gain"),
        ("sweep", "[matrix.iterate]\niterations = 0\n", "iterations"),
        ("sine", "[matrix.iterate]\n", "applies only to signals"),
    ],
)
def test_a_wrong_iteration_is_named(tmp_path: Path, waveform: str, table: str, message: str) -> None:
    more = SWEEP if waveform == "sweep" else ""
    text = matrix_of(waveform, more='current = ["0 A"]\namplitude = ["5 mm"]\nfrequency = ["1 Hz"]\n')
    text = matrix_of("sweep") if waveform == "sweep" else text
    with pytest.raises(FileProblem, match=re.escape(message)):
        load(tmp_path, f"{text}{more}{table}")


def test_an_iterated_command_is_checked_as_the_plan_checks_a_point(tmp_path: Path) -> None:
    matrix, rig = load(tmp_path, f"{matrix_of('sweep')}{SWEEP}{ITERATE}"), bench(tmp_path)
    point = matrix.points()[0]
    target = point.record_samples
    assert target is not None
    limits = SignalLimits(point, matrix, rig, forecaster(matrix.specimen))
    assert limits.against(target, target) == ""
    assert limits.share(target) == 1.0
    for factor, part in ((4.0, "speed"), (9.0, "stroke")):
        large = replace(target, amplitude_m=factor * target.amplitude_m)
        assert part in limits.against(large, target)
        share = limits.share(large)
        assert 0.0 < share < 1.0
        assert limits.against(replace(large, amplitude_m=share * large.amplitude_m), target) == ""
    planned = plan(matrix, rig)
    hint = next(line for line in planned.warnings if "iterated" in line)
    assert "up to 5 trials" in hint
    currents = len(planned.points)
    longest_s = 20.0 + 0.5 + currents * 5 * (target.duration_s + 0.5)  # noise, then the target and four corrections
    assert planned.trials_s == pytest.approx(longest_s)
    assert planned.duration_s == pytest.approx(currents * planned.points[0].duration_s + longest_s)
    assert planned.to_json()["trials_s"] == planned.trials_s


FORCE = (
    '[matrix]\nwaveform = ["file"]\ncurrent = ["1 A", "2 A"]\n[matrix.file]\nfile = ["drive.csv"]\ntarget = "force"\n'
    'highest_frequency = "5 Hz"\n'
)
WITH_PRIOR = HEAD.replace('max_force = "1 kN"', 'prior = "demo"')


def force_rows(amplitude_kN: float = 0.6, name: str = "force_kN") -> str:
    lines = [f"{0.01 * k:.2f},{amplitude_kN * math.sin(math.tau * 0.02 * k):.6f}" for k in range(501)]
    return f"time_s,{name}\n" + "\n".join(lines) + "\n"


def test_the_motion_for_a_force_depends_on_the_current_and_is_checked_as_any_motion(tmp_path: Path) -> None:
    matrix, rig = load(tmp_path, f"{WITH_PRIOR}{FORCE}{ITERATE}", force_rows()), bench(tmp_path)
    weak, strong = matrix.points()
    assert weak.described.startswith("file drive (force) up to")
    assert weak.amplitude_m > 2.0 * strong.amplitude_m, "more current, less speed for the same force"
    assert weak.record_samples is not None
    assert weak.record_samples.force is not None
    assert np.ptp(weak.record_samples.force.force_N) == pytest.approx(1200.0, rel=0.01), "kN"
    hints = [line for line in plan(matrix, rig).warnings if "subtracted from the force" in line]
    assert [line[:4] for line in hints] == ["p001", "p002"]
    assert "not expected to converge" in hints[1], "2 A are mostly hysteresis"
    slow = bench(tmp_path, speed='"0.1 m/s"')
    assert "speed" in [cause.slug for cause in plan(matrix, slow).points[0].causes]


@pytest.mark.parametrize(
    ("text", "drive", "message"),
    [
        (f"{HEAD}{FORCE}{ITERATE}", force_rows(), "prior: is missing; with target"),
        (f"{WITH_PRIOR}{FORCE}", force_rows(), "requires a table [matrix.iterate]"),
        (f'{WITH_PRIOR}{FORCE}amplitude = "5 mm"\n{ITERATE}', force_rows(), "applies only to displacements"),
        (f"{WITH_PRIOR}{FORCE}{ITERATE}", rows(), "no column for force in 'time_s, displacement_mm'"),
        (f"{WITH_PRIOR}{FORCE}{ITERATE}", force_rows(9.0), "at 1 A: force of -9000 N at"),
        (f"{HEAD}{FORCE}{ITERATE}".replace('"force"', '"speed"'), rows(), "target"),
        (f'{matrix_of("file")}{FILE}lowest_frequency = "1 Hz"\n', rows(), 'applies only with target = "force"'),
    ],
)
def test_a_force_that_cannot_be_a_target_is_refused_with_its_place(
    tmp_path: Path, text: str, drive: str, message: str
) -> None:
    with pytest.raises(FileProblem, match=re.escape(message)):
        load(tmp_path, text, drive)


def test_files_of_displacements_keep_their_digest(tmp_path: Path) -> None:
    text = load(tmp_path, f"{matrix_of('file')}{FILE}", rows()).model_dump_json()
    assert '"target"' not in text
    assert '"lowest_Hz"' not in text


def test_a_target_beyond_a_limit_is_refused_with_the_amplitude_that_fits(tmp_path: Path) -> None:
    text = f"{matrix_of('sweep')}{SWEEP}{ITERATE}".replace('first_amplitude = "10 mm"', 'first_amplitude = "60 mm"')
    planned = plan(load(tmp_path, text), bench(tmp_path))
    assert not planned.feasible
    fits_m = planned.points[0].would_fit_m
    assert fits_m is not None
    assert 0.0 < fits_m < 0.06


def test_stored_commands_are_copied_only_where_they_exist_and_something_is_iterated(tmp_path: Path) -> None:
    earlier, folder = tmp_path / "earlier", tmp_path / "new"
    folder.mkdir()
    iterated = load(tmp_path, f"{matrix_of('sweep')}{SWEEP}{ITERATE}")
    with pytest.raises(FileProblem, match="contains no commands"):
        keep_drives(earlier, folder, iterated)
    (earlier / "drives").mkdir(parents=True)
    (earlier / "drives" / "p001.h5").write_bytes(b"command")
    with pytest.raises(FileProblem, match=r"no \[matrix.iterate\] table"):
        keep_drives(earlier, folder, load(tmp_path, f"{matrix_of('sweep')}{SWEEP}"))
    keep_drives(earlier, folder, iterated)
    assert (folder / "drives" / "p001.h5").read_bytes() == b"command"
