"""Where fits are written: whole or not at all, and an older one is kept."""

from __future__ import annotations

import itertools
from datetime import UTC, datetime
from pathlib import Path

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.recording.atomic_write import write_durably, write_text_durably
from rig.text_file import read_json


def saved(text: str, path: Path) -> tuple[Path, Path | None]:
    """Write a fit to a file, or to the `fit.json` of a folder.

    Returns:
        Its path, and where an older fit is kept: `fit-<UTC of its writing>.json`; None where there was none, or the
        same.

    Raises:
        FileProblem: there is something at that place that is no fit, or it cannot be written.
    """
    target = CampaignFolder(path).fit if path.is_dir() else path
    kept = None
    try:
        if target.is_file():
            if target.read_text(encoding="utf-8", errors="replace") == text:
                return target, None
            _refuse_others(target)
            kept = _kept(target)
        elif target.exists():
            raise FileProblem(str(target), ["is not a regular file. Fix: specify another name"])
        target.parent.mkdir(parents=True, exist_ok=True)
        write_text_durably(target, text)
    except OSError as error:
        raise FileProblem(str(target), [f"cannot be written: {error.strerror or error}"]) from error
    return target, kept


def _refuse_others(target: Path) -> None:
    """Refuse to replace what is no fit.

    Raises:
        FileProblem: it is none.
    """
    if target.name == CampaignFolder.fit:
        return
    try:
        known = {"parameters", "model"} <= read_json(target).keys()
    except FileProblem:
        known = False
    if not known:
        raise FileProblem(str(target), ["is an existing file that does not contain a fit; it was not overwritten. "
            "Fix: specify another name"])


def _kept(target: Path) -> Path:
    """Give an older fit a name of its own, by the time it was written."""
    written = datetime.fromtimestamp(target.stat().st_mtime, UTC).strftime("%Y%m%dT%H%M%SZ")
    for number in itertools.count(1):
        name = target.with_stem(f"{target.stem}-{written}{'' if number == 1 else f'-{number}'}")
        try:
            name.hardlink_to(target)
        except FileExistsError:
            continue
        except OSError:  # a file system without hard links
            write_durably(name, target.read_bytes())
        break
    return name
