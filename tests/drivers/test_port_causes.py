"""A port that cannot be opened is explained by its cause, with what the user can do about this one."""

from __future__ import annotations

import errno
import os
import pty
import socket
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from serial.tools import list_ports

from drivers import port_causes
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.errors import DriverError, NoAnswer, PortClosed
from drivers.modbus_link import ModbusLink
from drivers.port_causes import System, fix_of, with_fix
from drivers.serial_port import SerialPort


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> System:
    """A computer with one FTDI adapter and one CH340 without a driver, a CAN interface up and one down."""
    adapters = [SimpleNamespace(device="/dev/ttyUSB0", description="FT232R USB UART")]
    monkeypatch.setattr(list_ports, "comports", lambda: adapters)
    files = {
        "usb/1-1/idVendor": "0403", "usb/1-1/idProduct": "6001", "usb/1-1:1.0/bInterfaceClass": "ff",
        "usb/1-1:1.0/driver/name": "ftdi_sio", "usb/1-2/idVendor": "1a86", "usb/1-2/idProduct": "7523",
        "usb/1-2/product": "USB Serial", "usb/1-2:1.0/bInterfaceClass": "ff",
        "net/can0/type": "280", "net/can0/flags": "0x40081", "net/can1/type": "280", "net/can1/flags": "0x40080",
        "net/eth0/type": "1", "net/eth0/flags": "0x1003", "proc/version": "Linux 6.1 Debian",
        "proc/77/cmdline": "minicom\0-D\0/dev/ttyUSB0\0",
    }  # fmt: skip
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")
    return System(tmp_path / "proc", tmp_path / "usb", tmp_path / "net")


def opened(url: str) -> DriverError:
    """What opening a real port raises."""
    with pytest.raises(PortClosed) as caught:
        (ModbusLink(url) if url.startswith("modbus") else SerialPort(url, device="load_cell")).open()
    return caught.value


def failed(address: str, number: int) -> PortClosed:
    """As a driver raises it for an error of the system that cannot be had here."""
    error = PortClosed("load_cell", address, os.strerror(number))
    error.__cause__ = OSError(number, os.strerror(number))
    return error


@pytest.fixture
def free_port() -> Iterator[int]:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield held.getsockname()[1]


@pytest.mark.parametrize(("url", "words"), [
    ("/dev/ttyUSB7", ["there is no such port", "Available ports: /dev/ttyUSB0 (FT232R USB UART)", "did you mean",
                      "1a86:7523 (USB Serial) has no driver: sudo modprobe ch341"]),
    ("COM3", ["COM3 is a Windows port name", "Available ports: /dev/ttyUSB0"]),
    ("modbus-rtu:com12", ["Windows port name"]),
    ("/dev/cu.usbserial-1410", ["macOS port name"]),
    ("/dev/null", ["not a serial port", "Available ports"]),
    ("ftp://there", ["socket://HOST:PORT"]),
    ("socket://no-such-host.invalid:4001", ["cannot resolve the host name no-such-host.invalid"]),
])  # fmt: skip
def test_the_cause_and_its_own_fix_are_named(url: str, words: list[str], system: System) -> None:
    text = fix_of(opened(url), system)
    assert [word for word in words if word not in text] == []
    assert "ftdi_sio" not in text


@pytest.mark.parametrize("scheme", ["socket", "rfc2217", "modbus-tcp"])
def test_a_refused_connection_is_a_host_that_answers(scheme: str, free_port: int, system: System) -> None:
    assert f"no program accepts connections on port {free_port}" in fix_of(opened(f"{scheme}://127.0.0.1:{free_port}"))


@pytest.mark.parametrize(("address", "number", "words"), [
    ("modbus-tcp://10.0.0.5:502", errno.ETIMEDOUT, "does not answer: check the device's power"),
    ("socket://10.0.0.5:502", errno.EHOSTUNREACH, "no route to 10.0.0.5"),
    ("/dev/ttyUSB0", errno.EIO, "no device is connected to /dev/ttyUSB0"),
    ("socketcan:can7", errno.ENODEV, "available CAN interfaces: can0, can1 (down)"),
    ("socketcan:can0", errno.EAFNOSUPPORT, "this kernel does not support CAN"),
    ("pcan:PCAN_USBBUS1", 0, "install PCAN-Basic"),
])
def test_errors_of_the_system_have_their_own_fix(address: str, number: int, words: str, system: System) -> None:
    assert words in fix_of(failed(address, number), system)


def test_a_forbidden_port_names_the_user_and_the_group(tmp_path: Path) -> None:
    (tmp_path / "tty").touch()
    assert "sudo usermod -aG " in fix_of(failed(str(tmp_path / "tty"), errno.EACCES))


def test_the_program_that_uses_a_port_is_named(system: System) -> None:
    (system.proc / "77" / "fd").mkdir()
    (system.proc / "77" / "fd" / "3").symlink_to("/dev/ttyUSB0")
    assert "(process 77: minicom -D /dev/ttyUSB0)" in fix_of(failed("/dev/ttyUSB0", errno.EBUSY), system)
    prepared = ["/usr/bin/python3", "-P", "-m", "drivers.prepared", "11", "rig run", "rig.cli.prepared_run", "--a"]
    (system.proc / "77" / "cmdline").write_text("\0".join(prepared))
    assert "(process 77: rig run)" in fix_of(failed("/dev/ttyUSB0", errno.EBUSY), system)
    master, slave = pty.openpty()
    name, first = os.ttyname(slave), SerialPort(os.ttyname(slave), device="lvdt")
    first.open()
    assert f"process {os.getpid()}" in fix_of(opened(name))
    first.close()
    os.close(master)
    os.close(slave)


def test_a_can_interface_that_is_down_is_not_joined(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(port_causes.is_down, "__defaults__", (system,))
    with pytest.raises(PortClosed, match="can1 is down") as caught:
        CanPort(CanAddress("socketcan", "can1", 500_000)).open()
    assert "sudo ip link set can1 up type can bitrate 500000" in with_fix(caught.value)
    assert not port_causes.is_down("can0", system)


def test_under_wsl_the_adapter_is_attached_first(system: System) -> None:
    (system.proc / "version").write_text("Linux version 6.6.36.3-microsoft-standard-WSL2")
    assert "usbipd attach --wsl" in fix_of(failed("/dev/ttyUSB3", errno.ENOENT), system)


def test_only_a_port_that_cannot_be_opened_is_looked_into() -> None:
    assert fix_of(ValueError("no driver's")) == fix_of(NoAnswer("ecu", "can0", "silent")) == ""
    assert fix_of(PortClosed("ecu", "can0", "the bus is not open")) == ""
    assert fix_of(NoAnswer("ecu", "can0", "silent", "switch it on")) == "switch it on"
