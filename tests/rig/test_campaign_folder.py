"""A campaign's folder: each of its files is named in one place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rig
from rig.campaign_folder import CampaignFolder, held_inodes
from rig.errors import FileProblem
from rig.recording.journal.journal_lock import campaign_held

NAMES = {name: value for name in vars(CampaignFolder) if isinstance(value := getattr(CampaignFolder, name), str)}
"""Attribute -> name of the file."""
NAMES = {name: value for name, value in NAMES.items() if not name.startswith("_")}


def test_no_other_module_makes_a_path_of_such_a_name() -> None:
    assert len(NAMES) > 15
    spelled = re.compile(rf"""/ f?["']({'|'.join(map(re.escape, NAMES.values()))})["']""")
    found = [
        f"{path.name}: {match[0]}" for path in sorted(Path(rig.__file__).parent.rglob("*.py"))
        for match in spelled.finditer(path.read_text(encoding="utf-8"))
    ]
    assert found == []


def test_files_of_further_sessions_have_names_of_their_own(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    assert folder.session_bench(2) == tmp_path / "bench-session2.toml"
    assert folder.session_truth(1) == tmp_path / "truth-session1.h5"


def test_points_are_written_into_a_real_folder_only(tmp_path: Path) -> None:
    folder = CampaignFolder(tmp_path)
    with pytest.raises(FileProblem, match="does not contain a points/ folder"):
        _ = folder.written_points
    folder.points.symlink_to(tmp_path)
    with pytest.raises(FileProblem, match="symbolic link"):
        _ = folder.written_points


def test_a_campaign_that_a_process_holds_is_told_from_one_that_was_cut_off(tmp_path: Path) -> None:
    with campaign_held(tmp_path):
        assert tmp_path.stat().st_ino in held_inodes()
    assert tmp_path.stat().st_ino not in held_inodes()
