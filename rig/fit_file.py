"""Reading `fit.json` without trust: one reader and one check of its shape for every command that uses a fit.

The shape is that of `rig identify --json` (docs/json.md). Keys that later versions added may be missing, unknown keys
are ignored; what is there has its type, and every number is finite or null. What a command needs beyond that (a model
that is known here, a value for each parameter) is its own check.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.dampers.temperature_law import RATES
from rig.errors import FileProblem
from rig.text_file import JSON_LIMIT_BYTES, json_of, read_bytes

FIT = "fit.json"
MOST_PROBLEMS = 12
LONGEST_VALUE = 60
FIX = "Fix: identify again (`rig identify RUN`), or restore the file from a copy"

Check = Callable[[str, Any], Iterator[str]]
"""From a key's path and its value: one line for each thing that is wrong."""


@dataclass(frozen=True)
class FitObject:
    """The object of a `fit.json` whose shape was checked, its file, and the file's SHA-256 (hex)."""

    content: Mapping[str, Any]
    file: Path
    sha256: str


def read_fit(path: Path) -> FitObject:
    """The fit in a file, or in the `fit.json` of a run's folder.

    Raises:
        FileProblem: there is none, or its shape is not that of a fit: one line for each key, with its value.
    """
    if path.is_dir():
        path = path / FIT
        if not path.is_file():
            raise FileProblem(str(path), ["there is no fit in this run. Fix: `rig identify RUN` makes one"])
    raw = read_bytes(path, JSON_LIMIT_BYTES)
    try:
        content = json_of(path, raw)
    except FileProblem as error:
        raise FileProblem(str(path), [*error.problems, FIX]) from error
    problems = problems_of(content)
    if problems:
        more = [f"{len(problems) - MOST_PROBLEMS} more"] * (len(problems) > MOST_PROBLEMS)
        raise FileProblem(str(path), [*problems[:MOST_PROBLEMS], *more, FIX])
    return FitObject(content, path, hashlib.sha256(raw).hexdigest())


def problems_of(content: Mapping[str, Any]) -> list[str]:
    """What of an object is not as in a fit, one line a key; empty where nothing is."""
    problems = [*_not_finite("", content), *_object(SHAPE, SHAPE_NEEDED)("", content)]
    return problems or [*_strangers(content)]


def _wrong(key: str, value: object, expected: str) -> str:
    shown = repr(value) if not isinstance(value, (dict, list)) else f"{type(value).__name__} {value!r}"
    return f"{key or 'the file'}: got {shown[:LONGEST_VALUE]}, expected {expected}"


def _not_finite(key: str, value: object) -> Iterator[str]:
    """Numbers that JSON does not have (NaN, Infinity), and those too large for a float, wherever they are."""
    if isinstance(value, dict):
        for name, one in value.items():
            yield from _not_finite(_inside(key, name), one)
    elif isinstance(value, list):
        for place, one in enumerate(value):
            yield from _not_finite(f"{key}[{place}]", one)
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            finite = math.isfinite(value)
        except OverflowError:
            finite = False
        if not finite:
            yield _wrong(key, value, "a finite number or null")


def _inside(key: str, name: str) -> str:
    return f"{key}.{name}" if key else name


def _number(key: str, value: object) -> Iterator[str]:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        yield _wrong(key, value, "a number")


def _text(key: str, value: object) -> Iterator[str]:
    if not isinstance(value, str):
        yield _wrong(key, value, "a text")


def _flag(key: str, value: object) -> Iterator[str]:
    if not isinstance(value, bool):
        yield _wrong(key, value, "true or false")


def _or_null(check: Check) -> Check:
    return lambda key, value: iter(()) if value is None else check(key, value)


def _list(check: Check, count: int | None = None) -> Check:
    def checked(key: str, value: object) -> Iterator[str]:
        if not isinstance(value, list) or (count is not None and len(value) != count):
            yield _wrong(key, value, "a list" if count is None else f"a list of {count}")
            return
        for place, one in enumerate(value):
            yield from check(f"{key}[{place}]", one)

    return checked


def _each(check: Check) -> Check:
    """An object whose values are all alike, by names such as those of parameters."""

    def checked(key: str, value: object) -> Iterator[str]:
        if not isinstance(value, dict):
            yield _wrong(key, value, "an object")
            return
        for name, one in value.items():
            yield from check(_inside(key, name), one)

    return checked


