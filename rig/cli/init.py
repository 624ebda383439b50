"""`rig init`: a commented bench and matrix file to start from, and the schemas by which editors complete them."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path, PurePath
from string import Template

import click

from rig.cli.options import Command, json_option
from rig.cli.output import say, shown_path, write_json
from rig.errors import EXIT_DONE, FileProblem
from rig.files.described import described
from rig.files.names import is_dbc, is_file
from rig.units import UnitProblem, parse

BENCH, MATRIX = "bench.toml", "matrix.toml"
DIALECT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True)
class Question:
    """One question: key of the templates, what is asked, the default answer, and its dimension if any."""

    key: str
    text: str
    default: str
    dimension: str = ""


QUESTIONS = (
    Question("name", "Name of the rig", "my rig"),
    Question("actuator", "Controller: a preset, or the path to a register map", "demo"),
    Question("actuator_url", "Address of the controller", "modbus-tcp://192.168.0.10:502"),
    Question("ecu", "Coil current: an ECU preset, a DBC file (with NAME-roles.toml), a supply, or by-hand", "demo"),
    Question("interface", "CAN interface (python-can)", "socketcan"),
    Question("channel", "CAN channel", "can0"),
    Question("supply_url", "Address of the supply", "tcp://192.168.0.20:5025"),
    Question("force", "Data format of the load cell", "frame16"),
    Question("force_url", "Port of the load cell", "/dev/serial/by-id/usb-load-cell"),
    Question("force_range", "Full scale of the load cell", "10 kN", "force"),
    Question("displacement", "Data format of the displacement sensor", "frame16"),
    Question("displacement_url", "Port of the displacement sensor", "/dev/serial/by-id/usb-lvdt"),
    Question("displacement_range", "Full scale of the displacement sensor", "100 mm", "length"),
    Question("travel", "Maximum displacement on either side of mid-stroke", "60 mm", "length"),
    Question("speed", "Maximum speed", "0.5 m/s", "speed"),
    Question("acceleration", "Maximum acceleration", "20 m/s^2", "acceleration"),
    Question("force_limit", "Maximum force", "5 kN", "force"),
    Question("current", "Maximum coil current", "2 A", "current"),
    Question("specimen", "Serial number of the damper", "MR-001"),
    Question("stroke", "Stroke of the damper (total)", "170 mm", "length"),
    Question("amplitude", "Amplitude of the first tests", "20 mm", "length"),
)


BY_HAND = "by-hand"
"""The answer to the question for the coil's current if an operator sets it."""
OF_A_SUPPLY, NOT_OF_A_SUPPLY = frozenset({"supply_url"}), frozenset({"interface", "channel"})


@click.command(
    name="init", cls=Command,
    examples=("rig init my-lab", "rig init my-lab --yes --actuator demo --force laumas-fast"),
)
@click.argument("folder", type=click.Path(file_okay=False, path_type=Path), default=Path(), metavar="[DIR]")
@click.option("--actuator", metavar="NAME", help="Type of controller: a preset, or the path to a register map.")
@click.option("--ecu", metavar="NAME",
              help="Current source: a preset, a DBC file (with its roles in NAME-roles.toml), a supply, or by-hand.")
@click.option("--force", metavar="FORMAT", help="Data format of the load cell.")
@click.option("--displacement", metavar="FORMAT", help="Data format of the displacement sensor.")
@click.option("--yes", is_flag=True, help="Do not ask questions; use the defaults for all values not specified.")
@json_option
def command(folder: Path, yes: bool, as_json: bool, **given: str | None) -> int:
    """Write bench.toml, matrix.toml and their JSON schemas into DIR; existing files are kept.

    Without --yes, the command asks for each value if it is run in a terminal. Both files are valid as written:
    `rig plan` and `rig run --simulate` accept them.
    """
    answers = {question.key: given.get(question.key) or "" for question in QUESTIONS}
    _check_names(answers)
    asks = not (yes or as_json) and sys.stdin.isatty()
    for question in QUESTIONS:
        if not answers[question.key]:
            needless = question.key in _needless(answers["ecu"])
            answers[question.key] = _ask(question) if asks and not needless else question.default
    written = write_files(folder, answers)
    if as_json:
        write_json({"folder": folder.resolve(), "files": [path.name for path in written]})
        return EXIT_DONE
    for path in written:
        say(f"written: {shown_path(path)}")
    bench, matrix = (shlex.quote(str(folder / name)) for name in (BENCH, MATRIX))
    say(f'next: check the entries marked "yours" in {bench}, then run:\n  rig check {bench}\n  rig plan {matrix} '
        f"--bench {bench}\n  rig run {matrix} --bench {bench} --simulate --speed 5")
    return EXIT_DONE


