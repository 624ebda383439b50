"""A run as MATLAB files and as NetCDF: one file a point, a variable a channel, names and units as in the CSV."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rig.export.point_tables import LISTED
from rig.recording.atomic_write import write_durably
from rig.recording.recorded_point import CHANNELS, RecordedPoint
from rig.recording.run import Run
from rig.signals.arrays import FloatArray

UNITS = {
    "time_s": "s", "displacement_m": "m", "velocity_m_s": "m s-1", "force_N": "N", "current_measured_A": "A",
    "coil_temperature_degC": "degree_Celsius",
}  # fmt: skip
"""Of `CHANNELS`, in the words of udunits."""


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
    described = {name: getattr(point, name) for name in LISTED}
    channels = {**_recorded(point), "point": described}
    savemat(content, channels, long_field_names=True, oned_as="column")  # type: ignore[arg-type]  # stub: paths only
    return content.getvalue()


def _netcdf(point: RecordedPoint) -> bytes:
    from scipy.io import netcdf_file

    content, channels = io.BytesIO(), _recorded(point)
    with netcdf_file(content, "w", version=2) as file:
        file.createDimension("sample", next(iter(channels.values())).size if channels else 0)
        for name in LISTED:
            value = getattr(point, name)
            setattr(file, name, np.float64(value) if isinstance(value, int | float) else str(value))
        for name, values in channels.items():
            variable = file.createVariable(name, "f8", ("sample",))
            variable[:] = values
            variable.units = UNITS[name]  # type: ignore[attr-defined]  # attributes of the file are made so
        file.flush()
        return content.getvalue()
