"""The report's figures from Python, in one call: shown by notebooks, saved as SVG, PDF or PNG."""

from __future__ import annotations

from pathlib import Path

from rig.document.plot import Plot
from rig.recording.run import Run
from rig.report import loops, standard
from rig.report.document import Material
from rig.report.over_current import parameter_figures
from rig.report.traces import chosen, trace_figures


def figures(run: Path | str | Run) -> dict[str, Plot]:
    """Every figure of a run's report by its name.

    Args:
        run: a campaign's directory, or the campaign.

    Returns:
        `overview/MOTION` (force over velocity, all currents), `loops/POINT/displacement`, `loops/POINT/velocity`,
        `loops/POINT/residual`, `traces/POINT/NAME` (over time: displacement, force, current, cycle),
        `parameters/NAME` (over current), `standard/force`, `standard/energy` and `standard/damping` (over peak
        velocity). A notebook shows each; `save(path)` writes `.svg`, `.pdf` or `.png`; `traces` of each holds its
        arrays.

    Raises:
        FileProblem: the directory is no run, or its `fit.json` is not one of ours.
    """
    campaign = run if isinstance(run, Run) else Run.open(run)
    material = Material.of(campaign)
    drawn = {f"overview/{view.figure_name}": figure for view, figure in loops.overview_figures(material.views)}
    for view in material.views:
        drawn |= {f"loops/{view.point.id}/{name}": figure for name, figure in loops.loop_figures(view).items()}
    for view in chosen(material.views):
        drawn |= {f"traces/{view.point.id}/{name}": figure for name, figure in trace_figures(view).items()}
    if material.fit is not None:
        drawn |= {f"parameters/{name}": figure for name, figure in parameter_figures(material.fit).items()}
    plots = standard.plots(material.characteristics.loops, material.display)
    drawn |= {f"standard/{name}": figure for name, figure in plots.items()}
    return {name: Plot(figure) for name, figure in drawn.items()}
