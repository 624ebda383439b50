"""Check before a campaign starts: does the matrix measure every value that its acceptance bands limit?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from rig.comparison.bands import Bands, LoopBand, ParameterBand, load_bands
from rig.comparison.readings import LoopReading, planned_loop
from rig.dampers import MODELS
from rig.dampers.current_law import AFFINE
from rig.errors import FileProblem, some
from rig.matrix.model import Matrix
from rig.signals.test_set import same_motion
from rig.test_point import FRICTION, LOOP

SEVERAL = ("all", "auto", "few", "grey")
"""Models of `[identify]` that stand for several."""
MOST_NAMED = 4


def check_acceptance(matrix_path: Path, matrix: Matrix, *, fitted: bool = True) -> None:
    """Refuse acceptance bands that this matrix can never meet because it does not measure what they limit.

    Args:
        matrix_path: the matrix file, for the message.
        matrix: its content; without `[acceptance]` nothing is checked.
        fitted: whether the model of `[identify]` will be fitted.

    Raises:
        FileProblem: the bands file has wrong entries, or bands limit what is not measured; one line for each.
    """
    if matrix.acceptance is None:
        return
    file = Path(matrix.acceptance.bands)
    bands = load_bands(file)
    if problems := list(_unmeasured(bands, matrix, fitted=fitted and matrix.wants_fit)):
        raise FileProblem(str(file), [f"{problem} ({matrix_path.name})" for problem in problems], "config-absurd")


def _unmeasured(bands: Bands, matrix: Matrix, *, fitted: bool) -> Iterator[str]:
    """What is wrong with each band that limits a value which the matrix does not measure."""
    points = matrix.points()
    loops = [planned_loop(point) for point in points if point.kind == LOOP]
    numbers: dict[str, int] = {}
    for key, band in bands.all:
        numbers[key] = numbers.get(key, 0) + 1
        place = f"{key}[{numbers[key]}]" + (f" ({band.where})" if band.where else "")
        if band.most_change is not None:
            yield (
                f"{place}: most_change limits the change relative to another run, which a campaign does not have. Fix: "
                "specify low and high, or compare the finished runs with `rig compare BEFORE AFTER --bands FILE`"
            )
        if isinstance(band, ParameterBand):
            text = _parameter(band, matrix, fitted=fitted)
        elif isinstance(band, LoopBand):
            text = _loops(key, band, loops)
        else:
            measured = any(point.kind == FRICTION for point in points)
            text = "" if measured else "the matrix has no slow triangle test. Fix: add a [friction] table to the matrix"
        if text:
            yield f"{place}: {text}"


def _loops(key: str, band: LoopBand, loops: Sequence[LoopReading]) -> str:
    chosen = [loop for loop in loops if band.holds(loop)]
    if not chosen:
        return (
            "no point of the matrix matches this band. Fix: correct waveform, amplitude, frequency, current, speed or "
            "point of the band, or add the point to the matrix"
        )
    if key != "dynamic_range":
        return ""
    active = [loop for loop in chosen if loop.motion.current_A != 0.0]
    if not active and band.current_A is None:
        return "the matrix measures these motions only at 0 A. Fix: add the same motions with current"
    passive = [loop.motion.read for loop in loops if loop.motion.current_A == 0.0]
    lonely = [loop.ids[0] for loop in active if not any(same_motion(loop.motion.read, read) for read in passive)]
    if lonely:
        return (
            f"the dynamic range of {some(lonely, most=MOST_NAMED)} requires the same motion at 0 A, which the matrix "
            "does not contain. Fix: add it to the matrix, or limit the band to other points"
        )
    return "" if active else "at 0 A, the dynamic range is undefined. Fix: specify another current, or remove the band"


def _parameter(band: ParameterBand, matrix: Matrix, *, fitted: bool) -> str:
    if not fitted:
        return (
            "no model is fitted in this campaign. Fix: enable [identify] in the matrix (and omit --no-identify), or "
            "remove the band"
        )
    settings = matrix.identify
    several = settings.model in SEVERAL
    if settings.current != AFFINE or settings.current_law != AFFINE or "+" in settings.model or settings.corrections:
        return ""  # the names of the parameters follow from the tests
    models = list(MODELS.values()) if several else [MODELS[settings.model]]
    units = {parameter.unit for model in models for parameter in model.parameters if parameter.name == band.name}
    which = "any damper model" if several else f"the model {settings.model}"
    if not units:
        known = "" if several else f"; its parameters are {', '.join(models[0].names)}"
        return f"{band.name} is not a parameter of {which}{known}"
    if band.unit not in units:
        return f'unit = "{band.unit}": {band.name} is fitted in "{", ".join(sorted(units))}"'
    return ""
