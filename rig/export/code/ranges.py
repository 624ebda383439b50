"""Whether a sample lies within what was tested, as conditions in the languages of the exports.

The numbers are those by which `Fit.predict` flags a row. `beyond` is 0 within, else the sum of `BITS`; `UNKNOWN` where
the fit does not say what its tests covered.
"""

from __future__ import annotations

from rig.dampers.covered import QUANTITIES, Covered

BITS = dict(zip(QUANTITIES, (1, 2, 4, 8), strict=True))
UNKNOWN = 16
VARIABLES = dict(zip(QUANTITIES, ("u", "v", "current", "temperature"), strict=True))
ABOUT = (
    "0: inside the tested range; otherwise the sum of 1 (u), 2 (v) and 4 (current) for the quantities outside their "
    "range; 16: range unknown"
)


def within(covered: Covered, name: str, both: str, either: str) -> str:
    """The condition that a quantity lies within, with a language's words for `and` and `or`; empty where not known."""
    variable = VARIABLES[name]
    return either.join(
        f"({variable} >= {low!r}{both}{variable} <= {high!r})" for low, high in covered.intervals().get(name, ())
    )


def c_beyond(covered: Covered | None) -> str:
    """The body of a C function of u, v, current and temperature (not a number where it is not known)."""
    if covered is None:
        return f"    (void)u, (void)v, (void)current, (void)temperature;\n    return {UNKNOWN};\n"
    lines = ["    int beyond = 0;"]
    for name, bit in BITS.items():
        inside = within(covered, name, " && ", " || ")
        if name == "temperature_degC":
            inside = " || ".join(filter(None, ("temperature != temperature", inside)))
        lines.append(f"    beyond += ({inside}) ? 0 : {bit};")
    return "\n".join([*lines, "    return beyond;", ""])


def python_beyond(covered: Covered | None) -> str:
    """The body of a Python function of u, v, current and temperature, which names the quantities."""
    if covered is None:
        return '    return "range not known"\n'
    lines = ["    names = []"]
    for name in BITS:
        inside = within(covered, name, " and ", " or ")
        if name == "temperature_degC":
            inside = " or ".join(filter(None, ("temperature is None", inside)))
        lines += [f"    if not ({inside}):", f'        names.append("{name}")']
    return "\n".join([*lines, '    return " ".join(names)', ""])


def octave_beyond(covered: Covered | None) -> str:
    """An expression of vectors u, v and current in Octave."""
    if covered is None:
        return f"{UNKNOWN} * ones(size(u))"
    return " + ".join(f"{BITS[name]} * ~({within(covered, name, ' & ', ' | ')})" for name in QUANTITIES[:3])


def modelica_beyond(covered: Covered | None) -> str:
    """An expression of u, v and current in Modelica, which makes no events."""
    if covered is None:
        return f"{UNKNOWN}.0"
    terms = (
        f"(if {within(covered, name, ' and ', ' or ')} then 0.0 else {BITS[name]}.0)" for name in QUANTITIES[:3]
    )
    return f"noEvent({' + '.join(terms)})"
