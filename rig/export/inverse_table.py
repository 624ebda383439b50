"""The inverse of a fit as a CSV table: the current over speed and force, for controllers that look it up."""

from __future__ import annotations

from pathlib import Path

from rig.identification.uncertainty.fit import Fit
from rig.recording.atomic_write import write_text_durably


def write_inverse(known: Fit, path: Path) -> Path:
    """Write `Fit.inverse_table` with the equation and the tested range as lines that begin with `#`.

    Args:
        known: the fit.
        path: where to.

    Raises:
        IdentificationFailed: the tests ran at one current, or the fit does not say at which.
    """
    table = known.inverse_table()
    tested = "" if known.tested is None else known.tested.describe()
    warmth = known.temperature
    lines = (
        f"# {known.model}: {known.equation}",
        f"# tested: {tested}",
        *([f"# {beyond}"] if (beyond := str(table.attrs["extrapolation"])) else []),
        *([f"# at {warmth.reference_degC:.4g} degC; for other temperatures, see the equation"] if warmth else []),
        "# steady sliding at mid-stroke; SI units; low_A and high_A: 95 % band of current_A",
    )
    content = (
        "\n".join(" ".join(line.split()) for line in lines) + "\n" + table.to_csv(index=False, float_format="%.9g")
    )
    write_text_durably(path, content)
    return path
