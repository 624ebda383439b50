"""Tables, indices and views of the results database; `docs/results-database.md` lists them, checked by a test.

The tables are equal in SQLite and in PostgreSQL. All numbers are in SI units, temperatures in degC; times are UTC:
`timestamp with time zone` in PostgreSQL, and text of the form 2026-11-27T20:02:19.000+00:00 in SQLite, which sorts and
compares by time. Unknown values are NULL. Names are in lower case, because PostgreSQL requires quotes otherwise.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import (
    Boolean,
    Column,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    types,
)

from rig.results.run_index import SCHEMA as VERSION

__all__ = ["CHILDREN", "LOCAL", "RESULTS", "VERSION", "VIEWS", "Utc", "stored_current", "view_columns"]

RESULTS, LOCAL = MetaData(), MetaData()
"""Tables of every results database; tables that only the file in a folder of runs has."""


class Utc(types.TypeDecorator[datetime]):
    """A time in UTC; text in SQLite, which has no such type."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> types.TypeEngine[Any]:
        """The type in a database."""
        stored: types.TypeEngine[Any] = Text() if dialect.name == "sqlite" else DateTime(timezone=True)
        return dialect.type_descriptor(stored)

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> str | datetime | None:
        """The value as it is stored; a time without a zone is UTC."""
        if value is None:
            return None
        zoned = value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)
        return zoned.isoformat(timespec="milliseconds") if dialect.name == "sqlite" else zoned

    def process_result_value(self, value: object, dialect: Dialect) -> datetime | None:
        """The value as read, in UTC."""
        del dialect
        read = datetime.fromisoformat(value) if isinstance(value, str) else value
        return read.astimezone(UTC) if isinstance(read, datetime) else None


def stored_current(current_A: float) -> float:
    """A current level (A) as it is stored, so that equal levels are equal numbers."""
    return round(current_A, 6) + 0.0


def _text(name: str, comment: str, *, key: bool = False) -> Column[str]:
    return Column(name, Text, primary_key=key, nullable=False, comment=comment, server_default=None if key else "")


def _number(name: str, comment: str) -> Column[float]:
    return Column(name, Double, nullable=True, comment=comment)


def _count(name: str, comment: str) -> Column[int]:
    return Column(name, Integer, nullable=False, comment=comment, server_default="0")


def _of_campaign() -> Column[int]:
    return Column(
        "campaign", Integer, ForeignKey("campaigns.campaign", ondelete="CASCADE"), primary_key=True,
        autoincrement=False, comment="the campaign: its number in `campaigns`",
    )


schema_version = Table(
    "schema_version", RESULTS,
    Column("version", Integer, primary_key=True, autoincrement=False, comment="version of these tables"),
    _text("software", "software that created the tables"),
)  # fmt: skip

stations = Table(
    "stations", RESULTS,
    _text("station", "name of the station: `[results] station` of the bench file, or the name of the bench", key=True),
    comment="test rigs",
)  # fmt: skip

specimens = Table(
    "specimens", RESULTS,
    _text("specimen", "serial number", key=True),
    comment="tested dampers",
)  # fmt: skip

campaigns = Table(
    "campaigns", RESULTS,
    Column("campaign", Integer, primary_key=True, comment="number of the campaign in this database only"),
    Column("campaign_id", Text, nullable=False, unique=True,
           comment="UUID of the campaign, in every database; the same for a copied or renamed run directory"),
    _text("run", "name of the run directory"),
    Column("station", Text, ForeignKey("stations.station"), comment="station; NULL for imported tests"),
    Column("specimen", Text, ForeignKey("specimens.specimen"), comment="serial number; NULL if not stated"),
    _text("operator", "person who performed the test; empty if not stated"),
    _text("matrix", "name of the matrix file"),
    _text("matrix_sha256", "hash of the matrix; identical for identical tests"),
    _text("bench", "name of the bench"),
    Column("started", Utc, nullable=True, comment="start of the campaign; for imported tests, time of the import"),
    _text("software", "software that recorded the campaign"),
    Column("simulated", Boolean, nullable=False, comment="whether the rig was simulated"),
    Column("imported", Boolean, nullable=False, comment="whether the tests were imported"),
    _count("planned_points", "number of points in the matrix; 0 if unknown"),
    _count("recorded_points", "number of recorded points; a block of an endurance test counts once"),
    _count("valid_points", "number of valid points; an interrupted block has the best verdict of its parts"),
    _text("bench_verdict", "worst verdict of all points: `valid`, `suspect`, `invalid`; empty without points"),
    _text("specimen_verdict", "`ok`, `not-ok`, `not-tested` (undecided, for example not enough valid points), or "
          "`no-bands` (the matrix has no acceptance bands)"),
    _text("digest", "SHA-256 of all rows of this campaign; changes when a result changes"),
    _text("filled_by", "software that filled these rows"),
    Column("filled", Utc, nullable=False, comment="time at which these rows were filled"),
    Index("campaigns_by_start", "started"),
    Index("campaigns_by_specimen", "specimen", "started"),
    Index("campaigns_by_station", "station", "started"),
    Index("campaigns_by_matrix", "matrix", "started"),
    comment="one row for each campaign (run)",
)  # fmt: skip

