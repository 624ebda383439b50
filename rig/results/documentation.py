"""The reference page of the results database, `docs/results-database.md`, from the tables themselves.

`python -m rig.results.documentation > docs/results-database.md` writes it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator

from sqlalchemy import Boolean, Double, Integer, Table

from rig.results.quantities import QUANTITIES
from rig.results.schema import RESULTS, VERSION, VIEWS, Utc, view_columns

HEAD = f"""# Results database

The results of all runs in a folder are stored in one SQLite file in that folder, `.rig-runs.sqlite`, and can be
delivered to a PostgreSQL server that collects the results of several stations. Both databases have the same
tables. See [Keep results in a database](how-to/keep-results-in-a-database.md).

Schema version {VERSION}. This page is generated from the tables (`python -m rig.results.documentation`) and checked
by a test.

- Only the run directories are authoritative: the database is created from the run directories and can be rebuilt at
  any time. Do not write to its tables, because such changes are lost.
- Numbers are in SI units (temperatures in degC). The unit is part of the column's name, or in the column `unit` of
  the same row.
- Times are in UTC. PostgreSQL: `timestamp with time zone`. SQLite: text such as `2026-11-27T20:02:19.000+00:00`,
  which sorts by time.
- Unknown values are NULL; unknown texts are empty.
- Uncertainties are standard uncertainties (k = 1), unless the name states otherwise.
- In SQLite, Boolean values are 0 and 1.
- A campaign has a UUID that is derived from the name in `campaign.json`: copies of a directory and renamed
  directories belong to the same campaign, which is counted once.
- Results of a run are updated if its points, its fit, the acceptance result or the text entered on the operator's
  page change.
- A campaign whose directory is deleted is removed from the SQLite file, but not from a server.

## Views

Use the views in Grafana, Excel and other programs. Each view joins several tables; the columns of a view have the
meaning stated below for the tables.

"""
LOCAL_ONLY = """## Further tables in the SQLite file

`format` and `runs` are the index of runs for `rig runs`; `sources`, `deliveries` and `servers` contain the state of
the file. Their content may change between versions.
"""


def page() -> str:
    """The page as Markdown."""
    return "".join([HEAD, *_views(), *_tables(), *_quantities(), LOCAL_ONLY])


def _views() -> Iterator[str]:
    meanings = {
        "campaign_list": "one row for each campaign, with its fit",
        "results": "one row for each measured value, with campaign, motion and verdict",
        "parameter_list": "one row for each fitted parameter",
        "acceptance_list": "one row for each value that was compared with an acceptance band",
        "calibration_list": "one row for each sensor and campaign",
    }
    yield "| view | content | columns |\n|---|---|---|\n"
    for name in VIEWS:
        yield f"| `{name}` | {meanings[name]} | {', '.join(f'`{column}`' for column in view_columns(name))} |\n"
    yield "\n## Tables\n\n"


def _tables() -> Iterator[str]:
    for table in RESULTS.tables.values():
        yield f"### `{table.name}`\n\n"
        if table.comment:
            yield f"{table.comment[0].upper()}{table.comment[1:]}.\n\n"
        yield from _columns(table)
        yield "\n"


def _columns(table: Table) -> Iterator[str]:
    yield "| column | type | meaning |\n|---|---|---|\n"
    for column in table.columns:
        kinds = ((Utc, "time"), (Boolean, "Boolean"), (Integer, "integer"), (Double, "number"))
        kind = next((name for known, name in kinds if isinstance(column.type, known)), "text")
        kind += ", key" if column.primary_key else ""
        yield f"| `{column.name}` | {kind} | {column.comment or ''} |\n"


def _quantities() -> Iterator[str]:
    yield "## Quantities\n\n"
    yield "Values of `characteristics.quantity`. Quantities of the specimen are not determined from invalid points.\n"
    yield "A response time that the rig cannot resolve has no row. The rows of an endurance test belong to the\n"
    yield "point of its last block; `endurance_cycles_to_...` exists only if that stop rule ended the test.\n"
    yield "`endurance_end_gas_force_down` is no gas leak by itself: the mean of rebound and compression force is the\n"
    yield "gas force only of a symmetric damper.\n\n"
    yield "| quantity | meaning | unit | subject |\n|---|---|---|---|\n"
    for one in QUANTITIES.values():
        yield f"| `{one.name}` | {one.title} | {one.unit} | {one.subject} |\n"
    yield "\n"


if __name__ == "__main__":
    sys.stdout.write(page())
