"""The controller's status as records: its clock unwrapped, every cycle pulse once."""

from __future__ import annotations

from drivers.ring import Channel
from drivers.roles import ActuatorStatus
from rig.station.threads.status_records import StatusRecords

WRAP = 1 << 32


def status(clock_us: int, *, pulses: int = 0, pulse_us: int = 0) -> ActuatorStatus:
    values: dict[str, float] = dict.fromkeys(ActuatorStatus._fields, 0)
    values |= {"received_ns": 5, "clock_us": clock_us % WRAP, "pulse_count": pulses, "pulse_clock_us": pulse_us % WRAP}
    return ActuatorStatus(**values)  # type: ignore[arg-type]  # numbers by name


def test_the_controllers_clock_goes_on_past_its_wrap_and_back_again() -> None:
    records = StatusRecords()
    clocks = [WRAP - 10_000, WRAP + 10_000, WRAP - 5_000, WRAP + 20_000]
    assert [records.of(status(clock_us), number)[0] for number, clock_us in enumerate(clocks)] == clocks


def test_a_pulse_is_recorded_once_at_its_own_moment_also_across_the_wrap() -> None:
    made = StatusRecords()
    answers = [
        status(WRAP - 9_000, pulses=3), status(WRAP + 1_000, pulses=4, pulse_us=WRAP - 2_000),
        status(WRAP + 11_000, pulses=4, pulse_us=WRAP - 2_000),
    ]  # fmt: skip
    pulses = [[each for each in made.of(answer, 0)[1] if each[4] == Channel.PULSE] for answer in answers]
    assert pulses == [[], [(5, WRAP - 2_000, 4.0, 4, Channel.PULSE, 0)], []]


def test_every_record_of_a_status_carries_its_poll_and_its_time() -> None:
    device_us, records = StatusRecords().of(status(1234), 17)
    assert len({record[4] for record in records}) == len(records) == 12
    assert {record[:2] + record[3:4] for record in records} == {(5, device_us, 17)}
