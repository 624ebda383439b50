"""A block of an endurance test from its journal to its file: every cycle counted once, some with all samples."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_rig import SyntheticRig

from drivers.ring import Channel
from drivers.roles import ProgramPhase
from rig.campaign.resume import renew_endurance
from rig.campaign_folder import CampaignFolder
from rig.recording.conversion.conversion import finish_alone
from rig.recording.conversion.delay_correction import retime
from rig.recording.endurance import BlockPiece, EnduranceLedger, ledgers_of, read_piece, read_pieces
from rig.recording.hdf5.reading import check_values, read_cycles
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.journal.journal_lock import campaign_held
from rig.recording.point_attributes import NOT_STATED, attributes_of, point_fields
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import RECORD_DTYPE
from rig.results.content import content_of
from rig.signals.record import RecordFacts
from rig.signals.wear_trend import NO_SECTIONS, StopRule
from rig.test_point import ENDURANCE, EnduranceStep, TestPoint

CYCLES = 40
RIG = SyntheticRig(cycles=CYCLES, frequency_Hz=4.0, noise_N=2.0)
STEP = EnduranceStep("wear", 100, 1000, 2, CYCLES, 10, unseen_cycles=7)


def counted(done: np.ndarray) -> np.ndarray:
    """The controller's count of cycles, in polls of 20 ms."""
    records = np.zeros(len(done), RECORD_DTYPE)
    time_s = RIG.start_s - 0.4 + 0.02 * np.arange(len(done))
    records["host_ns"], records["device_us"] = np.round(1e9 * time_s), np.round(1e6 * time_s)
    records["value"], records["channel"] = done, Channel.CYCLES_DONE
    return records


def set_points(until_s: float) -> np.ndarray:
    """Time and target of each set-point of a signal, every 10 ms from the motion's start to its end."""
    elapsed_s = np.arange(0.0, min(until_s, (CYCLES + 2) / RIG.frequency_Hz) + 0.011, 0.01)
    records = np.zeros((2, len(elapsed_s)), RECORD_DTYPE)
    records["host_ns"] = np.round(1e9 * (RIG.start_s + elapsed_s))
    records["device_us"] = -1
    target_m = RIG.amplitude_m * np.sin(2.0 * np.pi * RIG.frequency_Hz * elapsed_s)
    for row, (channel, value) in enumerate(
        ((Channel.SIGNAL_TIME, elapsed_s), (Channel.SIGNAL_TARGET, target_m))
    ):
        records[row]["channel"], records[row]["value"] = channel, value
    return records.ravel()


def repeated(points: Path, *, until_s: float = np.inf, ended: bool = True, stopped_by: str | None = None) -> Path:
    """The file of a block of a signal that is repeated, whose cycle is one of the synthetic rig's."""
    facts = RecordFacts("road", (CYCLES + 2) / RIG.frequency_Hz, 1.0 / RIG.frequency_Hz, RIG.frequency_Hz)
    return block(points, until_s=until_s, record=facts, more=set_points(until_s), ended=ended, stopped_by=stopped_by)


def block(
    points: Path, *, name: str = "wear-b2", step: EnduranceStep = STEP, until_s: float = np.inf, ended: bool = True,
    stopped_by: str | None = None, count: np.ndarray | None = None, cycles: int = CYCLES, lost: slice | None = None,
    record: RecordFacts | None = None, more: np.ndarray | None = None,
) -> Path:
    """Write a journal, have its file made, and return the file."""
    point = TestPoint(
        name, "sine", RIG.amplitude_m, RIG.frequency_Hz, RIG.current_A, cycles, 1.0, 1.0, kind=ENDURANCE, endurance=step
    )
    if record is not None:
        point = replace(point, waveform="file", record=record, ramp_in_cycles=0.0, ramp_out_cycles=0.0)
    context = RIG.context(point=point, provenance={"point": "wear-b2", "attempt": "1"})
    added = [counted(count)] if count is not None else [] if more is None else [more]
    records = np.concatenate([RIG.records(), *added])
    records = records[np.argsort(records["host_ns"], kind="stable")]
    records = records[records["host_ns"] < 1e9 * (RIG.start_s + until_s)]
    if lost is not None:
        of_force = np.flatnonzero(records["channel"] == Channel.FORCE)[lost]
        records = np.delete(records, of_force)
    points.mkdir(exist_ok=True)
    path = points / f"{name}.journal"
    writer = JournalWriter(path, context.to_json())
    writer.append(records)
    writer.close(stopped_by=stopped_by, lost_records=0)
    if not ended:
        path.write_bytes(path.read_bytes()[:-1])  # the end is torn, as after kill -9
    finished = finish_alone(path, recovered=not ended)
    assert finished.error == ""
    return Path(finished.file)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return block(tmp_path_factory.mktemp("whole") / "points")


