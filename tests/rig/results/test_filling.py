"""The results database of a folder contains what the run directories contain, whatever happened to either."""

from __future__ import annotations

import json
import math
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pandas
import pytest
from in_process import rig
from result_tables import comparable
from sqlalchemy import text

from rig.characteristics.hybrid_tests import HybridTest
from rig.comparison.acceptance import AcceptanceResult, Result, State
from rig.comparison.specimen import SpecimenResult, write_specimen
from rig.errors import FileProblem
from rig.hybrid.assessment import Assessment
from rig.recording.tested_specimens import SpecimenVerdict
from rig.results import documentation, filling, special_tests
from rig.results.content import content_of
from rig.results.filling import Filled, filled_database
from rig.results.reader import ResultFilter, ResultRow, date_range, open_results, result_rows
from rig.results.run_index import NAME, RunFilter, listed
from rig.results.schema import RESULTS, VIEWS, view_columns
from rig.signals.wear_trend import RULES

if TYPE_CHECKING:
    from conftest import Make

OMEGA = 2 * math.pi


def rows(folder: Path, **wanted: Any) -> list[ResultRow]:  # noqa: ANN401 - of the filter
    with open_results(folder) as (database, _):
        return list(result_rows(database, ResultFilter(**wanted)))


def filled(folder: Path, **options: bool) -> Filled:
    with filled_database(folder, **options) as (_, done):
        return done