MOTION = (
    ("motion", "motion as text, such as `sine 30 mm 2 Hz`", Text),
    ("waveform", "waveform; `hold` if the rod is at rest", Text),
    ("amplitude_m", "requested amplitude (m); for an imported test, the measured one", Double),
    ("frequency_hz", "requested frequency (Hz); for an imported test, the measured one", Double),
    ("current_a", "current level of the test (A)", Double),
)


def _motion() -> tuple[Column[object], ...]:
    return tuple(Column(name, kind(), nullable=True, comment=comment) for name, comment, kind in MOTION)


points = Table(
    "points", RESULTS,
    _of_campaign(),
    _text("point", "name of the point in its campaign", key=True),
    _text("kind", "`loop`, `friction`, `signal`, `current_step`, `hybrid`, ..."),
    *_motion(),
    _number("centre_m", "centre of the motion (m)"),
    _number("cycles", "number of cycles at full amplitude"),
    _count("repeat", "number of the repeat, from 1"),
    Column("recorded", Utc, nullable=True, comment="start of the recording"),
    _text("verdict", "`valid`, `suspect` or `invalid`"),
    _text("reasons", "reasons for the verdict, separated by semicolons"),
    _count("lost_samples", "number of lost samples"),
    _number("skew_s", "delay of the force relative to the displacement, corrected (s)"),
    _number("skew_standard_uncertainty_s", "standard uncertainty of `skew_s` (s)"),
    sqlite_with_rowid=False,
    comment="one row for each recorded point",
)  # fmt: skip

characteristics = Table(
    "characteristics", RESULTS,
    _of_campaign(),
    _text("point", "point from which the value was determined", key=True),
    _text("quantity", "name of the quantity, such as `rebound_force`", key=True),
    _text("subject", "`specimen` (property of the damper) or `bench` (state of the rig and its sensors)"),
    *_motion(),
    Column("recorded", Utc, nullable=True, comment="start of the recording of the point"),
    _text("point_verdict", "verdict of the point"),
    _count("repeat", "number of the repeat of the point, from 1"),
    _number("value", "value in `unit`"),
    _text("unit", "SI unit"),
    _number("standard_uncertainty", "combined standard uncertainty, as far as it is known; in `unit`"),
    _number("repeatability_uncertainty", "contribution of the variation between cycles; in `unit`"),
    _number("calibration_uncertainty", "contribution of the calibration certificates; in `unit`; NULL if not stated"),
    # SQLite stores the primary key in each index of this table. PostgreSQL reads a chart from the index only with it.
    Index("characteristics_by_quantity", "quantity", "motion", "current_a", "value", postgresql_include=["campaign"]),
    sqlite_with_rowid=False,
    comment="measured values without a damper model, one row for each value",
)  # fmt: skip

fits = Table(
    "fits", RESULTS,
    _of_campaign(),
    _text("model", "damper model"),
    _text("method", "fitting method"),
    Column("adequate", Boolean, nullable=True, comment="whether the model fits within the measurement noise"),
    _number("rmse_n", "RMS error of the force (N)"),
    _number("nrmse_percent", "RMS error in percent of the force amplitude"),
    _count("tests", "number of fitted tests"),
    _text("sha256", "SHA-256 of `fit.json`"),
    comment="the fit of a campaign",
)  # fmt: skip

parameters = Table(
    "parameters", RESULTS,
    _of_campaign(),
    _text("parameter", "name of the parameter", key=True),
    _number("value", "value in `unit`"),
    _text("unit", "SI unit"),
    _number("standard_uncertainty", "standard error in `unit`; NULL if the tests do not determine the parameter"),
    _number("low", "lower end of the 95 % interval in `unit`"),
    _number("high", "upper end of the 95 % interval in `unit`"),
    Column("identifiable", Boolean, nullable=False, comment="whether the tests determine the parameter"),
    _text("reason", "reason why the tests do not determine the parameter"),
    Index("parameters_by_name", "parameter"),
    sqlite_with_rowid=False,
    comment="parameters of the fits",
)  # fmt: skip

verdicts = Table(
    "verdicts", RESULTS,
    _of_campaign(),
    _text("subject", "`bench` (quality of the test) or `specimen` (acceptance of the damper)", key=True),
    Column("item", Integer, primary_key=True, autoincrement=False, comment="0: the verdict; from 1: one row for each "
           "value that was compared with its band"),
    _text("verdict", "item 0: as in `campaigns`; further items: `pass`, `fail`, `unsure`, `missing`"),
    _text("reason", "reason for the verdict"),
    _text("bands", "item 0 of the specimen: name of the acceptance bands"),
    _text("decision", "item 0 of the specimen: decision rule"),
    _text("quantity", "quantity or parameter"),
    _text("location", "motion and current"),
    _number("value", "value in `unit`"),
    _number("expanded_uncertainty", "expanded uncertainty (95 %) in `unit`"),
    _number("low", "lower limit in `unit`; NULL if open"),
    _number("high", "upper limit in `unit`; NULL if open"),
    _number("margin", "distance from the nearer limit in `unit`; negative outside the limits"),
    _text("unit", "unit"),
    sqlite_with_rowid=False,
    comment="verdicts of the bench and of the specimen",
)  # fmt: skip

