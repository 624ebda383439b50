"""The table of what the station can trip on."""

from collections import Counter

from rig.faults.matrix import REACTIONS
from rig.faults.row import StopKind


def test_every_row_has_a_code_of_its_own_since_trips_are_recorded_by_code() -> None:
    counted = Counter(row.code for row in REACTIONS.values())
    assert [code for code, count in counted.items() if count > 1] == []


def test_stops_are_ranked_from_a_fade_out_to_hydraulics_off() -> None:
    assert sorted(StopKind, key=lambda stop: stop.severity) == [
        StopKind.FADE_OUT, StopKind.HALT, StopKind.PRESSURE_OFF,
    ]
