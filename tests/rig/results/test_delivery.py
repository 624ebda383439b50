"""Results are delivered to a real PostgreSQL server: each campaign once, whatever happens in between."""

from __future__ import annotations

import json
import multiprocessing
import os
from datetime import datetime
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_process import rig
from result_tables import comparable
from sqlalchemy import text

from rig.comparison.acceptance import AcceptanceResult, Result, State
from rig.comparison.specimen import SpecimenResult, write_specimen
from rig.errors import FileProblem
from rig.recording.tested_specimens import SpecimenVerdict
from rig.results.connection import Unreachable
from rig.results.connection import server as opened
from rig.results.delivery import Outbox, deliver_folder
from rig.results.reader import ResultFilter, open_results, result_rows
from rig.results.run_index import NAME
from rig.results.schema import RESULTS

if TYPE_CHECKING:
    from conftest import Make, PostgreSQL

pytestmark = pytest.mark.wire

RUNS_A_STATION = 2


def delivered(runs: Path, url: str) -> Outbox:
    return deliver_folder(runs, url)


def table(url: str, name: str) -> list[dict[str, object]]:
    with opened(url) as database, database.transaction() as connection:
        keys = ", ".join(column.name for column in RESULTS.tables[name].primary_key.columns)
        return [dict(row) for row in connection.execute(text(f"SELECT * FROM {name} ORDER BY {keys}")).mappings()]


def all_rows(url: str) -> dict[str, list[dict[str, object]]]:
    return comparable({name: table(url, name) for name in RESULTS.tables})


def test_rows_on_the_server_equal_those_in_the_folder(runs: Path, made: Make, server: str) -> None:
    made("r1", points=2, percent=0.5)
    made("r2", specimen="MR-2", verdict="suspect", operator="J. Doe")
    assert delivered(runs, server).delivered == 2
    in_folder, on_server = (
        json.loads(rig("quality", "--quantity", "rebound_force", "--json", *place).stdout)
        for place in (("--in", runs), ("--results", server))
    )  # fmt: skip
    assert in_folder == on_server
    assert [one["count"] for one in on_server["series"]] == [1], "the other run is not valid"
    with open_results(runs) as (local, _), open_results(runs, server) as (remote, _):
        own, theirs = list(result_rows(local)), list(result_rows(remote))
        assert own == theirs
        assert len(own) == len(list(result_rows(remote, ResultFilter(specimen="MR-?"))))
        assert {row.specimen for row in result_rows(remote, ResultFilter(specimen="MR-2", date="2026-11"))} == {"MR-2"}


def test_a_second_delivery_writes_nothing_and_a_changed_run_is_updated(runs: Path, made: Make, server: str) -> None:
    made("r1")
    delivered(runs, server)
    before = all_rows(server)
    with opened(server) as database, database.transaction() as connection:
        (written,) = connection.execute(text("SELECT xmin::text FROM campaigns")).one()
    assert delivered(runs, server).delivered == 1
    with opened(server) as database, database.transaction() as connection:
        assert connection.execute(text("SELECT xmin::text FROM campaigns")).one() == (written,)
    entry = {"value": 5.0, "unit": "N", "standard_error": 0.5, "low": 4.0, "high": 6.0, "identifiable": True}
    (runs / "r1" / "fit.json").write_text(json.dumps({"model": "bingham", "parameters": {"Fy": entry}}))
    assert delivered(runs, server).waiting == 0
    after = all_rows(server)
    assert [row["parameter"] for row in after["parameters"]] == ["Fy"]
    assert after["characteristics"] == before["characteristics"]
    assert len(after["campaigns"]) == 1


def test_what_a_folder_or_a_server_has_forgotten_is_delivered_once(runs: Path, made: Make, server: str) -> None:
    """The record of deliveries is lost; the server is restored from an older backup."""
    made("r1")
    made("r2")
    delivered(runs, server)
    before = all_rows(server)
    (runs / NAME).unlink()
    assert (delivered(runs, server).delivered, all_rows(server)) == (2, before)
    with opened(server) as database, database.transaction() as connection:
        connection.execute(text("DELETE FROM campaigns WHERE run = 'r1'"))
    assert delivered(runs, server).waiting == 0
    assert all_rows(server) == before


def test_a_copy_that_another_computer_changed_is_not_changed_back(runs: Path, made: Make, server: str) -> None:
    made("r1")
    delivered(runs, server)
    with opened(server) as database, database.transaction() as connection:
        connection.execute(text("UPDATE campaigns SET digest = 'of another computer', operator = 'somebody'"))
    assert delivered(runs, server).waiting == 0
    assert table(server, "campaigns")[0]["operator"] == "somebody"


