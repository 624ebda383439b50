"""A disk that fills while files are made of the journals: other processes meet it than the one that records."""

from __future__ import annotations

import resource
import subprocess
from typing import TYPE_CHECKING

import pytest
from matrices import LONG_SECOND_POINT
from watched_campaign import assert_completed, wait_until

from drivers.roles import State

if TYPE_CHECKING:
    from conftest import InMotion

pytestmark = pytest.mark.wire

SMALLER_THAN_ANY_FILE = 1 << 13


def family(root: int) -> list[int]:
    """A process and everything it has started."""
    children = subprocess.run(["pgrep", "-P", str(root)], capture_output=True, text=True, check=False).stdout.split()
    return [root, *(pid for child in children for pid in family(int(child)))]


@pytest.mark.nightly
def test_a_disk_that_is_full_for_the_files_of_points_loses_none_of_them(in_motion: InMotion) -> None:
    """The journals are there; when there is room again, the campaign goes on from all of them."""
    campaign = in_motion(seconds=1.0, matrix=LONG_SECOND_POINT)
    wait_until((campaign.folder / "points" / "p001.h5").exists, "p001.h5")
    for process in family(campaign.child("finaliser")):
        resource.prlimit(process, resource.RLIMIT_FSIZE, (SMALLER_THAN_ANY_FILE, SMALLER_THAN_ANY_FILE))
    ending = campaign.finish()
    assert (ending.exit_code, ending.answer["rig_state"]) == (5, "safe"), ending.output
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}
    (reason,) = ending.answer["points"][1]["reasons"]
    assert reason.startswith("not-written")
    assert "the journal is kept" in reason
    assert ending.truth.state[-1] == State.OFF
    assert sorted(path.name for path in (ending.folder / "points").glob("p002*")) == ["p002.journal"]
    starts = len(ending.truth.all("START"))
    assert_completed(ending.folder)
    assert starts == 2
    assert not (ending.folder / "truth-session1.h5").exists(), "nothing had to move again"
