"""The options that commands share, declared once, and the command class whose help ends with examples."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

from rig.campaign_folder import LAST, LOGS, by_age, ignored, run_path
from rig.cli.help_examples import write_examples
from rig.cli.output import say
from rig.errors import FileProblem
from rig.files.quantity import Quantity
from rig.matrix.methods import METHODS, check_method, method_names

FROM_END = re.compile(r"-[1-9]\d{0,5}")


class QuantityOption(click.ParamType[float]):
    """A quantity with its unit on the command line, such as 0.5 A: of a dimension, or also with a range."""

    name = "quantity"

    def __init__(self, quantity: str | Quantity) -> None:
        self.quantity = quantity

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Text to SI; what does not fit is a usage error."""
        quantity = Quantity(self.quantity) if isinstance(self.quantity, str) else self.quantity
        try:
            return quantity.convert(value)
        except ValueError as problem:
            self.fail(str(problem), param, ctx)


class MethodName(click.ParamType[str]):
    """The name of a fitting method; plug-ins are looked for only where it is none of this program's."""

    name = "method"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The name as it is; an unknown one is a usage error."""
        if value not in METHODS and value not in method_names():
            self.fail(f"{value!r}: expected one of {', '.join(map(repr, method_names()))}.", param, ctx)
        check_method(value)
        return value


class RunPath(click.ParamType[str | Path]):
    """A run: its directory, or a short name of one in `logs/`: `last`, `-1` (the same), `-2`, part of its name."""

    name = "run"
    with_empty = False

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> str | Path:
        """The path of the run; the run that a short name means is shown. No run or several runs are a usage error."""
        try:
            path = run_path(value, with_empty=self.with_empty)
        except FileProblem as problem:
            self.fail(str(problem), param, ctx)
        if path != Path(value) and not (ctx is not None and ctx.resilient_parsing):
            skipped = ignored(path) if LAST.fullmatch(Path(value).name) and not self.with_empty else 0
            newer = f" (newer runs without recorded points, ignored: {skipped})" if skipped else ""
            say(f"run: {path}{newer}", err=True)
        return path

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Names of runs in `logs/` that begin with what was typed, or the only one that contains it; else files."""
        del ctx, param
        names, begun = by_age(LOGS)[::-1], incomplete.casefold()
        offered = [name for name in ("last", *names) if name.casefold().startswith(begun)]
        if not offered:
            containing = [name for name in names if begun in name.casefold()]
            offered = containing if len(containing) == 1 else []
        return [CompletionItem(name) for name in offered] or [CompletionItem(incomplete, type="file")]


class ResumedRun(RunPath):
    """A run to resume, which moves the rig: one that was stopped before its first point is not ignored."""

    with_empty = True


class RunOrFilter(RunPath):
    """A run as `RunPath`, or a filter on tests (`current_A=1`, `last 30 %`)."""

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """A filter unchanged; the path of the run otherwise."""
        text = str(value)
        return text if "=" in text or "%" in text else str(super().convert(text, param, ctx))


class FitName(RunPath):
    """A run with a fit as `RunPath`, a fit.json or a named parameter set: text that `fitted_damper` finds."""

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """The text unchanged."""
        del param, ctx
        return str(value)


class Command(click.Command):
    """A command whose help ends with examples, printed as they are typed."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the arguments; `-1` in a run's place is a run and not an option."""
        options = {name: param for param in self.params if isinstance(param, click.Option) for name in param.opts}
        takes_run = any(isinstance(param.type, RunPath) for param in self.params if isinstance(param, click.Argument))
        for at, text in enumerate(args):
            if text == "--":
                break
            before = options.get(args[at - 1]) if at else None
            valued = before is not None and not before.is_flag
            if FROM_END.fullmatch(text) and (isinstance(before.type, RunPath) if before and valued else takes_run):
                args[at] = "last" if text == "-1" else f"last{text}"
        return super().parse_args(ctx, args)

    def __init__(self, *args: Any, examples: tuple[str, ...] = (), **kwargs: Any) -> None:  # noqa: ANN401 - click's own
        super().__init__(*args, **kwargs)
        self.examples = examples

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples, one a line."""
        del ctx
        write_examples(formatter, self.examples)


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object to standard output.")
scheduler_option = click.option(
    "--scheduler",
    metavar="URL",
    help="Run the jobs on the workers of this Dask scheduler (tcp://HOST:8786, tls://HOST:8786, or a scheduler file) "
         "instead of on this computer.",
)
bench_option = click.option("--bench", type=click.Path(path_type=Path), help="Bench file of the rig.")
speed_option = click.option(
    "--speed", type=click.FloatRange(0.01, 1000.0), help="With --simulate: simulated seconds per real second. The "
    "default is 1."
)
seed_option = click.option(
    "--seed", type=click.IntRange(0), help="With --simulate: random seed for the simulated rig. The default is 0."
)
out_option = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=LOGS,
    show_default=True,
    help="Folder in which to create the run.",
)
run_argument = click.argument("run", type=RunPath())
