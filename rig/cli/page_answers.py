"""The process that answers what the page of a bench must ask of other rooms: `python -m rig.cli.page_answers`.

One JSON object on standard input, one on standard output:

    {"do": "plan", "matrix": PATH, "bench": PATH}    {"planned", "feasible", "serial_number", "devices", "line",
                                                      "blocks"}
    {"do": "questions", "run": PATH}                 {"stops", "requalify", "left_out"}
    {"do": "report", "run": PATH, "pdf": BOOL}       {"report", "pdf"}; pdf: its PDF is written, too

What is refused is answered by `refused` (a code) and `text`, in the words of the command. The page's own process
stays small, and no file that a plan is made of can harm it.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.campaign.confirmation import LOOK_AT_THE_RIG, REQUALIFY, open_stops
from rig.campaign.machine_resources import devices_of
from rig.campaign.resume import left_out
from rig.campaign.setup import described, plan_digest
from rig.campaign.stop_cause import OPERATOR
from rig.cli.output import write_pdf
from rig.cli.plan import planned
from rig.cli.tables import plan_blocks, verdict_blocks
from rig.document.blocks import Block, Note, Paragraph, Table
from rig.document.words import plain
from rig.errors import EXIT_DONE, RigError
from rig.matrix.line_table import LineTable
from rig.text_file import FirstRead

if TYPE_CHECKING:
    from rig.matrix.model import Matrix
    from rig.matrix.plan import Plan

NICENESS = 10
ON_PAGE = {LOOK_AT_THE_RIG: "the rig, and the cause named in this stop message"}
"""A page does not show `station.log`."""


def plan_answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """The plan of a matrix as `rig plan` shows it, and the digest of all that it was made of.

    Raises:
        RigError: as `rig plan`.
    """
    matrix_path, bench_path = Path(request["matrix"]), Path(request["bench"])
    with FirstRead():  # digest of the displayed bytes
        plan, matrix, bench = planned(matrix_path, bench_path)
        digest = plan_digest(matrix_path, bench_path, matrix, bench)
    return {
        "planned": digest, "feasible": plan.feasible,
        "serial_number": matrix.specimen.serial_number, "devices": sorted(devices_of(bench)), "line": line_of(matrix),
        "blocks": list(shown(verdict_first(plan))),
    }


def line_of(matrix: Matrix) -> dict[str, str] | None:
    """What the production view must know of a matrix; None without acceptance bands."""
    if matrix.acceptance is None:
        return None
    table = matrix.line or LineTable()
    return {"serial": table.serial or "", "retest": table.retest}


def questions_answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """What must be confirmed before a run is resumed, as `rig run --resume` prints it.

    Raises:
        RigError: there is no campaign to resume.
    """
    run = Path(request["run"])
    described(run)
    stops = open_stops(run)
    return {
        "stops": [{**stop.to_json(), "text": stop.text, "requested": stop.slug in OPERATOR, "check": ON_PAGE.get(
            stop.look_at, stop.look_at)} for stop in stops],
        "requalify": any(stop.resume == REQUALIFY for stop in stops), "left_out": list(left_out(run)),
    }


def report_answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """Write a run's report, and its PDF if it is requested.

    Raises:
        RigError: as `rig report`.
    """
    # loads numba: a plan has no use for it
    from rig.report.document import written_report

    report, document = written_report(Path(request["run"]))
    return {"report": report.name, "pdf": write_pdf(document, report).name if request.get("pdf") else None}


def verdict_first(plan: Plan) -> list[Block]:
    """The blocks of `rig plan` in the order of a page, whose first lines are seen first: a terminal shows the last."""
    verdict = verdict_blocks(plan)
    others = plan_blocks(plan)[: -len(verdict)]
    notes = [block for block in others if isinstance(block, Note)]
    return [*reversed(verdict), *notes, *(block for block in others if not isinstance(block, Note))]


def shown(blocks: list[Block]) -> Iterator[dict[str, Any]]:
    """Blocks of a document as values for a browser."""
    for block in blocks:
        match block:
            case Note():
                yield {"kind": "note", "level": str(block.severity), "text": plain(block.words)}
            case Paragraph():
                yield {"kind": "text", "text": plain(block.words)}
            case Table():
                columns = [{"title": one.title, "unit": one.unit, "numeric": one.numeric} for one in block.columns]
                rows = [{"level": str(row.severity), "cells": list(map(plain, row.cells))} for row in block.rows]
                yield {"kind": "table", "columns": columns, "rows": rows}
            case _:
                yield {"kind": "text", "text": str(block)}


ANSWERS: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
    "plan": plan_answer, "questions": questions_answer, "report": report_answer,
}


def answered(request: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to a request; a refusal in words."""
    try:
        return ANSWERS[str(request["do"])](request)
    except RigError as error:
        return {"refused": error.slug, "text": str(error)}
    except OSError as error:
        return {"refused": RigError.slug, "text": f"{error.filename or 'file'}: {error.strerror or error}"}


def main() -> int:
    """Answer one request."""
    os.nice(NICENESS)
    sys.stdout.write(json.dumps(answered(json.load(sys.stdin))) + "\n")
    return EXIT_DONE


if __name__ == "__main__":
    sys.exit(main())
