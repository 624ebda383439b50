"""Resources of this computer that a campaign uses: the locks of its devices, the location of the ring, the station.

A lock ends with the process that holds it. It names the device, not its spelling in a bench file: `localhost`,
`127.0.0.1`, `::1` and this computer's own name are one, a symbolic link is the port it points to. The lock files are in
one directory for all users, whatever TMPDIR states. Other computers, and containers with a directory of their own, are
excluded by the controller's lease. The ring is in memory if possible: its pages must never wait for a disk.
"""

from __future__ import annotations

import contextlib
import hashlib
import ipaddress
import os
import socket
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from drivers import clock
from drivers.port_causes import command_line
from drivers.posix import fcntl
from drivers.prepared import Prepared
from drivers.ring import MAGIC
from rig.bench.model import Bench
from rig.bench.settings import StationConfig
from rig.clock import monotonic_ns
from rig.errors import Refused
from rig.files.described import described
from rig.matrix.model import Matrix
from rig.station.client import StationClient, StationLost

STATION_STOPS_S = 90.0
"""How long the station of a killed campaign may need to bring its rig to rest and give the devices back."""
LOOK_AGAIN_S = 0.1
LOCK_FOLDERS = (Path("/run/lock"), Path("/tmp"))
"""The first one writable by all users is taken."""
SHARED = stat.S_ISVTX | stat.S_IWOTH
SERIAL_PREFIXES = ("modbus-rtu:", "spy://")
SLCAN = "slcan"
THIS_MACHINE = "this machine"


@contextmanager
def locked(bench: Bench) -> Iterator[tuple[int, ...]]:
    """Hold the rig's devices for this process while the block runs: one lock a device.

    The station inherits the descriptors (`pass_fds`), so the locks last until it is gone too: after a killed
    application it still stops the rig. Such a station is waited for; a campaign that lives is not.

    Raises:
        Refused: another campaign on this machine holds one of them, or its lock cannot be had (slug `two-instances`).
    """
    devices = devices_of(bench)
    with contextlib.ExitStack() as held:
        descriptors = []
        # Always in the same order, so that two that start together cannot each hold what the other wants.
        for device in sorted(devices):
            descriptors.append(_lock(device, devices[device]))
            held.callback(os.close, descriptors[-1])
        yield tuple(descriptors)


def devices_of(bench: Bench) -> dict[str, str]:
    """Names of the devices of a bench, as `device_names`, and the address of each in the bench file."""
    sensors = (bench.load_cell, bench.lvdt, *bench.auxiliary)
    source = (bench.ecu.port,) if bench.ecu.port else ()
    addresses = (bench.actuator.url, *source, *(sensor.port for sensor in sensors))
    return {device: address for address in addresses for device in device_names(address)}


def device_names(address: str) -> tuple[str, ...]:
    """What a bench file's address leads to: the same names for the same device, however it is written.

    Args:
        address: serial port, `modbus-tcp://host:port`, `socket://host:port`, `modbus-rtu:PORT`, `interface:channel`.

    Returns:
        One name; for a host with several network addresses one for each of them.
    """
    for prefix in SERIAL_PREFIXES:
        address = address.removeprefix(prefix)
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if host is not None and port is not None:
        return tuple(sorted({f"{place}:{port}" for place in _places(host)}))
    return (os.path.realpath(address) if os.path.exists(address) else address,)


def _places(host: str) -> set[str]:
    """Network addresses of a host; every address of this machine is one. An unknown name stands for itself."""
    try:
        answers = socket.getaddrinfo(host, None, type=socket.SOCK_DGRAM)
    except OSError:
        return {host.lower()}
    return {
        THIS_MACHINE if _is_here(family, place) else _plain(str(place[0])) for family, _, _, _, place in answers
    }


def _plain(address: str) -> str:
    given = ipaddress.ip_address(address.partition("%")[0])
    mapped = given.ipv4_mapped if isinstance(given, ipaddress.IPv6Address) else None
    return str(mapped or given)


def _is_here(family: int, place: tuple[Any, ...]) -> bool:
    """An address that can be bound to is one of this machine's own."""
    if ipaddress.ip_address(_plain(place[0])).is_loopback:
        return True
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((place[0], 0, *place[2:]))
    except OSError:
        return False
    return True


def _lock(device: str, address: str) -> int:
    """A descriptor that holds the device's lock.

    Raises:
        Refused: another process holds it, or its file is not one of ours to open.
    """
    name = hashlib.sha256(device.encode()).hexdigest()[:16]
    path = _folder() / f"mr-damper-rig-{name}.lock"
    try:
        descriptor = _open(path)
    except OSError as error:
        reason = f"{address}: the lock file {path} cannot be opened ({error}). Fix: check the lock file and delete it"
        raise Refused("two-instances", reason) from error
    deadline_ns = monotonic_ns() + int(STATION_STOPS_S * 1e9)
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except OSError as error:
            owner = _owner(descriptor)
            if _lives(owner) or monotonic_ns() > deadline_ns:
                os.close(descriptor)
                raise Refused("two-instances", _in_use(address, path, owner)) from error
        # A lock cannot be waited for with a time limit.
        time.sleep(LOOK_AGAIN_S)
    # What holds is the lock; the number only tells a waiting campaign whether the holder lives.
    with contextlib.suppress(OSError):
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, b"%d\n" % os.getpid(), 0)
    return descriptor


def _in_use(address: str, lock: Path, owner: int) -> str:
    """Who holds a device, and what the user can do."""
    holder = f"process {owner}: {command_line(owner)}" if owner else "process not yet known"
    return (
        f"{address} is in use by another campaign on this machine ({holder}; lock {lock}). Fix: wait until that "
        "campaign ends, or stop it with Ctrl-C in its terminal"
    )


