"""Open a results database, the SQLite file of a folder or a PostgreSQL server: create its tables, check its version."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, Index, MetaData, create_engine, event, insert, inspect, select, text
from sqlalchemy.engine import make_url
from sqlalchemy.exc import ArgumentError, DataError, DBAPIError, IntegrityError, OperationalError, ProgrammingError
from sqlalchemy.pool import NullPool

from rig import __version__
from rig.bench.server_address import checked_address, server_name, without_passwords
from rig.errors import FileProblem, RigError
from rig.results.run_index import NAME, newer_schema
from rig.results.schema import LOCAL, RESULTS, VERSION, VIEWS, schema_version, view_columns

LOCK_WAIT_S = 20.0
CONNECT_S = 5
STATEMENT_S = 60
CREATION_LOCK = 4_120_519_021
"""Key of the server's lock while tables are created: of several stations that start at once, one creates them."""


class Unreachable(RigError):
    """The server of results cannot be reached, or refused or lost the connection; nothing is lost."""

    slug = "results-unreachable"
    reason = ""
    """What the server or the driver reported."""
    repeatable = False
    """Whether the server ended the transaction because of others, so that it can be repeated at once."""
    rejected = False
    """Whether the server is reachable and does not accept these rows."""


class DamagedDatabase(FileProblem):
    """The SQLite file is damaged, or is no database."""


@dataclass(frozen=True)
class Database:
    """An open results database: `place` is its path, or the address of its server without password."""

    engine: Engine
    place: str

    @contextmanager
    def transaction(self, *, reading: bool = False) -> Iterator[Connection]:
        """A transaction: committed at the end of the block, rolled back if the block raises an error.

        Args:
            reading: nothing is written, so that others may write meanwhile.

        Raises:
            Unreachable: the server cannot be reached, lost the connection, or refused a statement.
            FileProblem: the SQLite file is locked, full or read-only.
            DamagedDatabase: the SQLite file is damaged.
        """
        try:
            with self.engine.execution_options(reading=reading).begin() as connection:
                yield connection
        except DBAPIError as error:
            raise self._explained(error) from error

    def _explained(self, error: DBAPIError) -> RigError:
        reason = (without_passwords(str(error.orig)).strip() or type(error.orig).__name__).splitlines()[0].strip()
        if self.engine.dialect.name == "sqlite":
            if not isinstance(error, OperationalError):
                return DamagedDatabase(self.place, [f"damaged ({reason}). Fix: rig results --rebuild"])
            return FileProblem(self.place, [f"cannot be used: {reason}"])
        password = self.engine.url.password
        reason = reason.replace(str(password), "***") if password else reason
        lost = Unreachable(f"results server {self.place}: {reason}")
        lost.reason = reason
        lost.repeatable = getattr(error.orig, "sqlstate", None) in {"40001", "40P01", "55P03"}
        lost.rejected = isinstance(error, (DataError, IntegrityError))
        return lost


@contextmanager
def server(url: str, *, create: bool = True) -> Iterator[Database]:
    """A PostgreSQL database, with its tables.

    Args:
        url: address; without a password, libpq uses PGPASSWORD or ~/.pgpass.
        create: create missing tables.

    Raises:
        FileProblem: the address is not valid, or the tables are of another version.
        Unreachable: the server cannot be reached.
    """
    try:
        name = server_name(checked_address(url))
        address = make_url(url.strip()).set(drivername="postgresql+psycopg")
    except (ValueError, ArgumentError) as error:
        text_of = without_passwords(str(error))
        raise FileProblem("--results", [text_of]) from None
    settings = {
        "connect_timeout": CONNECT_S, "application_name": "mr-damper-rig", "tcp_user_timeout": 1000 * CONNECT_S,
        "options": f"-c statement_timeout={STATEMENT_S}s -c lock_timeout={LOCK_WAIT_S:.0f}s -c timezone=UTC",
    }
    settings = {key: value for key, value in settings.items() if key not in address.query}
    engine = create_engine(address, poolclass=NullPool, connect_args=settings)
    try:
        database = Database(engine, name)
        with database.transaction() as connection:
            version = _version(connection)
            if version is None and create:
                connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": CREATION_LOCK})
                version = _version(connection)
                if version is None:
                    _check_empty(connection, name)
                    version = _create(connection, RESULTS)
            if create and version == VERSION:
                _renew(connection)
        _check(name, version)
        yield database
    finally:
        engine.dispose()


@contextmanager
def folder_database(folder: Path, report: Callable[[str], None] = lambda _text: None) -> Iterator[Database]:
    """The database in a folder of runs, with its tables; a damaged file is replaced by an empty database.

    If the folder cannot be written, the database is a copy in memory, which is lost at the end of the block.

    Args:
        folder: folder of runs.
        report: called with a message about a damaged or read-only file.

    Raises:
        FileProblem: the file is of a newer version (it is not written), or locked.
    """
    file = folder / NAME
    kept = writable(file)
    if not kept:
        report(f"{file}: the folder or the file is read-only; the results are read into memory")
    engine = _file_engine(file) if kept else _memory_engine(file)
    try:
        try:
            _prepare(engine, file)
        except OperationalError as error:
            raise FileProblem(str(file), [f"cannot be used: {error.orig}"]) from error
        except DBAPIError as error:
            engine.dispose()
            report(f"{file}: damaged ({error.orig}); it is rebuilt from the run directories")
            file.unlink()
            engine = _file_engine(file)
            _prepare(engine, file)
        yield Database(engine, str(file))
    finally:
        engine.dispose()


