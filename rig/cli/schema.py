"""`rig schema`: JSON schemas of the files a user writes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from rig.cli.options import Command, json_option
from rig.cli.output import write_json
from rig.errors import EXIT_DONE

if TYPE_CHECKING:
    from pydantic import BaseModel


def _bench() -> dict[str, Any]:
    # loads pyserial and pydantic: not needed for the help
    from rig.bench.model import Bench

    return Bench.model_json_schema(by_alias=True)


def _matrix() -> dict[str, Any]:
    # loads numpy and pyserial: not needed for the help
    from rig.matrix.model import Matrix

    return Matrix.model_json_schema(by_alias=True)


def _car() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.vehicle.car import Car

    return Car.model_json_schema(by_alias=True)


def _road() -> dict[str, Any]:
    # loads numpy and pydantic: not needed for the help
    from rig.vehicle.road_file import RoadFile

    return RoadFile.model_json_schema(by_alias=True)


def _bands() -> dict[str, Any]:
    # loads numpy and pydantic: not needed for the help
    from rig.comparison.bands import Bands

    return Bands.model_json_schema(by_alias=True)


def _specimens() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.files.specimens import SpecimensFile

    return SpecimensFile.model_json_schema(by_alias=True)


def _register_map() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.files.register_map import RegisterMapFile

    return RegisterMapFile.model_json_schema(by_alias=True)


def _ecu_roles() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.files.ecu_roles import RolesFile

    schema: dict[str, Any] = RolesFile.model_json_schema(by_alias=True)
    return schema


def _supply() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.files.supply import OutputFile, SupplyFile

    return _either(SupplyFile, OutputFile)


def _sensor_format() -> dict[str, Any]:
    # loads pydantic: not needed for the help
    from rig.files.sensor_format import FrameFormatFile, LineFormatFile, ModbusFormatFile

    return _either(LineFormatFile, FrameFormatFile, ModbusFormatFile)


def _either(*models: type[BaseModel]) -> dict[str, Any]:
    """The schema of a file of one of several kinds."""
    from pydantic.json_schema import models_json_schema

    _, definitions = models_json_schema([(model, "validation") for model in models], by_alias=True)
    return {"anyOf": [{"$ref": f"#/$defs/{model.__name__}"} for model in models], **definitions}


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "bench": _bench, "matrix": _matrix, "register-map": _register_map, "ecu-roles": _ecu_roles,
    "sensor-format": _sensor_format, "supply": _supply, "car": _car, "road": _road, "bands": _bands,
    "specimens": _specimens,
}  # fmt: skip
"""Kind of file -> what makes its schema."""


@click.command(name="schema", cls=Command, examples=("rig schema matrix > matrix.schema.json",))
@click.argument("file", type=click.Choice(list(SCHEMAS)))
@json_option
def command(file: str, as_json: bool) -> int:
    """Print the JSON schema for a file type, for validation in an editor."""
    del as_json  # a schema is JSON anyway
    write_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **SCHEMAS[file](), "title": f"{file} file"})
    return EXIT_DONE
