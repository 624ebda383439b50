"""Late set-points of a hybrid test are those of its own session."""

from __future__ import annotations

from typing import Any

from rig.characteristics.hybrid_tests import _reported


def counted(t_ns: int, steps: int, late: int) -> dict[str, Any]:
    return {"event": "station", "what": "setpoints", "t_ns": t_ns, "steps": steps, "late": late, "p99_s": 0.0004}


def test_counts_of_one_session_go_on() -> None:
    reported = _reported([counted(50, 900, 3), counted(250, 2400, 5)], 100, 200)
    assert (reported["late_steps"], reported["p99_step_ms"]) == (2, 0.4)


def test_a_session_after_another_one_counts_anew() -> None:
    assert _reported([counted(50, 2400, 7), counted(250, 1500, 2)], 100, 200)["late_steps"] == 2