def _ask(question: Question) -> str:
    """Ask until the answer can be used."""
    while True:
        answer = str(click.prompt(question.text, default=question.default, err=True)).strip().replace('"', "")
        if not question.dimension:
            try:
                _check_names({question.key: answer})
            except click.UsageError as error:
                click.echo(error.format_message(), err=True)
                continue
            return answer
        try:
            parse(answer, question.dimension)
        except UnitProblem as problem:
            click.echo(str(problem), err=True)
            continue
        return answer


def _check_names(answers: Mapping[str, str]) -> None:
    """Hold names of devices against those that there are; a path is held against the disk later.

    Raises:
        UsageError: there is no such device; the known ones are listed.
    """
    # loads pyserial: not needed for the help
    from drivers.catalogue import actuator_names, known_current_source_names, sensor_format_names, supply_names

    known = {
        "actuator": actuator_names(), "ecu": (*known_current_source_names(), *supply_names(), BY_HAND),
        "force": sensor_format_names(),
        "displacement": sensor_format_names(),
    }
    unknown = [
        f"--{key}: got {answers[key]!r}, expected {', '.join(names)}, or a file" for key, names in known.items()
        if answers.get(key) and answers[key] not in names and not (is_file(answers[key]) or is_dbc(answers[key]))
    ]
    if unknown:
        raise click.UsageError("\n".join(unknown))


def write_files(folder: Path, answers: Mapping[str, str]) -> list[Path]:
    """Write the files and hold them against what reads them; where they cannot be read, none is left.

    Args:
        folder: made where it is missing.
        answers: by key of `QUESTIONS`; the path of a file is made relative to the folder.

    Raises:
        FileProblem: one of them is there already, or a named file cannot be used.
        OSError: they cannot be written.
    """
    # loads numpy and pyserial: not needed for the help
    from rig.bench.model import Bench
    from rig.matrix.model import Matrix, load_files

    filled = {key: _from(folder, answer) for key, answer in answers.items()}
    dbc = is_dbc(filled["ecu"])
    filled["roles"] = f'roles = "{PurePath(filled["ecu"]).with_suffix("")}-roles.toml"' if dbc else "# roles = ..."
    filled["ecu_table"] = _filled(_template(answers["ecu"]), filled)
    texts = {name: _filled(name, filled) for name in (BENCH, MATRIX)}
    for name, model in (("bench.schema.json", Bench), ("matrix.schema.json", Matrix)):
        schema = {"$schema": DIALECT, **model.model_json_schema(by_alias=True)}
        texts[name] = json.dumps(schema, indent=1) + "\n"
    there = [name for name in texts if (folder / name).exists()]
    if there:
        raise FileProblem(str(folder), [f"{name} already exists. Fix: specify another folder" for name in there])
    paths: list[Path] = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            with (folder / name).open("x", encoding="utf-8") as file:
                file.write(text)
            paths.append(folder / name)
        Bench.load(folder / BENCH)
        load_files(folder / MATRIX, folder / BENCH)
    except (FileProblem, OSError):
        for path in paths:
            path.unlink()
        raise
    return paths


def _needless(ecu: str) -> frozenset[str]:
    """Questions that have no meaning for a current source."""
    if ecu == BY_HAND:
        return OF_A_SUPPLY | NOT_OF_A_SUPPLY
    return NOT_OF_A_SUPPLY if _is_supply(ecu) else OF_A_SUPPLY


def _template(ecu: str) -> str:
    """The table of a current source: by hand, an analogue output, a supply, an ECU.

    Raises:
        FileProblem: a supply's file cannot be used: everything that is wrong.
    """
    if ecu == BY_HAND:
        return "by_hand.toml"
    if not _is_supply(ecu):
        return "ecu.toml"
    # loads pyserial: not needed for the help
    from drivers.catalogue import supply
    return "supply.toml" if supply(described("supply", ecu)).output is None else "output.toml"


def _is_supply(answer: str) -> bool:
    """The current comes from a programmable supply: a preset's name, or a file of its language."""
    # loads pyserial: not needed for the help
    from drivers.catalogue import supply_names

    return answer in supply_names() or answer.endswith(".toml")


def _from(folder: Path, answer: str) -> str:
    """An answer; the path of a file as the folder's files name it."""
    if not ((is_file(answer) or is_dbc(answer)) and Path(answer).is_file()):
        return answer
    # `..` leads out of the folder that a link leads to.
    named = Path(answer).parent.resolve() / Path(answer).name
    return Path(os.path.relpath(named, folder.resolve())).as_posix()


def _filled(name: str, answers: Mapping[str, str]) -> str:
    """A template with the answers in it."""
    template = (files("rig.cli") / "templates" / name).read_text(encoding="utf-8")
    return Template(template).substitute(answers)