def _object(known: Mapping[str, Check], needed: tuple[str, ...] = ()) -> Check:
    """An object with some known keys, of which some must be there; files of earlier versions have not all of them."""

    def checked(key: str, value: object) -> Iterator[str]:
        if not isinstance(value, dict):
            yield _wrong(key, value, "an object")
            return
        for name in needed:
            if name not in value:
                yield f"{_inside(key, name)}: is missing"
        for name, check in known.items():
            if name in value:
                yield from check(_inside(key, name), value[name])

    return checked


def _one_of(*words: str) -> Check:
    def checked(key: str, value: object) -> Iterator[str]:
        if value not in words:
            yield _wrong(key, value, " or ".join(map(repr, words)))

    return checked


def _ends(key: str, value: object) -> Iterator[str]:
    """The lowest and the highest value of a quantity."""
    wrong = [*_list(_number, 2)(key, value)]
    if not wrong and isinstance(value, list) and value[0] > value[1]:
        wrong = [_wrong(key, value, "the lowest and the highest value")]
    yield from wrong


MAYBE = _or_null(_number)
NUMBERS, TEXTS = _list(_number), _list(_text)
ESTIMATE = _object({
    "value": MAYBE, "unit": _text, "low": MAYBE, "high": MAYBE, "simultaneous_low": MAYBE, "simultaneous_high": MAYBE,
    "standard_error": MAYBE, "identifiable": _flag, "reason": _or_null(_text), "variance_inflation": MAYBE,
}, ("value",))  # fmt: skip
RESIDUAL = _object(dict.fromkeys(
    ("noise_N", "repeating_N", "memory_s", "portmanteau_p", "runs_p", "widening"), MAYBE
), ("noise_N", "repeating_N", "memory_s", "portmanteau_p", "runs_p", "widening"))  # fmt: skip
TEST = _object({
    "id": _text, "file": _text, "rmse_N": MAYBE, "mae_N": MAYBE, "nrmse_percent_of_peak": MAYBE, "noise_N": MAYBE,
    "samples": _number, "energy_J": MAYBE, "modelled_energy_J": MAYBE, "beyond": _or_null(TEXTS), "residual": RESIDUAL,
}, ("id",))  # fmt: skip
SUMMARY = {
    "rmse_N": MAYBE, "mae_N": MAYBE, "sd_N": MAYBE, "r_squared": MAYBE, "nrmse_percent_of_peak": MAYBE,
    "within_nrmse_percent_of_peak": MAYBE, "per_test": _list(TEST),
}
UNSEEN_TEST = _object({
    "id": _text, "amplitude_m": _number, "frequency_Hz": _number, "current_A": _number, "rmse_N": MAYBE,
    "nrmse_percent_of_peak": MAYBE, "beyond": _or_null(TEXTS),
}, ("id", "amplitude_m", "frequency_Hz", "current_A", "nrmse_percent_of_peak"))  # fmt: skip
SHAPE: Mapping[str, Check] = {
    "model": _text,
    "equation": _text, "formula": _text, "interval": _text, "method": _text, "current_law": _text,
    "hysteresis": _one_of("kwok", "printed"), "weight": _text, "loss": _text,
    "parameters": _each(ESTIMATE),
    "error": _object({**SUMMARY, "holdout": _or_null(_object(SUMMARY))}),
    "selection": _list(_object({
        "model": _text, "holdout_nrmse_percent_of_peak": MAYBE, "within_nrmse_percent_of_peak": MAYBE, "bic": MAYBE,
        "rmse_N": MAYBE, "parameters": _number, "method": _text, "reason": _text, "beyond": _each(TEXTS),
    }, ("model",))),
    "references": _list(_object({
        "name": _text, "holdout_nrmse_percent_of_peak": MAYBE, "nrmse_percent_of_peak": MAYBE, "reason": _text,
        "within_nrmse_percent_of_peak": MAYBE,
    }, ("name",))),
    "adequate": _or_null(_flag), "warnings": TEXTS, "notes": TEXTS, "evaluations": _number, "wall_s": _number,
    "objective": MAYBE, "condition": MAYBE,
    "correlation": _each(_each(MAYBE)),
    "passivity": _or_null(_object({"share": _number, "worst": _text}, ("share", "worst"))),
    "profiles": _each(_object({"values": NUMBERS, "deviance": NUMBERS, "low": MAYBE, "high": MAYBE},
                              ("values", "deviance", "low", "high"))),
    "next_tests": _list(_object({
        "parameter": _text, "text": _text, "toml": _text, "standard_error": MAYBE, "expected_error": MAYBE,
    }, ("parameter", "text", "toml"))),
    "bootstrap": _or_null(_object({
        "count": _number, "tests": _number, "widening": _number, "draws": _each(NUMBERS),
        "parameters": _each(_object(
            {"low": _number, "high": _number, "standard_error": _number}, ("low", "high", "standard_error")
        )),
    }, ("count", "tests", "widening", "parameters", "draws"))),
    "temperature": _or_null(_object({
        "law": _one_of(*RATES), "reference_degC": _number,
        "lowest_degC": _number, "highest_degC": _number,
    }, ("law", "reference_degC", "lowest_degC", "highest_degC"))),
    "unseen": _or_null(_object({
        "split": _text, "nrmse_percent_of_peak": MAYBE, "within_nrmse_percent_of_peak": MAYBE,
        "per_pair": _list(_object({
            "amplitude_m": _number, "frequency_Hz": _number, "tests": _number, "nrmse_percent_of_peak": MAYBE,
            "r_squared": MAYBE,
        }, ("amplitude_m", "frequency_Hz", "tests", "nrmse_percent_of_peak", "r_squared"))),
        "per_test": _list(UNSEEN_TEST),
    }, ("split", "per_pair", "per_test"))),
    "diagnosis": _list(_object({"slug": _text, "text": _text, "explains": _number, "next": _text},
                               ("slug", "text", "explains", "next"))),
    "current": _or_null(_object({
        "dependence": _text, "currents_A": NUMBERS, "ranges": _each(_ends),
        "relations": _each(_object({"coefficients": NUMBERS, "rms": _number, "rms_left_out": MAYBE},
                                   ("coefficients", "rms", "rms_left_out"))),
    }, ("dependence",))),
    "series_spring": _or_null(_object({"stiffness_N_m": MAYBE, "low": MAYBE, "high": MAYBE}, ("stiffness_N_m",))),
    "tested": _or_null(_object({
        "displacement_m": _ends, "velocity_m_s": _ends, "current_A": _ends, "temperature_degC": _or_null(_ends),
        "only_at_A": NUMBERS,
        "band": _object({"current_A": NUMBERS, "half_width_N": NUMBERS, "source": _text},
                        ("current_A", "half_width_N", "source")),
    }, ("displacement_m", "velocity_m_s", "current_A"))),
    "coil_eta_1_s": MAYBE,
    "test_set": _or_null(_object({})),
}  # fmt: skip
SHAPE_NEEDED = ("model", "parameters")


