"""`rig schema`: JSON schemas of the files a user writes."""

from __future__ import annotations

import click

from rig.cli.options import Command, json_option
from rig.cli.output import write_json
from rig.errors import EXIT_DONE


@click.command(name="schema", cls=Command, examples=("rig schema matrix > matrix.schema.json",))
@click.argument("file", type=click.Choice(["bench", "matrix", "supply"]))
@json_option
def command(file: str, as_json: bool) -> int:
    """Print the JSON schema of a FILE for the rig, for editors that validate while you type."""
    del as_json  # a schema is JSON anyway
    if file == "supply":
        from rig.bench.supply_schema import SUPPLY

        write_json(SUPPLY)
        return EXIT_DONE
    from rig.bench.model import Bench
    from rig.matrix.model import Matrix

    schema = (Bench if file == "bench" else Matrix).model_json_schema(by_alias=True)
    write_json({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": f"{file} file"})
    return EXIT_DONE
