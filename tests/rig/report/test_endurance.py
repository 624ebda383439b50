"""The report's section on endurance tests: counts, stop rules, performance points before and after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rig.characteristics.endurance_tests import EnduranceTest, endurance_tests
from rig.display import SI
from rig.document.blocks import Document, Facts, Figures, Note, Table
from rig.document.pdf import pdf
from rig.document.terminal import lines
from rig.recording.endurance import BlockPiece, EnduranceLedger, performance_points
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.report.document import warnings
from rig.report.endurance import endurance_facts, endurance_section
from rig.signals.wear_trend import NO_SECTIONS, QUANTITIES, Sections, StopRule
from rig.test_point import ENDURANCE, EnduranceStep, TestPoint

TIME_S = np.arange(0.0, 5.0, 0.004)


def loop(name: str, force_N: float, step: EnduranceStep | None) -> RecordedPoint:
    angle = 2.0 * np.pi * TIME_S
    return RecordedPoint.from_arrays(
        id=name, waveform="sine", amplitude_m=0.01, frequency_Hz=1.0, current_A=1.0, time_s=TIME_S,
        displacement_m=0.01 * np.sin(angle), force_N=force_N * np.cos(angle), endurance=step,
    )


def weakening(force_N: np.ndarray, unseen: int = 0, sections_a_block: int = 1000) -> EnduranceTest:
    """A test whose peak force is given at every 10 cycles (n,), in blocks of so many sections."""
    cycle = 10.0 * np.arange(1, len(force_N) + 1)
    block = np.arange(len(force_N)) // sections_a_block + 1.0
    sections = Sections(cycle, block, {name: force_N.copy() for name in QUANTITIES},
                        np.zeros(len(force_N), np.int64))
    step = EnduranceStep("wear", 0, 1000, 1, 200, 10)
    ledger = EnduranceLedger("wear", (StopRule("force_down", 0.2),))
    ledger.add(BlockPiece("wear-b1", step, 200, 195, unseen, "suspect", sections, "wear-b1.h5", ("stopped",)))
    points = [
        loop("p001", 1000.0, None), loop("other", 1000.0, None),
        loop("p001-wear-end", 800.0, EnduranceStep("wear", 200, 1000)),
    ]
    points[1] = replace(points[1], frequency_Hz=2.0)
    motion = TestPoint("wear-b1", "sine", 0.01, 4.0, 0.5, 200, kind=ENDURANCE, endurance=step)
    return EnduranceTest(ledger, 1000, motion, tuple(performance_points(points, "wear")))


def test_no_section_without_an_endurance_test() -> None:
    assert endurance_section((), SI) == []
    run = Run(Run.NOWHERE, (loop("p001", 1000.0, None),))
    assert endurance_tests(run) == ()


def test_counts_rules_and_forecast_are_shown() -> None:
    blocks = endurance_section((weakening(np.linspace(1000.0, 900.0, 20), unseen=7),), SI)
    facts = next(block for block in blocks if isinstance(block, Facts)).facts
    assert [str(fact.value) for fact in facts] == ["200 of 1,000", "195", "5", "up to 7"]
    rules, performance, invalid = (block for block in blocks if isinstance(block, Table))
    assert [str(cell) for cell in rules.rows[0].cells][:4] == ["Decrease of the peak force", "20 %", "5.26 %", "466"]
    assert [[str(cell) for cell in row.cells] for row in performance.rows] == [
        ["sine 10 mm 1 Hz", "1", "0", "999.9", "+0.0", "\u2212999.9", "+0.0"],
        ["sine 10 mm 1 Hz", "1", "200", "800", "\u221220.0", "\u2212800", "\u221220.0"],
    ]
    assert [str(cell) for cell in invalid.rows[0].cells][1::6] == ["wear-b1", "stopped"]
    assert sum(isinstance(block, Figures) for block in blocks) == 5
    assert any("Stop rule" in str(line) for line in lines(blocks, 80))
    assert pdf(Document("endurance", blocks)).startswith(b"%PDF")


def test_the_summary_states_cycles_and_stop_rules() -> None:
    (running,) = endurance_facts([weakening(np.linspace(1000.0, 900.0, 20))], SI)
    assert (str(running.value), str(running.meaning)) == (
        "200 of 1,000", "cycles of the endurance test wear; decrease of the peak force 5.26 % (limit 20 %)"
    )
    (ended,) = endurance_facts([weakening(np.linspace(1000.0, 600.0, 20), sections_a_block=2)], SI)
    assert str(ended.value) == "200"
    assert str(ended.meaning) == (
        "cycles of the endurance test wear, of 1,000 planned; ended by a stop rule: decrease of the peak force; "
        "decrease of the peak force 39.4 % (limit 20 %)"
    )


def test_a_block_that_was_interrupted_and_continued_has_the_verdict_of_its_best_piece() -> None:
    def piece(name: str, before: int, verdict: str) -> RecordedPoint:
        made = loop(name, 1000.0, EnduranceStep("wear", before, 100, 1, 50, 10))
        return replace(made, kind=ENDURANCE, verdict=verdict, provenance={"point": "wear-b1"})

    first, second = piece("wear-b1", 0, "invalid"), piece("wear-b1-attempt2", 10, "valid")
    run = Run(Run.NOWHERE, (loop("p001", 1000.0, None), first, second))
    assert [point.id for point in run.judged] == ["p001", "wear-b1-attempt2"]
    assert warnings(run) == []
    assert [str(block.words) for block in warnings(run[:2]) if isinstance(block, Note)] == [
        "1 block of an endurance test is not valid; its cycles are counted. The full report states the reasons."
    ]


def test_the_end_by_a_stop_rule_is_stated() -> None:
    blocks = endurance_section((weakening(np.linspace(1000.0, 600.0, 20), sections_a_block=2),), SI)
    notes = [str(block.words) for block in blocks if isinstance(block, Note)]
    assert notes == ["A stop rule ended the test: decrease of the peak force."]


def test_a_test_without_a_full_cycle_shows_its_count() -> None:
    empty = replace(weakening(np.ones(20)), performance=())
    ledger = EnduranceLedger("wear", (StopRule("force_down", 0.2),))
    step = EnduranceStep("wear", 0, 1000, 1, 200, 10)
    ledger.add(BlockPiece("wear-b1", step, 0, 0, 3, "invalid", NO_SECTIONS, "wear-b1.h5"))
    blocks = endurance_section((replace(empty, ledger=ledger),), SI)
    assert not any(isinstance(block, Figures) for block in blocks)
