"""A run as MATLAB, NetCDF, Parquet, MDF and RPC III files: one for each point, with the names and units of the CSV."""

from __future__ import annotations

import io
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from rig.errors import FileProblem
from rig.export.point_tables import described
from rig.extras import how_to_install
from rig.recording.atomic_write import write_durably
from rig.recording.file_formats.column_files import UDUNITS
from rig.recording.file_formats.rpc3_file import Rpc3Channel, encoded
from rig.recording.recorded_point import CHANNELS, RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray

UNITS = {
    "time_s": "s", "displacement_m": "m", "velocity_m_s": "m s-1", "force_N": "N", "current_measured_A": "A",
    "coil_temperature_degC": "degree_Celsius",
}  # fmt: skip
"""Of `CHANNELS`, in the words of udunits."""
PLAIN_UNITS = {name: UDUNITS.get(unit, unit) for name, unit in UNITS.items()}
"""The same as MDF and RPC III tools write them."""
GRID = 0.01
"""Of a sample period: how far a sample may be from a uniform time grid that stands for it."""


def write_mat(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.mat` (MATLAB 5) a point: column vectors with the names of `CHANNELS`, and the struct `point`.

    What a point has not recorded has no variable.
    """
    return _written(run, folder, "mat", _mat)


def write_netcdf(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.nc` (NetCDF 3 with 64-bit offsets) a point: float64 variables over `sample`, with `units`.

    What a point has not recorded has no variable; what describes the point are global attributes.
    """
    return _written(run, folder, "nc", _netcdf)


def write_parquet(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.parquet` a point: float64 columns, each with `unit`; the table's metadata describe the point.

    What a point has not recorded has no column.

    Raises:
        FileProblem: pyarrow is not installed.
    """
    return _written(run, folder, "parquet", _parquet)


def write_mf4(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.mf4` (MDF 4.10) a point: float64 channels with their units on the point's own time.

    What a point has not recorded has no channel; what describes the point stands in the header's comment. The start
    time is 1970: a point's time counts from its own start.

    Raises:
        FileProblem: asammdf is not installed.
    """
    return _written(run, folder, "mf4", _mf4)


def write_rpc(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.rsp` (RPC III) a point: float32 channels on a uniform time grid, missing samples as NaN.

    Raises:
        FileProblem: the samples of a point are not on a uniform grid.
    """
    return _written(run, folder, "rsp", lambda point: _rpc(point, integers=False))


def write_rpc16(run: Run, folder: Path) -> list[Path]:
    """Write one `ID.rsp` (RPC III) a point: 16-bit integers with a scale for each channel.

    Raises:
        FileProblem: the samples of a point are not on a uniform grid, or some are missing.
    """
    return _written(run, folder, "rsp", lambda point: _rpc(point, integers=True))


def _written(run: Run, folder: Path, ending: str, content: Callable[[RecordedPoint], bytes]) -> list[Path]:
    files = []
    for point in run.points:
        files.append(folder / f"{point.id}.{ending}")
        write_durably(files[-1], content(point))
    return files


def _recorded(point: RecordedPoint) -> dict[str, FloatArray]:
    channels = {name: point.channel(dataset) for name, dataset in CHANNELS.items()}
    return {name: values for name, values in channels.items() if np.isfinite(values).any()}


def _mat(point: RecordedPoint) -> bytes:
    from scipy.io import savemat

    content = io.BytesIO()
    channels = {**_recorded(point), "point": described(point)}
    savemat(content, channels, long_field_names=True, oned_as="column")  # type: ignore[arg-type]  # stub: paths only
    return content.getvalue()


def _netcdf(point: RecordedPoint) -> bytes:
    from scipy.io import netcdf_file

    content, channels = io.BytesIO(), _recorded(point)
    with netcdf_file(content, "w", version=2) as file:
        file.createDimension("sample", next(iter(channels.values())).size if channels else 0)
        for name, value in described(point).items():
            setattr(file, name, np.float64(value) if isinstance(value, int | float) else str(value))
        for name, values in channels.items():
            variable = file.createVariable(name, "f8", ("sample",))
            variable[:] = values
            variable.units = UNITS[name]  # type: ignore[attr-defined]  # attributes of the file are made so
        file.flush()
        return content.getvalue()


def _parquet(point: RecordedPoint) -> bytes:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise FileProblem("parquet", [f"pyarrow is not installed. Fix: {how_to_install('files')}"]) from error
    channels = _recorded(point)
    fields = [pyarrow.field(name, pyarrow.float64(), metadata={"unit": UNITS[name]}) for name in channels]
    metadata = {name: _text(value) for name, value in described(point).items()}
    table = pyarrow.table(list(channels.values()), schema=pyarrow.schema(fields, metadata=metadata))
    content = io.BytesIO()
    pyarrow.parquet.write_table(table, content)
    return content.getvalue()


def _mf4(point: RecordedPoint) -> bytes:
    try:
        from asammdf import MDF, Signal
    except ImportError as error:
        raise FileProblem("mf4", [f"asammdf is not installed. Fix: {how_to_install('files')}"]) from error
    channels, content = _recorded(point), io.BytesIO()
    time_s = channels.pop("time_s", np.zeros(0))
    with MDF(version="4.10") as file:
        file.append([
            Signal(values, time_s, unit=PLAIN_UNITS[name], name=name)
            for name, values in channels.items()
        ], comment=point.id, common_timebase=True)  # fmt: skip
        comment = "\n".join(f"{name}: {_text(value)}" for name, value in described(point).items())
        file.header.comment = f"<HDcomment><TX>{escape(comment)}</TX></HDcomment>"
        file.header.start_time = datetime(1970, 1, 1, tzinfo=UTC)
        file.save(content)
    return content.getvalue()


def _rpc(point: RecordedPoint, *, integers: bool) -> bytes:
    channels = _recorded(point)
    time_s = channels.pop("time_s", np.zeros(0))
    measured = np.flatnonzero(np.all([np.isfinite(values) for values in channels.values()], axis=0))
    if len(measured) < 2:
        raise FileProblem(f"point {point.id}", ["no sample contains values for all channels. Fix: use --to mf4"])
    rows = slice(int(measured[0]), int(measured[-1]) + 1)
    step_s, places = _grid(point.id, time_s[rows])
    on_grid = np.full((len(channels), int(places[-1]) + 1), np.nan)
    on_grid[:, places] = [values[rows] for values in channels.values()]
    try:
        return encoded(
            [Rpc3Channel(name, PLAIN_UNITS[name], values)
             for name, values in zip(channels, on_grid, strict=True)],
            step_s, {f"RIG.{name.upper()}": value for name, value in described(point).items()}, integers=integers,
        )  # fmt: skip
    except ValueError as error:
        count = int(np.count_nonzero(np.isnan(on_grid).any(axis=0)))
        raise FileProblem(f"point {point.id}", [
            f"{count} of {on_grid.shape[1]} samples are missing, which 16-bit integers cannot represent. Fix: use "
            "--to rpc, which writes them as NaN"
        ]) from error  # fmt: skip


def _grid(name: str, time_s: FloatArray) -> tuple[float, NDArray[np.int64]]:
    """The period (s) of the uniform grid that samples are on, and the place of each, (n,), from 0.

    Raises:
        FileProblem: they are on none.
    """
    step_s = float(np.median(np.diff(time_s)))
    places = np.round((time_s - time_s[0]) / step_s).astype(np.int64)
    if len({*places.tolist()}) == len(places) and places[-1] < 2 * len(places):
        step_s, start_s = np.polyfit(places, time_s, 1).tolist()
        off = float(np.max(np.abs(time_s - start_s - step_s * places))) / step_s
        if off <= GRID:
            return step_s, places
    raise FileProblem(f"point {name}", [
        f"its samples are not on a uniform time grid (within {100.0 * GRID:g} % of a period), as RPC III requires. "
        "Fix: use --to mf4"
    ])  # fmt: skip


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)
