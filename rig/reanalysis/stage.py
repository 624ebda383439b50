"""The folder of a new result while it is made: it gets its name when everything is in it, or is removed.

A result that was interrupted by a crash remains under a name that no command reads; the next call removes it.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem, Refused
from rig.recording.atomic_write import FULL, flush_directory, inner_folder, write_whole
from rig.recording.journal.journal_lock import campaign_held, folder_claimed

PARTIAL = ".partial"
SPARE_BYTES = 32_000_000
"""Free space that must remain for the fit and the report."""
GROWTH = 1.1
"""Size of new files of points over that of the originals, at most, for the forecast of space."""
READ_BYTES = 1 << 22


@contextmanager
def staged(parent: Path, name_of: Callable[[int], str], needed_bytes: int) -> Iterator[tuple[Path, Path]]:
    """Provide a folder in which to make a result, and the name that it gets at the end of the block.

    The name belongs to this call from the start: a process that makes another result in `parent` has another one.

    Args:
        parent: folder of the results; it may be missing.
        name_of: name of a result; its argument counts up until a name is free.
        needed_bytes: size of what will be written.

    Raises:
        FileProblem: the place is not writable or does not have enough space; nothing remains there.
    """
    stage = final = parent
    made: Path | None = None
    try:
        if not parent.exists():
            made = parent
        inner_folder(parent.parent, parent.name)
        with contextlib.ExitStack() as held:
            with folder_claimed(parent):
                _remove_abandoned(parent)
                _check_space(parent, needed_bytes)
                stage, final = _reserved(parent, name_of)
                held.enter_context(campaign_held(stage))
            yield stage, final
            stage.rename(final)
        flush_directory(parent)
    except OSError as error:
        raise FileProblem(str(final), [f"cannot be written: {_reason(error)}; no part of it remains"]) from error
    finally:
        if stage != parent:
            shutil.rmtree(stage, ignore_errors=True)
        if made is not None:
            with contextlib.suppress(OSError):
                made.rmdir()  # only if it is empty


def _reserved(parent: Path, name_of: Callable[[int], str]) -> tuple[Path, Path]:
    """A new folder to make a result in, and the free name that it reserves.

    Raises:
        OSError: it cannot be made.
    """
    number = 0
    while True:
        final = parent / name_of(number)
        stage = parent / f".{final.name}{PARTIAL}"
        if not final.exists() and not stage.exists():
            stage.mkdir()
            return stage, final
        number += 1


def _reason(error: OSError) -> str:
    """What the system reports, and what to do."""
    if error.errno in FULL:
        return f"{error.strerror}. Fix: free space, or write to another disk with --out"
    return f"{error.strerror or error}. Fix: write to another folder with --out"


def _check_space(folder: Path, needed_bytes: int) -> None:
    """Reject a disk that has too little space.

    Raises:
        FileProblem: it has.
    """
    free = shutil.disk_usage(folder).free
    needed = round(GROWTH * needed_bytes) + SPARE_BYTES
    if free < needed:
        raise FileProblem(str(folder), [
            f"{needed / 1e6:.0f} MB required, {free / 1e6:.0f} MB free. Fix: free space, or write to another disk "
            "with --out"
        ], "disk-full")  # fmt: skip


def _remove_abandoned(parent: Path) -> None:
    """Remove results that were interrupted by a crash; one that a process is still making stays."""
    for folder in parent.glob(f".*{PARTIAL}"):
        try:
            with campaign_held(folder):
                shutil.rmtree(folder, ignore_errors=True)
        except (Refused, FileProblem):
            continue


def copied(source: Path, target: Path) -> None:
    """Copy a file complete or not at all.

    Raises:
        OSError: it cannot be read, or the disk refuses.
    """
    with source.open("rb") as read:
        write_whole(target, lambda file: shutil.copyfileobj(read, file, READ_BYTES))


@contextmanager
def view_of(run: Path, stage: Path) -> Iterator[Path]:
    """A run's folder through links: what is evaluated through it stores nothing in the original.

    Raises:
        OSError: links cannot be made.
    """
    view = stage / ".original"
    view.mkdir()
    try:
        for entry in run.iterdir():
            if entry.name not in {CampaignFolder.cache, CampaignFolder.reanalysed}:
                (view / entry.name).symlink_to(entry.resolve())
        yield view
    finally:
        shutil.rmtree(view, ignore_errors=True)
