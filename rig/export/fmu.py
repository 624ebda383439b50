"""A fitted model as a functional mock-up unit: FMI 2.0 for co-simulation, with sources and libraries."""

from __future__ import annotations

import io
import platform
import shutil
import subprocess
import tempfile
import warnings
import zipfile
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from xml.sax.saxutils import quoteattr

import rig
from rig.errors import DataWarning, FileProblem
from rig.export.code.ranges import ABOUT
from rig.export.fitted_model import FittedModel
from rig.export.model_files import source_name, write_c
from rig.recording.atomic_write import write_durably

INPUTS = {
    "u": ("m", "Extension about mid-stroke"), "v": ("m/s", "Velocity, positive in rebound"),
    "a": ("m/s2", "Acceleration"), "current": ("A", "Actual coil current"),
}  # fmt: skip
UNITS = """  <UnitDefinitions>
    <Unit name="m"><BaseUnit m="1"/></Unit>
    <Unit name="m/s"><BaseUnit m="1" s="-1"/></Unit>
    <Unit name="m/s2"><BaseUnit m="1" s="-2"/></Unit>
    <Unit name="A"><BaseUnit A="1"/></Unit>
    <Unit name="N"><BaseUnit kg="1" m="1" s="-2"/></Unit>
  </UnitDefinitions>"""
RANGES = {"u": "displacement_m", "v": "velocity_m_s", "current": "current_A"}
NATIVE = {("Linux", "x86_64"): "linux64"}
"""Names of FMI 2.0; on another machine the unit has no library for it."""
COMPILERS = ("cc", "gcc", "clang")
CROSS_COMPILERS = ("x86_64-w64-mingw32-gcc", "x86_64-w64-mingw32-gcc-win32", "x86_64-w64-mingw32-gcc-posix")
"""Of Windows programs."""
INSTALL_CROSS = "apt install gcc-mingw-w64-x86-64"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-shared")
LINUX_FLAGS = ("-fPIC", "-fvisibility=hidden")
WINDOWS_FLAGS = ("-static-libgcc", "-Wl,--no-insert-timestamp", "-s")
STEP_S = 1e-3
FIXED = (1980, 1, 1, 0, 0, 0)
"""Time of the files in the archive: the same fit makes the same unit."""


def write_fmu(fitted: FittedModel, folder: Path) -> list[Path]:
    """Write the model as `damper_MODEL.fmu`: inputs u, v, a, current, output force, the fit's values as constants.

    Raises:
        NotTranslatable: the model's kernel cannot be translated.
        FileProblem: there is no C compiler, or it refuses the sources.
    """
    name = source_name(fitted)
    with tempfile.TemporaryDirectory(prefix="fmu-") as held:
        place = Path(held)
        header, source = write_c(fitted, place)
        (place / "fmu.c").write_bytes(files("rig.export.code").joinpath("fmu.c").read_bytes())
        (place / "model.h").write_text(_model_header(fitted, header.name), encoding="utf-8")
        content = {f"sources/{file.name}": file.read_bytes() for file in sorted(place.iterdir())}
        content["modelDescription.xml"] = _description(fitted, source.name).encode()
        content |= _libraries(place, source.name, name)
    content["documentation/index.html"] = _page(fitted).encode()
    path = folder / f"{name}.fmu"
    write_durably(path, _archive(content))
    return [path]


def _model_header(fitted: FittedModel, header: str) -> str:
    name = source_name(fitted)
    numbers = ", ".join(repr(float(value)) for value in fitted.vector)
    return f"""#include "{header}"
#define GUID "{_guid(fitted)}"
#define MEMORY {name.upper()}_MEMORY
#define model_start {name}_start
#define model_step {name}_step
#define model_beyond {name}_beyond
static const double constants[] = {{{numbers}}};
"""


def _guid(fitted: FittedModel) -> str:
    return f"{{{fitted.sha256[:32]}}}"


