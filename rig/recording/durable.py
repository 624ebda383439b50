"""Getting bytes onto the disk for good: flush a file, rename it, flush its directory."""

from __future__ import annotations

import os
from pathlib import Path


def flush_directory(folder: Path) -> None:
    """Make renames and new names in a folder survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def replace_durably(partial: Path, final: Path) -> None:
    """Flush `partial`, give it its final name in one step, flush the directory.

    Raises:
        OSError: the disk refused; the final name then still holds what it held before.
    """
    handle = os.open(partial, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
    os.replace(partial, final)
    flush_directory(final.parent)


def write_text_durably(path: Path, text: str) -> None:
    """Write a small text file complete or not at all.

    Raises:
        OSError: the place cannot be written.
    """
    partial = path.with_name(path.name + ".tmp")
    partial.write_text(text, encoding="utf-8")
    replace_durably(partial, path)
