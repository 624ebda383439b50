"""`[[endurance]]` of a matrix file: its points, what is wrong with it, and digests that stay."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from rig.bench.model import Bench
from rig.campaign.sequencer.endurance import left_of
from rig.errors import FileProblem
from rig.matrix import named_files
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan
from rig.signals.repeated_record import RepeatedRecord
from rig.test_point import ENDURANCE, LOOP

ROOT = Path(__file__).resolve().parents[3]
QUICK = (ROOT / "examples" / "quick.toml").read_text(encoding="utf-8")
TEST = """
[[endurance]]
id = "wear"
amplitude = "10 mm"
frequency = "4 Hz"
current = "1 A"
cycles = 1000
block = 150
performance_every = 400
full_samples_every = 50
[endurance.stop]
force_down = "20 %"
temperature = "90 degC"
"""


def load(folder: Path, text: str) -> Matrix:
    path = folder / "matrix.toml"
    path.write_text(text, encoding="utf-8")
    return load_matrix(path)


def problems(folder: Path, text: str) -> str:
    with pytest.raises(FileProblem) as caught:
        load(folder, text)
    return "\n".join(caught.value.problems)


def test_blocks_and_performance_points_alternate(tmp_path: Path) -> None:
    points = load(tmp_path, QUICK + TEST).points()
    ids = [point.id for point in points]
    assert ids == [
        "p001", "p002", "wear-b1", "wear-b2", "wear-b3", "p001-wear-400", "p002-wear-400", "wear-b4", "wear-b5",
        "wear-b6", "p001-wear-800", "p002-wear-800", "wear-b7", "wear-b8", "p001-wear-end", "p002-wear-end",
    ]
    blocks = [point for point in points if point.kind == ENDURANCE]
    assert [point.cycles for point in blocks] == [133, 133, 134, 133, 133, 134, 100, 100]
    before = [point.endurance.cycles_before for point in blocks if point.endurance]
    assert before == [0, 133, 266, 400, 533, 666, 800, 900]
    last = points[-1]
    assert (last.kind, last.endurance.cycles_before if last.endurance else None) == (LOOP, 1000)
    assert points[0].endurance is None


def test_blocks_without_a_size_last_at_most_ten_minutes(tmp_path: Path) -> None:
    matrix = load(tmp_path, QUICK + TEST.replace("block = 150\n", "").replace("cycles = 1000", "cycles = 1000000"))
    test = matrix.endurance_tests["wear"]
    assert test.most_in_a_block == 2400
    assert max(point.motion_s for point in matrix.points() if point.kind == ENDURANCE) <= 602.0


def test_rules_are_in_si(tmp_path: Path) -> None:
    (test,) = load(tmp_path, QUICK + TEST).endurance
    assert [(rule.name, rule.limit, rule.kind.relative) for rule in test.stop.rules] == [
        ("force_down", 0.2, True), ("temperature", 90.0, False),
    ]


def test_the_digest_of_a_matrix_without_endurance_stays(tmp_path: Path) -> None:
    assert load(tmp_path, QUICK).digest == "a00ecbc94393f97d89fd9118652dba5f2167483f9f64e264ad264408659198a6"
    assert load(tmp_path, QUICK + TEST).digest != load(tmp_path, QUICK).digest


def test_endurance_alone_is_no_fit(tmp_path: Path) -> None:
    alone = re.sub(r"(?s)\[matrix\].*?\n\[campaign\]", "[campaign]", QUICK)
    matrix = load(tmp_path, alone + TEST.replace("performance_every = 400\n", ""))
    assert not matrix.wants_fit
    assert all(point.kind == ENDURANCE for point in matrix.points())


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("performance_every = 400", "performance_every = 4000"), "4000 cycles exceeds the length of the test"),
        (("cycles = 1000", "cycles = 5"), "endurance[1].cycles"),
        (("block = 150", "block = 20000"), "endurance[1].block"),
        (("block = 150", "block = 150\nrun_in = 1000"), "no cycles for the baseline"),
        (('force_down = "20 %"', 'force_down = "120 %"'), "endurance[1].stop.force_down"),
        (("[endurance.stop]", 'waveform = "triangle"\n[endurance.stop]\nfriction_up = "20 %"'), "cannot be separated"),
        (('force_down = "20 %"', 'forcedown = "20 %"'), "force_down"),
        (("cycles = 1000\nblock = 150\nperformance_every = 400", "cycles = 10000000\nblock = 10"), "longer blocks"),
        (("1000\nblock = 150\nperformance_every = 400", "100000000\nperformance_every = 10"), "10000000 blocks and"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, change: tuple[str, str], expected: str) -> None:
    assert expected in problems(tmp_path, QUICK + TEST.replace(*change))


def test_two_tests_of_one_name_are_refused(tmp_path: Path) -> None:
    assert "two endurance tests have the ID 'wear'" in problems(tmp_path, QUICK + TEST + TEST)


def test_a_block_beyond_the_machine_is_refused_and_named(tmp_path: Path) -> None:
    matrix = load(tmp_path, QUICK + TEST.replace('frequency = "4 Hz"', 'frequency = "40 Hz"'))
    planned = plan(matrix, Bench.load(ROOT / "examples" / "demo-bench.toml"))
    refused = {item.point.id for item in planned.points if not item.feasible}
    assert refused == {point.id for point in matrix.points() if point.kind == ENDURANCE}


def test_a_plan_of_many_blocks_checks_equal_motions_once(tmp_path: Path) -> None:
    matrix = load(tmp_path, QUICK + TEST.replace("cycles = 1000", "cycles = 200000"))
    planned = plan(matrix, Bench.load(ROOT / "examples" / "demo-bench.toml"))
    blocks = [item for item in planned.points if item.point.kind == ENDURANCE]
    assert len(blocks) == 1500
    assert len({id(item.peaks) for item in blocks}) <= 3


PROGRAM = 'current_program = [["0 s", "0.2 A"], ["2 s", "1 A"]]\ncurrent_period = "4 s"\n'


def test_a_current_program_is_repeated_through_each_block(tmp_path: Path) -> None:
    """16 cycles of 4 Hz: the first step is 8 cycles after the first full cycle, which begins at 0.25 s."""
    matrix = load(tmp_path, QUICK + TEST.replace('current = "1 A"\n', PROGRAM))
    block = next(point for point in matrix.points() if point.kind == ENDURANCE)
    assert block.steps_s[:4] == (0.0, 2.25, 4.25, 6.25)
    assert block.steps_A[:4] == (0.2, 1.0, 0.2, 1.0)
    assert block.steps_s[-1] < block.motion_s
    assert block.endurance is not None
    assert (block.current_A, block.first_current_A, block.endurance.program_cycles) == (1.0, 0.2, 16)
    planned = plan(matrix, Bench.load(ROOT / "examples" / "demo-bench.toml"))
    assert planned.feasible
    low = QUICK.replace("[specimen]", '[specimen]\nmax_current = "0.5 A"')
    low += TEST.replace('current = "1 A"\n', PROGRAM)
    refused = plan(load(tmp_path, low), Bench.load(ROOT / "examples" / "demo-bench.toml"))
    assert not any(item.feasible for item in refused.points if item.point.kind == ENDURANCE)


def test_blocks_have_no_more_steps_than_a_program_can_have(tmp_path: Path) -> None:
    text = TEST.replace('current = "1 A"\n', PROGRAM.replace("2 s", "0.5 s").replace("4 s", "1 s"))
    text = text.replace("block = 150\n", "").replace("cycles = 1000", "cycles = 100000").replace("400", "50000")
    text = text.replace('force_down = "20 %"\n', '')  # at 4 Hz no cycle has a constant current
    blocks = [point for point in load(tmp_path, QUICK + text).points() if point.kind == ENDURANCE]
    assert max(len(point.steps_s) for point in blocks) <= 2000
    (test,) = load(tmp_path, QUICK + text).endurance
    assert test.most_in_a_block == 2400


@pytest.mark.parametrize(
    ("program", "expected"),
    [
        ("", "specify current or current_program"),
        (PROGRAM.replace("4 s", "4.1 s"), "16.4 cycles at 4 Hz; cycles at the same current are compared"),
        (PROGRAM + 'current = "1 A"\n', "current_program is also specified"),
        (PROGRAM.splitlines()[0] + "\n", "current_period: missing"),
        (PROGRAM.replace("0 s", "1 s"), "required: 0 s"),
        (PROGRAM.replace("2 s", "5 s"), "not later than the last step"),
        (PROGRAM.replace("1 A", "0.2 A"), "only one current"),
        (PROGRAM.replace("4 s", "50 s"), "do not fit into a block"),
        (PROGRAM.replace("2 s", "20 ms").replace("4 s", "0.25 s"), "stop.force_down = \"20 %\": the current changes"),
        (PROGRAM.replace("2 s", "0.5 s").replace("4 s", "1 s"), "hold each current for at least 4 cycles"),
        (PROGRAM.replace("2 s", "0.75 s").replace("4 s", "1.5 s"), None),
    ],
)
def test_a_wrong_current_program_is_named(tmp_path: Path, program: str, expected: str | None) -> None:
    text = QUICK + TEST.replace('current = "1 A"\n', program)
    if expected is None:
        assert load(tmp_path, text).endurance[0].program is not None
    else:
        assert expected in problems(tmp_path, text)


@pytest.mark.parametrize(("at", "accepted"), [("0.25 s", True), ("0.5 s", False)])
def test_a_current_that_changes_in_every_cycle_can_be_judged_only_if_it_changes_at_a_reversal(
    tmp_path: Path, at: str, accepted: bool
) -> None:
    """1 Hz: the rod reverses at 0.25 s and 0.75 s; at mid-travel some milliseconds would look like wear."""
    program = f'current_program = [["0 s", "1 A"], ["{at}", "0.2 A"], ["0.75 s", "1 A"]]\ncurrent_period = "1 s"\n'
    text = QUICK + TEST.replace('current = "1 A"\n', program).replace('"4 Hz"', '"1 Hz"')
    if accepted:
        assert not load(tmp_path, text).endurance[0].program.held
    else:
        assert "looks like wear" in problems(tmp_path, text)


def test_a_current_without_a_constant_cycle_is_stated_by_the_plan(tmp_path: Path) -> None:
    program = 'current_program = [["0 s", "1 A"], ["2 s", "0.2 A"], ["2.25 s", "0.5 A"]]\ncurrent_period = "4 s"\n'
    (test,) = load(tmp_path, QUICK + TEST.replace('current = "1 A"\n', program)).endurance
    assert [hint for hint in test.hints("wear") if "do not use the cycles at 0.2 A" in hint]


MIXED = TEST.replace("cycles = 1000", 'add = [{ amplitude = "1 mm", frequency = "10 Hz" }]\ncycles = 1000')
STREAMED = ROOT / "examples" / "streamed-bench.toml"


def road(folder: Path, duration_s: float = 8.0) -> str:
    """A signal file, and a test that repeats it."""
    time_s = np.arange(0.0, duration_s + 0.005, 0.01)
    rows = "".join(f"{at_s:.2f},{8.0 * math.sin(4.0 * at_s):.4f}\n" for at_s in time_s)
    (folder / "road.csv").write_text(f"time_s,displacement_mm\n{rows}", encoding="utf-8")
    return re.sub(r"amplitude.*\nfrequency.*\n", 'file = "road.csv"\n', TEST).replace("block = 150", "block = 50")


def test_a_sine_on_sine_is_a_record_of_common_periods(tmp_path: Path) -> None:
    """4 Hz and 10 Hz repeat themselves together after 0.5 s."""
    matrix = load(tmp_path, QUICK + MIXED)
    block = next(point for point in matrix.points() if point.kind == ENDURANCE)
    assert (block.frequency_Hz, block.cycles, block.cyclic) == (2.0, 133, False)
    record = block.record
    assert isinstance(record, RepeatedRecord)
    assert record.duration_s - 2.0 * record.ramp_s == pytest.approx(133 * 0.5)
    assert block.described.startswith("sine on sine 4 Hz + 10 Hz up to")
    left = left_of(block, 30)
    assert left.motion_s == pytest.approx(30 * 0.5 + 2.0 * record.ramp_s, abs=2e-3)
    assert left.endurance is not None
    assert left.endurance.cycles_before == 103


def test_a_signal_file_is_repeated_and_counts_by_its_content(tmp_path: Path) -> None:
    text = QUICK + road(tmp_path)
    matrix = load(tmp_path, text)
    blocks = [point for point in matrix.points() if point.kind == ENDURANCE]
    assert blocks[0].motion_s == pytest.approx(50 * 8.0)
    assert blocks[0].described.startswith("file road up to")
    digest = matrix.digest
    kept_text, files = named_files.kept(text, tmp_path)
    assert files.keys() == {"road.csv"}
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "records").mkdir()
    (tmp_path / "copy" / "records" / "road.csv").write_bytes(files["road.csv"])
    assert load(tmp_path / "copy", kept_text).digest == digest
    road(tmp_path, 8.5)
    assert load(tmp_path, text).digest != digest


def test_a_current_program_follows_the_repetitions_of_a_signal(tmp_path: Path) -> None:
    program = 'current_program = [["0 s", "0 A"], ["16 s", "1 A"]]\ncurrent_period = "32 s"\n'
    matrix = load(tmp_path, QUICK + road(tmp_path).replace('current = "1 A"\n', program))
    block = next(point for point in matrix.points() if point.kind == ENDURANCE)
    assert block.steps_s[:4] == (0.0, 16.0, 32.0, 48.0)
    repeated = block.repeated_program
    assert repeated is not None
    assert (repeated.cycles, repeated.period_s, repeated.time_s) == (4, 32.0, (0.0, 16.0))
    left = left_of(block, 3)
    assert [at_s for at_s, _ in left.steps_in_motion] == [0.0, 16.0]


def test_only_an_actuator_with_set_points_repeats_a_record(tmp_path: Path) -> None:
    matrix = load(tmp_path, QUICK + MIXED.replace('"10 Hz"', '"5 Hz"'))
    for bench, feasible in ((STREAMED, True), (ROOT / "examples" / "demo-bench.toml", False)):
        planned = plan(matrix, Bench.load(bench))
        blocks = [item for item in planned.points if item.point.kind == ENDURANCE]
        assert {item.feasible for item in blocks} == {feasible}
        assert feasible or {cause.slug for item in blocks for cause in item.causes} == {"waveform"}


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (('"10 Hz" }', '"4 Hz" }'), "is already the frequency of the base sine"),
        (('"10 Hz" }', '"9.8696044 Hz" }'), "does not repeat within 599.5 s; its cycles cannot be compared. Fix: "
            "use simple ratios to 4 Hz, for example 10 Hz"),
        (('"10 Hz" }', '"4.001 Hz" }'), "for example 6 Hz"),
        (('"10 Hz" }', '"0.3141592 Hz" }'), "for example 0.25 Hz"),
        (('"10 Hz" }', '"9 Hz" }, { amplitude = "2 mm", frequency = "9 Hz" }'), "the frequency of another added sine"),
        (("cycles = 1000", 'waveform = "triangle"\ncycles = 1000'), "only to a sine, not to a triangle"),
        (("cycles = 1000", 'ramp = "1 s"\ncycles = 1000'), "applies only with file"),
        (("block = 150", "block = 5000"), "Fix: set block = 1199"),
        (("cycles = 1000", 'file = "road.csv"\ncycles = 1000'), "file is also specified"),
        (("amplitude = \"10 mm\"\n", ""), "missing: amplitude"),
    ],
)
def test_a_wrong_record_is_named(tmp_path: Path, change: tuple[str, str], expected: str) -> None:
    road(tmp_path)
    assert expected in problems(tmp_path, QUICK + MIXED.replace(*change))


def test_a_signal_file_that_cannot_be_used_is_named_with_its_line(tmp_path: Path) -> None:
    text = QUICK + road(tmp_path)
    (tmp_path / "road.csv").write_text("time_s,displacement_mm\n0,1\n0.1,x\n0.2,3\n0.3,4\n", encoding="utf-8")
    assert "endurance[1].file" in problems(tmp_path, text)
    assert "line 3" in problems(tmp_path, text)
    assert "no such file" in problems(tmp_path, text.replace("road.csv", "rood.csv"))
    road(tmp_path, 400.0)
    assert "block = 1" in problems(tmp_path, text)


def test_long_blocks_are_warned_of(tmp_path: Path) -> None:
    """600 s at 4 Hz are 2400 cycles; 60 s are 240."""
    long = TEST.replace("block = 150\n", "").replace("cycles = 1000\n", "cycles = 9600\n").replace("= 400", "= 4800")
    (test,) = load(tmp_path, QUICK + long).endurance
    (hint,) = test.hints("wear")
    assert "up to 2,400 further cycles (600 s)" in hint
    assert "Fix: set block = 240" in hint
    assert list(load(tmp_path, QUICK + long.split("[endurance.stop]")[0]).endurance[0].hints("wear")) == []
    (test,) = load(tmp_path, QUICK + TEST.replace('current = "1 A"\n', PROGRAM)).endurance
    assert list(test.hints("wear")) == []
