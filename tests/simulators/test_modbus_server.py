"""The injectors of the Modbus link, seen by a host on the wire; the server runs in this process's loop."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

import pytest

from drivers.errors import LinkLost, NoAnswer, RequestRefused, WrongAnswer
from drivers.modbus_link import ModbusLink
from protocols.modbus import decode_rtu, encode_rtu
from simulators.injection import INJECTORS
from simulators.modbus_server import STALE_EVERY, ModbusServer
from simulators.options import RigOptions
from simulators.rig import RunOptions, SimulatedRig
from simulators.schedule import ScheduledFault

T = TypeVar("T")
Host = Callable[[ModbusLink], T]
TIMEOUT_S = 0.1


def seen_by_a_host(slug: str | None, host: Host[T], actuator: str = "tcp", ports: str = "pty") -> T:
    """What `host` finds on a link whose fault is switched on once it is connected."""

    async def story() -> T:
        rig = SimulatedRig(RigOptions(), RunOptions(ports=ports, actuator=actuator))
        rig.warm_up()
        addresses = await rig.open()
        rig.modbus.late_s = 1.5 * TIMEOUT_S
        link = ModbusLink(addresses.actuator_url, timeout_s=TIMEOUT_S)
        try:
            await asyncio.to_thread(link.open)
            await asyncio.to_thread(link.read, 0, 2)
            if slug is not None:
                INJECTORS[slug](rig)
            return await asyncio.to_thread(host, link)
        finally:
            link.close()
            await rig.close()

    return asyncio.run(story())


def refusal_of(error: type[Exception], act: Host[object]) -> Host[str]:
    def host(link: ModbusLink) -> str:
        with pytest.raises(error) as caught:
            act(link)
        return str(caught.value)

    return host


def read(link: ModbusLink) -> list[int]:
    return link.read(0, 2)


@pytest.mark.parametrize(("actuator", "ports"), [("tcp", "pty"), ("rtu", "pty"), ("rtu", "socket")])
def test_the_same_registers_are_served_on_every_transport(actuator: str, ports: str) -> None:
    assert seen_by_a_host(None, read, actuator, ports) == [0x0102, 0x0304]


def test_busy_is_exception_6_and_rejected_writes_are_exception_4() -> None:
    assert "exception 6" in seen_by_a_host("modbus-busy", refusal_of(RequestRefused, read))
    write = refusal_of(RequestRefused, lambda link: link.write(350, [1]))
    assert "exception 4" in seen_by_a_host("modbus-reject", write)
    assert seen_by_a_host("modbus-reject", read) == [0x0102, 0x0304]


def test_a_reset_comes_once_in_the_middle_of_an_answer() -> None:
    def host(link: ModbusLink) -> list[int]:
        with pytest.raises(LinkLost):
            link.read(0, 2)
        link.open()
        return link.read(0, 2)

    assert seen_by_a_host("modbus-reset", host) == [0x0102, 0x0304]


@pytest.mark.parametrize("slug", ["modbus-halfopen", "modbus-wrong-tid"])
def test_a_bad_connection_is_bad_until_the_host_connects_again(slug: str) -> None:
    def host(link: ModbusLink) -> tuple[int, list[int]]:
        with pytest.raises(NoAnswer):
            link.read(0, 2)
        link.open()
        return link.stale, link.read(0, 2)

    stale, words = seen_by_a_host(slug, host)
    assert stale == (2 if slug == "modbus-wrong-tid" else 0)
    assert words == [0x0102, 0x0304]


@pytest.mark.parametrize("actuator", ["tcp", "rtu"])
def test_a_wrong_function_is_a_wrong_answer(actuator: str) -> None:
    assert "function 7" in seen_by_a_host("modbus-mismatch", refusal_of(WrongAnswer, read), actuator)


def test_on_rtu_a_wrong_function_has_the_checksum_of_its_frame() -> None:
    no_registers: Any = None
    server = ModbusServer(no_registers, 1, rtu=True)
    server.faults.wrong_function = True
    assert decode_rtu(server._trace(True, encode_rtu(1, bytes((3, 2, 0, 7))))) == (1, bytes((7, 2, 0, 7)))


def test_stale_answers_come_now_and_then_after_the_time_out() -> None:
    def host(link: ModbusLink) -> tuple[int, int]:
        for _ in range(2 * STALE_EVERY):
            assert link.read(0, 2) == [0x0102, 0x0304]
        return link.timeouts, link.stale

    timeouts, stale = seen_by_a_host("rtu-stale", host, "rtu")
    assert timeouts >= 1
    assert stale == timeouts


def test_damaged_frames_are_cut_lengthened_and_flipped_in_turn() -> None:
    def host(link: ModbusLink) -> set[str]:
        message = set()
        for _ in range(6):
            with pytest.raises(WrongAnswer) as caught:
                link.read(0, 2)
            message |= {word for word in ("truncated", "extra bytes", "checksum") if word in str(caught.value)}
        return message

    assert seen_by_a_host("rtu-crc", host, "rtu") == {"truncated", "extra bytes", "checksum"}


def test_a_fault_with_a_duration_ends_by_itself() -> None:
    async def story() -> list[bool]:
        fault = ScheduledFault("modbus-busy", None, 0.05)
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket", faults=(fault,)))
        rig.warm_up()
        await rig.open()
        seen = [rig.modbus.faults.busy]
        rig.advance(800)
        rig.tick()
        seen.append(rig.modbus.faults.busy)
        await rig.close()
        return seen

    assert asyncio.run(story()) == [True, False]
