"""Another master at the same controller, which counts its commands up from the number that ours would have next."""

from collections.abc import Iterator

import pytest
from modbus_device import ModbusDevice, demo_actuator

from drivers.modbus_actuator import ModbusActuator
from drivers.roles import Command


@pytest.fixture
def device() -> Iterator[ModbusDevice]:
    made = ModbusDevice()
    yield made
    made.close()


@pytest.fixture
def actuator(device: ModbusDevice) -> Iterator[ModbusActuator]:
    made = demo_actuator(device.url, timeout_s=0.1, owner_id=77)
    made.open()
    yield made
    made.close()


def test_a_number_that_another_master_has_used_is_not_used_again(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    sequence = actuator.send(Command.START)
    device.command(Command.ACQUIRE, sequence + 1)
    actuator.read_status()
    halt = actuator.send(Command.HALT)
    assert device.executed[-1] == Command.HALT
    assert actuator.read_status().acknowledges(Command.HALT, halt)
    device.command(Command.START, sequence + 2)
    actuator.read_status()
    actuator.send(Command.FADE_STOP)
    assert device.executed[-1] == Command.FADE_STOP, "its further numbers are not met either"


def test_a_command_whose_number_another_master_used_first_is_not_taken_for_acknowledged(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    sequence = actuator.send(Command.START)
    device.command(Command.ACQUIRE, sequence + 1)
    swallowed = actuator.send(Command.HALT)
    assert Command.HALT not in device.executed, "the controller has seen this number"
    assert not actuator.read_status().acknowledges(Command.HALT, swallowed)
    assert actuator.read_status().acknowledges(Command.ACQUIRE, swallowed)
    halt = actuator.send(Command.HALT)
    assert actuator.read_status().acknowledges(Command.HALT, halt)
    assert device.executed[-1] == Command.HALT


def test_of_unknown_outcome_and_swallowed_a_command_is_written_again_under_a_new_number(
    device: ModbusDevice, actuator: ModbusActuator
) -> None:
    sequence = actuator.send(Command.START)

    def overtaken(frame: bytes, right: bytes) -> list[bytes]:
        del frame, right
        device.command(Command.ACQUIRE, sequence + 1)
        return []

    overtaken.unheard = True  # type: ignore[attr-defined]  # read by the device before it executes
    device.faults = [overtaken]
    halt = actuator.send(Command.HALT)
    assert actuator.read_status().acknowledges(Command.HALT, halt)
    assert device.executed == [Command.START, Command.ACQUIRE, Command.HALT]
