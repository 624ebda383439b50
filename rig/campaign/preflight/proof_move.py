"""The slow check move (rows `sensors-swapped`, `wrong-damper`): do the sensors follow, is it the campaign's damper?

After full pressure and before any other motion, the rod moves 2 mm in one and 2 mm in the other direction, at 10 mm/s
and 0 A. At both ends, where it rests and no clock alignment is needed, the LVDT is compared with the controller's own
position. The damper resists the motion, so the force of the up stroke must be above the force of the down stroke.

The same move measures the damper's 0 A signature: its mean is gas force and offset, its swing friction and oil at that
speed. It must not exceed what the specimen's expected damper allows, because the plan relies on it. Every later session
must reproduce what the first session measured of rig and damper (`Baseline`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from rig.campaign.execution.campaign_context import CampaignContext
from rig.campaign.execution.observer import AT_CENTRE_M, Observer
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import StopCause, because
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.matrix.sections import Specimen
from rig.recording.atomic_write import write_text_durably
from rig.recording.journal.ring_reader import RecordBlock
from rig.signals.arrays import FloatArray
from rig.signals.rest import difference_N, is_constant
from rig.text_file import read_json

SWAPPED = "sensors-swapped"
PROOF_M = 2e-3
PROOF_SPEED_M_S = 0.010
SCALE_TOLERANCE = 0.1
FORCE_FACTOR = 2.0
"""The controller's force input is coarse: the two forces may differ by this factor."""
FEWEST_SAMPLES = 10
SURE = 6.0
"""Standard errors by which a difference of forces is more than noise."""
QUIET_S = 0.1
SETTLED_NS = 10_000_000


def proof_targets(start_m: float, low_m: float, high_m: float) -> tuple[float, float]:
    """Where the two ways of the proof move end (m): first up, then down, inside the position limits.

    Args:
        start_m: the controller's present position.
        low_m: lower position limit.
        high_m: upper position limit.
    """
    centre_m = min(max(start_m, low_m + 2.0 * PROOF_M), high_m - 2.0 * PROOF_M)
    return centre_m + PROOF_M, centre_m - PROOF_M


@dataclass(frozen=True)
class Leg:
    """One way of the move.

    Attributes:
        lvdt_m: LVDT at its end.
        position_m: the controller's own position there.
        force_N: load-cell samples on the way, (n,).
        controller_force_N: the controller's own coarse force input on the way, (k,).
        rest_force_N: load-cell samples at the end, (m,); on a rig faster than life the way can be over unseen.
    """

    lvdt_m: float
    position_m: float
    force_N: NDArray[np.float64]
    controller_force_N: NDArray[np.float64]
    rest_force_N: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))


def check_proof(up: Leg, down: Leg) -> StopCause | None:
    """Whether the sensors followed the actuator; None when they did.

    A force of motion that drowns in the load cell's noise proves nothing and refuses nothing.
    """
    moved_m, shown_m = up.position_m - down.position_m, up.lvdt_m - down.lvdt_m
    scale = shown_m / moved_m if moved_m > 0.5 * PROOF_M else math.nan
    if not abs(scale - 1.0) <= SCALE_TOLERANCE:
        return because(SWAPPED, "lvdt-scale", shown_mm=1e3 * shown_m, moved_mm=1e3 * moved_m)
    force_N, noise_N = difference_N(up.force_N, down.force_N)
    if force_N < -SURE * noise_N:
        return because(SWAPPED, "force-sign", force_N=-force_N)
    coarse_N, coarse_noise_N = difference_N(up.controller_force_N, down.controller_force_N)
    if abs(coarse_N) <= SURE * coarse_noise_N or abs(force_N) <= SURE * noise_N:
        return None
    if not 1.0 / FORCE_FACTOR <= force_N / coarse_N <= FORCE_FACTOR:
        return because(SWAPPED, "force-scale", force_N=force_N, own_N=coarse_N)
    return None


@dataclass
class ProofMove:
    """The move as it is seen in ring records.

    Attributes:
        observer: what follows the ring.
        damper: whether it is the campaign's damper, by both ways; asked once the sensors are proved.
    """

    observer: Observer
    damper: Callable[[Leg, Leg], StopCause | None]
    _targets: tuple[float, float] = (0.0, 0.0)
    _legs: list[Leg] = field(default_factory=list)

    def target(self, leg: int, low_m: float, high_m: float) -> float:
        """Where a way of the move ends (m); way 0 begins a new move inside these position limits."""
        if leg == 0:
            start_m = self.observer.last.get(Channel.POSITION, math.nan)
            self._targets, self._legs = proof_targets(start_m, low_m, high_m), []
        return self._targets[leg]

    def watch(self, target_m: float, since_ns: int) -> None:
        """The station has begun the way to `target_m`: wait for its end, `ProofLegDone` or `ProofJudged`."""
        observer = self.observer
        on_the_way: list[NDArray[Any]] = []
        at_end: list[NDArray[Any]] = []
        held_s, held_ns = math.inf, 0

        def wait(block: RecordBlock) -> ev.Event | None:
            nonlocal held_s, held_ns
            if held_s == math.inf:
                on_the_way.append(block.records[block.records["host_ns"] > since_ns])
                apart_m = abs(observer.last.get(Channel.POSITION, math.nan) - target_m)
                if observer.held_ns > since_ns and apart_m <= AT_CENTRE_M:
                    held_s, held_ns = observer.device_s, int(block.records["host_ns"].max())
                return None
            at_end.append(block.records[block.records["host_ns"] > held_ns + SETTLED_NS])
            lvdt_m, position_m = _values(at_end, Channel.DISPLACEMENT), _values(at_end, Channel.POSITION)
            if observer.device_s < held_s + QUIET_S or len(lvdt_m) < FEWEST_SAMPLES or len(position_m) == 0:
                return None
            if not is_constant(lvdt_m, 0.05 * PROOF_M):  # the host was held up: samples of the way that came late
                at_end.clear()
                held_s = observer.device_s
                return None
            forces = _values(on_the_way, Channel.FORCE), _values(on_the_way, Channel.CONTROLLER_FORCE)
            rest_N = _values(at_end, Channel.FORCE)
            self._legs.append(Leg(float(np.mean(lvdt_m)), float(np.mean(position_m)), *forces, rest_N))
            if len(self._legs) == 1:
                return ev.ProofLegDone()
            return ev.ProofJudged(check_proof(*self._legs) or self.damper(*self._legs))

        observer.wait = wait


