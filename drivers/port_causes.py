"""Why a port cannot be opened, and how the user fixes it: each cause has its own answer.

Call `fix_of` only where a message is written for the user, never while the rig is monitored: it reads /sys and /proc,
which takes up to 0.1 s. An error itself costs nothing.
"""

from __future__ import annotations

import contextlib
import errno
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from drivers.errors import DriverError, PortClosed
from drivers.processes import PREPARED
from protocols.near_miss import near_names

NETWORK = re.compile(r"(modbus-tcp|socket|tcp|rfc2217)://")
CAN_BUS = re.compile(r"([a-z][a-z0-9_]+):(?!//)([^/].*)")
WINDOWS_NAME = re.compile(r"(\\\\\.\\)?COM\d+", re.IGNORECASE)
MACOS_NAME = re.compile(r"/dev/(cu|tty)\.")
LINUX_NAME = re.compile(r"/dev/(tty(USB|ACM|S)\d+|serial/.*)")
SERIAL_PREFIXES = ("modbus-rtu:", "spy://")
MODULES = {
    "0403": "ftdi_sio", "067b": "pl2303", "10c4": "cp210x", "1a86": "ch341", "1d50": "gs_usb", "0c72": "peak_usb",
    "0bfd": "kvaser_usb",
}
"""USB vendor to the kernel module of its serial or CAN adapters."""
CDC = "02"
"""USB interface class of adapters that need no driver of their own (`cdc_acm`)."""
LIBRARIES = {
    "pcan": "PCAN-Basic", "kvaser": "Kvaser CANlib", "vector": "the Vector XL Driver Library", "ixxat": "IXXAT VCI",
}
CAN_DEVICE = "280"
"""ARPHRD_CAN, the type of a CAN interface in /sys/class/net."""
UP = 1
"""IFF_UP in the flags of a network interface."""
MOST_SHOWN = 8
SAME_STEM = 0.9
"""Similarity of port names that differ in their number only."""
CHAIN = 8
"""Causes of causes that are looked at."""


@dataclass(frozen=True)
class System:
    """Folders in which the operating system shows its devices and processes."""

    proc: Path = Path("/proc")
    usb: Path = Path("/sys/bus/usb/devices")
    net: Path = Path("/sys/class/net")

    @property
    def is_wsl(self) -> bool:
        """Whether this Linux runs inside Windows (WSL)."""
        return "microsoft" in _text(self.proc / "version").lower()


SYSTEM = System()


def fix_of(error: Exception, system: System = SYSTEM) -> str:
    """How the user fixes a driver's error, in words; empty if unknown.

    Args:
        error: any error; of those without their own fix only a port that cannot be opened has one.
        system: where the operating system shows its devices.
    """
    if not isinstance(error, DriverError):
        return ""
    if error.fix or not isinstance(error, PortClosed) or error.__cause__ is None:
        return error.fix
    address, number = error.port, error_number(error.__cause__)
    if NETWORK.match(address):
        return _network_fix(address, error.__cause__, number)
    for prefix in SERIAL_PREFIXES:
        address = address.removeprefix(prefix)
    bus = CAN_BUS.fullmatch(address)
    if bus is not None and not os.path.exists(address):
        return _can_fix(bus[1], bus[2], number, system)
    return _serial_fix(address, number, system)


def with_fix(error: Exception) -> str:
    """The message of an error, and how the user fixes it if that is known."""
    fix = fix_of(error)
    return f"{str(error).rstrip('.')}. Fix: {fix}" if fix else str(error)


def error_number(error: BaseException | None) -> int | None:
    """The operating system's error number in an error or in what caused it; None if there is none."""
    for _ in range(CHAIN):
        if error is None:
            return None
        if isinstance(error, OSError) and error.errno is not None:
            return error.errno  # negative if a host name cannot be resolved (socket.gaierror)
        # termios.error is no OSError: its first argument is the number.
        if type(error).__module__ == "termios" and error.args and isinstance(error.args[0], int):
            return error.args[0]
        error = error.__cause__ or error.__context__
    return None