def test_a_server_that_dies_in_a_write_keeps_no_part_of_a_campaign_and_loses_none(
    runs: Path, made: Make, server: str, postgresql: PostgreSQL, monkeypatch: pytest.MonkeyPatch
) -> None:
    made("r1")
    made("r2")
    delivered(runs, server)
    before = all_rows(server)
    made("r3")
    from rig.results import filling

    children = filling.CHILDREN

    class Dying(tuple):  # type: ignore[type-arg]
        def __iter__(self):  # type: ignore[no-untyped-def]  # noqa: ANN204
            yield from self[:2]
            postgresql.stop("immediate")
            yield from self[2:]

    with monkeypatch.context() as dying:
        dying.setattr("rig.results.delivery.put", lambda *given: _with(filling, Dying(children), given))
        state = delivered(runs, server)
    assert state.error
    stopped = delivered(runs, server)
    postgresql.start()
    assert (stopped.delivered, stopped.waiting, state.waiting) == (2, 1, 1)
    assert "2 of 3 campaigns delivered" in stopped.line
    assert "1 waiting" in stopped.line
    assert all_rows(server) == before
    assert delivered(runs, server).waiting == 0
    assert [row["run"] for row in sorted(table(server, "campaigns"), key=lambda row: str(row["run"]))] == [
        "r1", "r2", "r3",
    ]  # fmt: skip


def _with(filling, children, given):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    kept, filling.CHILDREN = filling.CHILDREN, children
    try:
        return filling.put(*given)
    finally:
        filling.CHILDREN = kept


def station(folder: Path, url: str) -> None:
    """A station's own process."""
    state = delivered(folder, url)
    os._exit(0 if (state.delivered, state.waiting, state.error) == (RUNS_A_STATION, 0, "") else 1)


@pytest.mark.parametrize("count", [3, pytest.param(10, marks=pytest.mark.nightly)])
def test_stations_that_write_at_once_lose_nothing_and_double_nothing(
    tmp_path: Path, runs: Path, made: Make, server: str, count: int
) -> None:
    source = made("a")
    assert source.parent == runs
    folders = [tmp_path / f"station{number}" for number in range(count)]
    for name, folder in enumerate(folders):
        for number in range(RUNS_A_STATION):
            copy = folder / f"s{name}-{number}"
            (copy / "points").mkdir(parents=True)
            (copy / "points" / "p001.h5").hardlink_to(source / "points" / "p001.h5")
            described = json.loads((source / "campaign.json").read_text())
            described |= {"id": copy.name, "bench": f"bench {name}", "specimen": f"MR-{number}"}
            (copy / "campaign.json").write_text(json.dumps(described))
    context = multiprocessing.get_context("fork")  # everything is imported: ten times 2 s of processor time less
    stations = [context.Process(target=station, args=(folder, server)) for folder in folders]
    for process in stations:
        process.start()
    for process in stations:
        process.join(120)
    assert [process.exitcode for process in stations] == [0] * count
    assert len(table(server, "campaigns")) == count * RUNS_A_STATION
    assert len(table(server, "stations")) == count
    assert [row["specimen"] for row in table(server, "specimens")] == ["MR-0", "MR-1"]
    values = table(server, "characteristics")
    assert len(values) == count * RUNS_A_STATION * len({row["quantity"] for row in values})


