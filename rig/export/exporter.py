"""What an exporter is, the exporters by name, and the one call that runs any of them."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from protocols.near_miss import near_names
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem, RigError
from rig.export.fitted_model import FittedModel
from rig.export.force_table import write_table
from rig.export.inverse_table import write_inverse
from rig.export.point_arrays import write_mat, write_mf4, write_netcdf, write_parquet, write_rpc, write_rpc16
from rig.export.point_tables import write_points
from rig.export.report_figures import write_figures
from rig.export.values import write_values
from rig.fits.fit_record import FitRecord
from rig.identification.uncertainty.fit import Fit
from rig.plugins import EXPORTS, Catalogue
from rig.recording.run import Run


@dataclass(frozen=True)
class Source:
    """What is exported: a campaign's directory or a fit's file, or a run or a fit in memory.

    Attributes:
        path: as the user names it; of a fit that was not saved, the name that it would have.
        given: the run or the fit, where it is in memory; None: it is read from the path.
    """

    path: Path
    given: Run | FitRecord | None = None

    @classmethod
    def of(cls, source: Path | str | Run | FitRecord) -> Source:
        """A path, a run or a fit as a source.

        Raises:
            FileProblem: it is none of these.
        """
        if isinstance(source, FitRecord):
            return cls(source.path or Path(CampaignFolder.fit), source)
        if isinstance(source, Run):
            return cls(source.path, source)
        if isinstance(source, str | os.PathLike):
            return cls(Path(source))
        raise FileProblem("export", [
            f"got {type(source).__name__}, expected a run or a fit (the object, or the path of its folder or file)"
        ])  # fmt: skip

    @cached_property
    def run(self) -> Run:
        """The campaign.

        Raises:
            FileProblem: it is none.
        """
        if isinstance(self.given, Run):
            return self.given
        if isinstance(self.given, FitRecord) or self.path.suffix == ".json":
            raise FileProblem(
                str(self.path),
                ["got a fit, expected a run: this format exports recordings. Fix: specify a campaign folder"],
            )
        return Run.open(self.path)

    @cached_property
    def fit_record(self) -> FitRecord:
        """The fit: that file, or `fit.json` of the campaign.

        Raises:
            FileProblem: there is none, or it is no fit; everything that is wrong with it.
        """
        if isinstance(self.given, FitRecord):
            return replace(self.given, sha256=self.given.sha256 or hashlib.sha256(self.given.text.encode()).hexdigest())
        file = self.fit_file
        if not file.is_file():
            raise FileProblem(str(file), ["no fit found. Fix: create a fit with `rig identify`"])
        return FitRecord.load(file)

    @property
    def fit(self) -> Mapping[str, Any]:
        """The object of `fit.json`, for exporters of plug-ins.

        Raises:
            FileProblem: as `fit_record`.
        """
        return self.fit_record.to_json()

    @cached_property
    def usable_fit(self) -> Fit:
        """The fit with the functions that use it.

        Raises:
            FileProblem: as `fit_record`.
        """
        return self.given if isinstance(self.given, Fit) else Fit.load(self.path)

    @property
    def fit_file(self) -> Path:
        """The fit's file, there or not."""
        return CampaignFolder(self.path).fit if self.path.is_dir() else self.path

    @cached_property
    def fitted(self) -> FittedModel:
        """The fit with its model.

        Raises:
            FileProblem: there is none, or it lacks values.
            RigError: there is no such model.
        """
        return FittedModel.of(self.fit_record)

    @property
    def name(self) -> str:
        """A name for files: that of the campaign's directory; `fit` or `tests` of what is only in memory."""
        if isinstance(self.given, FitRecord) and self.given.path is None:
            return "fit"
        if isinstance(self.given, Run) and self.given.path == Run.NOWHERE:
            return "tests"
        return (self.path if self.path.is_dir() else self.path.resolve().parent).resolve().name


@dataclass(frozen=True)
class Exporter:
    """One format.

    Attributes:
        name: as `--to` has it.
        takes: what it is made of; a "fit" is also found in its campaign's directory.
        line: one line for people.
        write: writes into an existing folder, from the source; the files it made.
        remark: what the files are and how to use them, for people, where the name does not tell; empty otherwise.
    """

    name: str
    takes: Literal["run", "fit"]
    line: str
    write: Callable[[Source, Path], list[Path]]
    remark: str = ""


def exporter_of_plug_in(name: str, brought: object) -> Exporter:
    """A plug-in's exporter.

    Raises:
        ValueError: it is something else.
    """
    if not isinstance(brought, Exporter):
        raise ValueError(f"expected a rig.export.Exporter, got {type(brought).__name__}")
    if brought.name != name:
        raise ValueError(f"got an exporter named {brought.name!r}, expected the name of its entry point")
    return brought


def _write_c(source: Source, out: Path) -> list[Path]:
    from rig.export.model_files import write_c  # loads numba, as the next four do

    return write_c(source.fitted, out)


def _write_fmu(source: Source, out: Path) -> list[Path]:
    from rig.export.fmu import write_fmu  # loads numba

    return write_fmu(source.fitted, out)


