"""Nothing is decided by words: with every message scrambled, codes, slugs and verdicts are the same."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
from in_process import rig
from matrices import matrix_text
from simulated_campaign import Session, session

from rig import errors
from rig.recording.journal.campaign_log import read_log
from simulators.scenarios.stage import load_everything

SCRAMBLED = "#"
CODES = ("slug", "stopped_by", "rig_state", "exit_code", "valid", "total")
ON_DEMO_BENCH = ("MATRIX", "--bench", "examples/demo-bench.toml")
ROOT = Path(errors.__file__).parents[1]


def decided(code: int, answer: dict[str, Any]) -> dict[str, object]:
    """What a machine reads of an answer: everything but words, times and paths.

    Of a point's reasons the first: what else the last samples before a stop show depends on the instant it came.
    """
    stop = answer.get("stop") or {}
    points = [
        (point["id"], point["verdict"], point["blamed"][:1], slugs(point)[:1]) for point in answer.get("points", ())
    ]
    found = [finding["slug"] for finding in answer.get("findings", ())]
    return {"code": code, **{key: answer.get(key) for key in CODES}, "stop": stop, "points": points, "findings": found}


def slugs(point: dict[str, Any]) -> list[str]:
    return [reason.partition(":")[0] for reason in point["reasons"]]


def both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, *arguments: str
) -> tuple[dict[str, object], dict[str, Any]]:
    """The same command plain and scrambled: what was decided, asserted equal, and the scrambled answer."""
    ends = []
    for name in ("plain", "scrambled"):
        if name == "scrambled":
            scramble(monkeypatch)
        matrix = tmp_path / f"{name}.toml"
        matrix.write_text(text, encoding="utf-8")
        given = [matrix.as_posix() if part == "MATRIX" else part for part in arguments]
        out = ["--out", str(tmp_path / name)] if arguments[0] == "run" else []
        ends.append(rig(*given[:2], *out, *given[2:], "--json", cwd=ROOT))
    plain, scrambled = ends
    answer, other = json.loads(plain.stdout), json.loads(scrambled.stdout)
    assert decided(scrambled.returncode, other) == decided(plain.returncode, answer)
    assert not plain.stderr or plain.stderr != scrambled.stderr
    return decided(plain.returncode, answer), other


def test_a_wrong_matrix_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = matrix_text("0.5 A", amplitude="5 A", cycles=5)
    ended, answer = both(tmp_path, monkeypatch, text, "plan", *ON_DEMO_BENCH)
    assert (ended["code"], ended["slug"]) == (2, "config-absurd")
    assert (answer["error"], answer["problems"]) == (SCRAMBLED, [SCRAMBLED])


def test_a_matrix_that_does_not_fit_the_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = matrix_text("0.5 A", amplitude="84 mm", cycles=5)
    ended, answer = both(tmp_path, monkeypatch, text, "run", *ON_DEMO_BENCH)
    assert (ended["code"], ended["slug"]) == (3, "matrix-infeasible")
    assert answer["error"] == SCRAMBLED


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("fault", "code", "slug"), [("not-tared", 3, "not-tared"), ("sensor-nan@1.5", 5, None), ("estop@1", 4, "estop")]
)
def test_a_campaign_refused_spoiled_or_stopped_and_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str, code: int, slug: str | None
) -> None:
    matrix, ends = matrix_text("0.5 A", amplitude="30 mm", cycles=5), []
    for name in ("plain", "scrambled"):
        if name == "scrambled":
            scramble(monkeypatch)
        (tmp_path / name).mkdir()
        with session(tmp_path / name, matrix, "--fault", fault) as begun:
            ends.append(begun.end())
            if name == "scrambled" and code == 4:
                requalified(begun, ends[-1].folder, str(slug))
    plain, scrambled = ends
    ended = decided(plain.exit_code, plain.answer)
    assert decided(scrambled.exit_code, scrambled.answer) == ended
    assert (ended["code"], ended["stopped_by"]) == (code, slug)
    assert not plain.output or plain.output != scrambled.output
    if slug is not None:
        assert scrambled.answer["error"] == SCRAMBLED


def scramble(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every module that hands messages on hands on nothing but a sign."""
    load_everything()
    before = errors.clean_text
    for module in [module for name, module in sys.modules.items() if name.startswith("rig.")]:
        if vars(module).get("clean_text") is before:
            monkeypatch.setattr(module, "clean_text", lambda text: SCRAMBLED)
    assert errors.clean_text("words") == SCRAMBLED


def requalified(stopped: Session, folder: Path, slug: str) -> None:
    """Resumed without a statement of what was repaired it is refused, with one it is completed."""
    assert {line["slug"] for line in read_log(folder) if line.get("what") in {"trip", "also"}} >= {slug}
    refused = stopped.resumed(folder)
    assert refused.end().answer == {"error": SCRAMBLED, "slug": "requalify", "exit_code": 3}
    resumed = refused.resumed(folder, "chain").end()
    assert (resumed.exit_code, resumed.answer["valid"], resumed.answer["rig_state"]) == (0, 1, "safe")
