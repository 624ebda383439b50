"""`rig run --page --stay`: what the page waits for, and what is let go of before."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rig.campaign.live_link import LiveLink
from rig.cli.main import main
from rig.cli.page import RunLink
from rig.station.live_folder import LOCK, held


class Page:
    """A page's process that remembers what it found when it was waited for."""

    url = "http://127.0.0.1:1/"

    def __init__(self, link: LiveLink, ends_by: type[BaseException] | None = None) -> None:
        self._link = link
        self._ends_by = ends_by
        self.campaign_held: list[bool] = []

    def wait(self) -> None:
        self.campaign_held.append(held(self._link.folder / LOCK))
        if self._ends_by is not None:
            raise self._ends_by


def stayed(place: Path, stopped_by: str | None, ends_by: type[BaseException] | None = None) -> list[bool]:
    link = LiveLink(place=place)
    page = Page(link, ends_by)
    try:
        assert held(link.folder / LOCK)
        RunLink(link, cast("Any", page)).stay(cast("Any", SimpleNamespace(stopped_by=stopped_by)))
    finally:
        link.close()
    return page.campaign_held


@pytest.mark.parametrize("stopped_by", [None, "operator", "force-limit"])
def test_a_page_stays_once_the_campaign_is_let_go_of(stopped_by: str | None, tmp_path: Path) -> None:
    assert stayed(tmp_path, stopped_by) == [False]


def test_ctrl_c_ends_the_waiting_and_no_more(tmp_path: Path) -> None:
    assert stayed(tmp_path, None, KeyboardInterrupt) == [False]


def test_a_program_that_was_requested_to_end_does_not_stay(tmp_path: Path) -> None:
    assert stayed(tmp_path, "sigterm") == []


def test_to_stay_without_a_page_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "matrix.toml", "--simulate", "--stay"]) == 2
    assert "--stay requires --page" in " ".join(capsys.readouterr().err.split())
