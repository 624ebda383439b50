"""The report's figures from Python, in one call: each is an SVG of its own, shown by notebooks and saved as a file."""

from __future__ import annotations

from pathlib import Path

from rig.characteristics import characterise
from rig.recording.run import Run
from rig.report import loops, standard
from rig.report.chart import Chart
from rig.report.document import read_fit, views_of
from rig.report.over_current import parameter_charts
from rig.report.traces import chosen, trace_charts


def figures(run: Path | str | Run) -> dict[str, Chart]:
    """Every figure of a run's report by its name.

    Args:
        run: a campaign's directory, or the campaign.

    Returns:
        `overview/MOTION` (force over velocity, all currents), `loops/POINT/displacement`, `loops/POINT/velocity`,
        `loops/POINT/residual`, `traces/POINT/NAME` (over time: displacement, force, current, cycle),
        `parameters/NAME` (over current), `standard/force`, `standard/energy` and `standard/damping` (over peak
        velocity). A notebook shows each; `save(path)` writes it as SVG; `traces` of each holds its arrays.

    Raises:
        FileProblem: the directory is no run, or its `fit.json` is not one of ours.
    """
    campaign = run if isinstance(run, Run) else Run.open(run)
    fit = read_fit(campaign.path)
    views, _ = views_of(campaign, fit)
    measured = {view.point.id: view.measured for view in views if view.measured is not None}
    standard_loops = characterise(campaign, measured).loops
    views = loops.placed_views(views, standard_loops)
    drawn = {f"overview/{motion}": chart for motion, chart in loops.overview_charts(views).items()}
    for view in views:
        drawn |= {f"loops/{view.point.id}/{name}": chart for name, chart in loops.loop_charts(view).items()}
    for view in chosen(views):
        drawn |= {f"traces/{view.point.id}/{name}": chart for name, chart in trace_charts(view).items()}
    drawn |= {f"parameters/{name}": chart for name, chart in parameter_charts(fit or {}).items()}
    charts = standard.plots(standard_loops)
    return {**drawn, **{f"standard/{name}": chart for name, chart in charts.items()}}
