"""The results of a run's hybrid tests, for the terminal and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.campaign_folder import CampaignFolder
from rig.cli.output import show
from rig.document.blocks import Column, table

if TYPE_CHECKING:
    from rich.console import Console

    from rig.cli.job import JobResult


def hybrid_numbers(result: JobResult) -> dict[str, Any]:
    """Contents of `hybrid.json`; the same keys without values where there is none."""
    # loads numba and numpy: not needed for the help
    from rig.characteristics.hybrid_tests import answer

    path = CampaignFolder(Path(result.campaign.campaign)).hybrid
    if not path.is_file():
        return answer(())
    numbers: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return numbers


def show_hybrid_tests(numbers: dict[str, Any], shown: Console) -> None:
    """Print one line for each test: delay, tracking, difference from the reference, energy, late set-points."""
    head = (
        Column("compensation"), Column("law"), Column("delay", "ms", True), Column("tracking", "%", True),
        Column("body to 3 Hz", "%", True), Column("energy error", "%", True), Column("late", "", True),
        Column("verdict"),
    )  # fmt: skip
    rows = []
    for test in numbers["tests"]:
        percent = (100.0 * value if value is not None else None for value in (
            test["tracking_nrms"], test["reference_error"], test["energy_error"]
        ))  # fmt: skip
        cells = ["-" if value is None else f"{value:.3g}" for value in (test["delay_ms"], *percent)]
        late = "-" if test["late_steps"] is None else f"{test['late_steps']} of {test['steps']}"
        rows.append([test["compensation"], test["law"], *cells, late, test["verdict"]])
    if rows:
        show([table(head, rows)], shown)
