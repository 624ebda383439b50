"""A current that is commanded anew at every step: one that follows late, one that does not."""

import math

from drivers.current_source import SourceStatus, SourceTiming
from rig.station.interlocks.law_interlock import LawInterlock

PERIOD_S = 0.010
SETTLING_S = 0.15
LAG_S = 0.05
"""A coil that needs three of them, 0.15 s, to settle to 5 %."""


def found(measured_share: float, seconds: float = 6.0, *, law: bool = True) -> list[str]:
    """Findings, with their times, on a current between 0 and 1 A that changes every 70 ms."""
    interlock = LawInterlock(SourceTiming(status_s=PERIOD_S), SETTLING_S)
    interlock.follow(law=law)
    current_A, seen = 0.0, []
    for n in range(round(seconds / PERIOD_S)):
        requested_A = float(int(n / 7) % 2)
        current_A += (1.0 - math.exp(-PERIOD_S / LAG_S)) * (measured_share * requested_A - current_A)
        findings = interlock.check(SourceStatus(2, current_A, 0), requested_A, int(1e9 * n * PERIOD_S))
        seen += [f"{finding.slug}@{n * PERIOD_S:.2f}" for finding in findings]
    return seen


def test_a_current_that_follows_late_is_a_law_s() -> None:
    assert found(1.0) == []


def test_a_source_that_drives_nothing_is_found_within_a_second_though_no_command_lasts() -> None:
    assert found(0.0) == ["current-tracking@1.01"]


def test_a_source_that_drives_too_much_is_found() -> None:
    assert [text.partition("@")[0] for text in found(1.6)] == ["current-tracking"]


def test_a_current_that_is_no_law_s_is_not_evaluated_here() -> None:
    assert found(0.0, law=False) == []


def test_the_end_of_a_step_before_the_window_is_no_deviation() -> None:
    """A window of equal commands still contains the decay of the last step: 2 A x 0.05 s / 1 s = 0.1 A."""
    interlock = LawInterlock(SourceTiming(status_s=PERIOD_S), SETTLING_S)
    interlock.follow(law=True, patience_s=0.03)
    current_A, seen = 0.0, []
    for n in range(600):
        requested_A = 2.0 if n < 250 else 0.0
        current_A += (1.0 - math.exp(-PERIOD_S / LAG_S)) * (requested_A - current_A)
        seen += interlock.check(SourceStatus(2, current_A, 0), requested_A, int(1e9 * n * PERIOD_S))
    assert seen == []
    for n in range(600, 700):
        seen += interlock.check(SourceStatus(2, 0.3, 0), 0.0, int(1e9 * n * PERIOD_S))
    assert [finding.slug for finding in seen] == ["current-tracking"], "a current that remains is detected"
