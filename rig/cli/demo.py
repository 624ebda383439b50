"""`rig demo`: plan, run, identify and report on the simulated rig, and compare the fit with the true values."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.campaign_folder import CampaignFolder
from rig.cli.options import Command, json_option, out_option
from rig.cli.output import console, show, write_json
from rig.cli.run import show_ending, show_result
from rig.errors import EXIT_DONE

if TYPE_CHECKING:
    from rich.console import Console

MATRIX = Path(__file__).with_name("demo.toml")


@click.command(name="demo", cls=Command, examples=("rig demo", "rig demo --speed 10 --seed 7 --out /tmp/runs"))
@click.option(
    "--speed", type=click.FloatRange(0.1, 100.0), default=25.0, show_default=True,
    help="Speed of the simulated rig, in simulated seconds per real second.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="Random seed for the simulated rig.")
@out_option
@json_option
def command(speed: float, seed: int, out: Path, as_json: bool) -> int:
    """Run a complete example on the simulated rig in under a minute: plan, run, identify, report.

    Only the devices are simulated; processes and sockets are real. The fitted parameters are compared with the true
    parameters of the simulated damper.
    """
    # loads numpy and pyserial: not needed for the help
    from rig.campaign.results import CampaignOptions
    from rig.cli.job import run_job
    from rig.matrix.model import load_matrix

    shown = console(as_json=as_json)
    shown.print(f"Running {MATRIX.name} on a simulated rig, {speed:g} times faster than real time:", markup=False)
    options = CampaignOptions(matrix_path=MATRIX, out=out, simulate=True, speed=speed, seed=seed)
    result = run_job(options, load_matrix(MATRIX).identify, shown)
    if result.exit_code == EXIT_DONE and result.fit is not None:
        error = _show_beside_truth(result.fit, CampaignFolder(result.campaign.campaign).truth, shown)
        show_ending(result, shown, error)
    else:
        show_result(result, shown)
    if as_json:
        write_json(result.to_json())
    return result.exit_code


def _show_beside_truth(fit_path: Path, truth_path: Path, shown: Console) -> str:
    """The fit's 95 % intervals beside the parameters the simulated damper really had; the fit's error, in words."""
    from rich.text import Text

    # loads numba and numpy: not needed for the help
    from rig.cli.fit_tables import fit_error, fit_summary
    from rig.fits.fit_record import FitRecord

    fit, truth = FitRecord.load(fit_path), _true_parameters(truth_path)
    show(fit_summary(fit, truth), shown)
    covered = [entry.holds(truth.get(name)) for name, entry in fit.parameters.items()]
    held, counted = covered.count(True), sum(item is not None for item in covered)
    text = (
        f"{held} of {counted} identifiable parameters: true value within the 95 % interval (1 in 20 is expected "
        "to lie outside)"
    )
    shown.print(Text(text, style="green" if held == counted else "yellow"))
    return fit_error(fit)


def _true_parameters(path: Path) -> dict[str, float]:
    """What the simulated damper's parameters were, from the truth file."""
    import h5py

    with h5py.File(path, "r") as file:
        attributes = file["entry/test"].attrs
        return {name.removeprefix("parameter_"): float(attributes[name]) for name in attributes if _is_value(name)}


def _is_value(name: str) -> bool:
    return name.startswith("parameter_") and name != "parameter_names"
