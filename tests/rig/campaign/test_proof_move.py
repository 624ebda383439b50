"""The slow proof move: what it commands, what it refuses, and that it finds both in ring records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from drivers.ring import Channel
from drivers.roles import State
from rig.campaign.execution.observer import Observer
from rig.campaign.preflight.proof_move import PROOF_M, Leg, ProofMove, check_proof, proof_targets
from rig.campaign.sequencer import event as ev
from rig.recording.journal.ring_reader import RecordBlock
from rig.recording.ring_records import RECORD_DTYPE

RANDOM = np.random.default_rng(5)
MS = 1_000_000


def show(observer: Observer, records: np.ndarray) -> ev.Event | None:
    return observer.observe(RecordBlock(records))


def way(lvdt_m: float, position_m: float, force_N: float, coarse_N: float | None = None) -> Leg:
    coarse = force_N if coarse_N is None else coarse_N
    return Leg(lvdt_m, position_m, RANDOM.normal(force_N, 5.0, 60), RANDOM.normal(coarse, 10.0, 20))


UP, DOWN = way(0.012, 0.012, 80.0), way(0.008, 0.008, -70.0)


def test_sensors_that_follow_the_actuator_are_proved() -> None:
    assert check_proof(UP, DOWN) is None


@pytest.mark.parametrize(
    ("up", "down", "named"),
    [
        (replace(UP, lvdt_m=-0.012), replace(DOWN, lvdt_m=-0.008), "showed -4 mm"),
        (replace(UP, lvdt_m=0.0), replace(DOWN, lvdt_m=0.0), "showed 0 mm"),
        (replace(UP, lvdt_m=0.0124), replace(DOWN, lvdt_m=0.0076), "4.8 mm"),
        (UP, replace(DOWN, position_m=0.012), "controller moved 0 mm"),
        (way(0.012, 0.012, -80.0, 80.0), way(0.008, 0.008, 70.0, -70.0), "showed 149 N less"),
        (way(0.012, 0.012, 800.0, 80.0), way(0.008, 0.008, -700.0, -70.0), "the controller showed 1"),
    ],
    ids=["sign", "still", "scale", "controller", "force-sign", "force-scale"],
)
def test_wrong_sign_scale_or_plug_is_refused(up: Leg, down: Leg, named: str) -> None:
    cause = check_proof(up, down)
    assert cause is not None
    assert cause.slug == "sensors-swapped"
    assert named in cause.detail


def test_a_force_that_drowns_in_noise_refuses_nothing() -> None:
    assert check_proof(way(0.012, 0.012, 0.1), way(0.008, 0.008, -0.1)) is None
    assert check_proof(replace(UP, force_N=np.zeros(2)), DOWN) is None


@pytest.mark.parametrize(("start_m", "middle_m"), [(0.0, 0.0), (0.0845, 0.081), (-0.2, -0.081)])
def test_the_move_stays_about_the_start_and_inside_the_limits(start_m: float, middle_m: float) -> None:
    assert proof_targets(start_m, -0.085, 0.085) == pytest.approx((middle_m + PROOF_M, middle_m - PROOF_M))


def block(t_ms: int, state: State, position_m: float, force_N: float, lvdt_m: float | None = None) -> np.ndarray:
    """What arrives in 10 ms: one status, and sensors at 2 kHz."""
    made = np.zeros(43, RECORD_DTYPE)
    shown_m = position_m if lvdt_m is None else lvdt_m
    rows = [(Channel.STATE, float(state)), (Channel.POSITION, position_m), (Channel.CONTROLLER_FORCE, force_N)]
    rows += [(Channel.FORCE, force_N), (Channel.DISPLACEMENT, shown_m)] * 20
    for row, (channel, value) in zip(made, rows, strict=True):
        row["channel"], row["value"] = channel, value
        row["host_ns"], row["device_us"] = t_ms * MS, t_ms * 1000
    return made


@pytest.mark.parametrize(("sign", "slug"), [(1.0, None), (-1.0, "sensors-swapped")])
def test_both_ways_are_found_in_the_records(sign: float, slug: str | None) -> None:
    observer = Observer()
    move, t_ms, events = ProofMove(observer, lambda up, down: None), 0, []
    for target_m, force_N in ((0.002, 60.0), (-0.002, -60.0)):
        move.watch(target_m, t_ms * MS)
        for part in np.linspace(0.0, 1.0, 20):
            t_ms += 10
            position_m = -target_m + 2 * target_m * part
            events.append(show(observer, block(t_ms, State.MOVING, position_m, force_N, sign * position_m)))
        for _ in range(20):
            t_ms += 10
            events.append(show(observer, block(t_ms, State.HOLD, target_m, 0.3 * force_N, sign * target_m)))
    found = [event for event in events if event is not None]
    assert found[0] == ev.ProofLegDone()
    (_, verdict) = found
    assert isinstance(verdict, ev.ProofJudged)
    assert (verdict.cause.slug if verdict.cause else None) == slug


def test_samples_of_the_way_that_come_late_are_no_samples_of_its_end() -> None:
    """The controller is there, the LVDT's values of the last 100 ms of the way are still in the port."""
    observer = Observer()
    proof = ProofMove(observer, lambda up, down: None)
    show(observer, block(0, State.HOLD, 0.0, 0.0))
    events, t_ms = [], 0
    for leg in range(2):
        target_m = proof.target(leg, -0.08, 0.08)
        proof.watch(target_m, t_ms * MS)
        show(observer, block(t_ms + 10, State.MOVING, 0.0, 60.0 - 120.0 * leg))
        for step in range(40):
            late_m = target_m * min(1.0, 0.5 + 0.05 * step)
            events.append(show(observer, block(t_ms + 20 + 10 * step, State.HOLD, target_m, 0.0, late_m)))
        t_ms += 1000
    assert [event for event in events if event is not None] == [ev.ProofLegDone(), ev.ProofJudged(None)]
