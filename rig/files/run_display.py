"""The display of a run: `[display]` of the bench and matrix files, or of an import's details, kept in its folder.

Loads no validator: the operator's page reads it, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.display import Display
from rig.errors import FileProblem
from rig.files.toml_source import read_toml


def run_display(run: Path) -> Display:
    """How the numbers of a run are shown; as usual where the run keeps no such file, or the file is damaged.

    Raises:
        FileProblem: an entry of `[display]`, edited since, is not valid.
    """
    folder = CampaignFolder(run)
    try:
        return Display.of(_table(folder.bench), _table(folder.matrix), _table(folder.details))
    except ValueError as error:
        raise FileProblem(f"{folder.bench} and {folder.matrix.name}", [str(error)]) from error


def _table(path: Path) -> Mapping[str, Any]:
    try:
        table = read_toml(path).data.get("display", {})
    except FileProblem:  # a run is shown without it: what was recorded does not depend on it
        return {}
    return table if isinstance(table, Mapping) else {}