def _description(fitted: FittedModel, source: str) -> str:
    name = source_name(fitted)
    variables = [
        _variable(place, variable, f"{meaning}{_range(fitted, variable)}",
                  'causality="input" variability="continuous"', f'start="0" unit="{unit}"')
        for place, (variable, (unit, meaning)) in enumerate(INPUTS.items())
    ]  # fmt: skip
    output = 'causality="output" variability="continuous"'
    variables.append(_variable(4, "force", "Force, positive where it resists extension (N)", output, 'unit="N"'))
    for place, parameter in enumerate(fitted.model.parameters, start=5):
        text, kind = f"{parameter.meaning} ({parameter.unit})", 'causality="local" variability="constant"'
        start = f'start="{float(fitted.values[parameter.name])!r}"'
        variables.append(_variable(place, f"p.{parameter.name}", text, kind, start))
    last = len(variables)
    variables.append(_variable(last, "beyond", ABOUT, output, ""))
    listed = "\n".join(variables)
    unknowns = '<Unknown index="5" dependencies="1 2 3 4"/>'
    unknowns += f'<Unknown index="{last + 1}" dependencies="1 2 4"/>'
    about = f"MR damper, model {fitted.model.name}: {fitted.model.equation}; fit {fitted.sha256}"
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{_guid(fitted)}" description={quoteattr(about)}
    generationTool="mr-damper-rig {rig.__version__}" variableNamingConvention="structured" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
      canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true">
    <SourceFiles><File name="fmu.c"/><File name="{source}"/></SourceFiles>
  </CoSimulation>
{UNITS}
  <DefaultExperiment startTime="0" stepSize="{STEP_S}"/>
  <ModelVariables>
{listed}
  </ModelVariables>
  <ModelStructure>
    <Outputs>{unknowns}</Outputs>
    <InitialUnknowns>{unknowns}</InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _variable(place: int, name: str, about: str, kind: str, attributes: str) -> str:
    text = f'name={quoteattr(name)} valueReference="{place}" description={quoteattr(about)} {kind}'
    return f"    <ScalarVariable {text}><Real {attributes}/></ScalarVariable>"


def _range(fitted: FittedModel, variable: str) -> str:
    """Where it was tested, as words: bounds would make importers stop where the force is only an extrapolation."""
    ends = fitted.tested.get(RANGES.get(variable, ""))
    return "" if ends is None else f"; tested from {ends[0]:g} to {ends[1]:g}"


def _libraries(place: Path, source: str, name: str) -> dict[str, bytes]:
    """The libraries for this platform and for Windows, by their paths in the unit.

    A platform without a compiler is left out with a `DataWarning`.

    Raises:
        FileProblem: there is no compiler at all, or one refuses the sources.
    """
    own = NATIVE.get((platform.system(), platform.machine()))
    compiler, cross = _found(COMPILERS), _found(CROSS_COMPILERS)
    if compiler is None and cross is None:
        raise FileProblem("fmi", [f"no C compiler found ({', '.join(COMPILERS)}). Fix: apt install gcc libc6-dev"])
    libraries = {}
    if own is not None and compiler is not None:
        command = [compiler, *FLAGS, *LINUX_FLAGS, "fmu.c", source, "-lm"]
        libraries[f"binaries/{own}/{name}.so"] = _compiled(place, command, "model.so")
    if cross is not None:
        command = [cross, *FLAGS, *WINDOWS_FLAGS, "fmu.c", source, "-lm"]
        libraries[f"binaries/win64/{name}.dll"] = _compiled(place, command, "model.dll")
    else:
        held = ", ".join(path.split("/")[1] for path in libraries) or "the sources"
        warnings.warn(
            f"fmi: the FMU contains only {held}; a library for Windows (win64) requires a cross compiler. Fix: "
            f"{INSTALL_CROSS}, then export again", DataWarning, stacklevel=2,
        )  # fmt: skip
    return libraries


def _found(names: Sequence[str]) -> str | None:
    return next((path for name in names if (path := shutil.which(name)) is not None), None)


def _compiled(place: Path, command: Sequence[str], library: str) -> bytes:
    """The shared library of the sources.

    Raises:
        FileProblem: the compiler refuses them.
    """
    done = subprocess.run([*command, "-o", library], cwd=place, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise FileProblem("fmi", [f"{command[0]} failed: {done.stderr.strip()[:400]}"])
    return (place / library).read_bytes()


def _page(fitted: FittedModel) -> str:
    text = "\n".join(fitted.described()).replace("&", "&amp;").replace("<", "&lt;")
    return f'<!doctype html><meta charset="utf-8"><title>{source_name(fitted)}</title>\n<pre>\n{text}\n</pre>\n'


def _archive(content: dict[str, bytes]) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in sorted(content.items()):
            archive.writestr(zipfile.ZipInfo(name, FIXED), data, zipfile.ZIP_DEFLATED)
    return held.getvalue()
