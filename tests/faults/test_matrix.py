"""The matrix itself: sixty-one rows, each with the test that proves it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

from mutation import ROOT, all_mutations

from rig.campaign.stop_cause import may_restart
from rig.faults.matrix import MATRIX, REACTIONS
from simulators.injection import INJECTORS

HERE = Path(__file__).parent


def marked_tests() -> dict[str, list[str]]:
    """Row tests by slug, as `file::function`, read from the `row` markers of this folder."""
    found: dict[str, list[str]] = {}
    for path in sorted(HERE.glob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            for mark in node.decorator_list:
                if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.row":
                    for slug in mark.args:
                        assert isinstance(slug, ast.Constant)
                        found.setdefault(str(slug.value), []).append(f"{path.name}::{node.name}")
    return found


def test_the_matrix_has_sixty_one_rows_each_once() -> None:
    assert len(MATRIX) == 61


def test_every_row_has_its_test_or_a_reason_why_it_cannot_be_built_here() -> None:
    missing = [slug for slug, row in MATRIX.items() if not row.tested and not row.reason]
    assert not missing, f"{len(missing)} rows without a test"


def test_the_tests_the_matrix_names_are_there_and_marked() -> None:
    marked = marked_tests()
    wrong = {slug: row.test for slug, row in MATRIX.items() if row.test and row.test not in marked.get(slug, [])}
    assert not wrong, f"no such test marked with the row: {wrong}"
    assert not set(marked) - {slug for slug, row in MATRIX.items() if row.tested}, "marked, but not in the matrix"


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
        for edit in edits:
            count = (ROOT / edit.file).read_text(encoding="utf-8").count(edit.old)
            if count != 1:
                wrong.append(f"{slug}: {edit.file} has {count} times: {edit.old.strip()}")
    assert not wrong, "\n".join(wrong)


def test_only_rows_with_automatic_resume_and_s2_restart_by_themselves() -> None:
    from rig.campaign.stop_cause import StopCause
    from rig.faults.row import StopKind

    for slug, row in MATRIX.items():
        for kind in StopKind:
            assert may_restart(kind, StopCause(slug)) is (row.resume == "a" and kind is StopKind.FADE_OUT)


def test_exit_codes_follow_the_rows_and_a_file_of_no_use_is_a_bad_file() -> None:
    codes = {"W": 0, "P": 5, "R": 3, "S2": 4, "S1": 4, "SO": 4}
    for slug, row in MATRIX.items():
        assert row.exit_code == (2 if slug == "config-absurd" else codes[row.end])


def test_list_faults_prints_the_matrix() -> None:
    printed = json.loads(subprocess.check_output([sys.executable, "-m", "simulators", "--list-faults", "--json"]))
    assert [each["slug"] for each in printed] == list(MATRIX)
    for each in printed:
        row = MATRIX[each["slug"]]
        assert (each["where"], each["reaction"], each["tested"]) == (row.where, row.reaction, row.tested)
        assert each["exit_code"] == row.exit_code
        assert bool(each["reason"]) is not row.tested