def reason(error: BaseException) -> str:
    """The operating system's words once; messages of libraries repeat the port and the system's words around them."""
    number = error_number(error)
    return str(error) if number is None or number not in errno.errorcode else os.strerror(number)


def _network_fix(address: str, error: BaseException, number: int | None) -> str:
    parts = urlsplit(address)
    host, port = parts.hostname, parts.port
    if number is not None and number < 0:
        return f"this computer cannot resolve the host name {host}: check the spelling, or write the IP address"
    if number == errno.ECONNREFUSED:
        return (
            f"{host} answers, but no program accepts connections on port {port}: check the port number, switch on the "
            "network protocol in the device's settings, and close other programs that are connected to the device"
        )
    if number in {errno.ENETUNREACH, errno.EHOSTUNREACH, errno.EADDRNOTAVAIL}:
        return (
            f"this computer has no route to {host}: check the network cable, and assign this computer an address in "
            "the device's network (`ip address`)"
        )
    if number in {errno.EACCES, errno.EPERM}:
        return f"a firewall on this computer blocks the connection to {host}, port {port}"
    if number == errno.ETIMEDOUT or isinstance(error, TimeoutError):
        return (
            f"{host} does not answer: check the device's power, its network cable and its IP address "
            f"(`ping {host}`), and firewalls in between"
        )
    return ""


def _serial_fix(port: str, number: int | None, system: System) -> str:
    if "://" in port:
        return "write a port such as /dev/ttyUSB0, socket://HOST:PORT or rfc2217://HOST:PORT"
    other = _other_system(port)
    if other:
        return f"{port} is a {other} port name. {_attached(port, system)}"
    if number in {errno.EACCES, errno.EPERM}:
        return _permission_fix(port)
    if number in {errno.EBUSY, errno.EAGAIN}:
        return f"another program uses {port}{_holders(port, system)}: close it"
    if number in {errno.ENOTTY, errno.EISDIR, errno.EINVAL}:
        return f"{port} is not a serial port. {_attached(port, system)}"
    if number in {errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO}:
        absent = "there is no such port" if number == errno.ENOENT else f"no device is connected to {port}"
        return f"{absent}. {_attached(port, system)}"
    return ""


def _other_system(port: str) -> str:
    """The operating system with such port names; empty if it is this one."""
    here = {"win32": "Windows", "darwin": "macOS"}.get(sys.platform, "Linux")
    forms = {"Windows": WINDOWS_NAME, "macOS": MACOS_NAME, "Linux": LINUX_NAME}
    return next((name for name, form in forms.items() if name != here and form.match(port)), "")


def _attached(port: str, system: System) -> str:
    """Serial ports that are plugged in now, and USB adapters without a driver."""
    # pyserial's list loads more than a station needs
    from serial.tools.list_ports import comports

    ports = sorted(comports())
    names = [one.device + f" ({one.description})" * (one.description not in {"n/a", None}) for one in ports]
    texts = [f"Available ports: {', '.join(names[:MOST_SHOWN])}" if names else "No serial ports found"]
    near = near_names(port, [one.device for one in ports if one.device != port], cutoff=SAME_STEM)
    if near:
        texts[0] += f"; did you mean {near[0]}?"
    texts += driverless(system)
    if system.is_wsl:
        texts.append("On Windows (WSL), attach the adapter first: usbipd attach --wsl --busid BUSID")
    return ". ".join(texts)


def driverless(system: System = SYSTEM) -> list[str]:
    """One sentence for each serial or CAN adapter that is plugged in and has no driver."""
    texts = []
    for interface in sorted(system.usb.glob("*:*")):
        device = system.usb / interface.name.partition(":")[0]
        vendor, product = _text(device / "idVendor"), _text(device / "idProduct")
        module = "cdc_acm" if _text(interface / "bInterfaceClass") == CDC else MODULES.get(vendor)
        if module is not None and not (interface / "driver").exists():
            name = _text(device / "product") or "adapter"
            texts.append(
                f"The USB adapter {vendor}:{product} ({name}) has no driver: sudo modprobe {module} (on Ubuntu, if the "
                "driver is loaded: sudo apt remove brltty)"
            )
    return list(dict.fromkeys(texts))


