"""`python -m simulators`: the simulated rig as a process of its own, on real wires."""

from __future__ import annotations

import asyncio
import json
import math
import signal
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from drivers.connection import ActuatorAddress, LinkKind
from drivers.devices.supply_file import supply_names
from rig.errors import EXIT_USAGE, FileProblem, RigError
from rig.faults.matrix import MATRIX
from rig.files.described import described
from rig.files.names import is_file
from simulators.bench import BY_HAND
from simulators.emulated_bench import appearing_as
from simulators.emulated_ecu import DEMO_ECU, EmulatedEcuFiles
from simulators.emulated_format import sending
from simulators.injection import NEEDS_AUXILIARY, VARIANTS
from simulators.options import RigOptions, load_options, with_option
from simulators.plant.plant import specimen_model
from simulators.schedule import (
    STREAMED,
    WITHIN_S,
    ScheduledFault,
    Wiring,
    check_source,
    drawn_faults,
    parse_fault,
    wiring_for,
)
from simulators.settings import setting_options, with_settings
from simulators.specimens import as_specimen

if TYPE_CHECKING:
    pass

MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
"""Where writing never waits for a disk."""
EPILOG = """\b
Example:
  python -m simulators --speed 10 --truth truth.h5
  rig run examples/quick.toml --bench <the path it prints>
"""


def list_faults(as_json: bool) -> None:
    """Print the fault matrix: slug, where, whether the fault suite proves it, and if not, why."""
    rows = []
    for slug, row in MATRIX.items():
        variants = [name for name in VARIANTS if name.startswith(f"{slug}:")]
        entry = {
            "slug": slug, "where": row.where, "place": row.place, "reaction": row.reaction, "limit": row.limit,
            "exit_code": row.exit_code, "tested": row.tested, "test": row.test, "reason": row.reason,
            "variants": variants,
        }
        rows.append(entry)
    if as_json:
        click.echo(json.dumps(rows, indent=1))
        return
    for entry in rows:
        click.echo(f"{entry['slug']:18} {entry['where']:8} {entry['reaction']:28} {entry['reason'] or 'tested'}")
        for name in VARIANTS:
            if name.startswith(f"{entry['slug']}:"):
                click.echo(f"  {name}")


def hints(bench: Path, text: str) -> str:
    """What is where, and commands of other people's tools to try on it."""
    import tomllib

    values: dict[str, Any] = tomllib.loads(text)
    modbus = values["actuator"]["url"]
    lines = [
        f"bench file   {bench}",
        f"actuator     {modbus}      {_mbpoll(modbus)}",
        _current_source(values["ecu"]),
    ]
    sensors = [(name, values[name]) for name in ("load_cell", "lvdt")]
    sensors += [(sensor["name"], sensor) for sensor in values.get("auxiliary", [])]
    for name, sensor in sensors:
        shown = sensor["format"] if isinstance(sensor["format"], str) else "described format"
        where = f"slcan {sensor['channel']}" if "channel" in sensor else (
            f"{sensor['url']}      python -m serial {sensor['url']} 921600"
        )
        lines.append(f"{name:12} {shown} {sensor['rate']} {where}")
    return "\n".join(lines)


def _current_source(ecu: dict[str, Any]) -> str:
    """Where the coil's current comes from, and how to look at it."""
    if (url := ecu.get("url", ecu.get("rehearsal"))) is not None:
        if not url.startswith("tcp:"):
            return f"output       {url}      mbpoll -m tcp -a 1 -p {url.rpartition(':')[2]} 127.0.0.1"
        host, _, port = url.removeprefix("tcp://").rpartition(":")
        return f"supply       {url}      nc {host} {port}"
    return f"current ECU  slcan {ecu['channel']}      python -m can.viewer -i slcan -c {ecu['channel']} -b 500000"


