"""Copies of the user's files in the campaign's directory."""

from __future__ import annotations

import hashlib
import json
import tomllib
from pathlib import Path

from rig.bench import named_files
from rig.campaign_folder import CampaignFolder
from rig.errors import Refused
from rig.matrix import named_files as matrix_files
from rig.recording.atomic_write import inner_folder, write_durably
from rig.text_file import LARGEST_NAMED_FILE_BYTES, read_bytes, read_text

LARGEST_BENCH_BYTES = 262_144
LARGEST_MATRIX_BYTES = 1_048_576


def keep_file(source: Path, kept: Path) -> None:
    """Keep a user's file with the campaign, as it was, also through a power cut.

    Raises:
        Refused: it cannot be copied.
        FileProblem: the source cannot be read.
    """
    content = read_bytes(source, LARGEST_NAMED_FILE_BYTES)
    try:
        write_durably(kept, content)
    except OSError as error:
        raise Refused("dir-readonly", f"{kept}: cannot be written: {error}") from error


def keep_matrix(source: Path, kept: Path) -> None:
    """Keep a matrix file with the files that it names, so that the copy needs nothing outside its folder.

    Raises:
        Refused: one cannot be copied.
        FileProblem: one cannot be read.
    """
    written = read_text(source, LARGEST_MATRIX_BYTES)
    text, files = matrix_files.kept(written, source.absolute().parent)
    if not files:
        keep_file(source, kept)
        return
    try:
        records = inner_folder(kept.parent, CampaignFolder.records)
        for own, content in files.items():
            write_durably(records / own, content)
        write_durably(kept, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{kept}: cannot be written: {error}") from error


def kept_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 (hex) of each file that a campaign's matrix names, by its name in the campaign's directory."""
    records = CampaignFolder(folder).records
    return {
        f"{records.name}/{path.name}": hashlib.sha256(read_bytes(path, LARGEST_NAMED_FILE_BYTES)).hexdigest()
        for path in sorted(records.iterdir() if records.is_dir() else ()) if path.is_file()
    }


def keep_bench(source: Path, kept: Path) -> None:
    """Keep a bench file and the files that it names, so that the copy can be used as the original was.

    Raises:
        Refused: one cannot be copied.
        FileProblem: one cannot be read.
    """
    text = read_text(source, LARGEST_BENCH_BYTES)
    for _, written in named_files.named(tomllib.loads(text)):
        name = named_files.kept_name(written)
        text, copy = text.replace(json.dumps(written), json.dumps(name)), kept.parent / name
        try:
            copy.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused("dir-readonly", f"{copy}: cannot be written: {error}") from error
        keep_file(source.parent / written, copy)
    if text == read_text(source, LARGEST_BENCH_BYTES):
        keep_file(source, kept)
        return
    try:
        write_durably(kept, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{kept}: cannot be written: {error}") from error
