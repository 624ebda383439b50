"""`rig quality`: is the process right - control charts, golden damper, gauge R&R, capability."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from protocols.near_miss import near_names
from rig.campaign_folder import LOGS
from rig.cli.delivering import ServerAddress
from rig.cli.options import Command, QuantityOption, json_option
from rig.cli.output import console, progress_bar, say, show, shown_path, write_json, write_pdf
from rig.display import SI, Display
from rig.errors import EXIT_DONE, EXIT_NOT_ACCEPTED, FileProblem
from rig.files.run_display import run_display
from rig.recording.atomic_write import write_text_durably

if TYPE_CHECKING:
    from rig.process_quality.document import Study
    from rig.results.reader import ResultRow

KINDS = ("charts", "golden", "gauge")
TEMPERATURE = "coil_temperature"
MOST_SHOWN = 20
"""Rows of a table on the terminal."""


@click.command(
    name="quality", cls=Command,
    examples=(
        "rig quality --in logs --quantity rebound_force --bands examples/acceptance-bands.toml --out quality.html",
        "rig quality golden --specimen GOLD-1 --date 2026",
        "rig quality gauge --in study --low 900 --high 1100 --quantity rebound_force",
    ),
)
@click.argument("kind", type=click.Choice(KINDS), default="charts", required=False)
@click.option("--in", "folder", type=click.Path(path_type=Path), default=LOGS, show_default=True,
              help="Folder that contains the runs.")
@click.option("--results", "url", type=ServerAddress(), metavar="URL",
              help="Address of a results database, such as postgresql://HOST/NAME, instead of a folder.")
@click.option("--specimen", metavar="TEXT",
              help="Serial number (for golden: of the golden damper); * and ? are wildcards.")
@click.option("--date", metavar="DATE", help="Start date (UTC): 2026, 2026-11, 2026-11-23 or a range FIRST:LAST.")
@click.option("--quantity", multiple=True, metavar="NAME",
              help="Quantity, such as rebound_force, or a fitted parameter (repeatable; * and ? are wildcards).  "
                   "[default: all damper values that are measured without a model]")
@click.option("--matrix", metavar="TEXT", help="Name of the matrix file.")
@click.option("--station", metavar="TEXT", help="Name of the station.")
@click.option("--operator", metavar="TEXT", help="Name of the operator.")
@click.option("--current", type=QuantityOption("current"), help="Current level, such as '0.5 A'.")
@click.option("--baseline", type=click.IntRange(8), metavar="N",
              help="Number of campaigns, from the first, that determine the control limits (phase I).  [default: "
                   "25; all if there are fewer (golden: all but the last)]")
@click.option("--by", type=click.Choice(["operator", "station"]), default="operator", show_default=True,
              help="For gauge: determine the reproducibility between operators or between stations.")
@click.option("--bands", type=click.Path(path_type=Path), help="Acceptance bands file: limits for capability.")
@click.option("--low", type=float, metavar="VALUE", help="Lower limit for all selected values (SI unit).")
@click.option("--high", type=float, metavar="VALUE", help="Upper limit for all selected values (SI unit).")
@click.option("--reference", type=float, metavar="VALUE",
              help="Reference value of the only specimen, for the bias of the measurement (SI unit).")
@click.option("--out", type=click.Path(path_type=Path), help="Write the page with all charts to this HTML file.")
@click.option("--pdf", "on_paper", is_flag=True, help="With --out: also write a PDF next to it.")
@json_option
def command(
    kind: str, folder: Path, url: str | None, quantity: tuple[str, ...], current: float | None, baseline: int | None,
    by: str, bands: Path | None, low: float | None, high: float | None, reference: float | None, out: Path | None,
    on_paper: bool, as_json: bool, **filters: str | None,
) -> int:  # fmt: skip
    """Check the test process by means of all runs in a folder or a results database.

    charts: control charts (individual values and moving ranges, Western Electric rules) of each value, and capability
    if limits are stated. golden: comparison of a golden damper with its own history, which shows what has drifted:
    force, displacement, current, temperature or the damper. gauge: repeatability and reproducibility by analysis of
    variance.

    The terminal and the page use the units of [display] of the newest run. JSON output and values from a server are
    in SI units.

    The exit code is 8 if a chart has a signal after phase I, or if the golden damper has a signal on its last day.
    """
    _check_options(out, on_paper=on_paper, low=low, high=high, bands=bands)
    # load scipy and SQLAlchemy: not needed for the help
    from rig.comparison.bands import load_bands
    from rig.process_quality.display_units import in_display
    from rig.process_quality.study import GoldenStudy, Limits, chart_study, gauge_studies, golden_study, json_of

    rows = _rows(kind, folder, url, quantity, current, filters)
    stated = None if bands is None else load_bands(bands)

    def made(rows: Sequence[ResultRow], display: Display) -> Study:
        limits = Limits(stated, low, high, reference, display)
        if kind == "golden":
            return golden_study(rows, baseline)
        if kind == "gauge":
            return gauge_studies(rows, "station" if by == "station" else "operator", limits)
        return chart_study(rows, baseline, limits)

    study, display = made(rows, SI), _display(folder, url, rows)
    people = study if display.usual or isinstance(study, GoldenStudy) else made(in_display(rows, display), display)
    pages = [] if out is None else _written(people, rows, out.resolve(), display, on_paper=on_paper)
    if as_json:
        report, paper = [*map(str, pages), None, None][:2]
        write_json({**json_of(study, kind), "report": report, "pdf": paper})
    else:
        _show(people, pages, display)
    return EXIT_DONE if getattr(study, "passed", True) else EXIT_NOT_ACCEPTED


def _check_options(
    out: Path | None, *, on_paper: bool, low: float | None, high: float | None, bands: Path | None
) -> None:
    """Reject options that contradict each other.

    Raises:
        UsageError: they do.
    """
    if on_paper and out is None:
        raise click.UsageError("--pdf is written next to the HTML file. Fix: add --out FILE.html")
    if out is not None and out.suffix == ".pdf":
        raise click.UsageError("--out names the HTML file; the PDF is written next to it. Fix: --out FILE.html --pdf")
    if bands is not None and (low is not None or high is not None):
        raise click.UsageError("--bands and --low or --high both state limits. Fix: omit one of them")
    if low is not None and high is not None and not low < high:
        raise click.UsageError(f"--low {low:g} is not below --high {high:g}. Fix: exchange them")


def _rows(
    kind: str, folder: Path, url: str | None, quantity: Sequence[str], current: float | None,
    filters: dict[str, str | None],
) -> list[ResultRow]:
    """The selected rows; without a requested quantity those that the study uses.

    Raises:
        FileProblem: no run can be read, or a filter is not valid or matches no campaign.
    """
    from rig.process_quality.series import usual
    from rig.results.reader import ResultFilter, open_results, result_rows, unmatched

    rows: list[ResultRow] = []
    with progress_bar("reading new runs") as progress, open_results(folder, url, progress) as (database, _):
        for name in quantity or (None,):
            wanted: dict[str, Any] = {**filters, "quantity": name, "current_A": current}
            read = list(result_rows(database, ResultFilter(**wanted)))
            if name is not None and not read:
                _check_quantity(name)
            rows += read
        named: dict[str, Any] = {**filters}
        if not rows and (problems := unmatched(database, ResultFilter(**named))):
            place = "rig quality" if kind == KINDS[0] else f"rig quality {kind}"
            raise FileProblem(place, [f"no value matches. {problem}. Fix: correct the filter" for problem in problems])
    if kind == "golden":
        return [row for row in rows if row.point]
    chosen = rows if quantity else usual(rows)
    return [row for row in chosen if row.quantity != TEMPERATURE] if kind == "gauge" and not quantity else chosen


def _check_quantity(name: str) -> None:
    """Reject a quantity without any value whose name looks like another one.

    Raises:
        UsageError: it does.
    """
    from rig.results.quantities import QUANTITIES

    near = near_names(name, QUANTITIES)
    if name not in QUANTITIES and near:
        raise click.UsageError(f"--quantity {name}: no such value. Fix: did you mean {' or '.join(near)}?")


def _display(folder: Path, url: str | None, rows: Sequence[ResultRow]) -> Display:
    """Units and signs of the newest of the runs; as usual for a server, which has no run directories.

    Raises:
        FileProblem: the `[display]` table of that run is not valid.
    """
    from rig.process_quality.series import when  # loads SQLAlchemy: not needed for the help

    return SI if url is not None or not rows else run_display(folder / max(rows, key=when).run)


def _written(
    study: Study, rows: Sequence[ResultRow], page: Path, display: Display, *, on_paper: bool
) -> list[Path]:
    from rig.document import html
    from rig.process_quality.document import document_of

    simulated = bool(rows) and all(row.simulated for row in rows)
    document = document_of(study, simulated=simulated, display=display)
    write_text_durably(page, html.page(document))
    return [page, *([write_pdf(document, page)] if on_paper else [])]


def _show(study: Study, pages: Sequence[Path], display: Display) -> None:
    from rig.process_quality.document import blocks_of

    show(blocks_of(study, MOST_SHOWN, display), console())
    for page in pages:
        say(shown_path(page))

