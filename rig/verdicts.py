"""The verdicts on a point, and their order. No numeric package: the lists of runs and the page read them."""

from __future__ import annotations

from collections.abc import Collection

VALID = "valid"
SUSPECT = "suspect"
INVALID = "invalid"
VERDICTS = (VALID, SUSPECT, INVALID)
"""Best first."""


def rank(verdict: object) -> int:
    """Place of a verdict among all, 0 for the worst: of a point's attempts the best counts; -1: no verdict."""
    return VERDICTS[::-1].index(str(verdict)) if verdict in VERDICTS else -1


def worst(verdicts: Collection[str]) -> str:
    """The worst of several verdicts; empty: there is none."""
    return min((verdict for verdict in verdicts if verdict in VERDICTS), key=rank, default="")
