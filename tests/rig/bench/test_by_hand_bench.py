"""A bench whose current is set by hand: what its file may say, what is refused, in which order points run."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import pytest

from drivers.catalogue import make_manual_source
from drivers.ring import Channel
from rig.bench.model import Bench
from rig.campaign.manual_current import TerminalManualCurrent, check_manual_current
from rig.campaign.setup import accepted
from rig.campaign.simulated_rig import wearing
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan

TEXT = (Path(__file__).parents[3] / "examples/demo-bench.toml").read_text(encoding="utf-8")
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["6 mm"]
frequency = ["2 Hz", "4 Hz"]
current = ["1 A", "0 A", "0.5 A"]
"""


def bench(folder: Path, *entries: str) -> Bench:
    path = folder / "bench.toml"
    ecu = "\n".join(("[ecu]", "by_hand = true", *entries))
    path.write_text(f"{TEXT[: TEXT.index('[ecu]')]}{ecu}\n{TEXT[TEXT.index('[load_cell]') :]}", encoding="utf-8")
    return Bench.load(path)


def matrix(folder: Path, text: str = MATRIX) -> Matrix:
    (folder / "matrix.toml").write_text(text, encoding="utf-8")
    return load_matrix(folder / "matrix.toml")


def test_nothing_else_is_needed_and_the_pressure_is_off_while_somebody_is_requested(tmp_path: Path) -> None:
    ecu = bench(tmp_path).ecu
    assert (ecu.pressure_while_asked, ecu.answer_within_s, ecu.rehearsal) == ("off", 600.0, None)
    assert wearing(tmp_path / "bench.toml")[2:4] == ("--by-hand", "off")


def test_entries_of_other_current_sources_are_refused_all_at_once(tmp_path: Path) -> None:
    with pytest.raises(FileProblem) as caught:
        bench(tmp_path, 'interface = "socketcan"', 'channel = "can0"', 'voltage_limit = "12 V"')
    for name in ("interface", "channel", "voltage_limit"):
        assert any(f"ecu.{name}" in text and "combined with by_hand" in text for text in caught.value.problems)


@pytest.mark.parametrize(
    "entry", ['pressure_while_asked = "half"', 'answer_within = "5 s"', 'rehearsal = "tcp://192.168.0.7:5025"']
)
def test_what_is_not_allowed_is_refused(tmp_path: Path, entry: str) -> None:
    with pytest.raises(FileProblem, match=entry.split(" ", maxsplit=1)[0]):
        bench(tmp_path, entry)


def test_points_run_by_rising_current_with_their_names_and_the_changes_are_counted(tmp_path: Path) -> None:
    given = matrix(tmp_path)
    planned = plan(given, bench(tmp_path))
    assert [item.point.current_A for item in planned.points] == [0.0, 0.0, 0.5, 0.5, 1.0, 1.0]
    assert [item.point.id for item in planned.points] == ["p003", "p004", "p005", "p006", "p001", "p002"]
    assert any("must change it 3 times" in warning for warning in planned.warnings), "to 0.5, to 1, back to 0"
    drawn = matrix(tmp_path, MATRIX + 'order = "random"\nseed = 4\n')
    assert [item.point for item in plan(drawn, bench(tmp_path)).points] == list(drawn.points())


@pytest.mark.parametrize(
    ("added", "slug"),
    [
        ("[[current_step]]\ncurrent = [\"0 A\", \"1 A\"]\n", "by-hand-without-steps"),
        ("[campaign]\ndemagnetise = true\n", "source-without-negative-current"),
        ('[temperature]\nwindow = ["25 degC", "40 degC"]\n', "source-without-temperature"),
        (
            '[[endurance]]\namplitude = "5 mm"\nfrequency = "1 Hz"\ncurrent = "0 A"\ncycles = 100\n'
            'stop.temperature = "90 degC"\n', "source-without-temperature",
        ),
    ],
)
def test_matrices_that_nobody_can_follow_are_refused(tmp_path: Path, added: str, slug: str) -> None:
    with pytest.raises(Refused) as caught:
        accepted(matrix(tmp_path, MATRIX + added), bench(tmp_path))
    assert caught.value.slug == slug


def test_without_somebody_at_a_terminal_it_is_refused(tmp_path: Path) -> None:
    given = bench(tmp_path)
    check_manual_current(given, attended=True)
    with pytest.raises(Refused, match="run the command in a terminal") as caught:
        check_manual_current(given, attended=False)
    assert caught.value.slug == "by-hand-unattended"
    check_manual_current(bench(tmp_path, 'rehearsal = "tcp://127.0.0.1:5025"'), attended=False)


def test_only_an_empty_line_typed_after_the_question_confirms() -> None:
    master, slave = os.openpty()
    try:
        hand = TerminalManualCurrent(slave)
        os.write(master, b"\n")
        assert not hand.answered(), "nothing was asked"
        hand.ask(0.5)
        assert not hand.answered(), "it was typed before the question"
        os.write(master, b"no\n")
        assert not hand.answered()
        os.write(master, b"\n")
        assert hand.answered()
        assert not hand.answered(), "once"
    finally:
        os.close(master)
        os.close(slave)


def test_what_was_stated_stays_stated_whatever_a_stop_commands() -> None:
    source = make_manual_source(None)
    source.open()
    source.start(0.01)
    source.command(0.5)
    source.send_now()
    batch = source.read_batch(0.0)
    assert [status.current_A for status in batch.statuses] == [0.5]
    assert {record[4]: record[2] for record in batch.records}[int(Channel.COIL_CURRENT)] == 0.5
    source.command(0.0, enable=False)
    assert [status.current_A for status in source.read_batch(0.0).statuses] == [0.5], "nobody turned the knob"
    source.command(0.0)
    assert [status.current_A for status in source.read_batch(0.0).statuses] == [0.0]
    assert not source.traits.measures
    assert source.identity is None, "which supply it is, nobody knows"


def test_a_controller_that_keeps_its_pressure_must_be_written(tmp_path: Path) -> None:
    map_file = Path(__file__).parents[3] / "drivers/devices/float-drive_controller.toml"
    given = bench(tmp_path)
    assert given.actuator.takes_pressure_away
    kept = dataclasses.replace(given.actuator, register_map="float-drive")
    assert map_file.exists()
    if not kept.takes_pressure_away:
        path = tmp_path / "bench.toml"
        path.write_text(path.read_text().replace("[actuator]", '[actuator]\nregister_map = "float-drive"', 1))
        with pytest.raises(FileProblem, match="pressure_while_asked"):
            Bench.load(path)
