"""Points spoiled on purpose: invalid for the right reason, repeated, exit 5 when nothing helps."""

from __future__ import annotations

from pathlib import Path

import pytest
from matrices import matrix_text
from simulated_campaign import Ended, options, simulated

from rig.recording.recorded_point import RecordedPoint


class Ending(Ended):
    """The campaign's end as these tests look at it."""

    def verdicts(self) -> dict[str, str]:
        return {point["id"]: point["verdict"] for point in self.answer["points"]}

    def reasons(self, point_id: str) -> dict[str, str]:
        """Slug of each reason, and who is to blame."""
        point = next(point for point in self.answer["points"] if point["id"] == point_id)
        return {text.partition(":")[0]: who for text, who in zip(point["reasons"], point["blamed"], strict=True)}

    def recorded(self) -> dict[str, RecordedPoint]:
        return {file.stem: RecordedPoint.open(file) for file in sorted((self.folder / "points").glob("*.h5"))}

    def trips(self) -> list[str]:
        return [line["slug"] for line in self.story if line["event"] == "station" and line.get("what") == "trip"]


def run(
    folder: Path, *simulator: str, currents: tuple[str, ...] = ("0.5 A",), frequency: str = "1 Hz", cycles: int = 5,
    campaign: str = "",
) -> Ending:
    more = f"[campaign]\nretries = 1\n{campaign}"
    matrix = matrix_text(*currents, frequency=frequency, cycles=cycles, more=more)
    ended = simulated(folder, matrix, *simulator, seed=3)
    return Ending(**vars(ended))


def test_peaks_clipped_for_a_moment_are_saturated_and_repeating_does_not_fix_them(tmp_path: Path) -> None:
    ending = run(tmp_path, *options("load_cell.clip=1050"), currents=("0 A", "1.5 A"), frequency="5 Hz", cycles=20)
    assert ending.exit_code == 5, ending.output
    assert ending.trips() == []
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}
    # A clipped force may also disagree with the controller's own, or look delayed: that depends on the seed.
    reasons = ending.reasons("p002")
    assert {"sensor-saturated"} <= reasons.keys() <= {"sensor-saturated", "load-cell-gain", "load-cell-zero", "skew"}
    assert set(reasons.values()) == {"bench"}
    assert {"p002", "p002-attempt2"} <= ending.recorded().keys()


@pytest.mark.nightly
def test_a_load_cell_that_stays_at_its_amplifiers_end_stops_the_rig(tmp_path: Path) -> None:
    ending = run(tmp_path, *options("load_cell.clip=480"), currents=("0 A", "1.5 A"))
    assert ending.exit_code == 4, ending.output
    assert ending.trips() == ["sensor-saturated"]
    assert ending.verdicts() == {"p001": "valid", "p002": "invalid"}


@pytest.mark.nightly
def test_a_point_with_a_gap_is_repeated_and_fixed(tmp_path: Path) -> None:
    ending = run(tmp_path, "--fault", "sample-gap@3+1", cycles=6)
    assert ending.exit_code == 0, ending.output
    assert ending.verdicts() == {"p001": "valid"}
    first, second = (ending.recorded()[name] for name in ("p001", "p001-attempt2"))
    assert first.verdict == "invalid"
    assert {reason.partition(":")[0] for reason in first.reasons} == {"sample-gap"}
    assert first.lost_samples > 0
    assert second.lost_samples == 0


@pytest.mark.nightly
def test_a_damper_that_heats_is_named_and_repeated(tmp_path: Path) -> None:
    heating = (
        "damper.heat_capacity_J_K=8.0", "damper.heat_loss_W_K=0.1", "damper.coil_heat_capacity_J_K=1.0",
        "damper.coil_to_body_W_K=10.0",
    )
    ending = run(tmp_path, *options(*heating), currents=("1 A",))
    assert ending.exit_code == 5, ending.output
    assert ending.reasons("p001")["temperature-drift"] == "test"
    assert set(ending.recorded()) == {"p001", "p001-attempt2"}


@pytest.mark.nightly
def test_a_fixture_that_slips_is_named_and_repeated(tmp_path: Path) -> None:
    ending = run(tmp_path, *options("damper.free_play_m=0.002"), currents=("1 A",))
    assert ending.exit_code == 5, ending.output
    assert ending.reasons("p001")["free-play"] == "bench"
    assert set(ending.recorded()) == {"p001", "p001-attempt2"}


def test_a_format_without_a_clock_cannot_carry_the_skew_that_is_requested(tmp_path: Path) -> None:
    ending = run(tmp_path, "--force-format", "ascii", campaign="require_skew = true")
    assert ending.exit_code == 3, ending.output
    assert ending.answer["slug"] == "format-without-clock"
    assert "[load_cell] format" in ending.answer["error"]
