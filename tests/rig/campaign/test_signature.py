"""The damper's 0 A signature: what it measures, and which dampers it refuses."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rig.campaign.preflight.proof_move import (
    Baseline,
    Signature,
    check_damper,
    expected_signature,
    measured_signature,
    read_baseline,
)
from rig.errors import FileProblem
from rig.matrix.sections import Specimen

DEMO = Specimen.model_validate({"serial_number": "MR-1", "stroke": "170 mm", "prior": "demo"})
IDENTITIES = {
    "actuator": {"vendor": "V", "model": "M", "serial_number": "A-1", "firmware": "1.0", "boot_count": 7},
    "ecu": {"serial_number": 1001, "firmware": 256, "layout": 1},
    "lvdt": {"rate_Hz": 250.0},
}


NOISE = np.random.default_rng(1).normal(0.0, 5.0, (2, 100))


def test_a_known_damper_is_measured_through_noise() -> None:
    found = measured_signature(-250.0 + 20.0 + NOISE[0], -250.0 - 20.0 + NOISE[1])
    assert found is not None
    assert (found.mean_N, found.swing_N) == (pytest.approx(-250.0, abs=2.0), pytest.approx(20.0, abs=2.0))


def test_the_prior_predicts_gas_force_and_friction_of_the_slow_move() -> None:
    expected = expected_signature(DEMO, 2e-3, 0.010)
    assert expected is not None
    assert expected.mean_N == pytest.approx(-269.0, abs=5.0)
    assert 5.0 < expected.swing_N < 60.0


def test_a_move_that_was_not_seen_has_no_signature_and_is_refused() -> None:
    assert measured_signature(NOISE[0][:4], NOISE[1]) is None
    refusal = check_damper(None, None, None)
    assert refusal is not None
    assert refusal.slug == "wrong-damper"


@pytest.mark.parametrize(("strength", "refused"), [(0.3, False), (1.0, False), (1.25, False), (1.6, True), (3.0, True)])
def test_a_damper_stronger_than_its_prior_allows_is_refused_a_weaker_one_is_not(strength: float, refused: bool) -> None:
    expected = expected_signature(DEMO, 2e-3, 0.010)
    assert expected is not None
    found = Signature(strength * expected.mean_N, strength * expected.swing_N)
    assert (check_damper(found, expected, None) is not None) is refused


@pytest.mark.parametrize(
    ("found", "refused"),
    [
        (Signature(-250.0, 60.0), False),
        (Signature(-270.0, 70.0), False),
        (Signature(-180.0, 60.0), True),
        (Signature(-330.0, 60.0), True),
        (Signature(-250.0, 120.0), True),
    ],
)
def test_a_resumed_campaign_wants_the_first_sessions_damper(found: Signature, refused: bool) -> None:
    assert (check_damper(found, None, Signature(-250.0, 60.0)) is not None) is refused


def test_without_a_prior_nothing_is_expected() -> None:
    specimen = Specimen.model_validate({"serial_number": "MR-1", "stroke": "170 mm", "max_force": "2 kN"})
    assert expected_signature(specimen, 2e-3, 0.010) is None


def test_the_baseline_is_the_first_sessions_and_is_never_replaced(tmp_path: Path) -> None:
    first = Baseline(tmp_path)
    assert first.signature is None
    assert first.other_device(IDENTITIES) is None
    first.keep(IDENTITIES, Signature(-250.0, 60.0), 23.0)
    later = Baseline(tmp_path)
    later.keep(IDENTITIES, Signature(0.0, 0.0), 99.0)
    assert Baseline(tmp_path).signature == Signature(-250.0, 60.0)


def test_a_device_of_another_serial_number_is_named_a_reboot_is_not(tmp_path: Path) -> None:
    Baseline(tmp_path).keep(IDENTITIES, Signature(-250.0, 60.0), 23.0)
    baseline = Baseline(tmp_path)
    assert baseline.other_device({**IDENTITIES, "actuator": {**IDENTITIES["actuator"], "boot_count": 8}}) is None
    other = baseline.other_device({**IDENTITIES, "actuator": {**IDENTITIES["actuator"], "serial_number": "A-2"}})
    assert other is not None
    assert (other.slug, "A-2" in other.detail, "A-1" in other.detail) == ("wrong-identity", True, True)


@pytest.mark.parametrize(
    ("now_degC", "seen_degC", "named"),
    [
        (23.0, (), None),
        (32.9, (), None),
        (33.1, (), "33.1"),
        (12.9, (), "warm the room"),
        (44.0, (23.0, 35.0), None),
        (45.1, (23.0, 35.0), "23.0 to 35.0 degC"),
        (math.nan, (), "does not report a coil temperature"),
        (33.1, (math.nan,), "33.1"),
    ],
)
def test_a_campaign_goes_on_near_the_temperatures_it_has_seen(
    tmp_path: Path, now_degC: float, seen_degC: tuple[float, ...], named: str | None
) -> None:
    assert Baseline(tmp_path).other_temperature(now_degC, seen_degC) is None, "the first session may be at any"
    Baseline(tmp_path).keep(IDENTITIES, Signature(-250.0, 60.0), 23.0)
    cause = Baseline(tmp_path).other_temperature(now_degC, seen_degC)
    assert (cause is None) if named is None else (cause is not None and named in cause.detail)
    assert cause is None or cause.slug == "temperature-window"


@pytest.mark.parametrize("text", ["[1", '"text"', '{"signature": {"mean_N": "x"}}', '{"signature": {}}'])
def test_a_damaged_baseline_is_reported_and_not_believed(tmp_path: Path, text: str) -> None:
    (tmp_path / "baseline.json").write_text(text, encoding="utf-8")
    with pytest.raises(FileProblem):
        _ = Baseline(tmp_path).signature


@pytest.mark.parametrize("content", [None, "{}"])
def test_kept_points_want_the_first_session_s_damper_and_devices(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "baseline.json").write_text(content, encoding="utf-8")
    assert read_baseline(tmp_path, points_kept=False).signature is None, "nothing was measured yet"
    with pytest.raises(FileProblem, match=r"baseline\.json: is missing or empty, so .*points.*start a new"):
        read_baseline(tmp_path, points_kept=True)


def test_without_kept_points_the_baseline_is_measured_again(tmp_path: Path) -> None:
    """A first session with a load cell that was not tared must not refuse all later ones (scenario 1030031)."""
    Baseline(tmp_path).keep(IDENTITIES, Signature(234.0, 11.0), 23.0)
    anew = read_baseline(tmp_path, points_kept=False)
    assert anew.signature is None
    anew.keep(IDENTITIES, Signature(-265.0, 11.0), 23.0)
    assert read_baseline(tmp_path, points_kept=True).signature == Signature(-265.0, 11.0)
