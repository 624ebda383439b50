"""The files of a model as source code: what people need to know, the functions, and how to call them."""

from __future__ import annotations

import json
import math
from pathlib import Path

from rig.export.code.c_source import c_functions
from rig.export.code.functions import Library, NotTranslatable
from rig.export.code.modelica_source import PROVED, modelica_functions
from rig.export.code.octave_source import octave_functions
from rig.export.code.program import Program, program_of
from rig.export.code.python_source import python_functions
from rig.export.code.ranges import ABOUT, c_beyond, modelica_beyond, octave_beyond, python_beyond
from rig.export.fitted_model import FittedModel
from rig.recording.atomic_write import write_text_durably

ARGUMENTS = "double u, double v, double a, double current"


def _program(fitted: FittedModel) -> tuple[Program, Library]:
    program = program_of(fitted.model, fitted.vector)
    return program, Library([program.start, program.step], program.states)


def source_name(fitted: FittedModel) -> str:
    """How the model's files and functions are called."""
    return f"damper_{fitted.name}"


def _numbers(fitted: FittedModel) -> str:
    return ", ".join(repr(float(value)) for value in fitted.vector)


def write_c(fitted: FittedModel, folder: Path) -> list[Path]:
    """Write the model as C99: a header and a source file that need `math.h` alone.

    Raises:
        NotTranslatable: the model's kernel cannot be translated.
    """
    program, library = _program(fitted)
    name = source_name(fitted)
    reported = "\n".join(f" * {line}".rstrip().replace("*/", "* /") for line in fitted.described())
    header, source = folder / f"{name}.h", folder / f"{name}.c"
    guard = f"{name.upper()}_H"
    write_text_durably(header, f"""/*
{reported}
 *
 * {name}_start returns the force at the first sample; {name}_step returns the force at each subsequent sample,
 * dt > 0 (s) later. Both write d, the state of the damper: use one array per damper.
 * {name}_beyond states whether a force is an extrapolation. {ABOUT}.
 * A temperature (degC; NaN if unknown) outside its range adds 8; the force does not depend on the temperature.
 */
#ifndef {guard}
#define {guard}

#ifdef __cplusplus
extern "C" {{
#endif

#define {name.upper()}_MEMORY {program.length}

double {name}_start(double d[{name.upper()}_MEMORY], {ARGUMENTS});
double {name}_step(double d[{name.upper()}_MEMORY], {ARGUMENTS}, double dt);
int {name}_beyond(double u, double v, double current, double temperature);

#ifdef __cplusplus
}}
#endif

#endif
""")
    write_text_durably(source, f"""/* Functions of {name}.h; link with -lm. */
#include <math.h>
#include "{header.name}"

/* {", ".join(fitted.model.names)} */
static const double parameters[] = {{{_numbers(fitted)}}};

{c_functions(library)}
double {name}_start(double d[{name.upper()}_MEMORY], {ARGUMENTS}) {{
    return mr_start(parameters, d, u, v, a, current);
}}

double {name}_step(double d[{name.upper()}_MEMORY], {ARGUMENTS}, double dt) {{
    return mr_step(parameters, d, u, v, a, current, dt);
}}

int {name}_beyond(double u, double v, double current, double temperature) {{
{c_beyond(fitted.covered)}}}
""")
    return [header, source]


def write_octave(fitted: FittedModel, folder: Path) -> list[Path]:
    """Write the model as one function file for Octave and MATLAB.

    Raises:
        NotTranslatable: the model's kernel cannot be translated.
    """
    program, library = _program(fitted)
    name = source_name(fitted)
    header = "\n".join(f"% {line}".rstrip() for line in fitted.described())
    path = folder / f"{name}.m"
    write_text_durably(path, f"""function [F, d, beyond] = {name}(u, v, a, current, dt, d)
{header}
%
% [F, d] = {name}(u, v, a, current, dt): force (N) at each sample of a motion with sampling interval dt (s).
% [F, d] = {name}(u, v, a, current, dt, d): continues from the state d that an earlier call returned.
% u, v, a: vectors of equal length; current: a vector or a scalar.
% beyond, the third output, states where F is an extrapolation. {ABOUT}.
    p = [{_numbers(fitted)}]; % {", ".join(fitted.model.names)}
    F = zeros(size(u));
    if isscalar(current)
        current = current * ones(size(u));
    end
    v = reshape(v, size(u));
    current = reshape(current, size(u));
    beyond = {octave_beyond(fitted.covered)};
    first = 1;
    if nargin < 6
        [d, F(1)] = mr_start(p, zeros(1, {program.length}), u(1), v(1), a(1), current(1));
        first = 2;
    end
    for k = first:numel(u)
        [d, F(k)] = mr_step(p, d, u(k), v(k), a(k), current(k), dt);
    end
end

{octave_functions(library)}""")
    return [path]


