"""Runs in files that other programs open: Octave, xarray, pyarrow and pandas, asammdf read them."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest

from rig.export import export
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run

T = np.arange(50) * 0.004 + 1e-9 / 3.0
X = 0.01 * np.sin(7.0 * T)
FORCE = np.where(np.arange(50) == 7, np.nan, 1e3 * np.cos(7.0 * T))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    point = RecordedPoint.from_arrays(
        time_s=T, displacement_m=X, force_N=FORCE, id="p001", waveform="sine", amplitude_m=0.01,
        frequency_Hz=1.114, current_A=0.5, skew_std_s=1.0 / 3.0,
    )  # fmt: skip
    monkeypatch.setattr(Run, "open", lambda path: Run(path, (point,)))
    return tmp_path


def test_every_format_says_that_the_current_was_not_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import pandas as pd
    import pyarrow.parquet
    import xarray
    from asammdf import MDF
    from scipy.io import loadmat

    point = RecordedPoint.from_arrays(
        time_s=T, displacement_m=X, force_N=FORCE, id="p001", waveform="sine", amplitude_m=0.01, frequency_Hz=1.114,
        current_A=0.5, provenance={"current": "as specified; not measured"},
    )  # fmt: skip
    monkeypatch.setattr(Run, "open", lambda path: Run(path, (point,)))
    for target in ("csv", "mat", "netcdf", "parquet", "mf4"):
        export(tmp_path, target, tmp_path)
    with xarray.open_dataset(tmp_path / "p001.nc", engine="scipy", decode_times=False) as data:
        reported = {data.attrs["current_source"]}
    reported |= {pd.read_csv(tmp_path / "points.csv")["current_source"][0]}
    reported |= {loadmat(tmp_path / "p001.mat", simplify_cells=True)["point"]["current_source"]}
    reported |= {pyarrow.parquet.read_table(tmp_path / "p001.parquet").schema.metadata[b"current_source"].decode()}
    expected = "as specified; not measured"
    assert reported == {expected}
    with MDF(tmp_path / "p001.mf4") as data:
        assert f"current_source: {expected}</TX>" in data.header.comment


def test_octave_reads_the_matlab_file_bit_for_bit(folder: Path) -> None:
    octave = shutil.which("octave-cli")
    if octave is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("octave-cli is not installed")
    (file,) = export(folder, "mat", folder / "out")
    assert file.name == "p001.mat"
    script = (
        "x = load('out/p001.mat'); printf('%s %s %g %s\\n', x.point.id, x.point.waveform, x.point.amplitude_m, "
        "mat2str(size(x.force_N))); printf('%s\\n', num2hex([x.time_s; x.displacement_m; x.force_N])');"
    )
    ran = subprocess.run(
        [str(octave), "--norc", "--eval", script], cwd=folder, capture_output=True, text=True, timeout=60
    )
    assert ran.returncode == 0, ran.stderr
    head, bits = ran.stdout.split("\n", 1)
    assert head == "p001 sine 0.01 [50 1]"
    expected = [struct.pack(">d", value).hex() for values in (T, X, FORCE) for value in values]
    reported = "".join(bits.split())
    assert reported == "".join(expected)


def test_xarray_reads_the_netcdf_file_with_units_bit_for_bit(folder: Path) -> None:
    import xarray

    (file,) = export(folder, "netcdf", folder / "out")
    with xarray.open_dataset(file, engine="scipy", decode_times=False) as data:
        assert (data.attrs["id"], data.attrs["current_source"]) == ("p001", "measured")
        assert float(data.attrs["skew_std_s"]) == 1.0 / 3.0  # all digits of it
        for name, unit, expected in (("time_s", "s", T), ("displacement_m", "m", X), ("force_N", "N", FORCE)):
            assert data[name].attrs["units"] == unit
            assert np.array_equal(data[name].values, expected, equal_nan=True)
        assert "coil_temperature_degC" not in data


def test_pyarrow_and_pandas_read_the_parquet_file_with_units_bit_for_bit(folder: Path) -> None:
    import pandas as pd
    import pyarrow.parquet

    (file,) = export(folder, "parquet", folder / "out")
    table = pyarrow.parquet.read_table(file)
    assert file.name == "p001.parquet"
    assert table.schema.metadata[b"skew_std_s"] == b"0.3333333333333333"
    assert table.schema.metadata[b"waveform"] == b"sine"
    for name, unit, expected in (("time_s", b"s", T), ("displacement_m", b"m", X), ("force_N", b"N", FORCE)):
        assert table.schema.field(name).metadata[b"unit"] == unit
        assert np.array_equal(pd.read_parquet(file)[name].to_numpy(), expected, equal_nan=True)


def test_asammdf_reads_the_mf4_file_with_units_and_time_bit_for_bit(folder: Path) -> None:
    from asammdf import MDF

    (file,) = export(folder, "mf4", folder / "out")
    assert file.name == "p001.mf4"
    with MDF(file) as data:
        assert data.version == "4.10"
        assert "frequency_Hz: 1.114" in data.header.comment
        for name, unit, expected in (
            ("displacement_m", "m", X),
            ("velocity_m_s", "m/s", None),
            ("force_N", "N", FORCE),
        ):
            signal = data.get(name)
            assert signal.unit == unit
            assert np.array_equal(signal.timestamps, T)
            assert expected is None or np.array_equal(signal.samples, expected, equal_nan=True)


def test_rpc3_files_keep_the_uniform_time_base_and_the_gaps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rig.errors import FileProblem
    from rig.recording.external_tests import ImportSettings, read_tests

    (file,) = export(folder, "rpc", folder / "out")
    (test,) = read_tests([file], ImportSettings({"displacement": "displacement_m", "force": "force_N"}, 0.5))
    assert test.time_s == pytest.approx(T - T[0], abs=1e-12)
    assert test.displacement_m == pytest.approx(X, rel=1e-7, abs=0.0)
    assert np.array_equal(np.isnan(test.force_N), np.isnan(FORCE))
    assert b"RIG.CURRENT_A" in file.read_bytes()
    with pytest.raises(FileProblem, match="1 of 50 samples are missing, which 16-bit integers cannot represent"):
        export(folder, "rpc16", folder / "16")
    assert not (folder / "16").exists()
    uneven = RecordedPoint.from_arrays(
        time_s=T * (1.0 + T), displacement_m=X, force_N=FORCE, id="p1", waveform="sine", amplitude_m=0.01,
        frequency_Hz=1.114, current_A=0.5,
    )  # fmt: skip
    monkeypatch.setattr(Run, "open", lambda path: Run(path, (uneven,)))
    with pytest.raises(FileProblem, match="not on a uniform time grid"):
        export(folder, "rpc", folder / "out")
