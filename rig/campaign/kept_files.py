"""Copies of the user's files in the campaign's directory."""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path

from rig.bench import named_files
from rig.errors import Refused
from rig.matrix import named_files as matrix_files
from rig.recording.atomic_write import inner_folder, write_durably
from rig.text_file import LARGEST_NAMED_FILE_BYTES, read_bytes, read_text

LARGEST_BENCH_BYTES = 262_144
LARGEST_MATRIX_BYTES = 1_048_576


def copy_into(source: Path, folder: Path, name: str) -> None:
    """Keep a user's file with the campaign, as it was, also through a power cut.

    Raises:
        Refused: it cannot be copied.
        FileProblem: the source cannot be read.
    """
    content = read_bytes(source, LARGEST_NAMED_FILE_BYTES)
    try:
        write_durably(folder / name, content)
    except OSError as error:
        raise Refused("dir-readonly", f"{folder / name}: cannot be written: {error}") from error


def keep_matrix(source: Path, folder: Path, name: str) -> None:
    """Keep a matrix file with the files that it names, so that the copy needs nothing beside the campaign.

    Raises:
        Refused: one cannot be copied.
        FileProblem: one cannot be read.
    """
    written = read_text(source, LARGEST_MATRIX_BYTES)
    text, files = matrix_files.kept(written, source.absolute().parent)
    if not files:
        copy_into(source, folder, name)
        return
    try:
        beside = inner_folder(folder, matrix_files.FOLDER)
        for own, content in files.items():
            write_durably(beside / own, content)
        write_durably(folder / name, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{folder / name}: cannot be written: {error}") from error


def kept_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 (hex) of each file that a campaign's matrix names, by its name in the campaign's directory."""
    beside = folder / matrix_files.FOLDER
    return {
        f"{matrix_files.FOLDER}/{path.name}": hashlib.sha256(read_bytes(path, LARGEST_NAMED_FILE_BYTES)).hexdigest()
        for path in sorted(beside.iterdir() if beside.is_dir() else ()) if path.is_file()
    }


def keep_bench(source: Path, folder: Path, name: str) -> None:
    """Keep a bench file and the files that it names, so that the copy can be used as the original was.

    Raises:
        Refused: one cannot be copied.
        FileProblem: one cannot be read.
    """
    text = read_text(source, LARGEST_BENCH_BYTES)
    for _, written in named_files.named(tomllib.loads(text)):
        kept = named_files.kept_name(written)
        text = text.replace(json.dumps(written), json.dumps(kept))
        try:
            (folder / kept).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused("dir-readonly", f"{folder / kept}: cannot be written: {error}") from error
        copy_into(source.parent / written, folder, kept)
    if text == read_text(source, LARGEST_BENCH_BYTES):
        copy_into(source, folder, name)
        return
    try:
        write_durably(folder / name, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{folder / name}: cannot be written: {error}") from error
