"""`fit.json`: the only module that knows its keys. They stay: users' scripts read them, and old files open.

The file is one flat object; the parts of a fit (`entries`) are read from it each by its own fields, and written back.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.dampers.current_law import AFFINE
from rig.dampers.current_law_model import PLUS
from rig.dampers.temperature_law import RATES
from rig.errors import FileProblem
from rig.fits.entries import Corrections, ErrorSummary, Evaluation, SolverReport, Uncertainty, Unseen
from rig.fits.plain import PlainReader, Value, plain
from rig.fits.relation import CurrentRelations
from rig.text_file import JSON_LIMIT_BYTES, json_of, read_bytes

INTERVAL = "95 % interval (each parameter separately)"
MOST_PROBLEMS = 12
MOST_TESTS = 1_000_000
FIX = "Fix: identify the run again (`rig identify RUN`), or restore the file from a backup"
FORMS = ("kwok", "printed")
KEYS = {
    "form": "equation", "drawn": "bootstrap", "series": "series_spring", "others": "corrections",
}  # fmt: skip
"""Fields whose key has another name; all other keys are the fields' names."""
PARTS = ("solver", "evaluation", "uncertainty", "corrections")
"""Fields of a fit whose own fields are keys of the file."""


def read_fit(kind: type[Value], path: Path) -> Value:
    """The fit in a file, or in the `fit.json` of a run's folder.

    Raises:
        FileProblem: there is none, or it is no fit: one line for each wrong key, with its value.
    """
    file = CampaignFolder(path).fit if path.is_dir() else path
    if path.is_dir() and not file.is_file():
        raise FileProblem(str(file), ["this run has no fit. Fix: create a fit with `rig identify RUN`"])
    raw = read_bytes(file, JSON_LIMIT_BYTES)
    try:
        content = json_of(file, raw)
    except FileProblem as error:
        raise FileProblem(str(file), [*error.problems, FIX]) from error
    return replace(fit_of(kind, content, str(file)), path=file, sha256=hashlib.sha256(raw).hexdigest())


def fit_of(kind: type[Value], content: Mapping[str, Any], file: str = CampaignFolder.fit) -> Value:
    """The fit in the object of a `fit.json`.

    Keys that later versions added may be missing, unknown keys are ignored.

    Args:
        kind: the class of the fit, `FitRecord` or one that adds to it.
        content: the object.
        file: its name, for messages.

    Raises:
        FileProblem: it is no fit: one line for each wrong key, with its value.
    """
    reader = PlainReader()
    error = content.get("error")
    held_out = error.get("holdout") if isinstance(error, Mapping) else None
    holdout = None if held_out is None else reader.read(ErrorSummary, held_out, "error.holdout")
    related = _relations(reader, content.get("current"))
    solver, evaluation = reader.read(SolverReport, content), reader.read(Evaluation, content, holdout=holdout)
    uncertainty = reader.read(Uncertainty, content, keys=KEYS)
    corrections = reader.read(Corrections, content, keys=KEYS, current=related)
    fit = reader.read(
        kind, content, keys=KEYS, solver=solver, evaluation=evaluation, uncertainty=uncertainty, corrections=corrections
    )
    problems = reader.problems
    if fit is None or uncertainty is None or corrections is None or problems:
        more = [f"{len(problems) - MOST_PROBLEMS} more"] * (len(problems) > MOST_PROBLEMS)
        raise FileProblem(file, [*problems[:MOST_PROBLEMS], *more, FIX])
    if problems := [
        *_without_counterpart(content["parameters"], uncertainty, corrections), *_unknown_words(content),
        *_impossible_band(content),
    ]:  # fmt: skip
        raise FileProblem(file, [*problems, FIX])
    return fit


def _without_counterpart(
    parameters: Mapping[str, Any], uncertainty: Uncertainty, corrections: Corrections
) -> Iterator[str]:
    """Names of parameters that are used where `parameters` does not have them, and lists that must be equally long."""
    draws = {} if uncertainty.drawn is None else uncertainty.drawn.draws
    profiles, related = uncertainty.profiles, corrections.current
    for key, names in (
        ("correlation", uncertainty.correlation), ("profiles", profiles), ("bootstrap.draws", draws),
    ):  # fmt: skip
        yield from (
            f"{key}.{name}: got a name that is missing from `parameters`" for name in names if name not in parameters
        )
    rates = () if corrections.temperature is None else RATES.get(corrections.temperature.law, ())
    for name in (*rates, *profiles):
        if (parameters.get(name) or {}).get("value") is None:
            yield f"parameters.{name}.value: missing, but required by the parameter's profile or the temperature law"
    if related is not None:
        yield from ["current.currents_A: is missing"] * bool(related.relations and not related.currents_A)
        for name in sorted(related.relations.keys() ^ related.ranges.keys()):
            yield f"current: {name}: expected in both `relations` and `ranges`, found in only one of them"
    for key, lists in (
        *((f"profiles.{name}", [one.values, one.deviance]) for name, one in profiles.items()),
        ("bootstrap.draws", list(draws.values())),
    ):
        if len({len(values) for values in lists}) > 1:
            yield f"{key}: got lists of different lengths"


