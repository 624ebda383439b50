"""A point's quality is written to and read from its file by its fields."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.quality.point_quality import MotionQuality, PointQuality, SensorQuality, Tolerances
from rig.recording.quality.verdict import Section, Stored, Verdict, invalid, suspect
from rig.recording.recorded_point import RecordedPoint

VALUES = {
    Stored.NUMBER: 0.25, Stored.COUNT: 7, Stored.FLAG: True, Stored.TEXT: "by edges", Stored.PER_CYCLE: (1.5, 2.5),
}
S = TypeVar("S", bound=Section)


def filled(empty: S) -> S:
    """The same section with a value in every field."""
    values: dict[str, object] = {}
    for entry in fields(empty):
        if "section" in entry.metadata:
            values[entry.name] = filled(entry.metadata["section"]())
        elif "attribute" in entry.metadata:
            values[entry.name] = VALUES[entry.metadata["kind"]]
    return replace(empty, **values)


QUALITY = replace(
    filled(PointQuality()), verdict=Verdict.of([suspect("skew", "3 ms"), invalid("free-play", "2 mm")]),
)


def test_every_field_survives_the_attributes() -> None:
    assert PointQuality.read(QUALITY.attributes) == QUALITY


def test_every_field_survives_the_file(tmp_path: Path) -> None:
    time_s = np.arange(16) / 250.0
    write_file(tmp_path / "p001.h5", PointFile(
        time_s, 250.0, [AlignedChannel("force", time_s, "N", "Force")], quality=QUALITY.attributes,
        test={"id": "p001", "waveform": "sine", "amplitude_m": 0.0, "frequency_Hz": 0.0, "current_A": 0.0},
    ))
    assert RecordedPoint.open(tmp_path / "p001.h5").quality == QUALITY


def test_no_two_fields_share_an_attribute() -> None:
    names = [name for name, _ in QUALITY.items()]
    assert len(names) == len(set(names)) > 80


def test_nothing_measured_is_no_attribute() -> None:
    assert PointQuality().attributes == {"verdict": "valid", "reasons": (), "reason_kinds": (), "blamed": ()}
    assert PointQuality.read({}) == PointQuality()


def test_a_file_without_tolerances_has_none_and_one_with_a_single_one_has_the_usual_others() -> None:
    assert PointQuality.read({"measured_cycles": 3}).tolerances is None
    assert PointQuality.read({"tolerance_force_gain": 0.03}).tolerances == Tolerances(force_gain=0.03)


@pytest.mark.parametrize("value", ["wide", math.nan, None, ("a",)])
def test_what_is_no_number_counts_as_not_measured(value: object) -> None:
    assert PointQuality.read({"force_span_N": value}).loop.span_N is None


def test_a_cycle_that_is_not_known_is_a_dash_in_the_file() -> None:
    motion = MotionQuality(cycle_amplitude_m=(0.02, math.nan))
    assert motion.attributes == {"cycle_amplitude_m": "0.02 -"}
    amplitudes = MotionQuality.read(motion.attributes).cycle_amplitude_m
    assert amplitudes is not None
    assert amplitudes[0] == 0.02
    assert math.isnan(amplitudes[1])


def test_the_two_sensors_have_attributes_of_their_own() -> None:
    attributes = PointQuality(
        force=SensorQuality(reference_offset=1.0), displacement=SensorQuality(reference_offset=2.0),
    ).attributes
    assert (attributes["force_reference_offset_N"], attributes["displacement_reference_offset_m"]) == (1.0, 2.0)


def test_a_value_without_its_deviation_is_no_estimate() -> None:
    assert SensorQuality(reference_gain=1.01).gain is None
    assert PointQuality.read({"rest_current_A": 0.1, "rest_current_std_A": 0.01}).rest.current is not None
