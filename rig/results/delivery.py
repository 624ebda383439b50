"""Delivery of results to a server: each campaign once, updated if its results change, whenever the server is reachable.

The outbox is the folder of runs itself: every campaign whose digest the server does not have is delivered, in one
transaction. A transaction that the server lost is rolled back there and delivered again later. The record of deliveries
in the folder's database only reports the state while the server is not reachable; without it, the server is asked.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Select, func, select

from rig.bench.server_address import server_name
from rig.clock import utc_now
from rig.errors import RigError
from rig.results.connection import Database, Unreachable, server
from rig.results.filling import Filled, filled_database, put, rows_of, upsert
from rig.results.schema import campaigns, characteristics, deliveries, servers

TRIES = 3
"""Attempts for one campaign, if the server ends a transaction because of others (deadlock)."""
DELIVERED_AT_ONCE = 500
"""Campaigns whose digests are compared with one query."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Outbox:
    """State of the delivery to a server.

    Attributes:
        server: address without password.
        delivered: number of campaigns that the server has, as they are now.
        waiting: number of campaigns that it does not have, or not as they are now.
        last_attempt: time of the last attempt; None if there was none.
        error: why the last attempt failed; empty if it did not.
    """

    server: str
    delivered: int
    waiting: int
    last_attempt: datetime | None = None
    error: str = ""

    @property
    def line(self) -> str:
        """The state in one line."""
        done = f"{self.delivered} of {self.delivered + self.waiting} campaigns delivered to {self.server}"
        waiting = f"; {self.waiting} waiting for the next attempt" if self.waiting else ""
        reason = self.error
        if self.waiting and not reason:
            reason = "no attempt so far" if self.last_attempt is None else (
                f"new or changed since the last attempt, {self.last_attempt:%Y-%m-%d %H:%M} UTC")
        return f"{done}{waiting}" + (f" ({reason})" if reason else "")

    def to_json(self) -> dict[str, Any]:
        """The keys of `delivery` in `rig results --json`."""
        return {
            "server": self.server, "delivered": self.delivered, "waiting": self.waiting,
            "last_attempt": None if self.last_attempt is None else self.last_attempt.isoformat(timespec="seconds"),
            "error": self.error or None,
        }


@dataclass(frozen=True)
class State:
    """State of the database of a folder.

    Attributes:
        database: path of the file.
        filled: what the last update did.
        campaigns: number of campaigns; `values` of values in `characteristics`; `specimens` of specimens.
        outboxes: state of the delivery to each server that was ever used.
    """

    database: Path
    filled: Filled
    campaigns: int
    values: int
    specimens: int
    outboxes: tuple[Outbox, ...] = field(default=())


def state_of(database: Database, filled: Filled, url: str | None = None) -> State:
    """State of a folder's database; `url` is a server that counts even if nothing was ever delivered to it."""
    with database.transaction(reading=True) as connection:
        numbers = (
            connection.execute(select(func.count()).select_from(campaigns)).scalar_one(),
            connection.execute(select(func.count()).select_from(characteristics)).scalar_one(),
            connection.execute(select(func.count(campaigns.c.specimen.distinct()))).scalar_one(),
        )
        names = list(connection.execute(select(servers.c.server).order_by(servers.c.server)).scalars())
        if url is not None and server_name(url) not in names:
            names.append(server_name(url))
        outboxes = tuple(_outbox(connection, name) for name in names)
    return State(Path(database.place), filled, *numbers, outboxes)


def servers_waited_for(database: Database) -> list[str]:
    """Addresses, without passwords and options, of known servers that do not have every campaign as it is now."""
    with database.transaction(reading=True) as connection:
        names = connection.execute(select(servers.c.server).order_by(servers.c.server)).scalars().all()
        return [name for name in names if _outbox(connection, name).waiting]


def _outbox(connection: Connection, name: str) -> Outbox:
    confirmed = select(deliveries.c.campaign_id).where(
        deliveries.c.server == name, deliveries.c.campaign_id == campaigns.c.campaign_id,
        deliveries.c.digest == campaigns.c.digest,
    )  # fmt: skip
    total = connection.execute(select(func.count()).select_from(campaigns)).scalar_one()
    delivered = connection.execute(select(func.count()).select_from(campaigns).where(confirmed.exists())).scalar_one()
    last = connection.execute(select(servers).where(servers.c.server == name)).first()
    if last is None:
        return Outbox(name, delivered, total - delivered)
    return Outbox(name, delivered, total - delivered, last.attempted, last.error)


