"""`rig results`: state, values and delivery of the results database."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from in_process import rig

from rig.bench.server_address import address_without_password, checked_address, server_name, without_passwords
from rig.campaign_folder import CampaignFolder
from rig.cli.delivering import Delivery
from rig.results import filling, run_index

NOWHERE = "postgresql://rig:top-secret@127.0.0.1:1/rig"


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with one campaign that was stopped before its first point, with a fit from elsewhere."""
    monkeypatch.delenv("RIG_RESULTS", raising=False)
    for module in (run_index, filling):
        monkeypatch.setattr(module, "SETTLED_NS", -60_000_000_000)
    folder = tmp_path / "runs" / "r1"
    (folder / "points").mkdir(parents=True)
    CampaignFolder(folder).description.write_text(json.dumps({
        "id": "r1", "specimen": "MR-1", "started_utc": "2026-11-27T10:00:00+00:00", "matrix_file": "quick.toml",
        "bench": "bench 1", "points": ["p001"],
    }))  # fmt: skip
    entry = {"value": 5.0, "unit": "N", "standard_error": 0.5, "low": 4.0, "high": 6.0, "identifiable": True}
    CampaignFolder(folder).fit.write_text(json.dumps({"model": "bingham", "parameters": {"Fy": entry}}))
    return tmp_path / "runs"


def test_the_state_of_a_folder_is_one_line_and_one_json_object(runs: Path) -> None:
    shown = rig("results", "--in", runs)
    assert (shown.returncode, shown.stdout.split(":")[0]) == (
        0, "1 campaigns of 1 specimens with 0 values, from 1 runs (1 new or changed)",
    )  # fmt: skip
    told = json.loads(rig("results", "--in", runs, "--json").stdout)
    assert (told["runs"], told["read"], told["campaigns"], told["delivery"]) == (1, 0, 1, [])
    assert Path(told["database"]) == runs / run_index.NAME
    rebuilt = json.loads(rig("results", "--in", runs, "--rebuild", "--json").stdout)
    assert rebuilt == told | {"read": 1}


def test_the_folder_of_a_refused_campaign_is_not_reported(runs: Path) -> None:
    (runs / "refused" / "points").mkdir(parents=True)
    CampaignFolder(runs / "refused").journal.write_text('{"event": "refused"}\n')
    (runs / "broken" / "points").mkdir(parents=True)
    (runs / "broken" / "points" / "p001.h5").write_text("no HDF5")
    assert set(json.loads(rig("results", "--in", runs, "--json").stdout)["remarks"]) == {"broken"}


def test_values_are_shown_exported_and_given_to_scripts(runs: Path, tmp_path: Path) -> None:
    assert "fit bingham" in rig("results", "--in", runs, "--specimen", "MR-?").stdout
    head, line = rig("results", "--in", runs, "--quantity", "F*").stdout.splitlines()[:2]
    assert ("specimen verdict" in head, "fit bingham" in line) == (True, True), "one line for each value in a pipe"
    (row,) = json.loads(rig("results", "--in", runs, "--quantity", "Fy", "--json").stdout)["results"]
    assert (row["value"], row["std"], row["unit"], row["station"], row["started"]) == (
        5.0, 0.5, "N", "bench 1", "2026-11-27T10:00:00+00:00",
    )  # fmt: skip
    file = tmp_path / "values.csv"
    assert rig("results", "--in", runs, "--csv", file).returncode == 0
    with file.open(newline="", encoding="utf-8") as opened:
        (written,) = csv.DictReader(opened)
    assert written == {name: "" if value is None else str(value) for name, value in row.items()}
    assert rig("results", "--in", runs, "--specimen", "none").stdout == "no matching results\n"


def test_a_server_that_cannot_be_reached_is_named_and_the_campaign_waits(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("psycopg", reason="psycopg is not installed: pip install 'mr-damper-rig[results]'")
    shown = rig("results", "--in", runs, "--deliver", "--results", NOWHERE)
    assert shown.returncode == 2
    assert "0 of 1 campaigns delivered to postgresql://rig@127.0.0.1:1/rig; 1 waiting" in shown.stdout
    known = rig("results", "--in", runs, "--deliver")
    assert known.returncode == 2
    assert "--results postgresql://rig@127.0.0.1:1/rig" in known.stderr
    monkeypatch.setenv("RIG_RESULTS", NOWHERE)
    told = rig("results", "--in", runs, "--deliver", "--json")
    (outbox,) = json.loads(told.stdout)["delivery"]
    assert (outbox["delivered"], outbox["waiting"]) == (0, 1)
    assert "Connection refused" in outbox["error"]
    everything = shown.stdout + shown.stderr + told.stdout + told.stderr + str((runs / run_index.NAME).read_bytes())
    assert "top-secret" not in everything


@pytest.mark.wire
def test_the_delivery_process_reports_without_raising(runs: Path) -> None:
    with Delivery(NOWHERE) as delivery:
        told = delivery.deliver(runs, wait_s=60.0)
    assert (told["server"], told["delivered"], told["waiting"]) == ("postgresql://rig@127.0.0.1:1/rig", 0, 1)
    assert told["line"].startswith("0 of 1 campaigns delivered")
    with Delivery(NOWHERE):  # of a run that was refused
        pass


@pytest.mark.parametrize(("options", "text"), [
    (("--deliver",), "no results server is configured"),
    (("--deliver", "--results", NOWHERE, "--specimen", "x"), "--deliver delivers all campaigns"),
    (("--rebuild", "--results", NOWHERE), "--rebuild makes the database of a folder"),
    (("--results", "mysql://me:top-secret@host/rig"), "expected postgresql://USER@HOST/DATABASE"),
    (("--date", "2026-13"), "month must be in 1..12"),
])
def test_what_cannot_be_done_is_refused_in_words(runs: Path, options: tuple[str, ...], text: str) -> None:
    shown = rig("results", "--in", runs, *options)
    assert shown.returncode == 2
    assert text in shown.stderr
    assert "top-secret" not in shown.stderr


@pytest.mark.parametrize(("url", "name"), [
    ("postgresql://rig@host/results", "postgresql://rig@host/results"),
    ("postgres://rig:a%2Fb@host:5433/results?sslmode=require", "postgresql://rig@host:5433/results"),
    ("postgresql:///results?host=/run/postgresql", "postgresql://%2Frun%2Fpostgresql/results"),
    ("postgresql://rig@[::1]:5433/results", "postgresql://rig@[::1]:5433/results"),
])
def test_a_server_is_named_without_password_and_options(url: str, name: str) -> None:
    assert server_name(url) == name


@pytest.mark.parametrize("url", [
    "", "results", "sqlite:///x", "postgresql://host", "postgresql://host:port/x", "postgresql://host:0/x",
    "http://host/x",
])
def test_what_is_no_address_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="expected postgresql://USER@HOST/DATABASE"):
        checked_address(url)


@pytest.mark.parametrize("url", ["postgresql://rig:secret@host/x", "postgresql://rig@host/x?password=secret"])
def test_a_password_is_not_kept_in_a_file_and_not_shown(url: str) -> None:
    with pytest.raises(ValueError, match="must not be stored in this file") as refused:
        address_without_password(url)
    assert "secret" not in str(refused.value)
    assert "secret" not in without_passwords(f"rig run --results {url} --json")