def test_a_wrong_password_is_named_without_the_password(
    runs: Path, made: Make, server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    made("r1")
    monkeypatch.setenv("PGPASSWORD", "wrong")
    state = delivered(runs, server)
    assert "password authentication failed" in state.error
    assert "wrong" not in state.error
    address = server.replace("rig@", "rig:also-wrong@")
    state = delivered(runs, address)
    assert "also-wrong" not in f"{state} {(runs / NAME).read_bytes()!r}"


def test_a_text_that_no_database_stores_does_not_hold_back_the_others(runs: Path, made: Make, server: str) -> None:
    texts = ("MR\x001", "MR-\ud8001", "O'Brien \"x\" %s {} :a; DROP TABLE campaigns;--")
    for number, specimen in enumerate(texts, start=1):
        made(f"r{number}", specimen=specimen)
    assert (delivered(runs, server).delivered, delivered(runs, server).waiting) == (3, 0)
    assert sorted(str(row["specimen"]) for row in table(server, "specimens")) == [
        "MR-\ufffd1", "MR\ufffd1", texts[2],
    ]  # fmt: skip


def test_a_campaign_that_the_server_rejects_does_not_hold_back_the_others(
    runs: Path, made: Make, server: str, postgresql: PostgreSQL
) -> None:
    with opened(server):
        pass
    postgresql.sql("ALTER TABLE specimens ADD CHECK (specimen <> 'MR-1')", server.rpartition("/")[2])
    made("r1", specimen="MR-1")
    made("r2", specimen="MR-2", started="2026-11-27T11:00:00+00:00")
    outbox = delivered(runs, server)
    assert (outbox.delivered, outbox.waiting) == (1, 1)
    assert outbox.error.startswith("campaign r1 rejected: ")


def test_a_newer_schema_on_the_server_is_refused_and_not_written(runs: Path, made: Make, server: str) -> None:
    made("r1")
    delivered(runs, server)
    made("r2")
    with opened(server) as database, database.transaction() as connection:
        connection.execute(text("UPDATE schema_version SET version = 99"))
    for _ in range(2):
        with pytest.raises(FileProblem, match="got schema version 99, expected at most 2"):
            delivered(runs, server)
    with pytest.raises(FileProblem, match="99"), open_results(runs, server):
        pass


def test_an_index_of_an_earlier_release_on_the_server_is_made_anew(runs: Path, made: Make, server: str) -> None:
    made("r1")
    delivered(runs, server)
    query = text("SELECT indexname, indexdef FROM pg_indexes WHERE schemaname = 'public' ORDER BY indexname")
    with opened(server) as database, database.transaction() as connection:
        before = connection.execute(query).all()
        connection.execute(text("DROP INDEX characteristics_by_quantity"))
        connection.execute(text(
            "CREATE INDEX characteristics_by_quantity ON characteristics (quantity, motion, current_a, value)"
        ))  # fmt: skip
    assert delivered(runs, server).waiting == 0
    with opened(server, create=False) as database, database.transaction(reading=True) as connection:
        assert connection.execute(query).all() == before


def test_tables_of_another_program_are_neither_used_nor_removed(
    runs: Path, made: Make, server: str, postgresql: PostgreSQL
) -> None:
    """Nor is a database without results written by reading."""
    made("r1")
    with pytest.raises(FileProblem, match="contains no results yet"), open_results(runs, server):
        pass
    name = server.rpartition("/")[2]
    postgresql.sql("CREATE TABLE points (x int)", name)
    postgresql.sql("INSERT INTO points VALUES (7)", name)
    with pytest.raises(FileProblem, match=r"another program with the same names \(points\)"):
        delivered(runs, server)
    assert postgresql.sql("SELECT x FROM points", name) == "7"


def test_an_unreachable_server_is_named_when_it_is_read(runs: Path) -> None:
    message = r"results server postgresql://rig@127\.0\.0\.1:1/rig: "
    with pytest.raises(Unreachable, match=message), open_results(runs, "postgresql://rig@127.0.0.1:1/rig"):
        pass


DASHBOARD = Path(__file__).parents[3] / "examples" / "grafana" / "damper-tests.json"
CHOSEN = {
    "${__from:date:iso}": "2026-01-01T00:00:00.000Z", "${__to:date:iso}": "2027-12-31T00:00:00.000Z",
    "${quantity}": "rebound_force", "${motion}": "sine 20 mm 1 Hz", "${current}": "0.5", "${parameter}": "Fy",
    "${simulated}": "excluded",
}  # fmt: skip


def queries_of_the_dashboard() -> dict[str, str]:
    dashboard = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    queries = {one["title"]: one["targets"][0]["rawSql"] for one in dashboard["panels"]}
    queries |= {one["name"]: one["query"] for one in dashboard["templating"]["list"] if one["type"] == "query"}
    for name, value in CHOSEN.items():
        queries = {title: query.replace(name, value) for title, query in queries.items()}
    return queries


def test_every_query_of_the_example_dashboard_gives_the_same_rows_in_both_databases(
    runs: Path, made: Make, server: str
) -> None:
    for number in range(3):
        run = made(f"r{number}", specimen=f"MR-{number}", started=f"2026-11-2{number}T10:00:00.500+00:00")
        entry = {"value": 5.0, "unit": "N", "standard_error": 0.5, "low": 4.0, "high": 6.0, "identifiable": True}
        (run / "fit.json").write_text(json.dumps({"model": "bingham", "parameters": {"Fy": entry}}))
    result = Result("rebound_force", "r1", "sine", ("p001",), 75.7, 1.0, 80.0, None, "N", State.FAILED)
    accepted = AcceptanceResult("drawing 1", "guarded", (result,))
    write_specimen(runs / "r1", SpecimenResult("MR-1", SpecimenVerdict.NOT_OK, "rebound force", accepted))
    delivered(runs, server)
    made("r3", specimen="MR-3", started="2026-11-24T10:00:00+00:00", simulated={"speed": 1.0})
    with opened(server) as database, database.transaction() as connection:  # as an earlier release made it
        connection.execute(text("DROP VIEW calibration_list"))
        connection.execute(text("CREATE VIEW calibration_list AS SELECT started, station FROM campaigns"))
    delivered(runs, server)
    answers: dict[str, list[list[tuple[object, ...]]]] = {}
    for url in (None, server):
        with open_results(runs, url) as (database, _):
            for title, query in queries_of_the_dashboard().items():
                assert "$" not in query
                with database.transaction(reading=True) as connection:
                    answers.setdefault(title, []).append([
                        tuple(map(_comparable, row)) for row in connection.exec_driver_sql(query)
                    ])  # fmt: skip
    assert {title: own for title, (own, theirs) in answers.items() if own != theirs} == {}
    assert [title for title, (own, _) in answers.items() if not own and "Sensitivity" not in title] == []
    assert answers["Campaigns"] == [[(3.0,)]] * 2, "simulated runs are excluded, unless they are requested"


def _comparable(value: object) -> object:
    """Times as instants, truth values and decimal numbers as numbers: what differs between the drivers."""
    if isinstance(value, str) and value[10:11] == "T":
        return datetime.fromisoformat(value)
    return float(value) if isinstance(value, (bool, int, Decimal)) else value
