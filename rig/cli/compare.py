"""`rig compare`: runs side by side, and acceptance bands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.options import Command, json_option
from rig.cli.output import console, say, write_json
from rig.errors import EXIT_DONE, EXIT_NOT_ACCEPTED

if TYPE_CHECKING:
    from rig.comparison import Comparison


@click.command(
    name="compare",
    cls=Command,
    examples=(
        "rig compare logs/BEFORE logs/AFTER",
        "rig compare logs/20260102T030405Z-MR-001-ab12cd --bands examples/acceptance-bands.toml",
        "rig compare logs/BEFORE logs/AFTER --bands examples/acceptance-bands.toml --out comparison.html",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option(
    "--bands", type=click.Path(path_type=Path),
    help="Acceptance bands file: every value passes or fails, with its margin; exit 8 where one does not pass.",
)  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Write the comparison as a page (HTML) to this file.")
@click.option("--all", "everything", is_flag=True, help="Show every value, not only what changed or did not pass.")
@json_option
def command(runs: tuple[Path, ...], bands: Path | None, out: Path | None, everything: bool, as_json: bool) -> int:
    """Hold recorded RUNs against the first of them, and against acceptance bands.

    A damper before and after endurance, two specimens, or one against bands. Only valid points count; motions that
    were tested in both are compared by force at peak velocity, energy, damping and dynamic range, fits by parameters.
    """
    from rig.comparison import compare

    compared = compare(runs, bands)
    if out is not None:
        from rig.recording.atomic_write import write_text_durably
        from rig.report.comparison import comparison_page

        write_text_durably(out, comparison_page(compared))
    page = None if out is None else str(out.resolve())
    if as_json:
        write_json({**compared.to_json(), "report": page})
    else:
        _show(compared, everything=everything)
        if page is not None:
            say(page)
    accepted = compared.judgement is None or compared.judgement.passed
    return EXIT_DONE if accepted else EXIT_NOT_ACCEPTED


def _show(compared: Comparison, *, everything: bool) -> None:
    from rig.cli.comparison_tables import comparison_lines

    shown = console()
    for line, style in comparison_lines(compared, shown.width, everything=everything):
        shown.print(line, style=style, markup=False, soft_wrap=True)