def content(folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Every row of every table but the time at which it was written."""
    with filled_database(folder) as (database, _), database.transaction() as connection:
        kept = {
            name: [dict(row) for row in connection.execute(text(f"SELECT * FROM {name}")).mappings()]
            for name in RESULTS.tables
        }  # fmt: skip
    return comparable(kept)


def test_a_run_gives_its_values_with_their_uncertainty(runs: Path, made: Make) -> None:
    made("r1", points=2, percent=0.5, operator="J. Doe")
    values = {row.quantity: row for row in rows(runs) if row.point == "p002"}
    rebound = values["rebound_force"]
    assert rebound.value == pytest.approx(1000.0 * 0.02 * OMEGA - 50.0, rel=2e-3)
    assert values["jounce_force"].value == pytest.approx(-1000.0 * 0.02 * OMEGA - 50.0, rel=2e-3)
    assert values["energy"].value == pytest.approx(math.pi * 1000.0 * OMEGA * 0.02**2, rel=2e-3)
    assert rebound.calibration_std == pytest.approx(0.005 * rebound.value)
    assert rebound.std == pytest.approx(math.hypot(rebound.repeatability_std or 0.0, 0.005 * rebound.value))
    assert values["energy"].calibration_std == pytest.approx(math.sqrt(2) * 0.005 * values["energy"].value)
    assert (rebound.unit, rebound.subject, rebound.motion, rebound.current_A, rebound.amplitude_m) == (
        "N", "specimen", "sine 20 mm 1 Hz", 0.5, 0.02,
    )  # fmt: skip
    assert (rebound.specimen, rebound.station, rebound.operator, rebound.matrix, rebound.repeat, rebound.verdict) == (
        "MR-1", "bench 1", "J. Doe", "sine.toml", 2, "valid",
    )  # fmt: skip
    assert rebound.started is not None
    assert rebound.started.isoformat() == "2026-11-27T10:00:00+00:00"
    assert rebound.specimen_verdict == "no-bands"


def test_an_invalid_point_gives_no_value_of_the_damper(runs: Path, made: Make) -> None:
    made("r1", verdict="invalid")
    assert {row.subject for row in rows(runs)} <= {"bench"}
    assert content(runs)["points"][0]["reasons"] == "estop: stopped"
    assert content(runs)["campaigns"][0]["bench_verdict"] == "invalid"


def test_a_fit_gives_its_identifiable_parameters(runs: Path, made: Make) -> None:
    run = made("r1")
    entry = {"value": 5.0, "unit": "N", "standard_error": 0.5, "low": 4.0, "high": 6.0, "identifiable": True}
    loose = {**entry, "identifiable": False, "standard_error": None, "low": None, "high": None, "reason": "no step"}
    (run / "fit.json").write_text(json.dumps({"model": "bingham", "parameters": {"Fy": entry, "eta": loose}}))
    assert [(row.quantity, row.value, row.std, row.motion) for row in rows(runs, quantity="[F]*")] == [
        ("Fy", 5.0, 0.5, "fit bingham")
    ]
    reasons = {row["parameter"]: row["reason"] for row in content(runs)["parameters"]}
    assert reasons == {"Fy": "", "eta": "no step"}


def test_hybrid_tests_and_the_rule_that_ended_an_endurance_test_are_rows(
    runs: Path, made: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    made("r1")
    hybrid = HybridTest("p001", "delay", "passive", "valid", None, Assessment(0.02, 0.03, None, {}), {"delay_s": 0.012})
    ledger = SimpleNamespace(
        test="e", cycles_run=4000, reached="force_down", sections=(1,),
        followed=lambda rule: SimpleNamespace(change=[0.1, rule.limit]),
    )
    block = SimpleNamespace(id="p001")
    monkeypatch.setattr(special_tests, "hybrid_tests", lambda _run: (hybrid,))
    monkeypatch.setattr(special_tests, "endurance_tests", lambda _run: (SimpleNamespace(ledger=ledger, planned=5000),))
    monkeypatch.setattr(special_tests, "_last_block", lambda _run, test: block if test == "e" else None)
    values = {row.quantity: row.value for row in rows(runs) if row.quantity.startswith(("hybrid", "endurance"))}
    assert values == {
        "hybrid_tracking_error": 0.02, "hybrid_reference_error": 0.03, "hybrid_delay": 0.012,
        "endurance_cycles": 4000.0, "endurance_progress": 0.8, "endurance_cycles_to_force_down": 4000.0,
        **{f"endurance_end_{name}": 1.0 for name in RULES},
    }  # fmt: skip


def test_points_that_a_stop_rule_withdrew_are_not_planned(runs: Path, made: Make) -> None:
    run = made("r1", points=2)
    (run / "points" / "p002.h5").unlink()
    for withdrawn, planned, reason in (([], 2, "1 of 2 points recorded"), (["p002"], 1, "")):
        (run / "endurance.json").write_text(json.dumps({"tests": [{"withdrawn": withdrawn}]}))
        kept = content(runs)
        assert (kept["campaigns"][0]["planned_points"], kept["verdicts"][0]["reason"]) == (planned, reason)


def test_the_verdict_on_the_specimen_comes_with_its_margins(runs: Path, made: Make) -> None:
    run = made("r1")
    result = Result("rebound_force", "r1", "sine, 20 mm, 1 Hz, 0.5 A", ("p001",), 75.7, 1.0, 80.0, None, "N",
                    State.FAILED)  # fmt: skip
    accepted = AcceptanceResult("drawing 1", "guarded", (result,))
    write_specimen(run, SpecimenResult("MR-1", SpecimenVerdict.NOT_OK, "rebound force", accepted))
    assert {row.specimen_verdict for row in rows(runs)} == {"not-ok"}
    verdicts = {(row["subject"], row["item"]): row for row in content(runs)["verdicts"]}
    assert {place: row["verdict"] for place, row in verdicts.items()} == {
        ("bench", 0): "valid", ("specimen", 0): "not-ok", ("specimen", 1): "fail",
    }  # fmt: skip
    assert verdicts["specimen", 1]["margin"] == pytest.approx(-4.3)
    assert verdicts["specimen", 0]["bands"] == "drawing 1"


WANTED: tuple[tuple[dict[str, Any], set[str]], ...] = (
    ({}, {"r1", "r2", "r3"}), ({"specimen": "MR-2"}, {"r2"}), ({"specimen": "mr-2"}, set()),
    ({"specimen": "MR-?"}, {"r1", "r2", "r3"}), ({"date": "2026-11-27"}, {"r1"}), ({"date": "2026-12"}, {"r2"}),
    ({"date": ":2026-11"}, {"r1"}), ({"date": "2026-12:"}, {"r2", "r3"}), ({"quantity": "energy"}, {"r1", "r2", "r3"}),
    ({"matrix": "sine.*"}, {"r1", "r2", "r3"}), ({"matrix": "100%"}, set()), ({"station": "bench 3"}, {"r3"}),
    ({"operator": ""}, {"r1", "r2", "r3"}), ({"current_A": 1.0}, {"r3"}), ({"verdict": "suspect"}, {"r2"}),
    ({"campaign": "r3"}, {"r3"}),
)  # fmt: skip


def test_all_conditions_of_a_filter_must_hold(runs: Path, made: Make) -> None:
    made("r1")
    made("r2", specimen="MR-2", started="2026-12-31T23:59:59+00:00", verdict="suspect")
    made("r3", specimen="MR-3", started="2027-01-01T00:00:00+00:00", station="bench 3", current_A=1.0)
    with open_results(runs) as (database, _):
        selected = [{row.run for row in result_rows(database, ResultFilter(**wanted))} for wanted, _ in WANTED]
    assert selected == [runs_of for _, runs_of in WANTED]


def test_a_date_that_does_not_exist_is_named() -> None:
    assert [str(end)[:10] for end in date_range("2026-12")] == ["2026-12-01", "2027-01-01"]
    assert [str(end)[:10] for end in date_range("2024-02-29")] == ["2024-02-29", "2024-03-01"]
    with pytest.raises(FileProblem, match="2026-02-30"):
        date_range("2026-02-30")


def test_what_changed_outside_is_read_again_and_nothing_else(runs: Path, made: Make) -> None:
    made("r1")
    made("r2", specimen="MR-2")
    filled(runs)
    changes: tuple[tuple[Callable[[], object], int], ...] = (
        (lambda: None, 0),
        (lambda: (runs / "r2" / "operator.json").write_text('{"operator": "J. Doe"}'), 1),
        (lambda: (runs / NAME).unlink(), 2),
        (lambda: (runs / "r1").rename(runs / "r9"), 1),
        (lambda: (runs / "r9" / "points" / "p001.h5").unlink(), 1),
        (lambda: shutil.rmtree(runs / "r9"), 0),
    )
    for change, read in changes:
        change()
        assert filled(runs).read == read
        kept = content(runs)
        assert filled(runs, rebuild=True).read == len(list(runs.glob("r?")))
        assert content(runs) == kept
        assert len(kept["specimens"]) == len(kept["campaigns"]) == len(list(runs.glob("r?")))


def test_a_copied_run_counts_once_and_takes_the_place_of_its_original(runs: Path, made: Make) -> None:
    made("r1")
    before = content(runs)
    shutil.copytree(runs / "r1", runs / "r0")
    done = filled(runs)
    assert list(done.remarks) == ["r0"]
    assert "copy of r1" in done.remarks["r0"]
    assert content(runs) == before
    shutil.rmtree(runs / "r1")
    assert [row["run"] for row in content(runs)["campaigns"]] == ["r0"]


def test_what_cannot_be_read_is_named_and_hides_no_other_run(runs: Path, made: Make) -> None:
    made("r1")
    made("r2")
    (runs / "r2" / "points" / "p001.h5").write_bytes(b"no HDF5")
    made("r3", points=0)
    (runs / "r4" / "points").mkdir(parents=True)
    made("r5")
    (runs / "r5" / "fit.json").write_text("{")
    done = filled(runs)
    assert set(done.remarks) == {"r2", "r4", "r5"}
    assert {row["run"] for row in content(runs)["campaigns"]} == {"r1", "r2", "r3", "r5"}


def test_a_run_that_is_being_recorded_waits_until_it_has_ended(
    runs: Path, made: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = made("r1")
    with monkeypatch.context() as recording:
        recording.setattr(filling, "held_inodes", lambda: frozenset({run.stat().st_ino}))
        assert filled(runs).running == ["r1"]
    assert filled(runs).read == 1


def test_the_index_of_runs_and_the_results_share_one_file(runs: Path, made: Make) -> None:
    made("r1")
    filled(runs)
    kept = content(runs)
    summary = {"id": "r1", "specimen": "MR-1", "started": "", "model": "", "verdict": ""}
    asked: list[Path] = []
    for _ in range(2):
        listed(runs, lambda place: asked.append(place) or summary, RunFilter())  # type: ignore[func-returns-value]
    assert asked == [runs / "r1"]
    assert content(runs) == kept
    assert [path.name for path in runs.iterdir() if path.is_file()] == [NAME]


def test_an_index_of_an_earlier_version_becomes_the_database(runs: Path, made: Make) -> None:
    made("r1")
    with closing(sqlite3.connect(runs / NAME)) as old, old:
        old.execute("CREATE TABLE format (written TEXT)")
        old.execute("INSERT INTO format VALUES ('4, 1.0.0')")
        old.execute("CREATE TABLE runs (name TEXT PRIMARY KEY, own TEXT, points TEXT, specimen TEXT)")
    assert (filled(runs).notes, len(rows(runs, quantity="energy"))) == ([], 1)


@pytest.mark.parametrize("damage", [lambda whole: b"no database" * 1000, lambda whole: whole[: len(whole) // 2]])
def test_a_damaged_database_is_named_and_made_again(runs: Path, made: Make, damage: Any) -> None:  # noqa: ANN401 - any call
    made("r1")
    before = content(runs)
    (runs / NAME).write_bytes(damage((runs / NAME).read_bytes()))
    done = filled(runs)
    assert "damaged" in done.notes[0]
    assert NAME in done.notes[0]
    assert content(runs) == before


def test_tables_of_an_earlier_version_are_made_again(runs: Path, made: Make) -> None:
    made("r1")
    before = content(runs)
    with closing(sqlite3.connect(runs / NAME)) as earlier, earlier:
        earlier.execute("UPDATE schema_version SET version = 1")
        earlier.execute("DROP VIEW results")
        earlier.execute("DROP TABLE characteristics")
        earlier.execute("CREATE TABLE characteristics (other TEXT)")
    assert (filled(runs).read, content(runs)) == (1, before)


def test_views_of_an_earlier_release_get_the_columns_that_were_added(runs: Path, made: Make) -> None:
    made("r1", simulated={"speed": 1.0})
    assert filled(runs).read == 1
    with closing(sqlite3.connect(runs / NAME)) as earlier, earlier:
        earlier.execute("DROP VIEW results")
        earlier.execute("CREATE VIEW results AS SELECT run, campaign_id FROM campaigns")
    assert filled(runs).read == 0, "no run is read again for it"
    with closing(sqlite3.connect(runs / NAME)) as renewed:
        assert renewed.execute("SELECT DISTINCT run, simulated FROM results").fetchall() == [("r1", 1)]


def test_a_spreadsheet_and_pandas_read_the_same_values(runs: Path, made: Make, tmp_path: Path) -> None:
    """Both ways of `docs/how-to/keep-results-in-a-database.md`; pandas stands for the import of a spreadsheet."""
    made("r1", points=2, percent=0.5, specimen="MR-α, 1")
    assert rig("results", "--in", runs, "--csv", tmp_path / "results.csv").returncode == 0
    sheet = pandas.read_csv(tmp_path / "results.csv", encoding="utf-8")
    with closing(sqlite3.connect(f"file:{runs / NAME}?mode=ro", uri=True)) as connection:
        view = pandas.read_sql("SELECT * FROM results", connection, parse_dates=["started", "recorded"])
    order = ["quantity", "point"]
    sheet, view = sheet.sort_values(order), view.sort_values(order)
    assert len(sheet) == len(view) == 8
    assert set(sheet.specimen) == set(view.specimen) == {"MR-α, 1"}
    assert sheet.value.tolist() == pytest.approx(view.value.tolist(), rel=1e-5)
    assert sheet["std"].tolist() == pytest.approx(view.standard_uncertainty.tolist(), rel=1e-3, nan_ok=True)
    assert str(view.started.dt.tz) == "UTC"


def test_an_index_of_an_earlier_release_is_made_anew(runs: Path, made: Make) -> None:
    made("r1")
    filled(runs)
    name, query = "characteristics_by_quantity", "SELECT name, sql FROM sqlite_master WHERE type = 'index' ORDER BY 1"
    with closing(sqlite3.connect(runs / NAME)) as earlier, earlier:
        before = earlier.execute(query).fetchall()
        earlier.execute(f"DROP INDEX {name}")
        earlier.execute(f"CREATE INDEX {name} ON characteristics (quantity)")
        earlier.execute("DROP INDEX campaigns_by_station")
    assert filled(runs).read == 0, "no run is read again for it"
    with closing(sqlite3.connect(runs / NAME)) as renewed:
        assert renewed.execute(query).fetchall() == before


def test_files_of_an_import_are_no_planned_points(runs: Path, made: Make) -> None:
    made("r1", points=2)
    description = runs / "r1" / "campaign.json"
    files = [{"file": "a.csv", "id": "p001"}, {"file": "b.csv", "id": "p002"}, {"file": "c.csv", "error": "empty"}]
    description.write_text(json.dumps(json.loads(description.read_text()) | {"points": files}))
    kept = content(runs)
    assert (kept["campaigns"][0]["planned_points"], kept["campaigns"][0]["recorded_points"]) == (0, 2)
    assert kept["verdicts"][0]["reason"] == ""


def test_a_folder_of_a_refused_campaign_that_an_earlier_release_read_is_removed(
    runs: Path, made: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    made("r1")
    other = Path(shutil.move(made("r2"), runs.parent / "r2"))
    refused = runs / "refused"
    (refused / "points").mkdir(parents=True)
    (refused / "journal.jsonl").write_text("")
    with monkeypatch.context() as earlier:
        earlier.setattr(filling, "CONTENT", filling.CONTENT - 1)
        earlier.setattr(filling, "_read", lambda place: (content_of(other if place == refused else place), ""))
        assert len(content(runs)["campaigns"]) == 2
    assert [row["run"] for row in content(runs)["campaigns"]] == ["r1"]


def test_a_database_of_a_newer_version_is_refused_and_not_written(runs: Path, made: Make) -> None:
    made("r1")
    filled(runs)
    with closing(sqlite3.connect(runs / NAME)) as newer, newer:
        newer.execute("UPDATE schema_version SET version = 99")
    before = (runs / NAME).read_bytes()
    for rebuild in (False, True):
        with pytest.raises(FileProblem, match="got schema version 99, expected at most 2"):
            filled(runs, rebuild=rebuild)
    assert (runs / NAME).read_bytes() == before


def test_in_a_folder_that_cannot_be_written_the_results_are_read_into_memory(
    runs: Path, made: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    made("r1")
    filled(runs)
    made("r2", specimen="MR-2")
    before = (runs / NAME).read_bytes()
    monkeypatch.setattr("rig.results.connection.writable", lambda _file: False)  # root may write everywhere
    with open_results(runs) as (database, done):
        assert "read-only" in done.notes[0]
        assert {row.run for row in result_rows(database)} == {"r1", "r2"}
    assert (runs / NAME).read_bytes() == before


def test_every_view_can_be_read_and_has_the_columns_of_the_page(runs: Path, made: Make) -> None:
    made("r1")
    with open_results(runs) as (database, _), database.transaction() as connection:
        for name in VIEWS:
            assert list(connection.execute(text(f"SELECT * FROM {name}")).keys()) == view_columns(name)
        counts = {name: connection.execute(text(f"SELECT count(*) FROM {name}")).scalar() for name in VIEWS}
    assert counts["results"] == len(rows(runs))
    assert counts["campaign_list"] == 1
    assert counts["calibration_list"] == 1


def test_the_reference_page_describes_the_tables_as_they_are() -> None:
    page = Path(__file__).parents[3] / "docs" / "results-database.md"
    assert page.read_text(encoding="utf-8") == documentation.page()
    comments = [column.comment for table in RESULTS.tables.values() for column in table.columns]
    assert all(comments)
