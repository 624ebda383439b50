"""`python -m rig.identification RUN... [options]`: fit recorded runs, write `fit.json`, say what was found."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from rig.errors import RigError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.identification.fit import Fit


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; the result is the exit code."""
    options = _parser().parse_args(arguments)
    from rig.identification import Method, identify_run

    try:
        method = Method(
            options.method, weight=options.weight, budget=options.budget, seed=options.seed, loss=options.loss
        )
        fit = identify_run(
            options.run, model=options.model, method=method, holdout=options.holdout, hysteresis=options.hysteresis
        )
    except RigError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201 - a command's own output
        return error.exit_code
    print(json.dumps(fit.to_json(), indent=1) if options.json else as_text(fit))  # noqa: T201 - as above
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m rig.identification", description=__doc__, allow_abbrev=False)
    parser.add_argument("run", nargs="+", help="campaign directory or point file")
    parser.add_argument("--model", default="asymmetric", help='a damper model, or "all" to compare them')
    parser.add_argument("--method", default="separable", help="separable or one of the papers' algorithms")
    parser.add_argument("--holdout", help="filter such as waveform=triangle, or another run: scored, not fitted")
    parser.add_argument("--hysteresis", default="kwok", choices=("kwok", "printed"), help="form of the tanh argument")
    parser.add_argument("--weight", choices=("1", "v"), help="weight of each sample: 1, or its speed (equation 12)")
    parser.add_argument("--loss", default="squares", choices=("squares", "huber"), help="huber: outliers count less")
    parser.add_argument("--budget", type=int, default=16_000, help="evaluations for the papers' algorithms")
    parser.add_argument("--seed", type=int, default=0, help="of every random draw")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    return parser


def as_text(fit: Fit) -> str:
    """A fit as plain text: parameters, errors, warnings."""
    lines = [f"{fit.model} by {fit.method}, weight {fit.weight}: {fit.error.nrmse_percent_of_peak:.3g} % of peak"]
    for name, each in fit.parameters.items():
        value = "-" if each.value is None else f"{each.value:.6g}"
        interval = "" if each.low is None else f"{each.low:.6g} to {each.high:.6g}"
        lines.append(f"  {name:9s} {value:>12s} {each.unit:10s} {interval} {each.reason}".rstrip())
    if fit.holdout is not None:
        lines.append(f"held out: {fit.holdout.nrmse_percent_of_peak:.3g} % of peak, {fit.holdout.rmse_N:.3g} N")
    if fit.adequate is False:
        lines.append("no model here describes these data within their noise")
    return "\n".join([*lines, *(f"warning: {text}" for text in fit.warnings)])


if __name__ == "__main__":
    sys.exit(main())
