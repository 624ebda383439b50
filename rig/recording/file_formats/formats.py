"""Any file of another program, recognised by its first bytes, not by its name."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

from rig.errors import FileProblem
from rig.recording.file_formats.column_files import NETCDF, PARQUET, netcdf_file, parquet_file
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.hdf5_file import Hdf5File, is_hdf5
from rig.recording.file_formats.lvm_file import SIGNATURE as LVM
from rig.recording.file_formats.lvm_file import LvmFile
from rig.recording.file_formats.mat_file import MatFile
from rig.recording.file_formats.mf4_file import Mf4File
from rig.recording.file_formats.rpc3_file import Rpc3File, is_rpc3
from rig.recording.file_formats.signatures import encoding_without_mark, what_it_is
from rig.recording.file_formats.table_file import Dialect, TableFile, read_bytes, stream, unreadable
from rig.recording.file_formats.tdms_file import TdmsFile
from rig.recording.file_formats.workbook_file import is_workbook, open_workbook


def open_file(file: Path, stated: Dialect) -> tuple[list[tuple[str, TableFile]], str]:
    """The tables of a file of any format, each with its name, and the SHA-256 of the content.

    Args:
        file: of text, Excel, MATLAB, HDF5, TDMS, MDF or RPC III.
        stated: what the user states of text files and workbooks.

    Returns:
        One table with an empty name; of a workbook a table for each sheet that is wanted, with the sheet's name.

    Raises:
        FileProblem: it cannot be read.
    """
    data = read_bytes(file)
    return _opened(file, data, stated), hashlib.sha256(data).hexdigest()


def _opened(file: Path, data: bytes, stated: Dialect) -> list[tuple[str, TableFile]]:
    if is_workbook(data, ()):
        return list(open_workbook(file, data, stated))
    if data[:4] == b"PK\x03\x04":
        return _from_archive(file, data, stated)
    opened = _binary(file, data)
    if opened is not None:
        return [("", opened)]
    known = what_it_is(data)
    if known is not None:
        raise FileProblem(str(file), [f"this file is {known[0]}, which cannot be imported. Fix: {known[1]}"])
    if data.removeprefix(b"\xef\xbb\xbf").startswith(LVM):
        return [("", LvmFile(file, data, stated))]
    if stated.encoding is None and b"\0" in data[:4096] and data[:2] not in {b"\xff\xfe", b"\xfe\xff"}:
        encoding = encoding_without_mark(data)
        way_out = f"UTF-16 text without a byte order mark. Fix: use --encoding {encoding}" if encoding else (
            "a binary file of an unknown format. Fix: save the file as CSV with the program that wrote it")
        raise FileProblem(str(file), [f"the file contains zero bytes, so it is {way_out}"])
    return [("", CsvFile(file, data, stated))]


def _binary(file: Path, data: bytes) -> TableFile | None:
    """A binary file of a format that is read; None for any other."""
    if data[:4] in (b"TDSm", b"TDSh"):
        return TdmsFile(file, data)
    if data[:8] in (b"MDF     ", b"UnFinMF "):
        return Mf4File(file, data)
    if (data[:7] == b"MATLAB " and data[7:8].isdigit()) or (file.suffix == ".mat" and b"\0" in data[:1024]):
        return MatFile(file, data)
    if is_hdf5(data):
        return Hdf5File(file, data)
    if data[:4] == PARQUET:
        return parquet_file(file, data)
    if data[:4] in NETCDF:
        return netcdf_file(file, data)
    return Rpc3File(file, data) if is_rpc3(data) else None


def _from_archive(file: Path, data: bytes, stated: Dialect) -> list[tuple[str, TableFile]]:
    """The sheets of a workbook.

    Raises:
        FileProblem: the archive is damaged, or no workbook.
    """
    try:
        with zipfile.ZipFile(stream(data)) as packed:
            names = packed.namelist()
    except Exception as error:
        raise FileProblem(str(file), unreadable("workbook or ZIP archive", error)) from error
    if is_workbook(data, names):
        return list(open_workbook(file, data, stated))
    name, way_out = what_it_is(data, tuple(names)) or ("an empty ZIP archive", "specify another file")
    raise FileProblem(str(file), [f"this file is {name}, which cannot be imported. Fix: {way_out}"])