def _mbpoll(url: str) -> str:
    """The mbpoll command that reads the status block at this URL."""
    address = ActuatorAddress.parse(url)
    if address.kind is LinkKind.MODBUS_RTU:
        return f"mbpoll -m rtu -b 115200 -P none -a 1 -0 -r 100 -c 34 -1 {address.line}"
    return f"mbpoll -m tcp -p {address.port} -a 1 -0 -r 100 -c 34 -1 {address.host}"


async def serve(arguments: dict[str, Any]) -> None:
    """Open everything, say so, run until stopped or signalled, complete the truth file.

    Raises:
        OSError: a socket, the bench file or the truth file cannot be had.
    """
    # loads pymodbus: not needed for the help
    from simulators.rig import SimulatedRig, take_real_time_priority

    rig = SimulatedRig(arguments["options"], arguments["run"])
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, rig.stop)
    rig.warm_up()
    addresses = await rig.open()
    real_time = arguments["real_time"] and take_real_time_priority(arguments["run"].speed)
    with tempfile.TemporaryDirectory(prefix="simulated-rig-", dir=MEMORY) as folder:
        if not arguments["real_time"] and not arguments["run"].drop_unread:
            rig.share_clock(Path(folder) / "clock", addresses)
        text = rig.bench(addresses, real_time)
        bench = arguments["bench"] or Path(folder) / "bench.toml"
        bench.write_text(text, encoding="utf-8")
        if arguments["json"]:
            faults = [str(fault) for fault in arguments["run"].faults]
            click.echo(json.dumps({"bench": str(bench.absolute()), "faults": faults}))
        else:
            click.echo(str(bench.absolute()))
        sys.stdout.flush()
        click.echo(hints(bench, text), err=True)
        if arguments["run"].faults:
            reported = " ".join(f"--fault {fault}" for fault in arguments["run"].faults)
            click.echo(f"faults       {reported}", err=True)
        try:
            await rig.run()
        finally:
            for number in (signal.SIGTERM, signal.SIGINT):
                asyncio.get_running_loop().remove_signal_handler(number)
                signal.signal(number, signal.SIG_DFL)  # a second one ends a wait for room on a full disk
            await rig.close()
    click.echo(rig.summary(), err=True)


def made_of(values: dict[str, Any]) -> RigOptions:
    """What the rig is made of, from the command line.

    Raises:
        FileProblem: a file or an option cannot be used.
        RigError: an unknown damper model or set.
    """
    from dataclasses import replace

    options = load_options(values["config"]) if values["config"] else RigOptions()
    assignments = [*values["option"], *(f"specimen.{text}" for text in values["specimen"])]
    if values["model"]:
        assignments.append(f'damper.model="{values["model"]}"')
    if values["parameter_set"]:
        assignments.append(f'damper.set="{values["parameter_set"]}"')
    for assignment in assignments:
        options = with_option(options, assignment)
    options = with_settings(options, values)
    if values["specimens"] is not None:
        options = as_specimen(options, Path(values["specimens"]))
    try:
        specimen_model(options.damper)
    except (KeyError, ValueError) as error:
        raise FileProblem("damper", [str(error.args[0])]) from None
    if values["rate"] is not None:
        for table in ("load_cell", "lvdt", "auxiliary"):
            options = with_option(options, f"{table}.rate_Hz={values['rate']}")
    if values["register_map"] is not None:
        options = appearing_as(options, values["register_map"])
    limits = options.limits
    if (force := values["force_format"]) is not None:
        options = replace(options, load_cell=sending(options.load_cell, force, "--force-format", limits.force_N))
    if (displacement := values["displacement_format"]) is not None:
        lvdt = sending(options.lvdt, displacement, "--displacement-format", limits.position_m)
        options = replace(options, lvdt=lvdt)
    return options