def test_every_cycle_has_its_number_and_its_statistics(whole: Path) -> None:
    columns = read_cycles(whole)
    assert columns is not None
    assert columns["number"].tolist() == list(range(101, 101 + CYCLES))
    assert columns["stiffness"] == pytest.approx(RIG.stiffness, rel=0.02)
    assert columns["damping"] == pytest.approx(RIG.damping, rel=0.02)
    area_J = np.pi * RIG.damping * RIG.amplitude_m**2 * 2.0 * np.pi * RIG.frequency_Hz
    assert columns["energy"] == pytest.approx(area_J, rel=0.01)
    check_values(whole)


def test_full_samples_are_kept_of_every_tenth_cycle(whole: Path) -> None:
    point = RecordedPoint.open(whole)
    columns = read_cycles(whole)
    assert columns is not None
    chosen = columns["number"] % 10 == 0
    starts = columns["start"][chosen]
    place = np.searchsorted(starts, point.time_s, side="right") - 1
    assert np.all(place >= 0)
    assert np.all(point.time_s < starts[place] + columns["period"][chosen][place] + 1e-6)
    assert point.samples == pytest.approx(4 * 250.0 / RIG.frequency_Hz, abs=4)
    raw = point.raw("force")
    assert raw is not None
    assert len(raw["value"]) == pytest.approx(point.samples, abs=8)


def test_a_whole_block_is_valid_and_counted(whole: Path) -> None:
    piece = read_piece(whole)
    assert piece is not None
    assert (piece.run, piece.recorded, piece.unseen, piece.verdict) == (CYCLES, CYCLES, 0, "valid")
    assert len(piece.sections) == 4
    assert RecordedPoint.open(whole).endurance == STEP
    rows = content_of(whole.parents[1]).children["characteristics"]
    values = {row["quantity"]: row["value"] for row in rows if row["quantity"].startswith("endurance")}
    assert (values["endurance_cycles"], values["endurance_progress"]) == (CYCLES, CYCLES / 1000)
    assert abs(values["endurance_end_force_down"]) < 0.02, "a damper that does not wear"
    assert not any(name.startswith("endurance_cycles_to") for name in values), "no stop rule ended the test"


def test_a_torn_journal_counts_what_it_holds_and_states_what_may_be_missing(tmp_path: Path) -> None:
    file = block(tmp_path / "points", until_s=(1.0 + 12.6) / RIG.frequency_Hz, ended=False)
    piece = read_piece(file)
    assert piece is not None
    assert (piece.run, piece.recorded, piece.unseen, piece.verdict) == (12, 12, 7, "invalid")
    assert "INTERRUPTED" in RecordedPoint.open(file).reasons[0]
    assert RecordedPoint.open(file).time_s[-1] > 12.0 / RIG.frequency_Hz  # the last seconds are kept


@pytest.mark.parametrize(("block_cycles", "sections"), [(CYCLES, 0), (4, 1)])
def test_a_short_piece_of_a_block_is_counted_but_not_compared(tmp_path: Path, block_cycles: int, sections: int) -> None:
    """4 cycles: of an interrupted block, after which the damper had cooled; or of a test whose blocks are as short."""
    step = STEP._replace(block_cycles=block_cycles)
    piece = read_piece(block(tmp_path / "points", step=step, until_s=5.4 / RIG.frequency_Hz, ended=False))
    assert piece is not None
    assert (piece.recorded, len(piece.sections)) == (4, sections)


def test_a_stopped_block_is_recorded_to_its_end(tmp_path: Path) -> None:
    file = block(tmp_path / "points", stopped_by="ecu-silent", cycles=CYCLES + 50)
    piece = read_piece(file)
    assert piece is not None
    assert (piece.run, piece.unseen) == (CYCLES, 0)


