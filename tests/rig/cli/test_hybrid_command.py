"""`rig hybrid --benchmark`: what it answers, and what it does not take."""

from __future__ import annotations

import json

import pytest

from rig.cli.main import main


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code, and what it printed."""
    code = main(["hybrid", "--benchmark", *arguments])
    return code, capsys.readouterr().out


def test_in_process_no_wire_takes_part(capsys: pytest.CaptureFixture[str]) -> None:
    asked = ("--case", "1", "--rate", "250", "--compensator", "adaptive-model", "--plants", "1")
    code, out = told(capsys, *asked, "--json")
    answer = json.loads(out)
    assert code == 0
    assert (answer["plants"], answer["latency_steps"], answer["wires"]) == (1, 0, None)
    (result,) = answer["results"]
    assert set(result["criteria"]) == {f"J{number}" for number in range(1, 10)}
    assert result["verdict"] == "good"


@pytest.mark.parametrize("more", [("--rate", "1024"), ("--latency-steps", "2")])
def test_wires_have_a_rate_and_a_latency_of_their_own(
    more: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert told(capsys, "--wires", *more)[0] == 2
