"""A campaign resumed by a relative path: what all its points know of the skew reaches the books of the kept ones."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from matrices import matrix_text
from simulated_campaign import session

from rig.recording.recorded_point import RecordedPoint

MATRIX = matrix_text("1 A", "1.5 A", "2 A", "0.5 A", "1.2 A", amplitude="30 mm")


def suspect_for_its_skew(file: Path) -> None:
    """The point as it would be had it seen too little of the skew alone."""
    with h5py.File(file, "r+") as content:
        quality = content["entry/quality"].attrs
        quality["verdict"], quality["skew_std_s"] = "suspect", 0.01
        quality["reasons"] = np.array([b"skew: force and displacement are tied together to 10 ms only"])
        quality["blamed"] = np.array([b"bench"])


@pytest.mark.nightly
def test_a_kept_point_evaluated_again_is_entered_as_its_file_says(tmp_path: Path) -> None:
    with session(tmp_path, MATRIX, speed=4.0, seed=7) as first:
        first.until(lambda line: line["event"] == "judged")
        first.interrupt()
        campaign = first.end().folder
        kept = campaign / "points" / "p001.h5"
        assert RecordedPoint.open(kept).verdict == "valid"
        suspect_for_its_skew(kept)
        second = first.resumed(campaign).end()
    assert {line["file"] for line in second.story if line["event"] == "retimed"} >= {"p001"}
    first_point = next(point for point in second.answer["points"] if point["id"] == "p001")
    assert RecordedPoint.open(kept).verdict == "valid"
    assert (first_point["verdict"], first_point["reasons"]) == ("valid", [])
    assert Path(first_point["file"]) == kept.resolve()
    assert first_point["quality"]["skew_std_s"] == RecordedPoint.open(kept).skew_std_s
    assert second.exit_code == 0, second.output
