"""`rig runs`: which runs there are, how they ended, how well they were fitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rig.cli.options import Command, json_option
from rig.cli.output import console, write_json
from rig.errors import EXIT_DONE, FileProblem
from rig.text_file import read_json


@click.command(name="runs", cls=Command, examples=("rig runs", "rig runs --in /data/dampers --json"))
@click.option(
    "--in", "folder", type=click.Path(path_type=Path), default=Path("logs"), show_default=True,
    help="Folder with the runs.",
)
@json_option
def command(folder: Path, as_json: bool) -> int:
    """List the runs in a folder, oldest first."""
    listed = _listed(folder)
    if as_json:
        write_json({"runs": listed})
    else:
        _show(listed, folder)
    return EXIT_DONE


def _listed(folder: Path) -> list[dict[str, Any]]:
    """One summary a run.

    Raises:
        FileProblem: there is no such folder.
    """
    if not folder.is_dir():
        raise FileProblem(str(folder), ["there is no such folder; runs are made in logs/ or where --out said"])
    return [_summary(place) for place in sorted(folder.iterdir()) if (place / "points").is_dir()]


def _show(runs: list[dict[str, Any]], folder: Path) -> None:
    from rich.table import Table

    shown = console()
    if not runs:
        shown.print(f"no runs in {folder}", markup=False)
        return
    table = Table()
    for name in ("run", "specimen", "points", "valid", "to recover", "fit: error % of peak", "remark"):
        table.add_column(name, justify="left" if name in {"run", "specimen", "remark"} else "right", overflow="fold")
    for run in runs:
        error = run["nrmse_percent_of_peak"]
        table.add_row(
            run["id"], run["specimen"], str(run["points"]), str(run["valid"]), str(run["unfinished"]),
            "-" if error is None else f"{error:.3g}", run["remark"],
        )  # fmt: skip
    shown.print(table)


def _summary(place: Path) -> dict[str, Any]:
    """One run in a few numbers; what cannot be read is said in `remark`, so that one bad run hides no others."""
    from rig.recording.point_files import unfinished
    from rig.recording.run import Run, read_campaign

    summary: dict[str, Any] = {
        "id": place.name, "path": str(place.resolve()), "specimen": "", "points": 0, "valid": 0,
        "unfinished": len(unfinished(place / "points")), "apart": 0, "nrmse_percent_of_peak": None, "remark": "",
    }  # fmt: skip
    try:
        summary["specimen"] = str(read_campaign(place).get("specimen", ""))
        run = Run.open(place)
        summary |= {"points": len(run.points), "valid": sum(point.verdict == "valid" for point in run.points)}
        summary["apart"] = len(run.apart)
        summary["nrmse_percent_of_peak"] = _fit_error(place / "fit.json")
    except FileProblem as error:
        name = f"{Path(error.file).name}: " if error.file.endswith(".json") else ""
        summary["remark"] = name + error.problems[0]
    return summary


def _fit_error(path: Path) -> float | None:
    """The fit's mean error in percent of peak; None when nothing was fitted.

    Raises:
        FileProblem: the file is no fit.
    """
    if not path.is_file():
        return None
    try:
        error = read_json(path)["error"]["nrmse_percent_of_peak"]
        return None if error is None else float(error)
    except (KeyError, TypeError, ValueError) as problem:
        raise FileProblem(str(path), ["not a fit: no error.nrmse_percent_of_peak in it"]) from problem
