"""The supply's driver against a supply written from the standard."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from scpi_peer import IDENTITY, ScpiPeer

from drivers.current_source import SourceFault, SourceState, SourceStatus
from drivers.devices.supply import SupplyConnection, SupplyLink
from drivers.devices.supply_file import supply
from drivers.errors import PortClosed
from drivers.ring import Channel
from drivers.scpi_supply import ScpiSupply
from protocols.errors import LocalProtocolError
from protocols.patterns import Pattern

GENERIC = supply("generic-scpi")


@pytest.fixture
def peer() -> Iterator[ScpiPeer]:
    with ScpiPeer() as made:
        yield made


def driver(peer: ScpiPeer, **changes: object) -> ScpiSupply:
    given = SupplyConnection(peer.url, GENERIC, poll_s=0.005, timeout_s=0.2, voltage_limit_V=12.0)
    made = ScpiSupply(replace(given, **changes))  # type: ignore[arg-type]  # a test's own choice
    made.open()
    return made


@pytest.fixture
def source(peer: ScpiPeer) -> Iterator[ScpiSupply]:
    made = driver(peer)
    yield made
    made.close()


def read_until(source: ScpiSupply, done: Callable[[SourceStatus], bool], timeout_s: float = 5.0) -> list[SourceStatus]:
    statuses: list[SourceStatus] = []
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        batch = source.read_batch(0.05)
        statuses += batch.statuses
        if batch.statuses and done(batch.statuses[-1]):
            return statuses
    pytest.fail(f"never seen; the last were {statuses[-3:]}")


def test_it_asks_who_is_there_before_anything_and_sets_nothing_before_it_is_started(
    peer: ScpiPeer, source: ScpiSupply
) -> None:
    read_until(source, lambda status: source.counters.statuses > 8)
    assert peer.lines[0] == "*IDN?"
    assert {line for line in peer.lines if "?" not in line} == set()
    assert source.identity is not None
    assert source.identity[:2] == ("SN0042", "2.01")


def test_zero_is_set_and_switched_off_before_anything_else_at_the_start(peer: ScpiPeer, source: ScpiSupply) -> None:
    peer.current_A, peer.on = 3.0, True
    assert read_until(source, lambda status: True)[-1].current_A == 3.0, "what flows is told, and left alone"
    source.command(0.0, enable=False, clear_faults=True)
    source.start(0.01)
    read_until(source, lambda status: status.current_A == 0.0 and peer.volts == 12.0)
    sent = [line for line in peer.lines if "?" not in line]
    assert sent[:4] == ["CURR 0.0000", "OUTP OFF", "*CLS", "VOLT 12.000"]


def test_a_current_is_set_then_switched_on_and_zero_is_the_other_way_round(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    source.command(1.25)
    source.send_now()
    statuses = read_until(source, lambda status: status.current_A == 1.25)
    assert statuses[-1].state == SourceState.ENABLED
    source.command(2.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 2.0)
    source.command(0.0, enable=False)
    source.send_now()
    assert read_until(source, lambda status: status.current_A == 0.0)[-1].state == SourceState.OFF
    sent = [line for line in peer.lines if line.startswith(("CURR", "OUTP O"))]
    assert sent == [
        "CURR 0.0000", "OUTP OFF", "CURR 1.2500", "OUTP ON", "CURR 2.0000", "CURR 0.0000", "OUTP OFF",
    ]


def test_zero_goes_out_while_an_answer_is_still_under_way(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    peer.mute = True
    source.read_batch(0.02)
    took_s = []
    for _ in range(5):
        source.command(0.0, enable=False)
        began_s = time.monotonic()
        source.send_now()
        took_s.append(time.monotonic() - began_s)
    assert min(took_s) < 0.1, "no answer was waited for, for 0.2 s each: a busy machine does not hold up all of them"
    assert peer.wait_for(lambda lines: lines[-1] == "OUTP OFF" and not peer.on)


def test_a_late_answer_is_not_taken_for_another(peer: ScpiPeer) -> None:
    """The voltage comes after its time; it must not become a current."""
    source = driver(peer, timeout_s=0.05)
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    seen: list[float] = []
    for _ in range(6):
        peer.slow_s = 0.08
        seen += [status.current_A for status in source.read_batch(0.12).statuses]
        peer.slow_s = 0.0
        seen += [status.current_A for status in read_until(source, lambda status: True)]
    assert set(seen) == {1.0}
    source.close()


def test_silence_gives_no_status_and_the_set_point_is_sent_again_when_it_is_back(
    peer: ScpiPeer, source: ScpiSupply
) -> None:
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    peer.mute = True
    for _ in range(8):
        assert not source.read_batch(0.05).statuses or not peer.mute
    peer.mute, peer.on = False, False
    read_until(source, lambda status: status.current_A == 1.0)


def test_an_open_coil_is_known_by_the_voltage_at_its_limit(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    peer.open_circuit = True
    source.command(1.0)
    source.send_now()
    faults = read_until(source, lambda status: status.faults != 0)[-1].faults
    assert faults == SourceFault.OPEN


def test_an_output_that_goes_off_by_itself_is_reported(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    time.sleep(GENERIC.settling_s)
    peer.on = False
    assert read_until(source, lambda status: status.faults != 0)[-1].faults == SourceFault.RESTARTED
    source.command(0.0, enable=False, clear_faults=True)
    source.send_now()
    assert read_until(source, lambda status: True)[-1].faults == 0


def test_an_error_in_its_queue_is_reported(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    read_until(source, lambda status: peer.volts == 12.0)
    peer.errors.append('-222,"Data out of range"')
    assert read_until(source, lambda status: status.faults != 0)[-1].faults == SourceFault.COMMAND_CHECK


def test_answers_that_are_no_numbers_are_counted_one_after_the_other(peer: ScpiPeer, source: ScpiSupply) -> None:
    peer.answers["MEAS:CURR?"] = "9.91E37"
    for _ in range(40):
        assert not source.read_batch(0.02).statuses
        if source.counters.bad_in_a_row >= 3:
            break
    assert source.counters.bad_in_a_row >= 3
    assert source.counters.unmeasured_in_a_row == source.counters.bad_in_a_row


def test_another_supply_is_named(peer: ScpiPeer) -> None:
    source = driver(peer, identity="SN0043")
    read_until(source, lambda status: True)
    assert source.identity_problem == f"identification: got {IDENTITY!r}, expected text that contains 'SN0043'"
    source.close()


def test_echo_acknowledgement_and_another_line_end(peer: ScpiPeer) -> None:
    """A supply that repeats every line and answers OK: nothing gets out of step, 0 A beside the cycle neither."""
    obey = peer.obey

    def chatty(line: str) -> str:
        answer = obey(line)
        return f"{line.strip()}\r\n{'OK' if answer is None else answer}\r"

    peer.obey = chatty  # type: ignore[method-assign]  # the same supply in another mood
    description = replace(GENERIC, link=SupplyLink(terminator="\r\n", echo=True, acknowledge=Pattern("^OK$")))
    source = driver(peer, description=description)
    source.start(0.01)
    for current_A in (0.5, 1.0, 0.0, 1.5):
        source.command(current_A)
        source.send_now()
        read_until(source, lambda status, expected=current_A: status.current_A == expected)  # type: ignore[misc]
    assert source.status is not None
    assert (source.status.faults, source.counters.bad_checks) == (0, 0)
    source.close()
    assert not peer.on


def test_a_pause_between_commands_holds_up_the_cycle_and_not_the_stop(peer: ScpiPeer) -> None:
    source = driver(peer, description=replace(GENERIC, link=SupplyLink(gap_s=0.05)))
    source.start(0.01)
    took_s: list[float] = []
    while len(took_s) < 5 and min(took_s, default=1.0) >= 0.05:  # a busy machine does not hold up every stop
        source.command(1.0)
        source.send_now()
        read_until(source, lambda status: status.current_A == 1.0)
        began_s = time.monotonic()
        source.command(0.0, enable=False)
        source.send_now()
        assert peer.wait_for(lambda lines: lines[-1] == "OUTP OFF")
        took_s.append(time.monotonic() - began_s)
        assert read_until(source, lambda status: status.current_A == 0.0)
    assert min(took_s) < 0.05
    source.close()
    assert not peer.on, "what was still to be repeated of the current did not switch it on again"


def test_closing_takes_the_current_away(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    source.close()
    assert peer.wait_for(lambda lines: not peer.on)


def test_a_pulled_cable_ends_the_port(peer: ScpiPeer, source: ScpiSupply) -> None:
    read_until(source, lambda status: True)
    peer.pull()
    with pytest.raises(PortClosed):
        read_until(source, lambda status: False)


def test_a_set_point_beyond_the_range_is_refused_and_the_old_one_stays(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.command(1.0)
    with pytest.raises(LocalProtocolError, match="0 to 20 A"):
        source.command(-1.0)
    assert source.commanded_A == 1.0


def test_records_hold_current_and_command(peer: ScpiPeer, source: ScpiSupply) -> None:
    source.start(0.01)
    source.command(0.75)
    source.send_now()
    batch = source.read_batch(0.2)
    while not batch.statuses or batch.statuses[-1].current_A != 0.75:
        batch = source.read_batch(0.2)
    reported = {record[4]: record[2] for record in batch.records}
    assert reported[Channel.COIL_CURRENT] == 0.75
    assert reported[Channel.COMMANDED_CURRENT] == 0.75


def test_what_flowed_before_a_set_point_was_sent_is_recorded_and_proves_nothing_of_it(peer: ScpiPeer) -> None:
    """The question is under way when the set-point goes out; its answer comes after it."""
    source = driver(peer, timeout_s=2.0)
    source.start(0.01)
    source.command(1.0)
    source.send_now()
    read_until(source, lambda status: status.current_A == 1.0)
    peer.slow_s = 0.1
    requested = peer.lines.count("MEAS:CURR?")
    while peer.lines.count("MEAS:CURR?") == requested:
        source.read_batch(0.0)
    source.command(0.0, enable=False)
    source.send_now()
    flowed_A: list[float] = []
    while len(flowed_A) < 2:
        batch = source.read_batch(0.15)
        flowed_A += [record[2] for record in batch.records if record[4] == Channel.COIL_CURRENT]
        assert all(status.current_A == 0.0 for status in batch.statuses)
    assert flowed_A[:2] == [1.0, 0.0]
    assert source.status is not None
    assert source.status.current_A == 0.0
    source.close()
