"""`rig identify`: fit damper models to recorded or imported runs."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.cli.options import Command, MethodName, QuantityOption, RunOrFilter, RunPath, json_option, scheduler_option
from rig.cli.output import console, job_bar, kept_after_stop, show, shown_path, write_json
from rig.document.blocks import Block, Column, Note, Row, table
from rig.document.words import FAIR, GOOD, PLAIN, POOR
from rig.errors import EXIT_DONE, EXIT_IDENTIFICATION
from rig.jobs.choice import workers_for
from rig.jobs.time_left import TimeLeft
from rig.matrix.corrections import CORRECTIONS
from rig.matrix.methods import DEPENDENCES, LAWS, METHODS

if TYPE_CHECKING:
    from rig.identification import FitOptions
    from rig.identification.runs import RunFit

SELDOM = 200_000  # new objects between two looks for circles of them: a twentieth of the time otherwise, for nothing
SETTINGS = ("weight", "loss", "budget", "population", "seed", "bounds")
"""Options that are the method's; what `command` does not name otherwise is one of `FitOptions` as it is."""
FLAGS = ", ".join(one.flag for one in CORRECTIONS if one.requestable)


def _correction_options(function: Callable[..., int]) -> Callable[..., int]:
    """An option of the command for each correction that can be requested."""
    for one in reversed([one for one in CORRECTIONS if one.requestable]):
        flag = one.flag
        if one.quantity is not None:
            about = f"{one.about}  [{one.quantity.allowed}]" if one.quantity.allowed else one.about
            function = click.option(flag, type=QuantityOption(one.quantity), help=about)(function)
        elif one.switch:
            function = click.option(flag, is_flag=True, help=one.about)(function)
        else:
            choice = click.Choice([str(name) for name in one.choices])
            default = choice.choices[0]
            function = click.option(flag, type=choice, default=default, show_default=True, help=one.about)(function)
    return function


@click.command(
    name="identify",
    cls=Command,
    examples=(
        "rig identify logs/20260102T030405Z-MR-001-ab12cd",
        "rig identify SINE_RUN --holdout TRIANGLE_RUN --json",
        "rig identify RUN --model all --holdout frequency_Hz=2",
        "rig identify RUN --model lost_motion --unseen pairs",
        "rig identify RUN --model kwok --current per-current-lagrange",
        "rig identify RUN --model asymmetric --current-law saturating",
        "rig identify RUN --model lost_motion --temperature-law both",
        "rig identify RUN --method c_foa --bounds wide --budget 16000",
        "rig identify --each logs/2026* --scheduler tcp://HOST:8786",
    ),
)
@click.argument("runs", type=RunPath(), nargs=-1, required=True)
@click.option(
    "--model",
    help="Damper model; `few` compares five models, `all` compares all models, `grey` adds a residual "
         "to the best of `few` if it predicts better (also NAME+grey).  [default: few, or asymmetric if any "
         f"option specific to a single model is given (a search method, --current, {FLAGS}, --profile-of, "
         "--hysteresis printed)]",
)
@click.option(
    "--method", type=MethodName(), metavar="NAME", default="separable", show_default=True,
    help=f"Fitting method: {', '.join(METHODS)}, or the name of a plug-in.",
)  # fmt: skip
@click.option(
    "--holdout", type=RunOrFilter(),
    help="Tests excluded from the fit and used for validation: a run, or a filter (waveform=triangle).",
)
@click.option(
    "--hysteresis", type=click.Choice(["kwok", "printed"]), default="kwok", show_default=True,
    help="Argument of tanh, in models that contain tanh: as defined by Kwok, or as printed in the c-FOA paper.",
)  # fmt: skip
@click.option(
    "--current", type=click.Choice(DEPENDENCES), metavar="NAME", default="affine", show_default=True,
    help="Dependence of the parameters on current: affine (one fit to all currents), or separate fits for each current "
         f"with a relation between the fits ({', '.join(DEPENDENCES[1:])}).",
)  # fmt: skip
@click.option(
    "--current-law", type=click.Choice(LAWS), default="affine", show_default=True,
    help="Current law, for any model: affine, saturating, polynomial, one level per current, or a comparison of all "
         "of these.",
)  # fmt: skip
@_correction_options
@click.option("--suspect", is_flag=True, help="Include suspect points; by default only valid points are fitted.")
@click.option(
    "--weight", type=click.Choice(["1", "v", "relative"]),
    help=(
        "Weight of each residual: 1, the speed, or the inverse of the test's peak force.  [default: depends on the "
        "method]"
    ),
)
@click.option(
    "--loss", type=click.Choice(["squares", "huber"]), default="squares", show_default=True,
    help="Loss function.",
)
@click.option(
    "--budget", type=click.IntRange(1), default=16_000, show_default=True,
    help="Maximum number of model evaluations in a search.",
)
@click.option("--population", type=click.IntRange(2), default=50, show_default=True, help="Number of candidates in "
    "each generation.")
