"""Any foreign file, told by its first bytes, not by its name."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rig.recording.foreign.csv_file import CsvFile
from rig.recording.foreign.foreign_file import Dialect, ForeignFile, read_foreign_bytes
from rig.recording.foreign.lvm_file import SIGNATURE as LVM
from rig.recording.foreign.lvm_file import LvmFile
from rig.recording.foreign.mat_file import MatFile
from rig.recording.foreign.mf4_file import Mf4File
from rig.recording.foreign.tdms_file import TdmsFile


def open_foreign(file: Path, said: Dialect) -> tuple[ForeignFile, str]:
    """A file of any format and the SHA-256 of its content.

    Args:
        file: of CSV, MATLAB, TDMS or MDF.
        said: what the user says of CSV files.

    Raises:
        FileProblem: it cannot be read.
    """
    data = read_foreign_bytes(file)
    return _opened(file, data, said), hashlib.sha256(data).hexdigest()


def _opened(file: Path, data: bytes, said: Dialect) -> ForeignFile:
    if data[:4] in (b"TDSm", b"TDSh"):
        return TdmsFile(file, data)
    if data[:8] in (b"MDF     ", b"UnFinMF "):
        return Mf4File(file, data)
    if data[:6] == b"MATLAB" or (file.suffix == ".mat" and b"\0" in data[:1024]):
        return MatFile(file, data)
    if data.removeprefix(b"\xef\xbb\xbf").startswith(LVM):
        return LvmFile(file, data, said)
    return CsvFile(file, data, said)
