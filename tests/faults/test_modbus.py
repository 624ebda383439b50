"""The controller's link where its troubles pass; those that stay are rows of `test_every_row.py`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from end_states import assert_warned_only
from matrices import ONE_POINT

if TYPE_CHECKING:
    from conftest import Run


def test_passing_troubles_of_the_link_are_overcome_and_flagged(run: Run) -> None:
    ending = run("modbus-busy@0.4+0.02", "modbus-wrong-tid@1", matrix=ONE_POINT, speed=1.0)
    assert_warned_only(ending, "modbus-busy")
    assert_warned_only(ending, "modbus-wrong-tid")
    assert len(ending.truth.all("FAULT")) == 2