def _write_modelica(source: Source, out: Path) -> list[Path]:
    from rig.export.model_files import write_modelica  # loads numba

    return write_modelica(source.fitted, out)


def _write_octave(source: Source, out: Path) -> list[Path]:
    from rig.export.model_files import write_octave  # loads numba

    return write_octave(source.fitted, out)


def _write_python(source: Source, out: Path) -> list[Path]:
    from rig.export.model_files import write_python  # loads numba

    return write_python(source.fitted, out)


def _write_table(source: Source, out: Path) -> list[Path]:
    return write_table(source.fitted, out, str(source.fit_file))


OWN = (
    Exporter("csv", "run", "one CSV file per point, and one CSV file with all points", lambda source, out: write_points(
        source.run, out)),
    Exporter("mat", "run", "one MATLAB file per point", lambda source, out: write_mat(source.run, out)),
    Exporter("netcdf", "run", "one NetCDF file per point", lambda source, out: write_netcdf(source.run, out)),
    Exporter("parquet", "run", "one Parquet file per point", lambda source, out: write_parquet(source.run, out)),
    Exporter("mf4", "run", "one ASAM MDF 4 file per point", lambda source, out: write_mf4(source.run, out)),
    Exporter("rpc", "run", "one RPC III file per point (.rsp, 32-bit floats)", lambda source, out: write_rpc(
        source.run, out)),
    Exporter("rpc16", "run", "one RPC III file per point (.rsp, 16-bit integers)", lambda source, out: write_rpc16(
        source.run, out)),
    Exporter("svg", "run", "one SVG file per figure of the report", lambda source, out: write_figures(
        source.run, out, ".svg")),
    Exporter("png", "run", "one PNG file per figure of the report", lambda source, out: write_figures(
        source.run, out, ".png")),
    Exporter("json", "fit", "only the parameters, with units and intervals", lambda
             source, out: [write_values(source.fit_record, out / f"{source.name}-parameters.json")]),
    Exporter("c", "fit", "the model as C99 source, verified against this software's model", _write_c),
    Exporter("fmi", "fit", "the model as an FMU 2.0 for co-simulation, with sources", _write_fmu),
    Exporter("modelica", "fit", "the model as a Modelica block (most models)", _write_modelica),
    Exporter("matlab", "fit", "the same file as octave: a function for MATLAB and Octave", _write_octave, (
        "A function file for MATLAB and Octave, the same as --to octave (tested in Octave). In MATLAB, add its folder "
        "to the path and call [F, d, beyond] = damper_MODEL(u, v, a, current, dt)")),
    Exporter("octave", "fit", "the model as a function for Octave and MATLAB", _write_octave),
    Exporter("simulink", "fit", "the same file as fmi: an FMU 2.0 for the FMU block of Simulink", _write_fmu, (
        "An FMU 2.0 for co-simulation, the same as --to fmi; it is not a .slx model. In Simulink, add the block `FMU`, "
        "select this file, and connect u (m), v (m/s), a (m/s^2) and current (A)")),
    Exporter("python", "fit", "the model as a self-contained Python module", _write_python),
    Exporter("table", "fit", "force as a function of speed and current (CSV), within the tested range", _write_table),
    Exporter("inverse", "fit", "current as a function of speed and force (CSV)", lambda
             source, out: [write_inverse(source.usable_fit, out / f"{source.name}-inverse.csv")]),
)  # fmt: skip
"""This program's formats. A new one is a line here."""

EXPORTERS: Mapping[str, Exporter] = Catalogue({one.name: one for one in OWN}, EXPORTS, exporter_of_plug_in)
"""Every format by name; plug-ins (entry points `mr_rig.exports`) behind our own."""


def export(path: Path | str | Run | FitRecord, to: str, out: Path | str) -> list[Path]:
    """Write a run or a fit in another format.

    Args:
        path: a campaign's directory, the file of a fit, or a run or a fit in memory.
        to: key of `EXPORTERS`.
        out: folder for the files; made where it is not there.

    Returns:
        The files that were written.

    Raises:
        RigError: no such format; the known ones are listed. Where an export is refused, a folder that it made is gone.
        FileProblem: there is no such run or fit, or the folder cannot be made.
        PlugInProblem: the format is a plug-in's, and that cannot be used or failed.
    """
    if to not in EXPORTERS:
        near = near_names(str(to), EXPORTERS)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise RigError(f"export: got {to!r}, expected one of {', '.join(EXPORTERS)}{hint}")
    exporter, source, folder = EXPORTERS[to], Source.of(path), Path(out)
    _ = source.run if exporter.takes == "run" else source.fit_record
    made = [level for level in (folder, *folder.parents) if not level.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return exporter.write(source, folder)
    except BaseException:
        _take_back(made)
        raise


def _take_back(made: Sequence[Path]) -> None:
    """Remove folders that a refused export made, deepest first: the files in the first, the others where empty."""
    if made:
        shutil.rmtree(made[0], ignore_errors=True)
    for level in made[1:]:
        with suppress(OSError):
            level.rmdir()
