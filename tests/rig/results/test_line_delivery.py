"""A production line whose results server is stopped and started again between its specimens."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from sqlalchemy import text

from rig.results.connection import server as opened
from rig.results.filling import filled_database

if TYPE_CHECKING:
    from conftest import PostgreSQL

pytestmark = [pytest.mark.wire, pytest.mark.nightly, pytest.mark.timeout(2400)]

EXAMPLE = Path(__file__).parents[3] / "examples" / "line.toml"
SERIALS = ("MR-101", "MR-102", "MR-103")
LONGEST_S = 600.0


def test_a_server_that_is_away_during_a_test_has_every_specimen_once_in_the_end(
    tmp_path: Path, server: str, postgresql: PostgreSQL
) -> None:
    command = (sys.executable, "-P", "-m", "rig.cli.main", "line", str(EXAMPLE), "--simulate", "--speed", "5", "--out",
               str(tmp_path), "--results", server, "--json")  # fmt: skip
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    with (tmp_path / "messages").open("wb") as messages:
        line = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=messages, text=True,
                                env=environment)  # fmt: skip
    assert line.stdin is not None
    try:
        for number, serial in enumerate(SERIALS, start=1):
            line.stdin.write(f"{serial}\n")
            line.stdin.flush()
            if number == 2:
                postgresql.stop("immediate")
            until(partial(waits_for_the_next, tmp_path / "messages", number))
            if number == 2:
                time.sleep(3.0)  # its delivery fails meanwhile
                postgresql.start()
        answer = json.loads(line.communicate("quit\n", timeout=LONGEST_S)[0])
    finally:
        if line.poll() is None:
            line.terminate()
            line.wait(LONGEST_S)
    assert [(one["serial_number"], one["verdict"]) for one in answer["specimens"]] == [
        ("MR-101", "ok"), ("MR-102", "ok"), ("MR-103", "not-ok"),
    ]  # fmt: skip
    assert line.returncode == 8
    until(lambda: delivered(server) == sorted(SERIALS))
    query = text("SELECT campaign_id, digest, specimen_verdict FROM campaigns ORDER BY campaign_id")
    with (
        filled_database(tmp_path) as (folder, _), opened(server) as remote,
        folder.transaction(reading=True) as own, remote.transaction(reading=True) as theirs,
    ):
        assert own.execute(query).all() == theirs.execute(query).all()


def waits_for_the_next(messages: Path, number: int) -> bool:
    """Whether so many specimens have their result: what is entered before is refused."""
    return messages.read_text(encoding="utf-8").count("scan the next serial number") == number


def delivered(server: str) -> list[str]:
    """Serial numbers of the campaigns on the server, one entry for each campaign."""
    with opened(server) as database, database.transaction(reading=True) as connection:
        return list(connection.execute(text("SELECT specimen FROM campaigns ORDER BY specimen")).scalars())


def until(reached: Callable[[], bool]) -> None:
    """Wait until a condition is reached."""
    deadline = time.monotonic() + LONGEST_S
    while not reached():
        assert time.monotonic() < deadline
        time.sleep(0.1)
