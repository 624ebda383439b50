"""A CAN interface's stamps on the host's clock: as good as is stated, through drift, jitter and steps."""

import random

from drivers.stamp_clock import StampClock

EPOCH_NS = 1_700_000_000_000_000_000


def run(seconds: float, ppm: float = 30.0, jitter_ns: int = 2_000_000, clock: StampClock | None = None,
        begin_ns: int = 0, epoch_ns: int = EPOCH_NS) -> tuple[StampClock, list[int]]:  # fmt: skip
    """Frames every 2 ms, read 20 us to `jitter_ns` later; the clock, and what each mapped stamp is off by."""
    draw, clock = random.Random(3), clock or StampClock()
    errors = []
    for number in range(int(seconds * 500)):
        true_ns = begin_ns + number * 2_000_000
        read_ns = true_ns + 20_000 + int(jitter_ns * draw.random() ** 4)
        stamp_ns = epoch_ns + round(true_ns * (1.0 + ppm * 1e-6))
        mapped_ns = clock.host_ns(stamp_ns, read_ns)
        assert mapped_ns <= read_ns
        errors.append(mapped_ns - true_ns)
    return clock, errors


def test_stamps_are_used_after_a_second_and_are_as_good_as_is_stated() -> None:
    clock, errors = run(5.0)
    assert clock.uncertainty_ns is not None
    assert clock.uncertainty_ns < 100_000
    late = errors[1000:]
    assert max(late) - min(late) <= 2 * clock.uncertainty_ns + 10_000
    assert min(late) >= 0
    assert max(late) < 20_000 + 100_000
    assert max(errors[:300]) > 1_000_000, "before, it is the arrival"


def test_without_stamps_it_is_the_arrival() -> None:
    clock = StampClock()
    assert [clock.host_ns(0, at_ns) for at_ns in (5, 9)] == [5, 9]
    assert clock.uncertainty_ns is None


def test_stamps_of_a_clock_that_runs_away_are_not_used() -> None:
    clock, errors = run(3.0, ppm=20_000.0)
    assert clock.uncertainty_ns is None
    assert min(errors) >= 20_000


def test_a_wall_clock_that_is_set_is_followed_anew() -> None:
    for step_ns in (3_600_000_000_000, -3_600_000_000_000):
        clock, _ = run(3.0)
        clock, errors = run(3.0, clock=clock, begin_ns=3_000_000_000, epoch_ns=EPOCH_NS + step_ns)
        assert clock.uncertainty_ns is not None
        assert min(errors) >= 0
        assert max(errors[1000:]) < 200_000