def test_a_block_that_ends_early_after_its_last_cycle_is_valid(tmp_path: Path) -> None:
    """Its cycles cannot be run again: they were run, and are on record."""
    for number, end in enumerate(({"stopped_by": "ecu-silent"}, {"ended": False})):
        file = block(tmp_path / f"points{number}", until_s=(1.0 + CYCLES + 0.6) / RIG.frequency_Hz, **end)
        piece = read_piece(file)
        assert piece is not None
        assert (piece.run, piece.unseen, piece.verdict) == (CYCLES, 0, "valid")


def test_samples_that_end_before_the_motion_leave_cycles_without_a_record(tmp_path: Path) -> None:
    """The station was killed: the application ends the journal in good order, but the rod went on for a while."""
    file = block(tmp_path / "points", until_s=(1.0 + 9.5) / RIG.frequency_Hz, stopped_by="task-dies")
    piece = read_piece(file)
    assert piece is not None
    assert (piece.run, piece.unseen) == (9, 7)


def test_the_count_of_the_program_before_is_not_that_of_a_block_that_was_cut_off(tmp_path: Path) -> None:
    """The controller shows the cycles of its last program until the next one starts."""
    stale = np.full(30, CYCLES + 2.0)
    reset = np.concatenate([stale, np.arange(4.0)])
    for number, count in enumerate((stale, reset), start=1):
        file = block(
            tmp_path / f"points{number}", until_s=(1.0 + 5.5) / RIG.frequency_Hz, ended=False, count=count
        )
        piece = read_piece(file)
        assert piece is not None
        assert piece.run == 5


def test_the_cycles_of_a_fade_out_are_not_counted(tmp_path: Path) -> None:
    """Stopped in the 13th full cycle, the controller counts on while it fades out over two cycles."""
    done = counted(np.array([0.0, 0.0, *range(14), 13.0, 14.0, 15.0, 15.0]))
    phases = counted(np.array([0.0, *[ProgramPhase.RAMP_IN] * 2, *[ProgramPhase.FULL_AMPLITUDE] * 13,
                               *[ProgramPhase.RAMP_OUT] * 3, ProgramPhase.IDLE], np.float64))
    phases["channel"] = Channel.PHASE
    until_s = (1.0 + 5.5) / RIG.frequency_Hz
    for number, (more, run) in enumerate(((np.concatenate((done, phases)), 12), (done, 14))):
        piece = read_piece(block(tmp_path / f"points{number}", until_s=until_s, stopped_by="ecu-silent", more=more))
        assert piece is not None
        assert piece.run == run


def test_cycles_whose_samples_are_missing_were_run_all_the_same(tmp_path: Path) -> None:
    file = block(tmp_path / "points", lost=slice(1000, 1200))
    piece = read_piece(file)
    assert piece is not None
    assert piece.run == CYCLES
    assert CYCLES - 6 <= piece.recorded <= CYCLES - 3


def test_the_cycles_of_a_repeated_signal_are_counted_by_its_set_points(tmp_path: Path) -> None:
    file = repeated(tmp_path / "points")
    piece, columns = read_piece(file), read_cycles(file)
    assert piece is not None
    assert columns is not None
    assert (piece.run, piece.recorded, piece.unseen) == (CYCLES, CYCLES, 0)
    assert columns["number"].tolist() == list(range(101, 101 + CYCLES))
    assert columns["period"] == pytest.approx(1.0 / RIG.frequency_Hz, abs=1e-9)
    assert columns["stiffness"][1:-1] == pytest.approx(RIG.stiffness, rel=0.02)
    area_J = np.pi * RIG.damping * RIG.amplitude_m**2 * 2.0 * np.pi * RIG.frequency_Hz
    assert columns["energy"][1:-1] == pytest.approx(area_J, rel=0.01)


@pytest.mark.parametrize("stopped_by", [None, "ecu-silent"])
def test_a_repeated_signal_that_was_interrupted_counts_its_whole_cycles(tmp_path: Path, stopped_by: str | None) -> None:
    until_s, ended = (1.0 + 12.6) / RIG.frequency_Hz, stopped_by is not None
    piece = read_piece(repeated(tmp_path / "points", until_s=until_s, ended=ended, stopped_by=stopped_by))
    assert piece is not None
    assert (piece.run, piece.recorded, piece.verdict) == (12, 12, "invalid")


def test_ramps_are_no_cycles_of_the_test(tmp_path: Path) -> None:
    """A block whose rest has fewer cycles than are seen at full amplitude counts no more than were requested."""
    piece = read_piece(block(tmp_path / "points", cycles=CYCLES - 2))
    assert piece is not None
    assert piece.run == CYCLES - 2


