"""Pipes and connections: what a reader and a writer see, beside the machine's own."""

from __future__ import annotations

import errno
import os
import select
import signal
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from simulators.scenarios.disk import Disk
from simulators.scenarios.kernel import Kernel
from simulators.scenarios.machine import Machine
from simulators.scenarios.streams import End

SEEDS = range(12)


def in_scenario(root: Path, seed: int, program: Callable[[Machine], object]) -> object:
    """What a program gives as the main thread of a process."""
    kernel = Kernel(seed)
    machine, results = Machine(kernel, Disk(kernel, root, seed), seed), []
    process = machine.start("program", lambda: results.append(program(machine)))
    kernel.run(lambda: not process.alive)
    assert process.errors == []
    return results[0]


def error_of(call: Callable[[], object]) -> object:
    """What a call gives, or the number or name of what it raises."""
    try:
        return call()
    except OSError as error:
        return errno.errorcode[error.errno] if error.errno else type(error).__name__


class Peers:
    """A listening place of a world that keeps the far ends."""

    def __init__(self, machine: Machine) -> None:
        self.ends: list[End] = []
        self.port = machine.network.listen(self.ends.append)


@pytest.fixture
def real_pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Both ends of a connection of this machine."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far, _ = server.accept()
        with near, far:
            yield near, far


def pair(machine: Machine, timeout: float | None = None) -> tuple[Any, End]:
    """The same of a world."""
    peers = Peers(machine)
    near = machine.connect(("127.0.0.1", peers.port), timeout)
    return near, peers.ends[0]


def sleep(machine: Machine, length_s: float) -> None:
    """Let time pass."""
    machine.kernel.sleep_ns(int(length_s * 1e9))


def test_bytes_arrive_in_order_whole_and_after_a_time(tmp_path: Path) -> None:
    sent = bytes(range(256)) * 2000

    def program(machine: Machine) -> object:
        near, far = pair(machine)
        assert far.outward is not None
        rest, got, chunks = sent, b"", 0
        while len(got) < len(sent):
            rest = rest[far.outward.write(rest[:100_000]) :]
            got += near.recv(1 << 16)
            chunks += 1
        return got == sent, chunks > 5

    for seed in SEEDS:
        assert in_scenario(tmp_path, seed, program) == (True, True)


def test_a_closed_connection_gives_what_was_sent_and_then_its_end(
    tmp_path: Path, real_pair: tuple[socket.socket, socket.socket]
) -> None:
    def program(machine: Machine) -> object:
        near, far = pair(machine)
        far.outward.write(b"last words")  # type: ignore[union-attr]  # a connection has both directions
        far.close()
        sleep(machine, 0.1)
        return [near.recv(4) + near.recv(100), near.recv(10), near.recv(10)]

    near, far = real_pair
    far.sendall(b"last words")
    far.close()
    real = [near.recv(4) + near.recv(100), near.recv(10), near.recv(10)]
    for seed in SEEDS:
        result = in_scenario(tmp_path, seed, program)
        assert isinstance(result, list)
        assert b"".join(result) == b"".join(real) == b"last words"
        assert result[-1] == real[-1] == b""


def test_the_first_write_to_a_closed_connection_goes_well_and_the_next_do_not(
    tmp_path: Path, real_pair: tuple[socket.socket, socket.socket]
) -> None:
    def course(near: Any, hang_up: Callable[[], object], wait: Callable[[], object]) -> list[object]:  # noqa: ANN401
        hang_up()
        wait()
        first = error_of(lambda: near.sendall(b"request"))
        wait()
        read = [error_of(lambda: near.recv(10)) for _ in range(2)]
        return [first, *read, error_of(lambda: near.sendall(b"x"))]

    def program(machine: Machine) -> object:
        near, far = pair(machine)
        return course(near, far.close, lambda: sleep(machine, 0.1))

    near, far = real_pair
    real = course(near, far.close, lambda: threading.Event().wait(0.05))
    assert real[0] is None
    assert real[-1] == "EPIPE"
    for seed in SEEDS:
        result = in_scenario(tmp_path, seed, program)
        assert isinstance(result, list)
        assert (result[0], result[-1]) == (real[0], real[-1])
        assert result[1] in {real[1], "ECONNRESET", b""}


