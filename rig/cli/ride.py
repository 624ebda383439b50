"""`rig ride`: the same car with several fitted dampers, and whether they differ significantly."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from rig.cli.options import Command, FitName, QuantityOption, json_option
from rig.cli.output import console, say, show, shown_path, write_json
from rig.display import SI
from rig.errors import EXIT_DONE
from rig.files.run_display import run_display
from rig.recording.atomic_write import write_text_durably
from rig.vehicle.laws import MOST_A, Control

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rig.display import Display
    from rig.vehicle.laws import Law

LAW_NAMES = ("passive", "skyhook", "groundhook", "hybrid", "inverse")


@click.command(
    name="ride",
    cls=Command,
    examples=(
        "rig ride cfoa-table5-fit1 cfoa-table5-fit2 cfoa-table5-fit3",
        "rig ride logs/20260102T030405Z-MR-001-ab12cd --car my-car.toml --road iso8608-c --law passive --law skyhook",
    ),
)
@click.argument("fits", nargs=-1, required=True, type=FitName())
@click.option("--car", default="compact-suv", show_default=True,
              help="Car file, or the name of a built-in car.")  # fmt: skip
@click.option("--road", default="paper-sweep", show_default=True,
              help="Road file, or the name of a built-in road.")  # fmt: skip
@click.option("--law", "laws", type=click.Choice(LAW_NAMES), multiple=True, default=("passive",), show_default=True,
              help="Control law for the coil current (repeatable).")  # fmt: skip
@click.option("--current", type=QuantityOption("current"), default="0 A", show_default=True,
              help="Constant current for the passive law.")  # fmt: skip
@click.option("--most-current", type=QuantityOption("current"), default="1 A", show_default=True,
              help="Maximum current for the semi-active laws.")  # fmt: skip
@click.option("--members", type=click.IntRange(0, 10_000), default=20, show_default=True,
              help="Number of Monte Carlo samples per fit, for the intervals.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed for the samples.")
@click.option("--out", type=click.Path(path_type=Path), help="Write the report to this HTML file.")
@json_option
def command(
    fits: tuple[str, ...], car: str, road: str, laws: tuple[Law, ...], current: float, most_current: float,
    members: int, seed: int, out: Path | None, as_json: bool,
) -> int:  # fmt: skip
    """Simulate a car on a road with each damper in FITS: fit.json files, runs with a fit, or named parameter sets.

    The output contains the heave, pitch and roll responses, the ISO 2631-1 weighted RMS acceleration, the tyre load,
    the suspension travel and the power. Differences in response between the dampers are given for 4 to 8 Hz and for 0
    to 18 Hz, with the uncertainty due to the fits.
    """
    _check_currents({"--current": current, "--most-current": most_current})
    # loads numba and scipy: not needed for the help
    from rig.study.ride_draws import drawn_again
    from rig.vehicle.answer import as_json as plain
    from rig.vehicle.car import load_car
    from rig.vehicle.fitted_damper import fitted_damper
    from rig.vehicle.ride import ride_study
    from rig.vehicle.road_file import load_road

    controls = [Control(law, current_A=current, most_A=most_current) for law in dict.fromkeys(laws)]
    chosen = [
        drawn_again(fitted_damper(given, members, seed + index), members, seed + index)
        for index, given in enumerate(fits)
    ]
    study = ride_study(load_car(car), load_road(road), chosen, controls, _progress)
    answer, shown = plain(study), _display(fits)
    if out is not None:
        from rig.report.ride import ride_page

        write_text_durably(out, ride_page(study, shown))
        answer["report"] = str(out.resolve())
    if as_json:
        write_json(answer)
        return EXIT_DONE
    # loads numba and scipy: not needed for the help
    from rig.report.ride import differences, numbers, warnings

    show([*differences(study), *numbers(study, shown), *warnings(study)], console())
    if out is not None:
        click.echo(shown_path(out))
    return EXIT_DONE


def _display(fits: Sequence[str]) -> Display:
    """The `[display]` of the first run with one among FITS."""
    folders = [path if path.is_dir() else path.parent for path in map(Path, fits) if path.exists()]
    return next((shown for folder in folders if not (shown := run_display(folder)).usual), SI)


def _check_currents(given: dict[str, float]) -> None:
    for name, value in given.items():
        if not 0.0 <= value <= MOST_A:
            raise click.BadParameter(f"got {value:g} A, expected 0 to {MOST_A:g} A", param_hint=name)


def _progress(done: int, of: int) -> None:
    if done == of or done % 20 == 0:
        say(f"{done}/{of} rides", err=True)