def collect(values: dict[str, Any]) -> dict[str, Any]:
    """Options and run options from the command line.

    Raises:
        FileProblem: a file or an option cannot be used.
        RigError: an unknown damper model or set.
    """
    from dataclasses import replace

    from simulators.rig import RunOptions

    options = made_of(values)
    emulated_ecu = emulated(values["dbc"], values["ecu_roles"])
    if values["by_hand"]:
        values = {**values, "supply": BY_HAND}
    written = tuple(parse_fault(text) for text in values["fault"])
    check_source(written, supply=bool(values["supply"]))
    wiring = wiring_for(written, values["actuator"], values["ports"])
    if wiring.actuator == STREAMED:
        options = replace(options, controller=replace(options.controller, generator=False))
    for fault in written:
        if fault.name in NEEDS_AUXILIARY and not values["auxiliary"]:
            raise FileProblem("--fault", [f"{fault.name!r} requires an auxiliary sensor. Fix: add --auxiliary 1"])
    run = RunOptions(
        speed=values["speed"],
        seed=values["seed"],
        ports=wiring.ports,
        actuator=wiring.actuator,
        supply=_supply(values["supply"]),
        by_hand=values["by_hand"] or "",
        auxiliary=values["auxiliary"],
        truth=values["truth"],
        exit_when_idle=values["exit_when_idle"],
        emulated_ecu=emulated_ecu,
        drop_unread=values["drop_unread"],
        faults=(*written, *drawn(values, wiring)),
    )
    settings = {"bench": values["bench"], "json": values["as_json"], "real_time": values["real_time"]}
    return {"options": options, "run": run, **settings}


def _supply(given: str) -> str:
    """The supply's preset or file, looked at.

    Raises:
        FileProblem: unknown, or everything that is wrong with the file.
    """
    if is_file(given):
        described("supply", given)
    elif given and given not in supply_names():
        known = ", ".join(supply_names())
        raise FileProblem("--supply", [f"unknown supply {given!r}; expected one of {known}, or a file NAME.toml"])
    return given


def emulated(dbc: Path | None, roles: Path | None) -> EmulatedEcuFiles:
    """A user's files that describe the current ECU; the demo's where none are given.

    Raises:
        FileProblem: one without the other, or they cannot be used: everything that is wrong.
    """
    # loads pydantic: not needed for the help
    from rig.files.ecu_files import ecu_problems
    if dbc is None and roles is None:
        return DEMO_ECU
    if dbc is None or roles is None:
        raise FileProblem("--dbc", ["requires --ecu-roles, and vice versa"])
    problems = ecu_problems(str(dbc), str(roles))
    if problems:
        raise FileProblem("--dbc", [text for _, text in problems])
    return EmulatedEcuFiles(dbc.absolute(), roles.absolute())


def drawn(values: dict[str, Any], wiring: Wiring) -> tuple[ScheduledFault, ...]:
    """The faults drawn from a seed, if one was given, among those that can happen on these wires.

    Raises:
        FileProblem: not a time.
    """
    if values["fault_seed"] is None:
        return ()
    within_s = float(values["fault_within"])
    if not math.isfinite(within_s):
        raise FileProblem("--fault-within", [f"{within_s}: expected a number of seconds, 0 or greater"])
    return drawn_faults(values["fault_seed"], wiring.kinds, within_s, supply=bool(values["supply"]))


def refuse(message: str, as_json: bool) -> NoReturn:
    """Say what is wrong and end with exit code 2.

    Raises:
        SystemExit: always.
    """
    click.echo(message, err=True)
    if as_json:
        click.echo(json.dumps({"error": message}))
    raise SystemExit(EXIT_USAGE)


FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.option("--speed", type=click.FloatRange(0.01, 1000.0), default=1.0, show_default=True,
              help="Simulated seconds per real second (upper limit).")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed for noise, clock "
    "offsets and drifts.")
@click.option("--truth", type=FILE, help="Write the true state of the simulated rig to this HDF5 file.")
@click.option("--bench", type=FILE, help="Write the bench file to this path instead of a temporary folder.")
@click.option("--config", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="TOML file with constants that replace the defaults.")
@click.option("--option", metavar="TABLE.KEY=VALUE", multiple=True, help="Replace one constant (repeatable).")
@click.option("--model", help="Damper model for the specimen.")
@click.option("--set", "parameter_set", help="Parameter set for the specimen.")
@click.option("--specimen", metavar="KEY=VALUE", multiple=True,
              help="Property of the specimen: serial_number, mid_stroke_m or stroke_m (repeatable).")