def test_a_reset_is_reported_once_and_then_the_connection_is_at_its_end(
    tmp_path: Path, real_pair: tuple[socket.socket, socket.socket]
) -> None:
    def program(machine: Machine) -> object:
        near, far = pair(machine)
        far.reset()
        sleep(machine, 0.1)
        return error_of(lambda: near.recv(10)), error_of(lambda: near.recv(10)), error_of(lambda: near.sendall(b"x"))

    near, far = real_pair
    far.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    far.close()
    threading.Event().wait(0.05)
    real = error_of(lambda: near.recv(10)), error_of(lambda: near.recv(10)), error_of(lambda: near.sendall(b"x"))
    assert real == ("ECONNRESET", b"", "EPIPE")
    for seed in SEEDS:
        assert in_scenario(tmp_path, seed, program) == real


def test_a_connection_closed_with_bytes_unread_is_reset(
    tmp_path: Path, real_pair: tuple[socket.socket, socket.socket]
) -> None:
    def program(machine: Machine) -> object:
        near, far = pair(machine)
        near.sendall(b"nobody reads this")
        sleep(machine, 0.1)
        far.close()
        sleep(machine, 0.1)
        return error_of(lambda: near.recv(10))

    near, far = real_pair
    near.sendall(b"nobody reads this")
    threading.Event().wait(0.05)
    far.close()
    threading.Event().wait(0.05)
    assert error_of(lambda: near.recv(10)) == "ECONNRESET"
    for seed in SEEDS:
        assert in_scenario(tmp_path, seed, program) == "ECONNRESET"


def test_half_a_connection_closed_still_carries_the_other_half(tmp_path: Path) -> None:
    def program(machine: Machine) -> object:
        near, far = pair(machine)
        near.shutdown(socket.SHUT_WR)
        after = error_of(lambda: near.sendall(b"x"))
        sleep(machine, 0.1)
        end = far.inward.read(10)  # type: ignore[union-attr]
        far.outward.write(b"answer")  # type: ignore[union-attr]
        sleep(machine, 0.1)
        return after, end, near.recv(1) + near.recv(10) != b""

    assert in_scenario(tmp_path, 1, program) == ("EPIPE", b"", True)


def test_time_outs_and_calls_that_do_not_wait(tmp_path: Path, real_pair: tuple[socket.socket, socket.socket]) -> None:
    def course(near: Any, read: Callable[[int, int], bytes]) -> object:  # noqa: ANN401
        near.settimeout(0.02)
        timed = error_of(lambda: near.recv(10)), error_of(lambda: read(near.fileno(), 10))
        near.setblocking(False)
        straight = error_of(lambda: near.recv(10)), error_of(lambda: read(near.fileno(), 10))
        near.close()
        return timed, straight, near.fileno(), error_of(lambda: near.recv(10))

    real = course(real_pair[0], os.read)
    assert in_scenario(tmp_path, 1, lambda machine: course(pair(machine)[0], machine.read)) == real


