"""The matrix itself: sixty-five rows, each with its world."""

from __future__ import annotations

import json
import subprocess
import sys

import test_every_row
from edits import ROOT, NoLongerThere, edited
from mutation import HALVES, all_mutations
from row_scenarios import ROW_SCENARIOS

from rig.campaign.stop_cause import may_restart
from rig.faults.matrix import MATRIX, REACTIONS
from simulators.injection import INJECTORS


def test_the_matrix_has_sixty_five_rows_each_once() -> None:
    assert len(MATRIX) == 65


def test_every_row_has_its_scenario_or_a_reason_why_it_cannot_have_one() -> None:
    assert all(row.tested or row.reason for row in MATRIX.values())
    assert not set(ROW_SCENARIOS) - {slug for slug, row in MATRIX.items() if row.tested}
    around = {slug for slug in MATRIX if MATRIX[slug].where == "process"}
    assert not around - set(ROW_SCENARIOS), "no device has such a fault: its world must say what happens"


def test_the_test_that_the_matrix_names_is_there_for_every_row() -> None:
    test = test_every_row.test_every_row_ends_as_the_matrix_says
    (marks,) = (mark for mark in test.pytestmark if mark.name == "parametrize")
    names = {f"{test_every_row.__name__}.py::{test.__name__}[{slug}]" for slug in marks.args[1]}
    assert names == {row.test for row in MATRIX.values() if row.tested}


def test_the_tests_of_the_halves_are_there() -> None:
    for name in HALVES.values():
        file, _, function = name.partition("::")
        assert f"def {function}(" in (ROOT / "tests" / "faults" / file).read_text(encoding="utf-8")


def test_every_row_on_the_wire_has_an_injector_and_no_other() -> None:
    assert {slug for slug, row in MATRIX.items() if row.where == "wire"} == set(INJECTORS)
    assert {row.where for row in MATRIX.values()} == {"wire", "process"}


def test_the_station_takes_its_reactions_from_the_matrix() -> None:
    shared = [slug for slug in REACTIONS if slug in MATRIX]
    assert shared
    assert all(REACTIONS[slug] is MATRIX[slug] for slug in shared)


def test_the_text_of_every_edit_stands_in_its_file_exactly_once() -> None:
    wrong = []
    for slug, edits in all_mutations().items():
        if not edits:
            wrong.append(f"{slug}: no mutation switches its detector off")
        for file in dict.fromkeys(edit.file for edit in edits):
            try:
                edited(file, edits)
            except NoLongerThere as error:
                wrong.append(f"{slug}: {error}")
    assert not wrong, "\n".join(wrong)


def test_only_rows_with_automatic_resume_and_s2_restart_by_themselves() -> None:
    from rig.campaign.stop_cause import StopCause
    from rig.faults.row import StopKind

    for slug, row in MATRIX.items():
        for kind in StopKind:
            assert may_restart(kind, StopCause(slug)) is (row.resume == "a" and kind is StopKind.FADE_OUT)


def test_exit_codes_follow_the_rows_but_for_a_bad_file_and_a_current_that_stays() -> None:
    codes = {"W": 0, "P": 5, "R": 3, "S2": 4, "S1": 4, "SO": 4}
    others = {"config-absurd": 2, "current-stuck": 7, "supply-not-zero": 7}
    for slug, row in MATRIX.items():
        assert row.exit_code == others.get(slug, codes[row.end])


def test_list_faults_prints_the_matrix() -> None:
    printed = json.loads(subprocess.check_output([sys.executable, "-m", "simulators", "--list-faults", "--json"]))
    assert [each["slug"] for each in printed] == list(MATRIX)
    assert len(printed) == 65
    assert set(printed[0]) == {
        "slug", "where", "place", "reaction", "limit", "exit_code", "tested", "test", "reason", "variants",
    }
    assert [each["variants"] for each in printed if each["slug"] == "sensor-stuck"] == [["sensor-stuck:lvdt"]]
    for each in printed:
        row = MATRIX[each["slug"]]
        assert (each["where"], each["reaction"], each["tested"]) == (row.where, row.reaction, row.tested)
        assert each["exit_code"] == row.exit_code
        assert bool(each["reason"]) is not row.tested
