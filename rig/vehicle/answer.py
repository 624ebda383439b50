"""A ride study as plain values: the keys of `rig ride --json`."""

from __future__ import annotations

from typing import Any

from rig.vehicle.response import BANDS
from rig.vehicle.ride import RideStudy

SHARED = ("damper_power_W", "damper_heat_J", "tyre_off_share")


def as_json(study: RideStudy) -> dict[str, Any]:
    """Plain types; what a motion or a fit does not have is null."""
    names = [variant.name for variant in study.variants]
    answer: dict[str, Any] = {
        "car": {"name": study.car.name, "kind": study.car.kind, "estimate": study.car.estimate},
        "road": {"name": study.road.name, "speed_m_s": study.road.speed_m_s, "duration_s": study.road.duration_s},
        "fits": [
            {
                "name": variant.name, "model": variant.fit.damper.model.name, "law": variant.control.law,
                "current_A": variant.control.current_A, "adequate": variant.fit.adequate,
                "members": len(variant.fit.draws), "remark": variant.fit.remark or None,
                "beyond": study.beyond(variant.name),
            }
            for variant in study.variants
        ],
        "step_s": study.step_s,
        "step_close": study.step_close,
        "bands": {
            motion: {band: {phase: _band(study, phase, motion, band) for phase in study.driven} for band in BANDS}
            for motion in study.own.body
        },
        "weighted_rms_m_s2": {name: _value(study, name, "weighted_rms heave") for name in names},
        "weighted_rms_rad_s2": {
            name: {motion: _value(study, name, f"weighted_rms {motion}") for motion in study.own.body[1:]}
            for name in names
        },
        "tyre_load_variation": {name: _value(study, name, "tyre_load_variation") for name in names},
        "travel_m": {name: _value(study, name, "travel_m") for name in names},
    }
    for key in SHARED:
        answer[key] = {name: _value(study, name, key) for name in names}
    answer["responses"] = {
        phase: {
            name: {
                "frequency_Hz": driven.responses[0].frequency_Hz.tolist(),
                **{
                    motion: None if level is None else level.tolist()
                    for motion, level in driven.responses[0].level_dB.items()
                },
            }
            for name, driven in by_name.items()
        }
        for phase, by_name in study.driven.items()
    }
    return answer


def extrapolations(study: RideStudy) -> list[str]:
    """A sentence for each damper whose tests the ride left, or of whose tests nothing is known."""
    lines = []
    for variant in study.variants:
        beyond, covered = study.beyond(variant.name), variant.fit.covered
        if beyond and covered is not None:
            parts = (f"{name.partition('_')[0]} {100.0 * share:.3g} % of the time" for name, share in beyond.items())
            lines.append(
                f"{variant.name}: outside the tested range ({', '.join(parts)}), where the force is extrapolated; "
                f"tested: {covered.describe()}"
            )
        elif covered is None and variant.fit.adequate is not None:
            lines.append(f"{variant.name}: this fit does not contain its tested range. Fix: run `rig identify` again")
    return lines


def _band(study: RideStudy, phase: str, motion: str, band: str) -> dict[str, Any]:
    """The largest difference of any two variants, and each pair's."""
    pairs: list[dict[str, Any]] = []
    for pair in study.pairs():
        apart = study.difference(phase, motion, band, pair)
        pairs.append({
            "between": list(pair), "difference_dB": None if apart is None else apart[0],
            "interval_dB": None if apart is None or apart[1] is None else list(apart[1]),
        })
    known = [entry for entry in pairs if entry["difference_dB"] is not None]
    largest = max(known, key=lambda entry: float(entry["difference_dB"]), default=None)
    empty = {"between": None, "difference_dB": None, "interval_dB": None}
    return {**(largest or empty), "pairs": pairs}


def _value(study: RideStudy, variant: str, name: str) -> dict[str, Any]:
    value, interval = study.number(variant, name)
    return {"value": value, "interval": None if interval is None else list(interval)}
