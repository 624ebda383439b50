from __future__ import annotations

from dataclasses import dataclass

import pytest

from drivers.connection import LinkKind
from drivers.errors import Busy, DriverError, LinkLost, NoAnswer, PortClosed, RequestRefused, WrongAnswer, WrongLayout
from rig.station.interlocks.link_faults import BUSY_POLLS, LinkFaults


@dataclass
class Link:
    link_kind: LinkKind = LinkKind.MODBUS_TCP
    is_open: bool = True
    stale: int = 0
    busy: int = 0


def error(kind: type[DriverError], message: str = "no") -> DriverError:
    return kind("actuator", "port", message)


def named(troubles: LinkFaults, kind: type[DriverError], message: str = "no") -> tuple[str, bool]:
    finding = troubles.failed(error(kind, message), 5)
    return finding.slug, finding.warns


@pytest.mark.parametrize(
    ("kind", "slug"),
    [(RequestRefused, "modbus-reject"), (LinkLost, "modbus-reset"), (PortClosed, "modbus-reset"),
     (WrongLayout, "actuator-reboot")],
)  # fmt: skip
def test_what_cannot_be_overcome_is_a_fault_at_once(kind: type[DriverError], slug: str) -> None:
    assert named(LinkFaults(Link()), kind) == (slug, False)


def test_a_message_decides_nothing() -> None:
    """A host whose name is `busybox` once turned a refusal into a busy answer."""
    assert named(LinkFaults(Link()), RequestRefused, "busybox is busy: exception 6 (busy)") == ("modbus-reject", False)


def test_busy_polls_are_a_fault_in_a_row_only() -> None:
    troubles = LinkFaults(Link())
    for _ in range(2):
        polls = [named(troubles, Busy) for _ in range(BUSY_POLLS)]
        assert polls == [("modbus-busy", True)] * (BUSY_POLLS - 1) + [("modbus-busy", False)]
        troubles.answered(6)


@pytest.mark.parametrize(("kind", "slug"), [(LinkKind.MODBUS_TCP, "modbus-mismatch"), (LinkKind.MODBUS_RTU, "rtu-crc")])
def test_wrong_answers_are_a_fault_the_third_time_in_a_row(kind: LinkKind, slug: str) -> None:
    troubles = LinkFaults(Link(kind))
    assert [named(troubles, WrongAnswer) for _ in range(3)] == [(slug, True), (slug, True), (slug, False)]
    troubles.answered(6)
    assert named(troubles, WrongAnswer) == (slug, True)


def test_silence_is_a_fault_when_the_connection_was_given_up() -> None:
    link = Link()
    troubles = LinkFaults(link)
    assert named(troubles, NoAnswer) == ("modbus-halfopen", True)
    link.is_open = False
    assert named(troubles, NoAnswer) == ("modbus-halfopen", False)


def test_a_connection_given_up_because_only_others_were_answered_is_tried_again_first() -> None:
    link = Link(is_open=False, stale=2)
    troubles = LinkFaults(link)
    assert named(troubles, NoAnswer) == ("modbus-wrong-tid", True)
    assert named(troubles, NoAnswer) == ("modbus-halfopen", False), "nothing has answered since"


def test_what_was_overcome_is_flagged_once() -> None:
    link = Link(LinkKind.MODBUS_RTU)
    troubles = LinkFaults(link)
    assert troubles.answered(5) == []
    link.stale, link.busy = 1, 2
    assert [(finding.slug, finding.warns) for finding in troubles.answered(6)] == [
        ("rtu-stale", True), ("modbus-busy", True),
    ]  # fmt: skip
    assert troubles.answered(7) == []