@click.option(
    "--bounds", type=click.Choice(["model", "wide", "none"]), default="model", show_default=True,
    help="Search range: the range defined for each parameter, -10,000 to 10,000 (SI units) for all parameters, or "
         "unbounded, as in the papers.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed for stochastic "
    "methods.")
@click.option("--profile", is_flag=True, help="Also compute the profile likelihoods of the nonlinear parameters.")
@click.option(
    "--profile-of", multiple=True, metavar="NAME",
    help="Also compute the profile likelihood of this parameter (repeatable).",
)
@click.option("--diagnose", is_flag=True, help="Search for causes of the misfit even if the fit is adequate.")
@click.option(
    "--bootstrap", type=click.IntRange(20), metavar="N",
    help="Compute bootstrap intervals, which are valid even if no model fits, by resampling the tests N times (1000 "
         "for a publication).",
)  # fmt: skip
@click.option(
    "--unseen", type=click.Choice(["pairs"]),
    help="Leave-one-motion-out cross-validation: prediction error for each amplitude and frequency, with the model "
         "fitted to all other motions.",
)
@click.option(
    "--each", is_flag=True,
    help="Fit each run separately, in parallel, and write a fit.json to each run. By default, all runs are fitted "
         "together.",
)  # fmt: skip
@scheduler_option
@json_option
def command(
    runs: tuple[Path, ...],
    model: str | None,
    method: str,
    suspect: bool,
    profile: bool,
    profile_of: tuple[str, ...],
    diagnose: bool,
    bootstrap: int | None,
    each: bool,
    scheduler: str | None,
    as_json: bool,
    **requested: Any,  # noqa: ANN401 - click has checked each by its own type
) -> int:
    """Fit damper models to RUNS and write fit.json to the first run; an earlier fit.json is kept under another name.

    A run is a campaign directory, a folder with exactly one campaign, or a point file. Parameters that the tests do not
    determine are reported as not identifiable, with the reason. The exit code is 6 if no model can be fitted (with
    --each: if a run cannot be fitted).
    """
    gc.set_threshold(SELDOM)
    # loads numpy: not needed for the help
    from rig.identification import FitOptions, Method, identify_run
    from rig.identification.options import FEW

    settings = Method(method, **{name: requested.pop(name) for name in SETTINGS})
    profiled = (*(["nonlinear"] if profile else []), *profile_of)
    options = FitOptions(method=settings, profile=profiled, diagnose=diagnose or None, bootstrap=bootstrap or 0)
    options = FitOptions.of(options, requested)
    if model is not None:
        options = replace(options, model=model)
    elif not (options.one_model_only or profile_of or options.hysteresis != "kwok"):
        options = replace(options, model=FEW)
    if each:
        return _each(runs, options, scheduler, suspect=suspect, as_json=as_json)
    if _of_many_jobs(options):
        options = replace(options, on_progress=lambda line: click.echo(line, err=True))
    with _distributed(options, scheduler) as where:
        fit = identify_run(runs, where, suspect=suspect)
    if fit.kept is not None:
        click.echo(f"the previous fit was saved as {shown_path(fit.kept)}", err=True)
    if as_json:
        write_json(fit.to_json())
        return EXIT_DONE
    # loads numba and numpy: not needed for the help
    from rig.cli.fit_tables import fit_tables

    show(fit_tables(fit), console())
    if fit.path is not None:
        click.echo(shown_path(fit.path))
    return EXIT_DONE