def _folder() -> Path:
    for folder in LOCK_FOLDERS[:-1]:
        with contextlib.suppress(OSError):
            if folder.stat().st_mode & SHARED == SHARED:
                return folder
    return LOCK_FOLDERS[-1]


def _open(path: Path) -> int:
    """Open a lock's file without following, truncating or trusting a file placed there.

    Raises:
        OSError: it is a symbolic link, has a second name, is no regular file, or may not be opened.
    """
    flags = os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | flags, 0o666)
        os.fchmod(descriptor, 0o666)
    except FileExistsError:
        try:
            descriptor = os.open(path, os.O_RDWR | flags)
        except PermissionError:
            # Another user's: a lock needs no writing.
            descriptor = os.open(path, os.O_RDONLY | flags)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink != 1:
        os.close(descriptor)
        raise OSError("expected a regular file with only one hard link")
    return descriptor


def _owner(descriptor: int) -> int:
    """Process id of the campaign that took the lock; 0 when it is not written yet."""
    text = os.pread(descriptor, 32, 0).strip()
    return int(text) if text.isdigit() else 0


def _lives(process: int) -> bool:
    """Whether a process runs; one that is not known (0) counts as running."""
    if process == 0:
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True


SHARED_MEMORY = Path("/dev/shm")
PREFIX = "mr-damper-rig-"


@contextmanager
def ring_path_for(campaign: str, place: Path | None = None) -> Iterator[Path]:
    """A path for the ring of the campaign of that name; the file is removed when the block ends.

    The station removes it too at its own end, in case the application was killed. Rings of stations that were killed
    themselves are removed here.

    Args:
        campaign: the campaign's id.
        place: the folder to use; by default shared memory, else the folder for temporary files.
    """
    folder = place or (SHARED_MEMORY if SHARED_MEMORY.is_dir() else Path(tempfile.gettempdir()))
    for left in [*folder.glob(f"{PREFIX}*.ring"), *folder.glob(f"{PREFIX}*.ring.new")]:
        # Another campaign may end at the same moment and remove its own.
        with contextlib.suppress(FileNotFoundError):
            if left.lstat().st_uid == os.getuid() and not _written(left):
                left.unlink()
    path = folder / f"{PREFIX}{campaign}.ring"
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _written(ring: Path) -> bool:
    """Whether the station that made the ring still lives: it holds the file's lock. True where that cannot be told.

    Raises:
        FileNotFoundError: the ring is gone.
    """
    try:
        handle = os.open(ring, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    except FileNotFoundError:
        raise
    except OSError:
        return True
    try:
        if os.pread(handle, len(MAGIC), 0) != MAGIC:
            return True  # begun at this moment, or not a ring
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(handle)
    return False


def station_config(bench: Bench, matrix: Matrix | None, ring_path: Path) -> StationConfig:
    """The station's settings: the bench's, limits narrowed to the specimen's travel, files of descriptions as tables.

    Args:
        bench: the bench.
        matrix: the matrix, for the specimen; None where it is not known: the bench's limits hold.
        ring_path: where the station makes its ring.
    """
    limits, (dbc, roles) = bench.limits, bench.ecu.described_source
    if matrix is not None:
        limits = limits.within_stroke(matrix.specimen.stroke_m, matrix.specimen.mid_stroke_m)
    return StationConfig(
        **vars(bench.station),
        **vars(bench.clock),
        actuator=replace(bench.actuator, register_map=bench.actuator.described),
        ecu=replace(bench.ecu, dbc=dbc, roles=roles, supply=described("supply", bench.ecu.supply)),
        load_cell=replace(bench.load_cell, format=bench.load_cell.described),
        lvdt=replace(bench.lvdt, format=bench.lvdt.described),
        auxiliary=tuple(replace(sensor, format=sensor.described) for sensor in bench.auxiliary),
        limits=limits,
        ring_path=str(ring_path),
    )


@contextmanager
def station_in_use(
    bench: Bench, matrix: Matrix | None, folder: Path, locks: tuple[int, ...], stop_socket: str = "",
    prepared: Prepared | None = None,
) -> Iterator[tuple[StationClient, StationConfig]]:
    """The station's process, and what it was told; the block closes its link.

    Args:
        bench: the bench.
        matrix: the matrix, for the specimen; None as for `station_config`.
        folder: the campaign's directory.
        locks: of the bench's devices, where they are held already; the station inherits them.
        stop_socket: where it takes a stop from others, too; empty: nowhere.
        prepared: a station that has been loaded in advance; None: there is none.

    Raises:
        Refused: it does not start, or another campaign holds a device (`locked`).
    """
    with contextlib.nullcontext(locks) if locks else locked(bench) as locks, ring_path_for(folder.name) as ring_path:
        config = replace(station_config(bench, matrix, ring_path), stop_socket=stop_socket)
        try:
            clock.follow(config.shared or "", clock.Role.APPLICATION, config.addresses)
        except clock.ClockRefused as error:
            raise Refused("config-absurd", str(error)) from error
        try:
            yield _started(config, folder, locks, prepared), config
        finally:
            clock.leave()


def _started(
    config: StationConfig, folder: Path, locks: tuple[int, ...], prepared: Prepared | None
) -> StationClient:
    try:
        return StationClient.start(config, folder, inherited=locks, prepared=prepared)
    except StationLost as error:
        raise Refused("task-dies", str(error)) from error
