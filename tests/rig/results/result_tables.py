"""Rows of results databases, for comparing them."""

from __future__ import annotations


def comparable(tables: dict[str, list[dict[str, object]]]) -> dict[str, list[dict[str, object]]]:
    """Rows without what differs between equal databases: the time of writing, and the campaigns' own numbers."""
    names = {row["campaign"]: row["run"] for row in tables["campaigns"]}
    for rows in tables.values():
        for row in rows:
            row.pop("filled", None)
            if "campaign" in row:
                row["campaign"] = names[row["campaign"]]
        rows.sort(key=str)
    return tables