def test_blocks_are_left_out_when_delays_are_corrected_together(whole: Path) -> None:
    assert list(retime(whole.parent)) == []


def test_a_copied_file_is_counted_once(whole: Path, tmp_path: Path) -> None:
    for name in ("wear-b2.h5", "copy.h5"):
        (tmp_path / name).write_bytes(whole.read_bytes())
    (tmp_path / "broken.h5").write_bytes(b"nothing")
    pieces, problems = read_pieces(tmp_path)
    assert [piece.run for piece in pieces] == [CYCLES]
    assert len(problems) == 1


MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
[[endurance]]
id = "wear"
amplitude = "10 mm"
frequency = "4 Hz"
current = "1 A"
cycles = 1000
block = 50
"""


def test_endurance_json_is_made_again_from_the_files(whole: Path, tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    folder.points.mkdir()
    (folder.points / whole.name).write_bytes(whole.read_bytes())
    renew_endurance(tmp_path)
    assert not folder.endurance.exists(), "without a matrix file nothing is known of the tests"
    folder.matrix.write_text(MATRIX, encoding="utf-8")
    renew_endurance(tmp_path)
    (test,) = json.loads(folder.endurance.read_text(encoding="utf-8"))["tests"]
    assert (test["cycles_run"], test["cycles_planned"], test["pieces"]) == (CYCLES, 1000, 1)
    assert test["trend"][0]["cycle"][-1] == 100 + CYCLES
    folder.endurance.write_text("old", encoding="utf-8")
    with campaign_held(tmp_path):
        renew_endurance(tmp_path)
    assert folder.endurance.read_text(encoding="utf-8") == "old", "a running campaign writes its own"


def piece(number: int, before: int, run: int, force_N: float, unseen: int = 0) -> BlockPiece:
    sections = replace(
        NO_SECTIONS, cycle=np.array([float(before + run)]), block=np.array([float(number)]),
        group=np.zeros(1, np.int64),
        medians={name: np.array([force_N]) for name in NO_SECTIONS.medians},
    )
    step = EnduranceStep("wear", before, 300, number, 100, 10)
    return BlockPiece(f"wear-b{number}", step, run, run, unseen, "valid", sections, f"wear-b{number}-{before}.h5")


def test_a_ledger_adds_the_pieces_of_a_block_and_knows_what_is_missing() -> None:
    ledger = EnduranceLedger("wear", (StopRule("force_down", 0.2),))
    ledger.add(piece(1, 0, 100, 1000.0))
    ledger.add(piece(2, 100, 30, 900.0, unseen=4))
    ledger.add(piece(2, 130, 70, 850.0))
    ledger.lose("wear-b3 0", 100)
    assert (ledger.cycles_run, ledger.run_of(2), ledger.unrecorded_at_most) == (200, 100, 104)
    assert ledger.reached == ""
    assert ledger.to_json(300)["state"] == "running"
    ledger.add(piece(3, 200, 100, 300.0))
    answer = ledger.to_json(300)
    assert (ledger.reached, answer["state"], answer["ended_by"]) == ("force_down", "ended by a stop rule", "force_down")
    assert answer["rules"][0]["value"] == pytest.approx(0.7)


def test_pieces_are_sorted_into_their_tests_in_any_order() -> None:
    pieces = [piece(3, 200, 100, 300.0), piece(1, 0, 100, 1000.0), piece(2, 100, 100, 900.0)]
    ledger = ledgers_of(pieces, {"wear": ((StopRule("force_down", 0.2),), 0)})["wear"]
    assert ledger.sections.cycle.tolist() == [100.0, 200.0, 300.0]
    assert ledger.reached == "force_down"


def test_the_attributes_of_a_block_state_its_program_and_older_files_have_none() -> None:
    step = STEP._replace(program_cycles=16)
    point = TestPoint(
        "b", "sine", 0.01, 4.0, 1.0, kind=ENDURANCE, steps_A=(0.2, 1.0), steps_s=(0.0, 2.25), endurance=step
    )
    attributes = attributes_of(point, NOT_STATED)
    assert point_fields(attributes)["endurance"] == step
    assert "endurance_program_cycles" not in attributes_of(replace(point, endurance=STEP), NOT_STATED)
    del attributes["endurance_program_cycles"]
    assert point_fields(attributes)["endurance"] == STEP
