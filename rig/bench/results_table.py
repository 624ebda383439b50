"""`[results]` of a bench file: the server to which results are delivered, and the name of the station."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from rig.bench.server_address import address_without_password
from rig.files.section import Section


class ResultsTable(Section):
    """Results database of a bench; no measured value depends on this table."""

    url: Annotated[str, AfterValidator(address_without_password)] | None = Field(
        default=None, description="address of the PostgreSQL database to which results are delivered, without "
            "password; default: none", examples=["postgresql://rig@results.example.org/rig"],
    )
    station: str | None = Field(
        default=None, min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]+$",
        description="name of the station in the results database; default: `name` of the bench",
    )
