"""The options that commands share, declared once, and the command class whose help ends with examples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click


class QuantityOption(click.ParamType[float]):
    """A quantity with its unit on the command line, such as 0.5 A."""

    name = "quantity"

    def __init__(self, dimension: str) -> None:
        self.dimension = dimension

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Text to SI; what does not fit is a usage error."""
        from rig.units import UnitProblem, parse

        try:
            return parse(value, self.dimension)
        except UnitProblem as problem:
            self.fail(str(problem), param, ctx)


class Command(click.Command):
    """A command whose help ends with examples, printed as they are typed."""

    def __init__(self, *args: Any, examples: tuple[str, ...] = (), **kwargs: Any) -> None:  # noqa: ANN401 - click's own
        super().__init__(*args, **kwargs)
        self.examples = examples

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The examples, one a line."""
        del ctx
        write_examples(formatter, self.examples)


def write_examples(formatter: click.HelpFormatter, examples: tuple[str, ...]) -> None:
    """Print examples in a help text as they are typed, never wrapped."""
    with formatter.section("Example" if len(examples) == 1 else "Examples"):
        for line in examples:
            formatter.write(f"{'':>{formatter.current_indent}}{line}\n")


json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")
scheduler_option = click.option(
    "--scheduler",
    metavar="URL",
    help="Dask scheduler (tcp://HOST:8786) for the searches; its workers need this software installed.",
)
out_option = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("logs"),
    show_default=True,
    help="Folder in which the run directory is created.",
)
run_argument = click.argument("run", type=click.Path(path_type=Path))