def write_python(fitted: FittedModel, folder: Path) -> list[Path]:
    """Write the model as one Python module that needs `math` alone, with the fit's numbers as data.

    Raises:
        NotTranslatable: the model's kernel cannot be translated.
    """
    program, library = _program(fitted)
    names, matrix = fitted.fit.known_covariance()
    header = "\n".join(line.replace("\\", "/").replace('"""', "'''") for line in fitted.described())
    covariance = {
        a: {b: None if math.isnan(value) else value for b, value in zip(names, row, strict=True)}
        for a, row in zip(names, matrix.tolist(), strict=True)
    }
    units = {parameter.name: parameter.unit for parameter in fitted.model.parameters}
    path = folder / f"{source_name(fitted)}.py"
    write_text_durably(path, f'''"""{header}
"""

import math  # noqa: F401 - most models need it

FIT_SHA256 = {fitted.sha256!r}
MODEL = {fitted.model.name!r}
PARAMETERS = {json.dumps(dict(fitted.values), indent=4)}
UNITS = {json.dumps(units, indent=4)}
COVARIANCE = {covariance!r}
TESTED = {fitted.tested!r}
_P = [{_numbers(fitted)}]


{python_functions(library)}

def memory():
    """Initial state of a damper, for `start` and `step`."""
    return [0.0] * {program.length}


def start(d, u, v, a, current):
    """Force (N) at the first sample."""
    return mr_start(_P, d, u, v, a, current)


def step(d, u, v, a, current, dt):
    """Force (N) at the next sample, dt > 0 (s) later."""
    return mr_step(_P, d, u, v, a, current, dt)


def beyond(u, v, current, temperature=None):
    """Names of the quantities outside their range in `TESTED` (the force is then an extrapolation); "" if none.

    The temperature (degC) is only compared with its range; the force does not depend on the temperature.
    """
{python_beyond(fitted.covered)}

def force(u, v, a, current, dt):
    """Force (N) at each sample, as a list; u, v, a and current are sequences with sampling interval dt (s)."""
    d = memory()
    samples = list(zip(u, v, a, current))
    return [start(d, *samples[0])] + [step(d, *sample, dt) for sample in samples[1:]]
''')
    return [path]


def write_modelica(fitted: FittedModel, folder: Path) -> list[Path]:
    """Write the model as a Modelica block that needs no library; its internal states are the tool's to integrate.

    Raises:
        NotTranslatable: no tool has proved its internal states, or it has a table in it, or its kernel cannot be
            translated.
    """
    model, kernel = fitted.model, fitted.model.kernel()
    if kernel.whole is not None:
        raise NotTranslatable(
            f"{model.name} has a residual, whose Modelica code could not be verified with a Modelica tool, so this "
            "export is not available. Fix: use --to fmi; Modelica tools can import the FMU"
        )
    library = Library([kernel.rates, kernel.force] if model.states else [kernel.force])
    hidden = bool(model.states) and model.name.partition("+")[0] not in PROVED
    unproved = "internal states" if hidden else "a table in its equation" if library.arrays else ""
    if unproved:
        raise NotTranslatable(
            f"{model.name} has {unproved}: its Modelica code could not be verified with a Modelica tool, so this "
            "export is not available. Fix: use --to fmi; Modelica tools can import the FMU"
        )
    called = library.functions[-1].name
    name = source_name(fitted)
    states = [f"s{k}" for k in range(model.states)]
    given = ", ".join(("p", *states, *["0.0"] * (2 - len(states)), "u, v"))
    declared = "".join(f'  Real {state} "internal state";\n' for state in states)
    begun, moving = "", ""
    if states:
        rates = Library([kernel.rates]).functions[-1].name
        begins = zip(states, model.initial_state(1.0).tolist(), strict=True)
        begun = "initial equation\n" + "".join(
            f"  {state} = {f'{moves!r}*u' if moves else '0.0'};\n" for state, moves in begins
        )
        moving = f"  rates = {rates}({given}, current);\n"
        moving += "".join(f"  der({state}) = rates[{k}];\n" for k, state in enumerate(states, start=1))
        declared += "  Real rates[2];\n"
    header = "\n".join(f"// {line}".rstrip() for line in fitted.described())
    path = folder / f"{name}.mo"
    write_text_durably(path, f"""{header}
block {name} "MR damper, force of motion and coil current"
  input Real u(unit = "m") "extension about mid-stroke";
  input Real v(unit = "m/s") "velocity, positive in rebound";
  input Real a(unit = "m/s2") "acceleration";
  input Real current(unit = "A") "actual coil current";
  output Real force(unit = "N") "positive where it resists extension";
  output Real beyond "{ABOUT}";
  constant Real p[{len(fitted.vector)}] = {{{_numbers(fitted)}}}; // {", ".join(model.names)}
{declared}
{modelica_functions(library)}

{begun}equation
{moving}  force = {called}({given}, a, current);
  beyond = {modelica_beyond(fitted.covered)};
end {name};
""")
    return [path]