def test_a_pipe_that_is_full(tmp_path: Path) -> None:
    def course(write: Any, choose: Any, read: Any, ends: tuple[int, int]) -> object:  # noqa: ANN401
        inward, outward = ends
        total = 0
        while choose([], [outward], [], 0)[1]:
            total += write(outward, bytes(1000))
        full = error_of(lambda: write(outward, bytes(4096)))
        read(inward, 10)
        after_little = choose([], [outward], [], 0)[1], error_of(lambda: write(outward, bytes(4096)))
        while total > 0 and choose([inward], [], [], 0)[0]:
            total -= len(read(inward, 1 << 16))
        return full, after_little, choose([], [outward], [], 0)[1] == [outward], error_of(lambda: read(inward, 1))

    def program(machine: Machine) -> object:
        numbers = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        for number in numbers:
            machine.set_blocking(number, False)

        def read(number: int, size: int) -> bytes:
            sleep(machine, 0.001)
            return machine.read(number, size)

        return course(machine.write, machine.select, read, (numbers[0], numbers[1]))

    ends = os.pipe()
    for number in ends:
        os.set_blocking(number, False)
    real = course(os.write, select.select, os.read, ends)
    for number in ends:
        os.close(number)
    for seed in SEEDS:
        assert in_scenario(tmp_path, seed, program) == real


def _pipe(machine: Machine) -> tuple[End, End]:
    from simulators.scenarios.streams import pipe

    return pipe(machine.kernel)


def test_a_pipe_without_a_reader_breaks_and_one_without_a_writer_ends(tmp_path: Path) -> None:
    def program(machine: Machine) -> object:
        inward, outward = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        machine.write(outward, b"abc")
        machine.close(outward)
        sleep(machine, 0.01)
        got = machine.read(inward, 10), machine.read(inward, 10), machine.select([inward], [], [], None)[0] == [inward]
        inward, outward = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        machine.close(inward)
        writable = machine.select([], [outward], [], None)[1] == [outward]
        return got, writable, error_of(lambda: machine.write(outward, b"x"))

    assert in_scenario(tmp_path, 1, program) == ((b"abc", b"", True), True, "EPIPE")


def test_a_waiting_write_goes_on_as_room_comes(tmp_path: Path) -> None:
    def program(machine: Machine) -> object:
        inward, outward = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        got: list[bytes] = []

        def read() -> None:
            while data := machine.read(inward, 10_000):
                got.append(data)

        reader = machine.kernel.spawn("reader", machine.here, read)
        written = machine.write(outward, bytes(300_000))
        machine.close(outward)
        while not reader.finished:
            sleep(machine, 0.01)
        return written, sum(map(len, got))

    for seed in SEEDS:
        assert in_scenario(tmp_path, seed, program) == (300_000, 300_000)


def test_select_waits_for_readers_and_writers_together(tmp_path: Path) -> None:
    def program(machine: Machine) -> object:
        inward, outward = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        other_in, other_out = [machine.descriptor(end, machine.here) for end in _pipe(machine)]
        machine.set_blocking(outward, False)
        while machine.select([], [outward], [], 0)[1]:
            machine.write(outward, bytes(4096))
        machine.kernel.spawn("late", machine.here, lambda: machine.write(other_out, b"x"), 500_000_000)
        began_ns = machine.kernel.now_ns
        timed_out = machine.select([other_in], [outward], [], 0.1)
        ready = machine.select([other_in], [outward], [], 5.0)
        return timed_out, ready == ([other_in], [], []), (machine.kernel.now_ns - began_ns) // 100_000_000, inward > 0

    assert in_scenario(tmp_path, 1, program) == (([], [], []), True, 5, True)


def test_nobody_listens(tmp_path: Path) -> None:
    assert (
        in_scenario(tmp_path, 1, lambda machine: error_of(lambda: machine.connect(("127.0.0.1", 9)))) == "ECONNREFUSED"
    )


def test_the_ends_of_a_killed_process_close(tmp_path: Path) -> None:
    def program(machine: Machine) -> object:
        inward, outward = _pipe(machine)
        process = machine.start("writer", lambda: machine.kernel.block() and 0)
        theirs = machine.descriptor(outward, process)
        ours = machine.descriptor(inward, machine.here)
        sleep(machine, 0.01)
        machine.signal(process, signal.SIGKILL)
        return machine.read(ours, 10), process.exit_code, theirs in machine.ends

    assert in_scenario(tmp_path, 1, program) == (b"", -9, False)
