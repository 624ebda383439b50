"""Section 4.2 of paper 1: the printed fits in a car, and what is said of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.document.figure import Figure, Panels
from rig.study.findings import findings
from rig.study.ride_of_fits import ride_figures, ride_table, rides
from rig.study.study_file import load_study


@pytest.mark.nightly
def test_the_printed_fits_differ_as_the_page_on_rides_says(small_study: Path) -> None:
    small_study.write_text(small_study.read_text() + "[ride]\n")
    study = load_study(small_study)
    driven = rides(study, {})
    assert driven is not None
    assert driven.ours is None
    table = ride_table(driven)
    reported = {(row[0], row[1]): (row[2], row[-1]) for row in table.rows}
    assert reported["pitch", "4-8 Hz"] == (pytest.approx(4.1, abs=0.05), 5.0)  # docs/how-to/ride-comfort.md, 0 A
    assert reported["heave", "0-18 Hz"] == (pytest.approx(9.3, abs=0.05), 12.0)
    assert "fewer than two of c-FOA, GA and PSO" in table.note
    claim = next(one for one in findings(study, {}, {}, {}, driven) if one.slug == "ride-of-fits")
    assert claim.verdict == "holds"
    assert "4.1 dB at 4-8 Hz and 27 dB up to 18 Hz (in pitch)" in claim.text
    curves, panels = ride_figures(driven).values()
    assert isinstance(curves, Figure)
    assert isinstance(panels, Panels)
    assert (len(curves.traces), len(panels.figures)) == (3, 4)


def test_a_study_without_a_ride_drives_nothing(small_study: Path) -> None:
    assert rides(load_study(small_study), {}) is None
