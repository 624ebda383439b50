"""What a campaign's first session saw of rig and damper; every later one must see the same.

The damper's 0 A signature (fault row `wrong-damper`) comes from the slow proof move before the matrix: its mean is gas
force and offset, its swing friction and oil at that speed. It must not be stronger than the specimen's prior allows,
because the plan relies on that, and in a resumed campaign it must be the signature of the first session.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rig.campaign.stop_cause import StopCause, because
from rig.errors import FileProblem
from rig.matrix.sections import Specimen
from rig.recording.atomic_write import write_text_durably
from rig.signals.arrays import FloatArray
from rig.text_file import read_json

FEWEST_SAMPLES = 5
STEPS_A_CYCLE = 400
STRONGER_SHARE, STRONGER_N = 0.4, 30.0
"""How much stronger than its prior a damper may be: priors are rough, but the plan relies on them."""
MEAN_SHARE, MEAN_N = 0.15, 25.0
SWING_SHARE, SWING_N = 0.35, 20.0
"""How far a signature may be from the first session's: gas force and oil follow the temperature."""


@dataclass(frozen=True)
class Signature:
    """Mean of the forces on the way up and down, and half of their difference, N."""

    mean_N: float
    swing_N: float

    @property
    def peak_N(self) -> float:
        """Mean and swing together (N), without sign."""
        return abs(self.mean_N) + self.swing_N

    def __str__(self) -> str:
        return f"{self.mean_N:.0f} N ± {self.swing_N:.0f} N"

    def to_json(self) -> dict[str, float]:
        """Its fields by name."""
        return asdict(self)

    @classmethod
    def from_json(cls, entry: Mapping[str, float]) -> Signature:
        """From `to_json`.

        Raises:
            KeyError: a field is missing.
        """
        return cls(float(entry["mean_N"]), float(entry["swing_N"]))


def expected_signature(specimen: Specimen, amplitude_m: float, speed_m_s: float) -> Signature | None:
    """What the specimen's prior predicts for a slow move there and back; None without a prior.

    Args:
        specimen: the damper as the matrix describes it.
        amplitude_m: half of the move's way (m).
        speed_m_s: its speed (m/s).
    """
    if specimen.prior is None:
        return None
    from rig.dampers import model, parameter_set

    prior = parameter_set(specimen.prior)
    damper = model(prior.model, "printed" if prior.hysteresis == "printed" else "kwok")
    # Two cycles; the second counts, because models with memory start at rest.
    dt_s = 4.0 * amplitude_m / speed_m_s / STEPS_A_CYCLE
    quarter = np.arange(2 * STEPS_A_CYCLE) % STEPS_A_CYCLE / STEPS_A_CYCLE
    v = np.where((quarter < 0.25) | (quarter >= 0.75), speed_m_s, -speed_m_s)
    force_N = damper.force(prior.values, np.cumsum(v) * dt_s, v, np.zeros_like(v), 0.0, dt_s)[STEPS_A_CYCLE:]
    upwards = v[STEPS_A_CYCLE:] > 0.0
    return measured_signature(np.asarray(force_N[upwards]), np.asarray(force_N[~upwards]))


def measured_signature(up_N: FloatArray, down_N: FloatArray) -> Signature | None:
    """The signature of a slow move; None with too few samples.

    Args:
        up_N: force on the way up, (n,) N.
        down_N: force on the way down, (m,) N.
    """
    if min(len(up_N), len(down_N)) < FEWEST_SAMPLES:
        return None
    up, down = float(np.median(up_N)), float(np.median(down_N))
    return Signature(0.5 * (up + down), 0.5 * abs(up - down))


def judge_damper(now: Signature | None, expected: Signature | None, first: Signature | None) -> StopCause | None:
    """Whether the damper is the campaign's; None when it is.

    Args:
        now: its signature now; None when there was none to be measured.
        expected: what its prior predicts; None without a prior.
        first: the signature of the campaign's first session; None in the first.
    """
    if now is None or not (math.isfinite(now.mean_N) and math.isfinite(now.swing_N)):
        return because("wrong-damper", "no-signature")
    if first is not None:
        mean_off = abs(now.mean_N - first.mean_N) > MEAN_SHARE * abs(first.mean_N) + MEAN_N
        swing_off = abs(now.swing_N - first.swing_N) > SWING_SHARE * first.swing_N + SWING_N
        if mean_off or swing_off:
            return because("wrong-damper", "other-signature", now=now, first=first)
    if expected is not None and now.peak_N > (1.0 + STRONGER_SHARE) * expected.peak_N + STRONGER_N:
        return because("wrong-damper", "stronger-damper", now=now, expected=expected)
    return None


