"""Unsupported files, by their first bytes: what each one is, and how to convert it."""

from __future__ import annotations

import re
from collections.abc import Iterator

CSV = "save the file as CSV with the program that wrote it"
BEGINNINGS: tuple[tuple[bytes, str, str], ...] = (
    (b"ARROW1", "a Feather (Arrow) file", "pandas.read_feather(FILE).to_csv('a.csv'), or RecordedPoint.from_pandas"),
    (b"\x93NUMPY", "a NumPy array (.npy)", "numpy.savetxt('a.csv', numpy.load(FILE), delimiter=',')"),
    (b"SQLite format 3\0", "an SQLite database", "export the table of the test as CSV"),
    (b"%PDF", "a PDF document", "export the numerical data as CSV"),
    (b"\x1f\x8b", "a gzip archive", "unpack the file first (gunzip)"),
    (b"BZh", "a bzip2 archive", "unpack the file first (bunzip2)"),
    (b"\xfd7zXZ\0", "an xz archive", "unpack the file first (unxz)"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", "unpack the file first"),
    (b"Rar!", "a RAR archive", "unpack the file first"),
    (b"\x89PNG", "a picture (PNG)", "export the numerical data as CSV"),
    (b"\xff\xd8\xff", "a picture (JPEG)", "export the numerical data as CSV"),
    (b"|CF,", "an imc FAMOS file", CSV),
    (b"|CK,", "an imc FAMOS file", CSV),
    (b"DEWESoft", "a Dewesoft file", "export the data as MDF4, MATLAB or CSV"),
    (b"DIAEHL", "a DIAdem file", "save the data as TDMS or CSV"),
    (b"{\\rtf", "an RTF document", "save the numbers as a text file"),
    (b"FEA1", "a Feather file", "pandas.read_feather(FILE).to_csv('a.csv'), or RecordedPoint.from_pandas"),
    (b"CDF\x05", "a NetCDF 3 file", "ncks -4 or xarray.open_dataset(FILE).to_netcdf('a.nc', engine='h5netcdf')"),
    (b"\x0e\x03\x13\x01", "an HDF4 file", "convert the file to HDF5 (h4toh5)"),
    (b"$FL2", "an SPSS file (.sav)", "save the data as CSV"),
    (b"$FL3", "an SPSS file (.zsav)", "save the data as CSV"),
    (b"<stata_dta>", "a Stata file (.dta)", "pandas.read_stata(FILE).to_csv('a.csv')"),
    (bytes(12) + b"\xc2\xea\x81\x60", "a SAS file (.sas7bdat)", "pandas.read_sas(FILE).to_csv('a.csv')"),
    (b"RDX2\n", "an R workspace (.RData)", "write.csv(TABLE, 'a.csv') in R"),
    (b"RDX3\n", "an R workspace (.RData)", "write.csv(TABLE, 'a.csv') in R"),
    (b"LOGG", "a Vector BLF bus log", "export its signals as MDF4 or CSV with the bus database"),
    (b"MATLAB Data Acquisition File", "a MATLAB data acquisition file (.daq)",
     "[d, t] = daqread(FILE); writematrix([t d], 'a.csv') in MATLAB"),
    (b"DTLG", "a LabVIEW datalog file", "export the data as TDMS or LVM"),
    (b"CPYA", "an Origin project", "export the worksheet as CSV"),
    (b"CPYUA", "an Origin project", "export the worksheet as CSV"),
    (b"#ROSBAG", "a ROS bag", "export the topics as CSV"),
    (b"\x89MCAP", "an MCAP log", "export the topics as CSV"),
    (b"\x28\xb5\x2f\xfd", "a Zstandard archive", "unpack the file first (unzstd)"),
    (b"\x80\x04\x95", "a Python pickle, which can execute code when it is loaded", "save the data as CSV"),
    (b"\x80\x05\x95", "a Python pickle, which can execute code when it is loaded", "save the data as CSV"),
    (b"\x00\x01\x00\x00Standard", "an Access database", "export the table of the test as CSV"),
    (b"MZ", "a Windows program", "specify the file that contains the data"),
    (b"\x7fELF", "a Linux program", "specify the file that contains the data"),
    *((number.to_bytes(2, "little"), "an HBM catman file (.bin)", "export the data as MDF4, MATLAB or CSV")
      for number in range(5010, 5015)),
)
WITHIN: tuple[tuple[int, bytes, str, str], ...] = (
    (8, b"WAVE", "an audio file (WAV)", "read the file with SciPy, scale it to physical units, and save it as CSV"),
    (257, b"ustar", "a tar archive", "unpack the file first"),
    (11, b"WAVEDESC", "a LeCroy oscilloscope file (.trc)", CSV), (0, b"WAVEDESC", "a LeCroy oscilloscope file", CSV),
)
"""Signatures behind the beginning, with their offset."""
IN_ARCHIVES = (
    ("word/", "a Word document", "save the numbers as a text file"),
    ("ppt/", "a PowerPoint presentation", "save the numbers as a text file"),
    ("Index/", "an Apple Numbers spreadsheet", "export the spreadsheet as .xlsx or CSV"),
    ("modelDescription.xml", "an FMU (a model)", "specify the file that contains the data"),
    (".npy", "NumPy arrays (.npz)", "numpy.savetxt('a.csv', columns, delimiter=',')"),
)
TEXTS: tuple[tuple[re.Pattern[bytes], str, str], ...] = (
    (re.compile(rb"\s*-1\s*\n\s*(15|55|58b?|82|151|164)\b"), "a universal file (UFF, UNV)", CSV),
    (re.compile(rb"(?s)\s*(<\?xml[^>]*>\s*)?(<!--.{0,2000}?-->\s*)?<(usi:)?tdm\b"), "a DIAdem TDM file",
     "save the data as TDMS or CSV"),
    (re.compile(rb"(?s)\s*(<\?xml[^>]*>\s*)?(<!--.{0,2000}?-->\s*)?<atfx_file\b"), "an ASAM ODS file (ATFX)",
     "export the measurement as MDF4 or CSV"),
    (re.compile(rb"\s*ATF_FILE\b"), "an ASAM ODS file (ATF)", "export the measurement as MDF4 or CSV"),
    (re.compile(rb"(?s)\s*(<\?xml[^>]*>\s*)?(<!--.{0,2000}?-->\s*)?<sie\b"), "a SoMat SIE file",
     "export the data as CSV or RPC III with SoMat InField or nCode"),
    (re.compile(rb"(?i)date [a-z]{3} [a-z]{3} +\d+ .*\r?\nbase (hex|dec)"), "a Vector ASC bus log",
     "export its signals as MDF4 or CSV with the bus database"),
    (re.compile(rb"\s*(\{\s*\"|\[\s*[\[{])"), "a JSON file", "pandas.read_json(FILE).to_csv('a.csv')"),
    (re.compile(rb"\s*<\?xml[^>]*>\s*(<\?mso[^>]*>\s*)?<Workbook\b"), "an Excel 2003 XML workbook",
     "save the workbook as .xlsx or CSV"),
    (re.compile(rb"(?i)\s*(<!doctype html|<html|<table)\b"), "a web page (HTML), which some programs save with the "
        "extension .xls",
     "open the file in a spreadsheet and save it as .xlsx or CSV"),
    (re.compile(rb"\s*<\?xml\b"), "an XML file", CSV),
)  # fmt: skip


def what_it_is(data: bytes, names: Iterator[str] | tuple[str, ...] = ()) -> tuple[str, str] | None:
    """What a file is that is not read, and the way out; None where it may be a text of numbers.

    Args:
        data: the file's bytes.
        names: of the files in it, where it is a ZIP archive.
    """
    held = tuple(names)
    if held:
        known = next((known for known in IN_ARCHIVES if any(known[0] in name for name in held)), None)
        return known[1:] if known else ("a ZIP archive", "unpack it first")
    binary = b"\0" in data[:4096]
    for beginning, name, way_out in BEGINNINGS:
        if data.startswith(beginning) and (binary or not beginning.isalnum()):  # else perhaps a heading, such as `MZ;x`
            return name, way_out
    for offset, signature, name, way_out in WITHIN:
        if data[offset : offset + len(signature)] == signature:
            return name, way_out
    head = data[:8192].removeprefix(b"\xef\xbb\xbf")
    return next(((name, way_out) for pattern, name, way_out in TEXTS if pattern.match(head)), None)


def encoding_without_mark(data: bytes) -> str:
    """UTF-16 without a mark, by the zero bytes in every other place; empty where the zeros are not those of a text."""
    head = data[:4096]
    odd, even = head[1::2].count(0), head[::2].count(0)
    places = max(1, len(head) // 2)
    if odd > 0.8 * places and even < 0.05 * places:
        return "utf-16-le"
    return "utf-16-be" if even > 0.8 * places and odd < 0.05 * places else ""
