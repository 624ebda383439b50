"""`rig benchmark`: what it answers, and what it does not take."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from rig.cli.main import main
from rig.cli.run import following
from rig.matrix.model import load_matrix


def run_rig(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code, and what it printed."""
    code = main(["benchmark", *arguments])
    return code, capsys.readouterr().out


def test_in_process_no_wire_takes_part(capsys: pytest.CaptureFixture[str]) -> None:
    requested = ("--case", "1", "--rate", "250", "--compensator", "adaptive-model", "--plants", "1")
    code, out = run_rig(capsys, *requested, "--json")
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
    assert run_rig(capsys, "--wires", *more)[0] == 2


def test_the_usual_simulated_rig_follows_set_points_for_a_hybrid_test_whichever_command_starts_it() -> None:
    examples = Path(__file__).resolve().parents[3] / "examples"
    hybrid, loops = (load_matrix(examples / name) for name in ("hybrid-quarter.toml", "table1.toml"))
    assert following(hybrid, ("--fault", "estop@3"), usual=True) == ("--actuator=setpoints", "--fault", "estop@3")
    assert following(hybrid, ("--actuator", "rtu"), usual=True) == ("--actuator", "rtu")
    assert following(hybrid, (), usual=False) == ()
    assert following(loops, (), usual=True) == ()
