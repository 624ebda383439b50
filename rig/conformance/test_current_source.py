"""Requirements for a current source's driver (`drivers.current_source.CurrentSource`).

The peer drives a coil of some ohms, or a similar load: up to half an ampere is commanded.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from drivers.catalogue import make_current_source
from drivers.connection import CanAddress
from drivers.current_source import CurrentSource, SourceBatch
from drivers.errors import DriverError
from drivers.plugins import members_of
from drivers.ring import Channel
from rig.conformance.peer import Peer

TARGET_A = 0.5
PERIOD_S = 0.01
SETTLES_S = 3.0
PROMPT_S = 2.0
Made = Callable[..., CurrentSource]


@pytest.fixture
def made(driver_name: str, peer: Peer) -> Iterator[Made]:
    """Makes drivers on the peer; what is open at the end is told 0 A and closed."""
    begun: list[CurrentSource] = []

    def make(channel: str = peer.url) -> CurrentSource:
        begun.append(make_current_source(driver_name.rpartition(":")[2], None, CanAddress("slcan", channel)))
        return begun[-1]

    yield make
    for source in begun:
        source.command(0.0, enable=False)
        source.close()


def until(source: CurrentSource, true: Callable[[], bool], seconds: float = SETTLES_S) -> list[SourceBatch]:
    """Read until something is true; fails when that does not come."""
    batches, until_s = [], time.monotonic() + seconds
    while time.monotonic() < until_s:
        batches.append(source.read_batch(0.05))
        if true():
            return batches
    pytest.fail(f"did not occur within {seconds:g} s; the last status is {source.status}")


def measured_A(source: CurrentSource) -> float:
    """The measured current; huge before there is a status."""
    return 1e9 if source.status is None else source.status.current_A


def test_it_has_what_the_role_has(made: Made) -> None:
    source = made()
    assert [name for name in members_of(CurrentSource) if not hasattr(source, name)] == []
    assert source.commanded_A == 0.0


def test_it_opens_closes_and_opens_again(made: Made) -> None:
    source = made()
    source.open()
    until(source, lambda: source.status is not None)
    source.close()
    source.close()
    with pytest.raises(DriverError):
        source.read_batch(0.05)
    source.open()
    statuses = source.counters.statuses
    until(source, lambda: source.counters.statuses > statuses)


def test_opening_a_dead_port_raises(made: Made, peer: Peer) -> None:
    with pytest.raises(DriverError):
        made(peer.without_listener).open()


def test_it_says_who_it_is_and_how_it_is(made: Made) -> None:
    source = made()
    source.open()
    until(source, lambda: None not in {source.identity, source.status, source.temperature})
    assert source.identity_problem == ""
    assert source.temperature is not None
    assert -40.0 < source.temperature.coil_degC < 200.0, "the coil temperature must be in degC"
    assert abs(measured_A(source)) < 0.1, "without a command the current must be 0 A"


def test_it_drives_what_is_commanded_in_ampere_and_stops_on_command(made: Made) -> None:
    source = made()
    source.open()
    source.start(PERIOD_S)
    source.command(0.0, enable=True, clear_faults=True)
    until(source, lambda: source.status is not None and source.status.faults == 0)
    source.command(TARGET_A)
    assert source.commanded_A == TARGET_A
    batches = until(source, lambda: abs(measured_A(source) - TARGET_A) < 0.05)
    records = [record for batch in batches for record in batch.records]
    assert [value for _, _, value, _, channel, _ in records if channel == Channel.COMMANDED_CURRENT and value > 0.0]
    last = [value for _, _, value, _, channel, _ in records if channel == Channel.COIL_CURRENT][-1]
    assert last == pytest.approx(measured_A(source), abs=1e-9), "the recorded current must equal the status, in A"
    source.command(0.0, enable=False)
    source.send_now()
    assert source.commanded_A == 0.0
    until(source, lambda: abs(measured_A(source)) < 0.02)


def test_a_driver_that_is_gone_leaves_no_current(made: Made) -> None:
    """The device's own time-out: the last safety of a dead host."""
    first = made()
    first.open()
    first.start(PERIOD_S)
    first.command(0.0, enable=True, clear_faults=True)
    until(first, lambda: first.status is not None and first.status.faults == 0)
    first.command(TARGET_A)
    until(first, lambda: abs(measured_A(first) - TARGET_A) < 0.05)
    first.close()
    second = made()
    second.open()
    until(second, lambda: abs(measured_A(second)) < 0.02)


def test_silence_gives_no_status_and_returns_in_time(made: Made, peer: Peer) -> None:
    source = made()
    source.open()
    until(source, lambda: source.status is not None)
    peer.silence()
    quiet_s = time.monotonic() + 0.3
    while time.monotonic() < quiet_s:
        source.read_batch(0.05)
    began_s = time.monotonic()
    assert source.read_batch(0.2).statuses == []
    assert time.monotonic() - began_s < PROMPT_S


def test_a_pulled_cable_raises(made: Made, peer: Peer) -> None:
    source = made()
    source.open()
    until(source, lambda: source.status is not None)
    peer.hang_up()
    with pytest.raises(DriverError):
        until(source, lambda: False, PROMPT_S)