def _values(parts: list[NDArray[Any]], channel: Channel) -> NDArray[np.float64]:
    """Finite values (n,) of one channel."""
    values = np.concatenate([part["value"][part["channel"] == channel] for part in parts]).astype(np.float64)
    return np.asarray(values[np.isfinite(values)])


FEWEST_FOR_SIGNATURE = 5
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
    prior = specimen.assumed
    if prior is None:
        return None
    # Two cycles; the second counts, because models with memory start at rest.
    dt_s = 4.0 * amplitude_m / speed_m_s / STEPS_A_CYCLE
    quarter = np.arange(2 * STEPS_A_CYCLE) % STEPS_A_CYCLE / STEPS_A_CYCLE
    v = np.where((quarter < 0.25) | (quarter >= 0.75), speed_m_s, -speed_m_s)
    force_N = prior.model.force(prior.values, np.cumsum(v) * dt_s, v, np.zeros_like(v), 0.0, dt_s)[STEPS_A_CYCLE:]
    upwards = v[STEPS_A_CYCLE:] > 0.0
    return measured_signature(np.asarray(force_N[upwards]), np.asarray(force_N[~upwards]))


def measured_signature(up_N: FloatArray, down_N: FloatArray) -> Signature | None:
    """The signature of a slow move; None with too few samples.

    Args:
        up_N: force on the way up, (n,) N.
        down_N: force on the way down, (m,) N.
    """
    if min(len(up_N), len(down_N)) < FEWEST_FOR_SIGNATURE:
        return None
    up, down = float(np.median(up_N)), float(np.median(down_N))
    return Signature(0.5 * (up + down), 0.5 * abs(up - down))


def check_damper(now: Signature | None, expected: Signature | None, first: Signature | None) -> StopCause | None:
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
        anew: ignore the file; `keep` replaces it.

    Raises:
        FileProblem: the file is there but cannot be used.
    """

    def __init__(self, folder: Path, *, anew: bool = False) -> None:
        self._path = CampaignFolder(folder).baseline
        self._values: dict[str, Any] = {}
        if self._path.is_file() and not anew:
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


def read_baseline(folder: Path, *, points_kept: bool) -> Baseline:
    """What the campaign's first session found; damaged entries are found now, not in motion.

    Args:
        folder: the campaign's directory.
        points_kept: points of an earlier session are kept: the rest must be measured on the same damper and devices.
            Otherwise no result depends on the baseline, and this session measures it again: one that was measured
            with a load cell that was not tared would refuse every later session.

    Raises:
        FileProblem: points are kept, and the file is missing or cannot be used.
    """
    if not points_kept:
        return Baseline(folder, anew=True)
    baseline = Baseline(folder)
    if baseline.signature is None:
        text = (
            "is missing or empty, so the program cannot verify that the campaign's points were measured with this "
            "damper and these devices; "
        )
        raise FileProblem(str(CampaignFolder(folder).baseline), [text + "restore the file, or start a new campaign"])
    try:
        baseline.other_device({})
    except (AttributeError, TypeError, ValueError) as error:
        raise FileProblem(str(CampaignFolder(folder).baseline), [f"devices: {error!r}"]) from error
    return baseline


@dataclass
class DamperCheck:
    """Judges the damper by its 0 A signature, and keeps what the first session found.

    Attributes:
        campaign: what the campaign works with.
        baseline: what its first session found.
        last: the last value of every channel.
        disk_error: why `baseline.json` could not be written; None while it could.
    """

    campaign: CampaignContext
    baseline: Baseline
    last: Mapping[int, float]
    disk_error: OSError | None = None

    def check(self, up: Leg, down: Leg) -> StopCause | None:
        """Why this not the campaign's damper, or not as warm as it may be; None when all is well."""
        campaign = self.campaign
        expected = expected_signature(campaign.matrix.specimen, PROOF_M, PROOF_SPEED_M_S)
        first = self.baseline.signature
        signature = measured_signature(up.force_N, down.force_N)
        if signature is None:
            signature = measured_signature(up.rest_force_N, down.rest_force_N)
        campaign.log.note("signature", found=str(signature), expected=str(expected), first=str(first))
        temperature_degC = self.last.get(Channel.COIL_TEMPERATURE, math.nan)
        cause = check_damper(signature, expected, first)
        if cause is None and campaign.matrix.temperature is None and campaign.results.began_ns is None:
            # With a window every point finds its own temperature; after a restart the session's own points have warmed.
            cause = self.baseline.other_temperature(temperature_degC, campaign.stock.temperatures_degC)
        if cause is None and signature is not None:
            try:
                self.baseline.keep(campaign.identities, signature, temperature_degC)
            except OSError as error:
                self.disk_error = self.disk_error or error
        return cause