def _permission_fix(port: str) -> str:
    # only on Unix; this module is also imported on Windows
    import grp
    import pwd

    try:
        group = grp.getgrgid(os.stat(port).st_gid)
        user = pwd.getpwuid(os.getuid()).pw_name
    except (OSError, KeyError):
        return f"you do not have permission to open {port}: ask the administrator"
    if user in group.gr_mem and group.gr_gid not in os.getgroups():
        return f"the group {group.gr_name} of the user {user} takes effect at the next login: log out and in again"
    return (
        f"the user {user} has no permission to open {port}: sudo usermod -aG {group.gr_name} {user}, then log out and "
        "in again"
    )


def _holders(port: str, system: System) -> str:
    """Programs that have opened a port, as far as this user can see them: ` (process 1234: minicom)`."""
    real, names = os.path.realpath(port), []
    for process in _processes(system):
        if real in _opened(process):
            names.append(f"process {process.name}: {command_line(int(process.name), system)}")
    return f" ({', '.join(names[:MOST_SHOWN])})" if names else " (find it with `sudo fuser -v " + real + "`)"


def _opened(process: Path) -> Iterator[str]:
    """Files that a process has open; none if it is another user's or has ended."""
    with contextlib.suppress(OSError):
        for link in (process / "fd").iterdir():
            with contextlib.suppress(FileNotFoundError):
                yield os.readlink(link)


def _processes(system: System) -> Iterator[Path]:
    try:
        yield from (entry for entry in system.proc.iterdir() if entry.name.isdigit())
    except OSError:
        return


def command_line(process: int, system: System = SYSTEM) -> str:
    """The command of a process as typed, up to 120 characters; `unknown` if this user cannot see it."""
    words = [word for word in _text(system.proc / str(process) / "cmdline").split("\0") if word]
    if len(words) > 1 and os.path.basename(words[0]).startswith("python"):
        words = words[1:]
    if PREPARED in words:
        words = words[words.index(PREPARED) + 2 :][:1]
    text = " ".join([os.path.basename(word) for word in words[:1]] + words[1:])
    return "".join(sign if sign.isprintable() else "?" for sign in text)[:120] or "unknown"


def _can_fix(interface: str, channel: str, number: int | None, system: System) -> str:
    if interface != "socketcan":
        library = LIBRARIES.get(interface)
        source = f"install {library}, the library of the adapter's maker" if library else "install its driver"
        return f"python-can cannot open the interface {interface}: {source}, and check that the adapter is plugged in"
    if number == errno.EAFNOSUPPORT:
        wsl = " (the WSL kernel does not support CAN: use an slcan adapter, or build a kernel with CAN)" * system.is_wsl
        return f"this kernel does not support CAN: sudo modprobe can_raw{wsl}"
    if number == errno.ENODEV:
        names = can_interfaces(system)
        shown = f"available CAN interfaces: {', '.join(names)}" if names else "no CAN interfaces found"
        adapters = "".join(f". {text}" for text in driverless(system))
        return f"there is no interface {channel} ({shown}): plug in the adapter, or correct `channel`{adapters}"
    if number in {errno.EACCES, errno.EPERM}:
        return f"you do not have permission to use the CAN interface {channel}: ask the administrator"
    return ""


def can_interfaces(system: System = SYSTEM) -> list[str]:
    """Names of the CAN interfaces of this computer; those that are down are marked."""
    kinds = {entry.name: _text(entry / "type") for entry in sorted(system.net.glob("*"))}
    return [f"{name}{' (down)' * is_down(name, system)}" for name, kind in kinds.items() if kind == CAN_DEVICE]


def is_down(interface: str, system: System = SYSTEM) -> bool:
    """Whether a network interface exists and is switched off."""
    flags = _text(system.net / interface / "flags") if "/" not in interface else ""
    try:
        return bool(flags) and not int(flags, 16) & UP
    except ValueError:
        return False


def _text(path: Path) -> str:
    """Content of a small file of the system without spaces at its ends; empty if it cannot be read."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
