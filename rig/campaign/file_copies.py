"""Copies of the user's files in the campaign's directory."""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path

from rig.bench import named_files
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem, Refused
from rig.matrix import named_files as matrix_files
from rig.matrix.model import Matrix
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


def keep_matrix(source: Path, kept: Path, serial_number: str = "") -> None:
    """Keep a matrix file with the files that it names, so that the copy needs nothing outside its folder.

    Args:
        source: the matrix file.
        kept: its copy.
        serial_number: of the specimen, where it is not the one in the file; the copy then states this one.

    Raises:
        Refused: one cannot be copied.
        FileProblem: one cannot be read, or its serial number cannot be replaced.
    """
    written = read_text(source, LARGEST_MATRIX_BYTES)
    text, files = matrix_files.kept(written, source.absolute().parent)
    text = with_serial_number(text, serial_number, str(source))
    if not files and text == written:
        keep_file(source, kept)
        return
    try:
        records = inner_folder(kept.parent, CampaignFolder.records)
        for own, content in files.items():
            write_durably(records / own, content)
        write_durably(kept, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{kept}: cannot be written: {error}") from error


def with_serial_number(text: str, serial_number: str, name: str = "") -> str:
    """A matrix file's text for another specimen; every other value and all comments stay as they are.

    Args:
        text: of the matrix file.
        serial_number: of the specimen; empty: the one in the file.
        name: of the file, for the message.

    Raises:
        FileProblem: the entry is written in a way that cannot be replaced.
    """
    wanted = tomllib.loads(text)
    before = str(wanted["specimen"]["serial_number"])
    if serial_number in {"", before}:
        return text
    wanted["specimen"]["serial_number"] = serial_number
    entry = re.compile(rf"""(serial_number["']?\s*=\s*)(["']){re.escape(before)}\2""")
    for match in entry.finditer(text):  # a comment or another table may hold such a line, too
        changed = f"{text[: match.start()]}{match[1]}{json.dumps(serial_number)}{text[match.end() :]}"
        if tomllib.loads(changed) == wanted:
            return changed
    raise FileProblem(name, [
        'specimen.serial_number cannot be replaced in the copy of this file. Fix: write it in [specimen] as '
        f'serial_number = "{before}"'
    ])


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
    written = read_text(source, LARGEST_BENCH_BYTES)
    data = tomllib.loads(written)
    plan = named_files.kept(data, source.parent, _reserved(kept.name))
    text = _with_names(written, plan.names)
    if tomllib.loads(text) != named_files.renamed(data, plan.names):
        names = ", ".join(repr(name) for name, own in plan.names.items() if name != own)
        raise FileProblem(str(source), [
            f"the name of a file cannot be replaced in the copy of this file: {names}. Fix: write each of these names "
            "in double quotes, as a separate entry"
        ])
    for own, name in plan.files.items():
        copy = kept.parent / own
        try:
            copy.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused("dir-readonly", f"{copy}: cannot be written: {error}") from error
        keep_file(source.parent / name, copy)
    if text == written:
        keep_file(source, kept)
        return
    try:
        write_durably(kept, text.encode())
    except OSError as error:
        raise Refused("dir-readonly", f"{kept}: cannot be written: {error}") from error


def keep_drives(run: Path, folder: Path, matrix: Matrix) -> None:
    """Copy the stored commands of an earlier run into a new campaign, which starts its iterations from them.

    Args:
        run: the earlier run.
        folder: the new campaign's directory.
        matrix: of the new campaign.

    Raises:
        Refused: they cannot be copied.
        FileProblem: the run has none, one cannot be read, or the matrix iterates no signal.
    """
    if matrix.sweep.iterate is None:
        raise FileProblem("--drives", ["the matrix has no [matrix.iterate] table, so no command is iterated. Fix: add "
            "the table, or remove --drives"])
    own = CampaignFolder(folder).drives
    files = sorted(CampaignFolder(run).drives.glob("*.h5"))
    if not files:
        text = f"contains no commands: {own.name}/ is missing or empty. Fix: specify a run whose signals were iterated"
        raise FileProblem(str(run), [text])
    try:
        inner_folder(folder, own.name)
    except OSError as error:
        raise Refused("dir-readonly", f"{own}: cannot be written: {error}") from error
    for file in files:
        keep_file(file, own / file.name)


def _reserved(bench: str) -> frozenset[str]:
    """Names in a campaign's folder that a file of the bench must not have."""
    of = CampaignFolder
    return frozenset({bench, of.bench, of.matrix, of.details, of.records, of.points, of.cache, of.reference, of.drives})


def _with_names(text: str, names: Mapping[str, str]) -> str:
    """A bench file's text with other names of files; everything else stays as it is."""
    changed = {name: own for name, own in names.items() if name != own}
    quoted = {
        form: json.dumps(own, ensure_ascii=False) for name, own in changed.items()
        for form in (json.dumps(name, ensure_ascii=False), json.dumps(name), f"'{name}'")
    }
    if not quoted:
        return text
    return re.sub("|".join(map(re.escape, quoted)), lambda match: quoted[match[0]], text)
