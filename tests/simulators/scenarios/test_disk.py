"""The disk of a world: what survives a power cut, what it refuses."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from simulators.scenarios.disk import PAGE
from simulators.scenarios.machine import Machine, Process
from simulators.scenarios.os_stubs import Files

WRITE = os.O_RDWR | os.O_CREAT
SEEDS = range(40)


def run(machine: Machine, program: Callable[[Files], object]) -> Process:
    """Run a program to its end."""
    process = machine.start("program", lambda: program(Files(machine)))
    machine.kernel.run(lambda: not process.alive)
    assert process.errors == []
    return process


def refused(call: Callable[[], object]) -> bool:
    """The disk is full."""
    try:
        call()
    except OSError as error:
        return error.errno == errno.ENOSPC
    return False


def flush_folder(files: Files, folder: Path) -> None:
    """Make its names last."""
    handle = files.open(folder, os.O_RDONLY)
    files.fsync(handle)


def test_what_was_flushed_survives_and_what_was_not_may_be_lost(make: Callable[[int], tuple[Machine, Path]]) -> None:
    kept = set()
    for seed in SEEDS:
        machine, folder = make(seed)

        def program(files: Files) -> None:
            handle = files.open(folder / "file", WRITE)  # noqa: B023 - runs within this turn
            files.pwrite(handle, b"a" * 6000, 0)
            files.fsync(handle)
            flush_folder(files, folder)  # noqa: B023
            files.pwrite(handle, b"b" * 6000, 6000)

        run(machine, program)
        machine.disk.power_cut()
        content = (folder / "file").read_bytes()
        assert content[:6000] == b"a" * 6000
        assert set(content[6000:]) <= set(b"b\0")
        kept.add((len(content) == 12000, 0 in content))
    assert len(kept) > 2


def test_pages_written_over_in_reserved_room_are_lost_in_any_order(make: Callable[[int], tuple[Machine, Path]]) -> None:
    outcomes = set()
    for seed in SEEDS:
        machine, folder = make(seed)

        def program(files: Files) -> None:
            handle = files.open(folder / "file", WRITE)  # noqa: B023 - runs within this turn
            files.posix_fallocate(handle, 0, 8 * PAGE)
            files.fsync(handle)
            flush_folder(files, folder)  # noqa: B023
            for page in range(4):
                files.pwrite(handle, b"x" * PAGE, page * PAGE)

        run(machine, program)
        machine.disk.power_cut()
        content = (folder / "file").read_bytes()
        assert len(content) == 8 * PAGE
        pages = [content[page * PAGE : (page + 1) * PAGE] for page in range(8)]
        assert all(page in {b"x" * PAGE, bytes(PAGE)} for page in pages)
        outcomes.add("".join("x" if page[0] else "-" for page in pages))
    assert {"xxxx----", "--------"} < outcomes
    assert any(outcome.startswith("-") and "x" in outcome for outcome in outcomes)


def test_a_flush_covers_what_was_there_when_it_began(make: Callable[[int], tuple[Machine, Path]]) -> None:
    lost = 0
    for seed in SEEDS:
        machine, folder = make(seed)
        machine.disk.slow_ns = 1_000_000_000

        def program(files: Files) -> None:
            machine, place = files._machine, folder  # noqa: B023 - runs within this turn
            handle = files.open(place / "file", WRITE)
            flush_folder(files, place)
            files.pwrite(handle, b"early", 0)
            kernel = machine.kernel
            writer = kernel.spawn("writer", machine.here, lambda: files.pwrite(handle, b" late", 5), 500_000_000)
            files.fsync(handle)
            assert writer.finished

        run(machine, program)
        machine.disk.power_cut()
        content = (folder / "file").read_bytes()
        assert content[:5] == b"early"
        lost += content != b"early late"
    assert lost > 5


def test_a_rename_without_a_flush_of_the_folder_may_be_undone(make: Callable[[int], tuple[Machine, Path]]) -> None:
    outcomes: dict[bool, set[tuple[bytes, bool]]] = {False: set(), True: set()}
    for flushed in outcomes:
        for seed in SEEDS:
            machine, folder = make(seed)

            def program(files: Files) -> None:
                for name, data in (("final", b"old"), ("final.tmp", b"new")):
                    handle = files.open(folder / name, WRITE)  # noqa: B023 - runs within this turn
                    files.pwrite(handle, data, 0)
                    files.fsync(handle)
                flush_folder(files, folder)  # noqa: B023
                files.replace(folder / "final.tmp", folder / "final")  # noqa: B023
                if flushed:  # noqa: B023
                    flush_folder(files, folder)  # noqa: B023

            run(machine, program)
            machine.disk.power_cut()
            outcomes[flushed].add(((folder / "final").read_bytes(), (folder / "final.tmp").exists()))
    assert outcomes == {False: {(b"old", True), (b"new", False)}, True: {(b"new", False)}}


def test_names_are_lost_from_the_newest(make: Callable[[int], tuple[Machine, Path]]) -> None:
    outcomes = set()
    for seed in SEEDS:
        machine, folder = make(seed)

        def program(files: Files) -> None:
            for number in range(4):
                files.open(folder / str(number), WRITE)  # noqa: B023 - runs within this turn
            files.unlink(folder / "0")  # noqa: B023

        run(machine, program)
        machine.disk.power_cut()
        outcomes.add("".join(sorted(path.name for path in folder.iterdir())))
    assert outcomes == {"", "0", "01", "012", "0123", "123"}


def test_what_a_killed_process_wrote_is_there(make: Callable[[int], tuple[Machine, Path]]) -> None:
    machine, folder = make(1)

    def program() -> None:
        handle = Files(machine).open(folder / "file", WRITE)
        Files(machine).pwrite(handle, b"in the machine's memory", 0)
        machine.kernel.block()

    process = machine.start("program", program)
    machine.start("other", lambda: machine.kernel.sleep_ns(10**9))
    machine.kernel.run(lambda: machine.kernel.time_s > 0.5)
    machine.end(process, -9)
    assert (folder / "file").read_bytes() == b"in the machine's memory"


def test_a_full_disk_takes_some_bytes_or_says_so_and_never_none(make: Callable[[int], tuple[Machine, Path]]) -> None:
    taken = set()
    for seed in SEEDS:
        machine, folder = make(seed)

        def program(files: Files) -> None:
            handle = files.open(folder / "file", WRITE)  # noqa: B023 - runs within this turn
            files._machine.disk.refuses = errno.ENOSPC
            while not refused(lambda: taken.add(files.pwrite(handle, b"abc", 0))):
                pass
            with pytest.raises(OSError, match="No space"):
                files.open(folder / "other", WRITE)  # noqa: B023
            with pytest.raises(OSError, match="No space"):
                files.posix_fallocate(handle, 0, 1 << 20)

        run(machine, program)
    assert taken <= {1, 2, 3}
    assert taken


def test_a_failing_flush_keeps_nothing(make: Callable[[int], tuple[Machine, Path]]) -> None:
    contents = set()
    for seed in SEEDS:
        machine, folder = make(seed)

        def program(files: Files) -> None:
            handle = files.open(folder / "file", WRITE)  # noqa: B023 - runs within this turn
            flush_folder(files, folder)  # noqa: B023
            files.pwrite(handle, b"abc", 0)
            files._machine.disk.flush_fails = True
            with pytest.raises(OSError, match=os.strerror(errno.EIO)):
                files.fsync(handle)

        run(machine, program)
        machine.disk.power_cut()
        contents.add((folder / "file").read_bytes())
    assert b"abc" in contents
    assert len(contents) > 2


def test_an_emptied_file_may_have_its_content_again(make: Callable[[int], tuple[Machine, Path]]) -> None:
    contents = set()
    for seed in SEEDS:
        machine, folder = make(seed)
        (folder / "file").write_bytes(b"before")

        def program(files: Files) -> None:
            files.open(folder / "file", WRITE | os.O_TRUNC)  # noqa: B023 - runs within this turn

        run(machine, program)
        assert (folder / "file").read_bytes() == b""
        machine.disk.power_cut()
        contents.add((folder / "file").read_bytes())
    assert contents == {b"", b"before"}


def test_folders_are_listed_in_one_order(make: Callable[[int], tuple[Machine, Path]]) -> None:
    _, folder = make(1)
    for name in "zaqxswcde":
        (folder / name).touch()
    assert Files.listdir(folder) == sorted("zaqxswcde")
    with Files.scandir(folder) as entries:
        assert [entry.name for entry in entries] == sorted("zaqxswcde")
