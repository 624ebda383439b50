"""Rows of the actuator controller: what it says, what it forgets, what it refuses to do."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from conftest import Run

pytestmark = pytest.mark.wire

Judge = Callable[..., None]


@pytest.mark.row("estop")
def test_an_opened_e_stop_chain_is_mirrored_and_latched(run: Run, assert_stopped: Judge) -> None:
    assert_stopped(run("estop@6.3"), "estop")