@click.option("--specimens", metavar="FILE", help="Specimens file: properties of the damper by its serial number.")
@click.option("--force-format", metavar="FORMAT",
              help="Data format of the load cell: a name or a file.  [default: frame16]")
@click.option("--displacement-format", metavar="FORMAT", help="Data format of the LVDT.  [default: frame16]")
@click.option("--by-hand", type=click.Choice(["off", "low", "on"]), default=None,
              help="Rehearse with a manually set current; the value is the state of the pressure while the "
                   "operator is at the supply.")
@click.option("--register-map", metavar="MAP",
              help="Simulate a controller with this register map: a file, or the name of a built-in map.")
@click.option("--supply", default="", metavar="NAME|FILE",
              help="Drive the coil with a power supply instead of the ECU: a preset, or your own file.")
@click.option("--dbc", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Simulate the ECU that this DBC file describes (requires --ecu-roles).")
@click.option("--ecu-roles", type=click.Path(path_type=Path, exists=True, dir_okay=False),
              help="Roles file, which defines the meaning of the signals in the DBC file.")
@click.option("--rate", type=click.FloatRange(1.0, 10_000.0), help="Sampling rate of all sensors (Hz).")
@click.option("--auxiliary", type=click.IntRange(0, 4), default=0, show_default=True, help="Number of auxiliary "
    "channels.")
@click.option("--ports", type=click.Choice(["pty", "socket", "by-id"]),
              help="How the sensors are connected; by-id: device names with serial numbers.  [default: pty, or by-id "
                   "if a fault requires it]")
@click.option("--actuator", type=click.Choice(["tcp", "rtu", "setpoints"]),
              help="Controller: Modbus TCP, Modbus RTU (port as in --ports), or streamed set-points over TCP without a "
                  "function generator.  [default: tcp, unless a fault requires another one]")
@click.option("--real-time/--no-real-time", default=False, show_default=True,
              help="Run in real time, as hardware does: with real-time priority if permitted and, at speed 1, with the "
                  "timing limits of real hardware. By default, the rig's clock waits while the computer is busy.")
@click.option("--drop-unread", is_flag=True,
              help="Drop and count data that are not read in time, as real ports do. By default, the rig's clock waits "
                  "for its readers (up to about half a second).")
@setting_options
@click.option("--fault", metavar="SLUG[:VARIANT][@T[+D]]", multiple=True,
              help="Inject a fault T s (simulated time) after the first cycle begins, for D s (repeatable).")
@click.option("--fault-seed", type=click.IntRange(0), metavar="N",
              help="Draw one to three random faults with seed N; they are printed at the start as --fault options.")
@click.option("--fault-within", type=click.FloatRange(0.0, 1e6), default=WITHIN_S, show_default=True, metavar="S",
              help="Latest start of a random fault, in simulated seconds after the first cycle begins.")
@click.option("--exit-when-idle", is_flag=True, help="Stop the rod and exit when the parent process ends.")
@click.option("--list-faults", "listing", is_flag=True, help="List the fault matrix and exit.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON to standard output.")
def main(listing: bool, **values: Any) -> None:  # noqa: ANN401 (click hands options over by name)
    """Run a simulated rig: an actuator on Modbus TCP, a current ECU on slcan, and sensors on serial ports.

    The first line of output, printed once every socket is open, is the path to the rig's bench file. SIGTERM or Ctrl-C
    stops the rig.
    """
    if listing:
        list_faults(bool(values["as_json"]))
        return
    try:
        arguments = collect(values)
        asyncio.run(serve(arguments))
    except RigError as error:
        refuse(str(error), bool(values["as_json"]))
    except OSError as error:
        refuse(f"the simulated rig cannot start: {error}", bool(values["as_json"]))


if __name__ == "__main__":
    main(prog_name="python -m simulators")
