"""Check before a campaign starts: can `[identify]` and `[acceptance]` of the matrix be applied to its points?

After this check, only the measured values can make an identification fail, not names, filters or combinations.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem, IdentificationFailed
from rig.identification.points.whole_record import last_share
from rig.recording.run import Selection
from rig.signals.test_set import CurrentReading, current_levels
from rig.test_point import LOOP, SIGNAL

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rig.matrix.model import Matrix
    from rig.matrix.sections import Identify
    from rig.test_point import TestPoint

SEVERAL = ("all", "few", "grey")
SEPARABLE = "separable"
TEMPERATURE, SPRING = "temperature_law", "series_spring"
AFFINE = "affine"
THREE_STEPS = "zhu_three_step"
MODEL_OF_THREE_STEPS = "normalized_bouc_wen"


def check_analysis(path: Path, matrix: Matrix) -> None:
    """Refuse a matrix whose identification must fail after the last point.

    Args:
        path: the matrix file, for the message.
        matrix: what it says; with `[identify] enabled = false` nothing is checked.

    Raises:
        FileProblem: one line for each thing that cannot work.
    """
    if not matrix.wants_fit:
        return
    problems = analysis_problems(matrix.identify, matrix.points())
    if problems:
        raise FileProblem(str(path), [f"identify.{text}" for text in problems])


def check_specimen(path: Path, matrix: Matrix, *, fitted: bool = True) -> None:
    """Refuse acceptance bands that limit what the matrix does not measure.

    Args:
        path: the matrix file, for the message.
        matrix: what it says; without `[acceptance]` nothing is checked.
        fitted: whether the model of `[identify]` will be fitted.

    Raises:
        FileProblem: one line for each thing that cannot work.
    """
    if matrix.acceptance is None:
        return
    from rig.comparison.planned_bands import check_acceptance  # loads numba, which most matrices do not need

    check_acceptance(path, matrix, fitted=fitted)


def analysis_problems(settings: Identify, points: Iterable[TestPoint]) -> list[str]:
    """The same as lines of text; none when the identification can begin."""
    loops = [point for point in points if point.kind in {LOOP, SIGNAL}]
    if not loops:
        return ["enabled: the matrix contains no points that can be fitted. Fix: add such points, or set "
            "enabled = false"]
    problems, fitted = _holdout(settings.holdout, loops)
    problems += _combination(settings)
    if settings.current != AFFINE and _currents(fitted) == 1:
        problems.append(f'current = "{settings.current}": all fitted tests have the same current; '
            "expected at least two different currents")
    return problems


def _currents(points: list[TestPoint]) -> int:
    """How many different currents were requested."""
    return len(current_levels([CurrentReading(point.current_A, requested_A=point.current_A) for point in points]))


def _holdout(text: str | None, loops: list[TestPoint]) -> tuple[list[str], list[TestPoint]]:
    """What is wrong with the filter, and the points that it leaves to be fitted."""
    if text is None:
        return [], loops
    in_time = _end_of_time(text, loops)
    if in_time is not None:
        return in_time, loops
    if Path(text).exists():
        if CampaignFolder(Path(text)).points.is_dir():
            return [], loops
        return [f"holdout = \"{text}\": the path exists but is not a run (a campaign folder)"], loops
    try:
        selection = Selection.parse(text)
    except FileProblem as error:
        return [f'holdout = "{text}": {problem}' for problem in error.problems], loops
    # Only valid points are fitted or scored.
    held_out = [selection.holds(SimpleNamespace(**vars(point), verdict="valid")) for point in loops]
    fitted = [point for point, out in zip(loops, held_out, strict=True) if not out]
    if len(fitted) == len(loops):
        return [f'holdout = "{text}": matches none of the {len(loops)} points; '
            f"{selection.values_of(loops)}; no validation points would be left"], loops
    if not fitted:
        return [f'holdout = "{text}": matches all {len(loops)} points; no points would be left to fit'], loops
    return [], fitted


def _end_of_time(text: str, loops: list[TestPoint]) -> list[str] | None:
    """What is wrong with holding the end of the time out, `last 30 %`; None where the text says something else."""
    try:
        share = last_share(text)
    except IdentificationFailed as error:
        return [f"holdout: {error}"]
    cyclic = [point.id for point in loops if point.record is None]
    if share is None or not cyclic:
        return None if share is None else []
    return [
        f'holdout = "{text}": only signals can be split in time, not cyclic points ({", ".join(cyclic[:3])}). '
        "Fix: hold out whole points, such as waveform=road"
    ]


def _combination(settings: Identify) -> list[str]:
    """Models and methods that do not go together."""
    problems = []
    if settings.method == THREE_STEPS and settings.model != MODEL_OF_THREE_STEPS:
        problems.append(
            f'method = "{THREE_STEPS}": this method requires the model {MODEL_OF_THREE_STEPS}. Fix: set model = '
            f'"{MODEL_OF_THREE_STEPS}"'
        )
    bent = settings.current_law != AFFINE or "+" in settings.model
    corrections = settings.corrections
    several = [f'model = "{settings.model}"'] if settings.model in SEVERAL else []
    conflicts = [*several, *corrections, *(["a current law"] if bent else [])]
    if settings.current != AFFINE and conflicts:
        problems.append(
            f'current = "{settings.current}": requires a single model, so it cannot be combined with '
            f'{", ".join(conflicts)}. Fix: remove the conflicting settings'
        )
    conflicts = [
        *several, *([f'current = "{settings.current}"'] if settings.current != AFFINE else []),
        *(name for name in corrections if name != TEMPERATURE),
        *([f'method = "{settings.method}"'] if settings.method != SEPARABLE else []),
    ]  # fmt: skip
    if TEMPERATURE in corrections and conflicts:
        problems.append(
            f'{TEMPERATURE} = "{corrections[TEMPERATURE]}": requires a single named model and method = "{SEPARABLE}", '
            f'so it cannot be combined with {", ".join(conflicts)}. Fix: remove the conflicting settings'
        )
    if SPRING in corrections and settings.model in SEVERAL:
        problems.append('series_spring: requires a single model. Fix: name one model, such as model = "asymmetric"')
    return problems