def _strangers(content: Mapping[str, Any]) -> Iterator[str]:
    """Names of parameters that are used where `parameters` does not have them, and lists that must be equally long."""
    parameters, drawn = content["parameters"], content.get("bootstrap") or {}
    profiles = content.get("profiles") or {}
    for key, names in (
        ("correlation", content.get("correlation") or {}), ("profiles", profiles),
        ("bootstrap.draws", drawn.get("draws") or {}),
    ):
        yield from (f"{key}.{name}: `parameters` has no {name}" for name in names if name not in parameters)
    law = (content.get("temperature") or {}).get("law", "none")
    for name in (*RATES[law], *profiles):
        if (parameters.get(name) or {}).get("value") is None:
            yield f"parameters.{name}.value: is missing; its profile or the temperature law needs it"
    yield from _relations(content.get("current") or {})
    band = (content.get("tested") or {}).get("band") or {}
    for key, lists in (
        *((f"profiles.{name}", (one["values"], one["deviance"])) for name, one in profiles.items()),
        ("bootstrap.draws", (drawn.get("draws") or {}).values()),
        ("tested.band", [band[name] for name in ("current_A", "half_width_N") if band]),
    ):
        if len({len(values) for values in lists}) > 1:
            yield f"{key}: lists of different lengths"


def _relations(related: Mapping[str, Any]) -> Iterator[str]:
    """What of the relations of parameters to the current is there without its counterpart."""
    if "relations" not in related:
        return
    yield from (f"current.{name}: is missing" for name in ("currents_A", "ranges") if name not in related)
    for name in sorted(related["relations"].keys() ^ related.get("ranges", {}).keys()):
        yield f"current: {name} is in only one of relations and ranges"