def writable(file: Path) -> bool:
    """Whether the file can be written, and its journal beside it."""
    return os.access(file.parent, os.W_OK) and (not file.exists() or os.access(file, os.W_OK))


def _file_engine(file: Path) -> Engine:
    return _sqlite(lambda: sqlite3.connect(file, timeout=LOCK_WAIT_S, isolation_level=None), poolclass=NullPool)


def _memory_engine(file: Path) -> Engine:
    memory = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False)
    if file.is_file():
        address = f"{file.absolute().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as written:
            written.backup(memory)
    return _sqlite(lambda: memory)


def _sqlite(connect: Callable[[], sqlite3.Connection], **options: Any) -> Engine:  # noqa: ANN401 - SQLAlchemy's own
    """An engine whose transactions lock the file from their beginning: none fails in the middle because of another."""
    engine = create_engine("sqlite://", creator=connect, **options)

    @event.listens_for(engine, "connect")
    def _settings(connection: sqlite3.Connection, _record: object) -> None:
        connection.execute("PRAGMA foreign_keys = ON")

    @event.listens_for(engine, "begin")
    def _begin(connection: Connection) -> None:
        reading = connection.get_execution_options().get("reading", False)
        connection.exec_driver_sql("BEGIN" if reading else "BEGIN IMMEDIATE")

    return engine


def _prepare(engine: Engine, file: Path) -> None:
    with engine.begin() as connection:
        version = _version(connection)
        if version is None or version < VERSION:
            _remove_earlier(connection)
            version = _create(connection, RESULTS, LOCAL)
        elif version == VERSION:
            _renew(connection)
    _check(str(file), version)


def _version(connection: Connection) -> int | None:
    """Version of the tables; None if there are none."""
    if not inspect(connection).has_table(schema_version.name):
        return None
    return connection.execute(select(schema_version.c.version)).scalar()


def _remove_earlier(connection: Connection) -> None:
    """Remove the tables of an earlier version from a folder's file, which is made again from the run directories."""
    for name in VIEWS:
        connection.execute(text(f"DROP VIEW IF EXISTS {name}"))
    for one in (LOCAL, RESULTS):
        one.drop_all(connection)


def _check_empty(connection: Connection, place: str) -> None:
    """Refuse a server's database with tables of other programs that have the same names.

    Raises:
        FileProblem: it names them.
    """
    present = {*inspect(connection).get_table_names(), *inspect(connection).get_view_names()}
    if taken := sorted(present & {*RESULTS.tables, *VIEWS}):
        raise FileProblem(place, [
            f"contains tables of another program with the same names ({', '.join(taken)}). Fix: use a separate database"
        ])


def _create(connection: Connection, *tables: MetaData) -> int:
    for one in tables:
        one.create_all(connection)
    for name, query in VIEWS.items():
        connection.execute(text(f"CREATE VIEW {name} AS {query}"))
    connection.execute(insert(schema_version).values(version=VERSION, software=f"mr-damper-rig {__version__}"))
    return VERSION


def _renew(connection: Connection) -> None:
    """Bring the indices and views of an earlier release to those of this one; what another owner made remains as it is.

    Neither changes a row, so the version of the tables stays, and earlier releases go on to use them.
    """
    _renew_indices(connection)
    _renew_views(connection)


def _renew_indices(connection: Connection) -> None:
    if not _other_indices(connection):
        return
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:key)"), {"key": CREATION_LOCK})
    for index in _other_indices(connection):
        # A writer that holds the table for too long is not disturbed: the next process that opens the database tries.
        with suppress(ProgrammingError, OperationalError), connection.begin_nested():
            index.drop(connection, checkfirst=True)
            index.create(connection)


def _other_indices(connection: Connection) -> list[Index]:
    """Indices that the database does not have, or has with other columns."""
    inspected, indices = inspect(connection), [index for table in RESULTS.tables.values() for index in table.indexes]
    held = {
        one["name"]: (one["column_names"], one.get("include_columns") or [])
        for name in {index.table.name for index in indices if index.table is not None}
        for one in inspected.get_indexes(name)
    }
    included = connection.dialect.name == "postgresql"
    return [
        index for index in indices if held.get(index.name) != (
            [column.name for column in index.columns],
            list(index.dialect_options["postgresql"]["include"] or ()) if included else [],
        )
    ]  # fmt: skip


def _renew_views(connection: Connection) -> None:
    """Add the columns that the views of an earlier release do not have; a view of another owner remains as it is."""
    inspected = inspect(connection)
    for name, query in VIEWS.items():
        if {*view_columns(name)} <= {column["name"] for column in inspected.get_columns(name)}:
            continue
        with suppress(ProgrammingError), connection.begin_nested():
            if connection.dialect.name == "sqlite":
                connection.execute(text(f"DROP VIEW {name}"))
                connection.execute(text(f"CREATE VIEW {name} AS {query}"))
            else:
                connection.execute(text(f"CREATE OR REPLACE VIEW {name} AS {query}"))


def _check(place: str, version: int | None) -> None:
    """Refuse tables of another version.

    Raises:
        FileProblem: with the version and what to do.
    """
    if version is None:
        raise FileProblem(place, ["contains no results yet. Fix: deliver results with rig results --deliver"])
    if version > VERSION:
        raise FileProblem(place, [newer_schema("", version).removeprefix(": ")])
    if version < VERSION:
        text_of = f"got schema version {version}, expected {VERSION}. Fix: deliver to an empty database"
        raise FileProblem(place, [text_of])
