"""Every slug that the product can show has a text for `rig explain`, and every text belongs to such a slug."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from in_process import rig

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.catalogue import make_manual_source
from drivers.devices.ecu_missing import WITHOUT
from drivers.devices.supply import Command, SupplyCommands, SupplyDescription, SupplyLink, supply_missing
from drivers.devices.supply_file import supply
from rig.explanations.explanation import explained, texts
from rig.faults.matrix import MATRIX, REACTIONS
from rig.identification.diagnosis.ranking import STATEMENTS
from rig.recording.external_tests import DOUBTS
from rig.recording.quality.instrument_checks import SLUGS, ZERO_RETURN
from rig.recording.quality.quality_checks import VERDICT_REMARKS
from rig.study.printed_values import SENSITIVITY as PRINTED_SENSITIVITY
from simulators.injection import LASTING_VARIANTS, PASSING_VARIANTS
from simulators.scenarios.plan import AROUND

CAUSES = [statement.slug for statement in STATEMENTS]
"""Of a misfit, as report and `rig identify --json` show them."""
ROOT = Path(__file__).resolve().parents[2]
SLUG = re.compile(r"[A-Za-z][a-z0-9]*(-[a-z0-9]+)*|INTERRUPTED")
REPORTED_BY = {
    "Refused", "Stopped", "StationRefused", "because", "StopCause", "Finding", "CampaignFinding", "CheckFinding",
    "Reason", "suspect", "invalid", "explained", "_share", "fails", "NotProved", "warn", "Cause", "Trial", "Doubt",
    "_certain", "Remark", "_refused", "ConversionEnded", "Claim",
    "Refusal",
}
"""Calls whose first argument is a slug."""
FUNCTIONS = {"failed", "warning", "note"}
"""The same, but methods of these names say something else."""

BARE = SupplyDescription(
    "bare", SupplyLink(), SupplyCommands(output_on=(Command.of("ON"),)), (0.0, 1.0), tried="unverified"
)
"""A supply that can do next to nothing."""
WRITTEN_ONLY = """
[range]
current_A = [0, 1]
[quantities]
current = {address = 0, scale = 0.001, unit = "A", access = "w"}
temperature = {address = 1}
"""
"""An analogue output that can do next to nothing."""


def texts_in(node: ast.AST) -> Iterator[str]:
    for part in ast.walk(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, str) and SLUG.fullmatch(part.value):
            yield part.value


def second_arguments(node: ast.Call) -> Iterator[str]:
    """The slug of `Denied(status, slug)`, and of `Note(..., code=slug)`."""
    name = getattr(node.func, "id", getattr(node.func, "attr", ""))
    if name == "Denied":
        yield from texts_in(node.args[1])
    if name == "Note":
        yield from (slug for keyword in node.keywords if keyword.arg == "code" for slug in texts_in(keyword.value))


def is_slug_name(name: str) -> bool:
    return name in {"slug", "error_slug", "SLUG"} or name.endswith("_slug")


def slugs_of_call(node: ast.Call) -> Iterator[str]:
    yield from second_arguments(node)
    name = getattr(node.func, "id", getattr(node.func, "attr", ""))
    if node.args and (name in REPORTED_BY or (name in FUNCTIONS and isinstance(node.func, ast.Name))):
        yield from texts_in(node.args[0]) if isinstance(node.args[0], (ast.Constant, ast.IfExp)) else ()
    for keyword in node.keywords:
        if is_slug_name(keyword.arg or ""):
            yield from texts_in(keyword.value)


def slugs_in(node: ast.AST) -> Iterator[str]:
    """Slugs that one node of the code can show: what is given to a call, assigned, returned or put under the key."""
    if isinstance(node, ast.Call):
        yield from slugs_of_call(node)
    elif isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            named = isinstance(key, ast.Constant) and key.value in {"slug", "refused"}
            if named and isinstance(value, ast.Constant) and str(value.value).islower():  # not a title
                yield from texts_in(value)
    elif isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        for target in targets:
            if is_slug_name(getattr(target, "id", "")) and isinstance(node.value, (ast.Constant, ast.IfExp)):
                yield from texts_in(node.value)
    elif isinstance(node, ast.FunctionDef) and "slug" in node.name:
        for part in ast.walk(node):
            if isinstance(part, ast.Return) and part.value is not None:
                yield from (slug for slug in texts_in(part.value) if part.value is not None)


def in_code() -> dict[str, str]:
    """Slug -> where the code names it."""
    places: dict[str, str] = {}
    for room in ("rig", "drivers", "protocols"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                for slug in slugs_in(node):
                    places.setdefault(slug, f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', '')}")
    return places


@cache
def known() -> dict[str, str]:
    nothing = Capabilities(watchdog=WatchdogKind.NONE, hydraulics=False, tried=False)
    echoless = Capabilities(watchdog=WatchdogKind.COUNTER, hydraulics=False, watchdog_tested="on")
    output = supply(tomllib.loads(WRITTEN_ONLY))
    missing = {name for one in (nothing, echoless) for name, _ in one.lacking()}
    return {
        **in_code(),
        **dict.fromkeys(CAUSES, "rig/identification/diagnosis"),
        **dict.fromkeys((*MATRIX, *REACTIONS), "rig/faults"),
        **dict.fromkeys(DOUBTS, "rig/recording/external_tests.py"),
        **dict.fromkeys((*SLUGS, ZERO_RETURN, *VERDICT_REMARKS), "rig/recording/quality"),
        **{f"actuator-without-{name}": "drivers/capabilities.py" for name in missing},
        **{f"ecu-without-{name}": "drivers/manual_current.py" for name, _ in make_manual_source(None).lacking},
        **{f"ecu-without-{name}": "drivers/devices/supply.py" for name, _ in supply_missing(BARE)},
        **{f"ecu-without-{name}": "drivers/devices/output.py" for name, _ in supply_missing(output)},
        **{f"ecu-without-{name}": "drivers/devices/ecu_missing.py" for name in WITHOUT},
        **dict.fromkeys(("lease-taken", "not-running"), "rig/page/lease.py: take"),
        **dict.fromkeys(("not-recorded",), "rig/page/server.py: _send_recorded"),
        **{f"sensitivity-{name}": "rig/study/findings.py: _sensitivity" for name in PRINTED_SENSITIVITY},
        **dict.fromkeys((*AROUND, *LASTING_VARIANTS, *PASSING_VARIANTS), "simulators: events and variants"),
        "hydraulics": "rig/station/requests.py: await_status",
        "amplitude-scatter": "rig/recording/quality/verdict_rules.py", "force-scatter": "the same",
    }


def test_every_slug_of_the_product_is_explained() -> None:
    missing = {slug: place for slug, place in known().items() if slug not in texts()}
    assert missing == {}, "write what it means and what to look at into a file of rig/explanations"


def test_every_text_explains_a_slug_of_the_product() -> None:
    named = known().keys()
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "rig").rglob("*.py"))
    assert [slug for slug in texts() if slug not in named and f'"{slug}"' not in sources] == []


def test_every_statement_of_the_diagnosis_is_in_its_table() -> None:
    part = (ROOT / "docs/json.md").read_text(encoding="utf-8").split("**`diagnosis`**")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in part.splitlines() if line.startswith("| `")]
    assert {slug for row in rows for slug in re.findall("`([^`]+)`", row)} == set(CAUSES)


@pytest.mark.parametrize("slug", texts())
def test_an_explanation_says_what_it_means_what_was_done_and_what_to_look_at(slug: str) -> None:
    answer = explained(slug)
    assert len(answer.means) > 20
    assert len(answer.done) > 10
    assert all(len(line) > 6 for line in answer.look_at)
    assert answer.means.endswith(".")
    row = {**REACTIONS, **MATRIX}.get(slug)
    assert (answer.resume != "") == (row is not None and row.stop is not None)


def test_a_stop_of_the_matrix_says_how_the_rig_was_stopped_and_how_to_go_on() -> None:
    broken_coil, frozen = explained("coil-open-short"), explained("actuator-frozen")
    assert "the coil goes to 0 A" in broken_coil.done
    assert "--requalified" in broken_coil.resume
    assert "without using its position" in frozen.done
    assert (broken_coil.exit_code, explained("not-tared").exit_code, explained("config-absurd").exit_code) == (4, 3, 2)


def test_the_command_explains_lists_and_guesses_what_was_meant() -> None:
    answer = json.loads(rig("explain", "watchdog-absent", "--json").stdout)
    assert {"slug", "means", "done", "look_at", "resume", "exit_code", "reaction"} == answer.keys()
    listed = {entry["slug"] for entry in json.loads(rig("explain", "--json").stdout)["slugs"]}
    assert listed == set(texts())
    wrong = rig("explain", "watchdog-abset")
    assert wrong.returncode == 2
    assert "did you mean watchdog-absent" in wrong.stderr
