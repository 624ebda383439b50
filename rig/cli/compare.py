"""`rig compare`: comparison of runs, and acceptance bands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

from rig.cli.options import Command, RunPath, json_option, scheduler_option
from rig.cli.output import console, say, show, shown_path, write_json, write_pdf
from rig.errors import EXIT_DONE, EXIT_NOT_ACCEPTED, FileProblem
from rig.jobs.choice import workers_for
from rig.recording.atomic_write import write_text_durably

if TYPE_CHECKING:
    from rig.comparison import Comparison


@click.command(
    name="compare",
    cls=Command,
    examples=(
        "rig compare logs/BEFORE logs/AFTER",
        "rig compare logs/20260102T030405Z-MR-001-ab12cd --bands examples/acceptance-bands.toml",
        "rig compare logs/BEFORE logs/AFTER --bands examples/acceptance-bands.toml --out comparison.html --pdf",
        "rig compare logs/GOLDEN --make-bands bands.toml --tolerance '5 %'",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=RunPath(), metavar="RUN...")
@click.option(
    "--bands", type=click.Path(path_type=Path),
    help="File of acceptance bands. Each value is shown as PASS or FAIL, with its margin; the exit code is 8 if any "
         "value fails.",
)  # fmt: skip
@click.option(
    "--make-bands", "bands_file", type=click.Path(dir_okay=False, path_type=Path), metavar="FILE",
    help="Write an acceptance bands file from golden runs: mean of the runs, plus and minus --tolerance.",
)
@click.option(
    "--tolerance", "tolerances", multiple=True, metavar="[QUANTITY=]VALUE",
    help="With --make-bands: half-width of all bands, such as '5 %', or of the bands of one quantity, such as "
         "'energy=2 J'. Can be specified repeatedly.",
)  # fmt: skip
@click.option(
    "--of-fit", "fitted", is_flag=True,
    help="With --make-bands: use the forces of each run's fitted model instead of the measured forces.",
)
@click.option("--out", type=click.Path(path_type=Path), help="Write the comparison to this HTML file.")
@click.option(
    "--pdf", "on_paper", is_flag=True,
    help="Also write a PDF next to the HTML file. Without --out, both are written next to the first run, as "
         "RUN-comparison.html and RUN-comparison.pdf.",
)  # fmt: skip
@click.option("--all", "everything", is_flag=True, help="Show every value, not only values that changed or failed.")
@scheduler_option
@json_option
def command(
    runs: tuple[Path, ...], bands: Path | None, bands_file: Path | None, tolerances: tuple[str, ...], fitted: bool,
    out: Path | None, on_paper: bool, everything: bool, scheduler: str | None, as_json: bool,
) -> int:  # fmt: skip
    """Compare each recorded RUN with the first, and check all of them against acceptance bands.

    Use this command to compare a damper before and after an endurance test, to compare two specimens, or to check one
    specimen against its tolerances. Only valid points are used. Motions tested in both runs are compared in terms of
    force at peak velocity, energy, damping and dynamic range; fits are compared in terms of their parameters. With
    --bands, up to 1,000 runs are allowed; more than 12 runs are listed only with their verdicts. With --make-bands,
    the acceptance bands are made from golden runs instead.
    """
    if bands_file is not None:
        other = bands is not None or out is not None or on_paper or everything
        return _make_bands(runs, bands_file, tolerances, fitted=fitted, other=other, as_json=as_json)
    _refuse_without_file(tolerances, fitted=fitted)
    # loads numpy and pydantic: not needed for the help
    from rig.comparison import compare
    from rig.comparison.differences import MOST_RUNS

    several = len(runs) > MOST_RUNS
    if several and (on_paper or out is not None):
        _refuse_page(len(runs), MOST_RUNS)
    if on_paper:
        out = _page_of(out, runs[0])
    with workers_for(scheduler, None if several else 1) as workers:
        compared = compare(runs, bands, workers)
    pages: list[str] = [] if out is None else _written(compared, out.resolve(), on_paper=on_paper)
    if as_json:
        report, paper = [*pages, None, None][:2]
        write_json({**compared.to_json(), "report": report, "pdf": paper})
    else:
        _show(compared, everything=everything)
        for page in pages:
            say(shown_path(Path(page)))
    accepted = compared.judgement is None or compared.judgement.passed
    return EXIT_DONE if accepted else EXIT_NOT_ACCEPTED


def _make_bands(
    runs: tuple[Path, ...], file: Path, tolerances: tuple[str, ...], *, fitted: bool, other: bool, as_json: bool
) -> int:
    """Write a bands file from golden runs.

    Raises:
        UsageError: the options contradict each other.
        FileProblem: the file exists or cannot be written.
        RigError: the runs contain no values for bands.
    """
    if other:
        raise click.UsageError("--make-bands cannot be combined with --bands, --out, --pdf or --all")
    if not tolerances:
        raise click.UsageError("--make-bands requires a tolerance. Fix: add, for example, --tolerance '5 %'")
    if file.exists():
        raise FileProblem(str(file), ["the file already exists. Fix: specify another name"])
    # loads numpy and pydantic: not needed for the help
    from rig.comparison.master_curve import make_bands, tolerances_of
    from rig.recording.run import Run

    half_widths = tolerances_of(tolerances)
    made = make_bands([Run.open(run) for run in runs], half_widths, fitted=fitted)
    try:
        write_text_durably(file, made.text)
    except OSError as error:
        raise FileProblem(str(file), [f"cannot be written: {error.strerror or error}"]) from error
    if as_json:
        write_json({"bands_file": str(file.resolve()), "bands": made.count, "remarks": list(made.remarks)})
        return EXIT_DONE
    for remark in made.remarks:
        say(f"remark: {remark}")
    say(f"{made.count} band{'s' * (made.count > 1)} written to {shown_path(file)}. Check the limits before use.")
    return EXIT_DONE


def _refuse_without_file(tolerances: tuple[str, ...], *, fitted: bool) -> None:
    """Refuse options of bands that are not made.

    Raises:
        UsageError: there is one.
    """
    if tolerances or fitted:
        raise click.UsageError(f"{'--tolerance' if tolerances else '--of-fit'} requires --make-bands FILE")


def _refuse_page(count: int, most: int) -> NoReturn:
    """Reject a page with too many runs.

    Raises:
        UsageError: always.
    """
    raise click.UsageError(f"--out and --pdf: got {count} runs, expected at most {most}. Fix: omit these options")


def _page_of(out: Path | None, first: Path) -> Path:
    """The HTML file that a PDF is written next to; by default next to the first run.

    Raises:
        UsageError: `out` is a PDF.
    """
    if out is None:
        first = Path(first).resolve()
        return first.with_name(f"{first.name}-comparison.html")
    if out.suffix == ".pdf":
        raise click.UsageError("--out names the HTML file; the PDF is written next to it. Fix: --out FILE.html")
    return out


def _written(compared: Comparison, page: Path, *, on_paper: bool) -> list[str]:
    """Write the page, and the PDF if that is wanted; their paths."""
    # loads numba and numpy: not needed for the help
    from rig.document import html
    from rig.report.comparison import comparison_document

    document = comparison_document(compared)
    write_text_durably(page, html.page(document))
    return [str(page), *([str(write_pdf(document, page))] if on_paper else [])]


def _show(compared: Comparison, *, everything: bool) -> None:
    # loads numpy and pydantic: not needed for the help
    from rig.cli.comparison_tables import comparison_blocks

    show(comparison_blocks(compared, everything=everything), console())
