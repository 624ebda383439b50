"""What goes over the wire to the controllers of the register maps that come with the program, by hand."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from modbus_device import ModbusDevice

from drivers.catalogue import make_actuator
from drivers.connection import ActuatorConnection
from drivers.errors import WrongLayout
from drivers.roles import Actuator, Command, Move, State

ENABLED = 1 << 8


class Peer(ModbusDevice):
    """A device, and the drivers that were opened on it."""

    def __init__(self) -> None:
        super().__init__()
        self.drivers: list[Actuator] = []


@pytest.fixture
def device() -> Iterator[Peer]:
    made = Peer()
    yield made
    for driver in made.drivers:
        driver.close()
    made.close()


def opened(device: Peer, name: str) -> Actuator:
    driver = make_actuator(name, ActuatorConnection(device.url, timeout_s=0.5))
    device.drivers.append(driver)
    driver.open()
    return driver


def written(device: Peer) -> list[tuple[int, list[int]]]:
    return [(address, words) for function, address, words in device.requests if function == 16]


def rmc(device: Peer) -> Actuator:
    """An RMC with its signature, enabled, program 1 running, the rod at 12.5 mm and 0 mm/s; low words first.

    Modbus address = 2 x (256 x file + element) + 1, counted from 1 (RMC151 User Manual, page 1041): %MD8.0 is 4097,
    4096 on the wire, %MD8.8 is 4113; variables from 1537. 1234.5 = 0x449A5000, 12.5 = 0x41480000, 1.0 = 0x3F800000.
    """
    device.put(1540, [0x5000, 0x449A])
    device.put(4096, [ENABLED, 0])
    device.put(4112, [0x0000, 0x4148])
    device.put(1542, [0x0000, 0x3F80])
    return opened(device, "delta-rmc")


def test_the_rmcs_position_and_state_are_read(device: Peer) -> None:
    driver = rmc(device)
    driver.read_identity()
    status = driver.read_status()
    assert (status.state, status.position_m) == (State.HOLD, pytest.approx(0.0125))
    device.put(4098, [1 << 6, 0])
    assert driver.read_status().fault_bits != 0, "No Transducer, bit 6 of the Error Bits (page 870)"
    device.put(4096, [ENABLED | 1 << 15, 0])
    assert driver.read_status().state == State.TRIPPED


def test_a_command_to_the_rmc_is_its_number_and_its_parameters_as_reals(device: Peer) -> None:
    driver = rmc(device)
    driver.read_status()
    device.requests.clear()
    driver.send(Command.HYDRAULICS_OFF)
    # As page 303 has it for program 8 of axis 0: 90 (0x42B40000), task 0, then the program: 2.0 = 0x40000000.
    assert (1024, [0, 0x42B4, 0, 0, 0, 0x4000]) in written(device)


def test_a_set_point_for_the_rmc_is_its_variable_0_in_mm(device: Peer) -> None:
    driver = rmc(device)
    driver.read_status()
    driver.send(Command.MOVE_TO, Move(0.0125, 0.1))
    device.requests.clear()
    driver.exchange(3)
    # 12.5 = 0x41480000; the watchdog's counter 3.0 = 0x40400000.
    assert written(device) == [(1536, [0, 0x4148, 0, 0x4040])]


def test_an_rmc_with_its_words_the_other_way_round_is_refused(device: Peer) -> None:
    driver = rmc(device)
    device.put(1540, [0x449A, 0x5000])
    with pytest.raises(WrongLayout, match="signature"):
        driver.read_identity()


def test_a_float_drive_gets_position_speed_and_counter_in_one_write(device: Peer) -> None:
    device.put(0, [0x449A, 0x5000, 1, 0])
    device.put(4, [0x4148, 0x0000])
    device.put(10, [0x4148, 0x0000])
    driver = opened(device, "float-drive")
    driver.read_identity()
    assert driver.read_status().state == State.HOLD
    driver.send(Command.MOVE_TO, Move(0.0125, 0.1))
    device.requests.clear()
    driver.exchange(7)
    assert written(device) == [(22, [0x4148, 0, 0, 0, 7])]
    driver.send(Command.HALT)
    assert written(device)[-1] == (20, [2])