def deliver(database: Database, url: str, report_progress: Progress = lambda _done, _total: None) -> Outbox:
    """Deliver every campaign of a folder's database that the server does not have as it is now.

    An unreachable server is no error: the state names it, and the campaigns wait.

    Args:
        database: of the folder, brought up to date.
        url: address of the server.
        report_progress: called with the numbers of delivered campaigns and of all that are to be delivered.

    Raises:
        RigError: the address is not valid, the server's tables are of another version, or the folder's database
            cannot be read.
    """
    name, error = server_name(url), ""
    try:
        with server(url) as target:
            _deliver_all(database, target, name, report_progress)
    except Unreachable as problem:
        error = problem.reason
    except RigError as problem:
        _note(database, name, str(problem))
        raise
    _note(database, name, error)
    with database.transaction(reading=True) as connection:
        return _outbox(connection, name)


def _note(database: Database, name: str, error: str) -> None:
    """Keep the result of an attempt; a file that cannot be written keeps none."""
    with contextlib.suppress(RigError), database.transaction() as connection:
        upsert(connection, servers, {"server": name, "attempted": utc_now(), "error": error})


def _deliver_all(database: Database, target: Database, name: str, report_progress: Progress) -> None:
    """Deliver what is missing, oldest first.

    Raises:
        Unreachable: the server was lost; what it had confirmed is noted. Also if it rejected a campaign: the others
            are delivered first.
    """
    rejected: Unreachable | None = None
    waiting = _waiting(database, target, name)
    for number, campaign_id in enumerate(waiting, start=1):
        with database.transaction(reading=True) as connection:
            campaign, children, digest = rows_of(connection, campaign_id)
        for attempt in range(TRIES):
            try:
                with target.transaction() as connection:
                    put(connection, campaign, children, digest)
            except Unreachable as error:
                if error.rejected:
                    rejected = error
                    rejected.reason = f"campaign {campaign['run']} rejected: {error.reason}"
                    break
                if not error.repeatable or attempt == TRIES - 1:
                    raise
            else:
                _confirm(database, name, {campaign_id: digest})
                break
        report_progress(number, len(waiting))
    if rejected is not None:
        raise rejected


def _waiting(database: Database, target: Database, name: str) -> list[str]:
    """Campaigns that are to be delivered; those that the server has already are noted as delivered.

    A campaign that this folder delivered and that another computer has changed since is left alone: the last writer
    wins, and two computers with a copy of one run do not replace each other's results for ever.
    """
    with database.transaction(reading=True) as connection:
        query = select(campaigns.c.campaign_id, campaigns.c.digest)
        own = _digests(connection, query.order_by(campaigns.c.started, campaigns.c.campaign_id))
        query = select(deliveries.c.campaign_id, deliveries.c.digest)
        noted = _digests(connection, query.where(deliveries.c.server == name))
    theirs: dict[str, str] = {}
    with target.transaction(reading=True) as connection:
        for part in _parts(list(own), DELIVERED_AT_ONCE):
            query = select(campaigns.c.campaign_id, campaigns.c.digest).where(campaigns.c.campaign_id.in_(part))
            theirs |= _digests(connection, query)
    present = {one: digest for one, digest in own.items() if theirs.get(one) == digest or (
        one in theirs and noted.get(one) == digest
    )}  # fmt: skip
    _confirm(database, name, {one: digest for one, digest in present.items() if noted.get(one) != digest})
    return [one for one in own if one not in present]


def _digests(connection: Connection, query: Select[Any]) -> dict[str, str]:
    return {row[0]: row[1] for row in connection.execute(query)}


def _parts(names: list[str], size: int) -> Iterator[list[str]]:
    for start in range(0, len(names), size):
        yield names[start : start + size]


def _confirm(database: Database, name: str, digests: dict[str, str]) -> None:
    if not digests:
        return
    with contextlib.suppress(RigError), database.transaction() as connection:  # the server knows it anyway
        for campaign_id, digest in digests.items():
            row = {"server": name, "campaign_id": campaign_id, "digest": digest, "delivered": utc_now()}
            upsert(connection, deliveries, row)


def deliver_folder(folder: Path, url: str) -> Outbox:
    """Bring the database of a folder up to date and deliver it.

    Raises:
        FileProblem: as `filled_database` and `deliver`.
    """
    with filled_database(folder) as (database, _):
        return deliver(database, url)
