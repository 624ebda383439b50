"""What a campaign's first session found out about rig and damper; every later one must find the same."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rig.campaign.cause import Cause
from rig.campaign.signature import Signature
from rig.errors import FileProblem
from rig.recording.atomic_write import write_text_durably
from rig.text_file import read_json

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
        found = self._values.get("signature")
        try:
            return None if found is None else Signature.from_json(found)
        except (KeyError, TypeError, ValueError) as error:
            raise FileProblem(str(self._path), [f"signature: {error!r}"]) from error

    def other_device(self, identities: Mapping[str, Any]) -> Cause | None:
        """Why these are not the devices of the first session; None when they are, or in the first session."""
        for device, known in self._values.get("devices", {}).items():
            found = _lasting(device, identities)
            for name, value in known.items():
                if found.get(name) != value:
                    return Cause(
                        "wrong-identity",
                        f"{device}: {name} {found.get(name)!r}, in the campaign's first session {value!r}",
                    )
        return None

    def other_temperature(self, now_degC: float, seen_degC: Iterable[float]) -> Cause | None:
        """Why the damper's temperature is not one of this campaign's; None when it is, or in the first session.

        Args:
            now_degC: the coil's temperature at the proof move.
            seen_degC: coil temperatures of the points recorded so far.
        """
        first_degC = self._values.get("coil_temperature_degC")
        if not isinstance(first_degC, float):
            return None
        known = [first_degC, *(each for each in seen_degC if math.isfinite(each))]
        low_degC, high_degC = min(known) - TEMPERATURE_APART_K, max(known) + TEMPERATURE_APART_K
        if low_degC <= now_degC <= high_degC:
            return None
        if math.isnan(now_degC):
            return Cause("temperature-window", "the ECU reports no coil temperature")
        seen = f"this campaign saw {min(known):.1f} to {max(known):.1f} degC"
        advice = "let it cool down" if now_degC > high_degC else "warm the room or the damper"
        return Cause(
            "temperature-window",
            f"coil at {now_degC:.1f} degC; {seen} and goes on from {low_degC:.1f} to {high_degC:.1f} degC: {advice}, "
            "then resume",
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