LASTING = {"actuator": ("vendor", "model", "serial_number", "firmware"), "ecu": ("serial_number", "firmware", "layout")}
"""Of an identity, what no restart of the device changes."""


TEMPERATURE_APART_K = 10.0
"""A later session may begin so much below and above what the campaign has seen; its points heat the damper more."""


class Baseline:
    """`baseline.json` in a campaign's directory.

    Args:
        folder: the campaign's directory.

    Raises:
        FileProblem: the file is there but cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / "baseline.json"
        self._values: dict[str, Any] = {}
        if self._path.is_file():
            self._values = read_json(self._path)

    @property
    def signature(self) -> Signature | None:
        """The damper's first 0 A signature; None before there was one.

        Raises:
            FileProblem: the entry is damaged.
        """
        entry = self._values.get("signature")
        try:
            return None if entry is None else Signature.from_json(entry)
        except (KeyError, TypeError, ValueError) as error:
            raise FileProblem(str(self._path), [f"signature: {error!r}"]) from error

    def other_device(self, identities: Mapping[str, Any]) -> StopCause | None:
        """Why these are not the devices of the first session; None when they are, or in the first session."""
        for device, known in self._values.get("devices", {}).items():
            present = _lasting(device, identities)
            for name, value in known.items():
                if present.get(name) != value:
                    now = present.get(name)
                    return because("wrong-identity", "other-device", device=device, name=name, now=now, first=value)
        return None

    def other_temperature(self, now_degC: float, seen_degC: Iterable[float]) -> StopCause | None:
        """Why the damper's temperature is not one of this campaign's; None when it is, or in the first session.

        Args:
            now_degC: the coil's temperature at the proof move.
            seen_degC: coil temperatures of the points recorded so far.
        """
        first_degC = self._values.get("coil_temperature_degC")
        if not isinstance(first_degC, float):
            return None
        known = [first_degC, *(seen for seen in seen_degC if math.isfinite(seen))]
        low_degC, high_degC = min(known) - TEMPERATURE_APART_K, max(known) + TEMPERATURE_APART_K
        if low_degC <= now_degC <= high_degC:
            return None
        if math.isnan(now_degC):
            return because("temperature-window", "no-coil-temperature")
        message = "too-hot-to-resume" if now_degC > high_degC else "too-cold-to-resume"
        return because(
            "temperature-window", message, now_degC=now_degC, lowest_degC=min(known), highest_degC=max(known),
            from_degC=low_degC, to_degC=high_degC,
        )

    def keep(self, identities: Mapping[str, Any], signature: Signature, temperature_degC: float) -> None:
        """Write down what was found, in the first session.

        Args:
            identities: what the devices said at connect.
            signature: the damper's 0 A signature.
            temperature_degC: the coil's temperature then; NaN where the ECU reports none.

        Raises:
            OSError: it cannot be written.
        """
        if not self._values:
            devices = {device: _lasting(device, identities) for device in LASTING}
            self._values = {"devices": devices, "signature": signature.to_json()}
            if math.isfinite(temperature_degC):
                self._values["coil_temperature_degC"] = temperature_degC
            write_text_durably(self._path, json.dumps(self._values, indent=1) + "\n")


def _lasting(device: str, identities: Mapping[str, Any]) -> dict[str, Any]:
    entry = identities.get(device, {})
    return {name: entry[name] for name in LASTING.get(device, ()) if name in entry}


def read_baseline(folder: Path) -> Baseline:
    """What the campaign's first session found; damaged entries are found now, not in motion.

    Raises:
        FileProblem: the file cannot be used.
    """
    baseline = Baseline(folder)
    if baseline.signature is not None:
        try:
            baseline.other_device({})
        except (AttributeError, TypeError, ValueError) as error:
            raise FileProblem(str(folder / "baseline.json"), [f"devices: {error!r}"]) from error
    return baseline