def _of_many_jobs(options: FitOptions) -> bool:
    """Whether the fit consists of several jobs, which report their progress and can be distributed."""
    return bool(options.several or options.bootstrap or options.unseen is not None)


@contextmanager
def _distributed(options: FitOptions, scheduler: str | None) -> Iterator[FitOptions]:
    """Return the options, with the workers of a scheduler if one is specified.

    Raises:
        UsageError: the fit has no parts for workers.
    """
    # loads all algorithms and numpy: not needed for the help
    from rig.optimisers import METHODS

    if scheduler is None:
        yield options
        return
    method = options.how
    if not (_of_many_jobs(options) or method.name in METHODS):
        raise click.UsageError(
            f"--scheduler: a fit of one model with --method {method.name} is a single job and cannot be distributed. "
            "Fix: omit --scheduler, or add --each, --model all, --bootstrap N, --unseen pairs, or a search method "
            f"(--method {'|'.join(METHODS)})"
        )
    with workers_for(scheduler) as workers:
        if method.name in METHODS:
            method = replace(method, executor=workers.executor, chunks=workers.count)
        yield replace(options, workers=workers, method=method)


def _each(
    runs: tuple[Path, ...], options: FitOptions, scheduler: str | None, *, suspect: bool, as_json: bool
) -> int:
    """Fit the runs separately, with progress on standard error; a stop states how many runs were fitted."""
    # loads numpy: not needed for the help
    from rig.identification import identify_each

    ended = 0
    clock = TimeLeft(len(runs))
    with job_bar("runs") as show_progress:
        show_progress(0, len(runs))

        def finished(_fit: RunFit, done: int) -> None:
            nonlocal ended
            ended = done
            show_progress(done, len(runs), clock.after(done))

        processes = min(len(runs), os.cpu_count() or 1)
        kept = kept_after_stop(lambda: f"{ended} of {len(runs)} runs were fitted; their fit.json files are kept")
        with kept, workers_for(scheduler, processes) as workers:
            where = replace(options, workers=workers)
            fits = identify_each(runs, where, suspect=suspect, finished=finished)
    failed = sum(1 for fit in fits if fit.error)
    if as_json:
        write_json({"runs": [fit.to_json() for fit in fits], "fitted": len(fits) - failed, "failed": failed})
    else:
        show(_table_of(fits), console())
    return EXIT_IDENTIFICATION if failed else EXIT_DONE


def _table_of(fits: Sequence[RunFit]) -> list[Block]:
    """One row per run, and the reasons why runs could not be fitted."""
    head = [
        Column("run"), Column("model"), Column("error, % of force amplitude", "", True),
        Column("fits within measurement noise"),
    ]  # fmt: skip
    words = {True: ("yes", GOOD), False: ("no", FAIR), None: ("-", PLAIN)}
    rows = []
    for fit in fits:
        adequate, level = ("failed", POOR) if fit.error else words[fit.adequate]
        error = "-" if fit.error else f"{fit.nrmse_percent_of_peak:.3g}"
        rows.append(Row((fit.run.name, fit.model or "-", error, adequate), level))
    reasons = [Note(POOR, f"{fit.run.name}: {fit.error}") for fit in fits if fit.error]
    return [table(head, rows), *reasons]
