"""The table of what the station can trip on."""

from collections import Counter

from rig.station.fault_table import TABLE, Stop


def test_every_row_has_a_code_of_its_own_since_trips_are_recorded_by_code() -> None:
    counted = Counter(row.code for row in TABLE.values())
    assert [code for code, count in counted.items() if count > 1] == []


def test_stops_are_ranked_from_a_warning_to_hydraulics_off() -> None:
    assert sorted(Stop, key=lambda stop: stop.severity) == [Stop.W, Stop.S2, Stop.SO, Stop.S1]