def _unknown_words(content: Mapping[str, Any]) -> Iterator[str]:
    """Entries that are none of the words that there are."""
    law = (content.get("temperature") or {}).get("law")
    for key, value, words in (("hysteresis", content.get("hysteresis"), FORMS), ("temperature.law", law, (*RATES,))):
        if value is not None and value not in words:
            yield f"{key}: got {value!r}, expected {' or '.join(map(repr, words))}"


def _impossible_band(content: Mapping[str, Any]) -> Iterator[str]:
    """Numbers of the prediction error that no fit has: it would answer predictions with a false band, or break them."""
    entry = (content.get("tested") or {}).get("band")
    if entry is None:
        return
    current_A, half_width_N, key = entry["current_A"], entry["half_width_N"], "tested.band"
    left_out, motions = entry.get("left_out") or 0, entry.get("motions") or 0
    if not current_A or len(half_width_N) != len(current_A):
        yield (
            f"{key}: got {len(half_width_N)} `half_width_N` and {len(current_A)} `current_A`, expected equally many, "
            "1 at least"
        )
    yield from (
        f"{key}.current_A[{place + 1}]: got {after}, expected more than {before} (rising currents)"
        for place, (before, after) in enumerate(pairwise(current_A)) if after <= before
    )  # fmt: skip
    yield from (
        f"{key}.half_width_N[{place}]: got {width}, expected 0 N or more"
        for place, width in enumerate(half_width_N) if width < 0.0
    )  # fmt: skip
    if not (0 <= left_out <= MOST_TESTS and min(1, left_out) <= motions <= left_out):
        yield (
            f"{key}: got left_out {left_out:g} and motions {motions:g}, expected left_out from 0 to "
            f"{MOST_TESTS}, and motions from 1 to left_out (0 if left_out is 0)"
        )


def _relations(reader: PlainReader, entry: object) -> CurrentRelations | None:
    """The relations to the current; None for a model that is affine in it. Their kind is part of the dependence."""
    if entry is None or (isinstance(entry, Mapping) and entry.get("dependence") == AFFINE):
        return None
    if isinstance(entry, Mapping) and isinstance(related := entry.get("relations"), Mapping):
        kind = str(entry.get("dependence")).removeprefix("per-current-")
        named = {name: {**one, "kind": kind} if isinstance(one, Mapping) else one for name, one in related.items()}
        entry = {**entry, "relations": named}
    return reader.read(CurrentRelations, entry, "current")


def fit_text(content: Mapping[str, Any]) -> str:
    """What `fit_content` gives, as the text of a file."""
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def fit_content(fit: Mapping[str, Any], evaluation: Evaluation, equation: str) -> dict[str, Any]:
    """The object of `fit.json`: plain types, no NaN or infinity (null instead).

    Args:
        fit: a fit as plain types, its parts as objects in it.
        evaluation: its evaluation.
        equation: the model's equation with the fitted numbers.
    """
    flat = {KEYS.get(name, name): value for name, value in fit.items() if name not in PARTS}
    for part in PARTS:
        flat |= {KEYS.get(name, name): value for name, value in fit[part].items()}
    holdout, error = flat.pop("holdout"), _errors(flat["error"])
    for entry in flat["parameters"].values():
        for name in ("reason", "quantity"):
            if not entry[name]:
                del entry[name]
    for name in ("corrections", "cycles"):
        if not flat.get(name):
            flat.pop(name, None)
    error["holdout"] = None if holdout is None else _with_mean_within(_errors(holdout), evaluation.holdout)
    return flat | {
        "error": error,
        "unseen": None if flat["unseen"] is None else _with_mean_within(flat["unseen"], evaluation.unseen),
        "current": _dependence(flat["current"]),
        "current_law": flat["model"].partition(PLUS)[2] or AFFINE,
        "formula": equation,
        "interval": INTERVAL,
    }


def _errors(entry: dict[str, Any]) -> dict[str, Any]:
    """Errors over some tests; of each test what is known of it alone."""
    for test in entry["per_test"]:
        for name in ("beyond", "residual"):
            if test[name] is None:
                del test[name]
    return entry


def _with_mean_within(entry: dict[str, Any], summary: ErrorSummary | Unseen | None) -> dict[str, Any]:
    """The errors of held-out tests with their mean over those within the data."""
    within = None if summary is None else summary.within_nrmse_percent_of_peak
    return entry | {"within_nrmse_percent_of_peak": plain(within)}


def _dependence(related: dict[str, Any] | None) -> dict[str, Any]:
    """How the parameters depend on the current; the kind of the relations is part of the dependence."""
    if related is None:
        return {"dependence": AFFINE}
    for relation in related["relations"].values():
        del relation["kind"]
    return related