calibrations = Table(
    "calibrations", RESULTS,
    _of_campaign(),
    _text("channel", "`force`, `displacement` or the name of an auxiliary channel", key=True),
    _text("sensor", "name of the sensor in the bench file"),
    _text("serial_number", "serial number of the sensor"),
    _text("certificate", "number of the calibration certificate"),
    _text("due", "date on which the calibration expires (ISO 8601)"),
    Column("overdue", Boolean, nullable=False, comment="whether the calibration had expired"),
    _number("sensitivity", "value of one raw count, in `unit`"),
    _number("offset_value", "offset that is subtracted, in `unit`"),
    _number("uncertainty_percent", "standard uncertainty of the sensitivity (%); NULL if not stated"),
    _number("range_value", "measuring range in `unit`"),
    _text("unit", "SI unit of the channel"),
    sqlite_with_rowid=False,
    comment="calibration of each sensor during a campaign",
)  # fmt: skip

CHILDREN = (points, characteristics, fits, parameters, verdicts, calibrations)
"""Tables whose rows belong to one campaign."""

sources = Table(
    "sources", LOCAL,
    _text("run", "name of the run directory", key=True),
    _text("stamp", "inodes, sizes and change times of the files from which the rows were filled"),
    _text("campaign_id", "the campaign; empty if the directory could not be read, or is a copy"),
    _text("remark", "reason why the run, or a part of it, is not in the database"),
)  # fmt: skip

deliveries = Table(
    "deliveries", LOCAL,
    _text("server", "address of the server without password", key=True),
    _text("campaign_id", "the campaign", key=True),
    _text("digest", "digest of the campaign that the server has confirmed"),
    Column("delivered", Utc, nullable=False, comment="time of the confirmation"),
    sqlite_with_rowid=False,
)  # fmt: skip

servers = Table(
    "servers", LOCAL,
    _text("server", "address of the server without password", key=True),
    Column("attempted", Utc, nullable=False, comment="time of the last attempt"),
    _text("error", "why the last attempt failed; empty if it did not"),
)  # fmt: skip

VIEWS = {
    "campaign_list": """
        SELECT c.started, c.station, c.specimen, c.operator, c.matrix, c.bench_verdict, c.specimen_verdict,
            c.valid_points, c.recorded_points, c.planned_points, f.model, f.nrmse_percent, f.adequate, c.simulated,
            c.imported, c.run, c.campaign_id
        FROM campaigns c LEFT JOIN fits f ON f.campaign = c.campaign""",
    "results": """
        SELECT c.started, c.station, c.specimen, c.operator, c.matrix, x.quantity, x.subject, x.motion, x.current_a,
            x.value, x.unit, x.standard_uncertainty, x.repeatability_uncertainty, x.calibration_uncertainty,
            x.repeat, x.point_verdict, c.specimen_verdict, x.waveform, x.amplitude_m, x.frequency_hz, x.recorded,
            x.point, c.run, c.campaign_id, c.simulated
        FROM characteristics x JOIN campaigns c ON c.campaign = x.campaign""",
    "parameter_list": """
        SELECT c.started, c.station, c.specimen, c.operator, c.matrix, f.model, q.parameter, q.value, q.unit,
            q.standard_uncertainty, q.low, q.high, q.identifiable, q.reason, f.adequate, c.specimen_verdict, c.run,
            c.campaign_id, c.simulated
        FROM parameters q JOIN campaigns c ON c.campaign = q.campaign
            JOIN fits f ON f.campaign = q.campaign""",
    "acceptance_list": """
        SELECT c.started, c.station, c.specimen, c.operator, c.matrix, v.verdict, v.quantity, v.location, v.value,
            v.expanded_uncertainty, v.low, v.high, v.margin, v.unit, v.reason, c.specimen_verdict, c.run,
            c.campaign_id, c.simulated
        FROM verdicts v JOIN campaigns c ON c.campaign = v.campaign
        WHERE v.subject = 'specimen' AND v.item > 0""",
    "calibration_list": """
        SELECT c.started, c.station, k.channel, k.sensor, k.serial_number, k.certificate, k.due, k.overdue,
            k.sensitivity, k.offset_value, k.uncertainty_percent, k.range_value, k.unit, c.run, c.campaign_id,
            c.simulated
        FROM calibrations k JOIN campaigns c ON c.campaign = k.campaign""",
}
"""Views with readable names, for Grafana, Excel and other programs: name -> query, equal in both databases.

Columns are only added, and at the end: PostgreSQL replaces a view in place only then.
"""


def view_columns(name: str) -> list[str]:
    """Names of the columns of a view."""
    selected = VIEWS[name].split("SELECT", 1)[1].split("FROM", 1)[0]
    return [part.split(" AS ")[-1].strip().rpartition(".")[2] for part in selected.split(",")]
