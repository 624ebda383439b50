"""When tests were run: of a campaign as recorded, of imported tests as the user states it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from rig.clock import utc_now
from rig.errors import FileProblem

TESTED = "tested"
"""In `campaign.json` of an imported run: date, or date and time with zone, of the tests (ISO 8601)."""
DAY_FIRST = re.compile(r"^(\d{1,2})\.(\d{1,2})\.(\d{4})(?!\d)")
EARLIEST = 1950
EARLIER_ZONES = timedelta(hours=14)
"""In the easternmost time zone it is tomorrow so long before it is tomorrow in UTC."""


def tested_on(text: str) -> str:
    """A date ("2026-03-05", or "05.03.2026" with the day first) as "2026-03-05".

    A time ("2026-03-05 14:30", local if it states no zone) is given in UTC (ISO 8601).

    Raises:
        FileProblem: it is neither, or not between 1950 and now.
    """
    text = DAY_FIRST.sub(lambda date: f"{date[3]}-{date[2]:0>2}-{date[1]:0>2}", text.strip())
    try:
        moment = datetime.fromisoformat(text)
        is_date = len(text) == len("2026-03-05")
        moment = moment.replace(tzinfo=UTC) if is_date else moment.astimezone(UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise FileProblem("--date", [f'got {text[:40]!r}, expected a date such as "2026-03-05" or "05.03.2026", or a '
                                     'time such as "2026-03-05 14:30"']) from error  # fmt: skip
    latest = utc_now() + (EARLIER_ZONES if is_date else timedelta())
    if moment.year < EARLIEST or moment > latest:
        raise FileProblem("--date", [f"got {text}, expected a date from {EARLIEST} to today"])
    return moment.date().isoformat() if is_date else moment.isoformat(timespec="seconds")


def when_tested(campaign: Mapping[str, Any]) -> str:
    """When the tests of a run were run (ISO 8601); of imported tests without a date when they were imported.

    Args:
        campaign: content of `campaign.json`; empty where neither is stated.
    """
    return str(campaign.get("started_utc") or campaign.get(TESTED) or campaign.get("created") or "")
