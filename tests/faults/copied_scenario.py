"""Campaigns that begin alike are begun once, stand where the first point begins, and are copied for each test.

`os.fork` copies the world's memory, greenlets included; its files are put back before each copy goes on. What a test
does happens in the copy, which ends with it: no test sees what another one did.
"""

from __future__ import annotations

import fcntl
import gc
import multiprocessing
import os
import re
import signal
import stat
import traceback
import warnings
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NoReturn

import pytest
from scenario_campaign import SEED, ScenarioCampaign, Setting, begin, rig_options

from simulators.scenarios.stage import Stage

HUNG_S = 300
"""A copy that runs for so long on a real clock is ended."""

BLOCK = 1 << 16

Judge = Callable[[ScenarioCampaign], None]


@dataclass(frozen=True)
class OpenFile:
    """An open file: the descriptors that share it, where its next read or write goes, and the lock that it holds."""

    numbers: list[int]
    place: int
    lock: int

    def unlock(self) -> None:
        """Let go of its lock, so that a copy can take it; who only waits needs none."""
        fcntl.flock(self.numbers[0], fcntl.LOCK_UN)

    def open_again(self) -> None:
        """Have it for this process alone: what is closed here is then closed, and its lock free."""
        first = self.numbers[0]
        flags = fcntl.fcntl(first, fcntl.F_GETFL) & (os.O_ACCMODE | os.O_APPEND)
        own = os.open(f"/proc/self/fd/{first}", flags)
        for number in self.numbers:
            os.dup2(own, number)
        os.close(own)
        os.lseek(first, self.place, os.SEEK_SET)
        fcntl.flock(first, self.lock | fcntl.LOCK_NB)


class KeptFolder:
    """A folder as it is now, its open files included, to be put back as often as wanted.

    Args:
        root: the folder.
        kept: where a second name of each file lies meanwhile: a file that is removed keeps its inode.
    """

    def __init__(self, root: Path, kept: Path) -> None:
        kept.mkdir()
        self._root = root
        self._folders = [path for path in root.rglob("*") if path.is_dir()]
        self._files: list[tuple[Path, Path, bytes]] = []
        for number, path in enumerate(path for path in root.rglob("*") if path.is_file()):
            os.link(path, kept / str(number))
            self._files.append((path, kept / str(number), path.read_bytes()))
        self._open = open_files(root)
        for file in self._open:
            file.unlock()

    def restore(self) -> None:
        """Put all back: names, contents, places and locks."""
        for path in sorted(self._root.rglob("*"), reverse=True):  # what is in a folder before the folder
            if not path.is_dir():
                path.unlink()
            elif path not in self._folders:
                path.rmdir()
        for folder in self._folders:
            folder.mkdir(exist_ok=True)
        for path, kept, content in self._files:
            os.link(kept, path)
            put_back(kept, content)

    def open_again(self) -> None:
        """In a copy of this process: have the open files for it alone, as they were."""
        for file in self._open:
            file.open_again()


def put_back(path: Path, content: bytes) -> None:
    """Give a file its content again, where it is another one: little of a ring is."""
    with path.open("r+b") as file:
        file.truncate(len(content))
        for start in range(0, len(content), BLOCK):
            block = content[start : start + BLOCK]
            if os.pread(file.fileno(), BLOCK, start) != block:
                os.pwrite(file.fileno(), block, start)


def open_files(root: Path) -> list[OpenFile]:
    """What this process has open of the files below a folder."""
    held = {"READ": fcntl.LOCK_SH, "WRITE": fcntl.LOCK_EX}
    files: list[OpenFile] = []
    for entry in Path("/proc/self/fd").iterdir():
        if not (entry.exists() and entry.resolve().is_relative_to(root)):
            continue
        number = int(entry.name)
        shared = next((file for file in files if is_same(file.numbers[0], number)), None)
        if shared is not None:
            shared.numbers.append(number)
            continue
        locks = re.findall(r"FLOCK +\w+ +(READ|WRITE)", Path(f"/proc/self/fdinfo/{number}").read_text("utf-8"))
        lock = held[locks[0]] if locks else fcntl.LOCK_UN
        files.append(OpenFile([number], os.lseek(number, 0, os.SEEK_CUR), lock))
    return files


def is_same(one: int, other: int) -> bool:
    """Whether two descriptors share an open file: the place of one is that of the other."""
    if not os.path.sameopenfile(one, other) or stat.S_ISDIR(os.fstat(one).st_mode):
        return False
    before = os.lseek(other, 0, os.SEEK_CUR)
    place = os.lseek(one, 0, os.SEEK_CUR)
    os.lseek(one, 1, os.SEEK_CUR)
    moved = os.lseek(other, 0, os.SEEK_CUR) != before
    os.lseek(one, place, os.SEEK_SET)
    return moved


class StandingCampaign:
    """A process in which a campaign stands where its first point begins.

    Args:
        setting: what it begins with; no faults.
        folder: an empty one.
    """

    def __init__(self, setting: Setting, folder: Path) -> None:
        self.setting = setting
        self._here, there = multiprocessing.Pipe()
        self._process = fork()
        if not self._process:
            self._here.close()
            leave_after(lambda: serve(setting, folder, there))
        there.close()

    def judge(self, setting: Setting, judge: Judge) -> None:
        """Have a copy judged whose rig has the faults of a setting; fails with what the judge says."""
        self._here.send((setting, judge))
        if text := self._here.recv():
            pytest.fail(text, pytrace=False)

    def end(self) -> None:
        """End it."""
        self._here.close()
        os.waitpid(self._process, 0)


class StandingCampaigns:
    """One of each setting, made when it is first asked for."""

    def __init__(self, folder: Callable[[], Path]) -> None:
        self._folder = folder
        self._made: list[StandingCampaign] = []

    def judge(self, setting: Setting, judge: Judge) -> None:
        """Have a copy of the campaign with this setting judged.

        Raises:
            ValueError: its rig is not as without its faults until the first point begins.
        """
        common = without_faults(setting)
        if common is None:
            raise ValueError(f"no fault in motion: {setting.simulator}")
        standing = next((one for one in self._made if one.setting == common), None)
        if standing is None:
            standing = StandingCampaign(common, self._folder())
            self._made.append(standing)
        standing.judge(setting, judge)

    def end(self) -> None:
        """End all, the newest first: it holds open what the others listen to."""
        while self._made:
            self._made.pop().end()


def without_faults(setting: Setting) -> Setting | None:
    """What a campaign begins with whose rig is the same up to its faults; None: a fault is there from the start."""
    options, run = rig_options(*setting.arguments)
    if any(fault.after_s is None for fault in run.faults):
        return None
    common = replace(setting, simulator=("--actuator", run.actuator))
    alike = repr(rig_options(*common.arguments)) == repr((options, replace(run, faults=())))  # NaN is not equal to NaN
    return common if alike else None


def serve(setting: Setting, folder: Path, asked: Connection) -> None:
    """Begin the campaign, then make a copy for each judge that is sent; returns when no further copy is requested."""
    world = folder / "world"
    world.mkdir()
    with ExitStack() as ends:
        try:
            campaign = begin(ends.enter_context(Stage(SEED, world)), world, setting)
            campaign.until(lambda: campaign.happened("START") or campaign.stage.rig.first_cycle_s is not None, "motion")
            files, problem = KeptFolder(world, folder / "kept"), ""
            gc.freeze()
        except BaseException:  # noqa: BLE001 - told by every test that asks
            problem = traceback.format_exc()
        with suppress(EOFError):
            while True:
                changed, judge = asked.recv()
                if problem:
                    asked.send(problem)
                    continue
                files.restore()
                copied = fork()
                if not copied:
                    leave_after(partial(answer, asked, campaign, files, changed, judge))
                if status := os.waitpid(copied, 0)[1]:
                    asked.send(f"the copied campaign ended without a judgement, status {status}")


def answer(
    asked: Connection, campaign: ScenarioCampaign, files: KeptFolder, setting: Setting, judge: Judge
) -> None:
    """Send what is wrong with the end of a campaign whose rig has the faults of a setting; empty: nothing."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(HUNG_S)
    problem = ""
    try:
        files.open_again()
        campaign.stage.rig._pending_faults += rig_options(*setting.arguments)[1].faults
        judge(replace(campaign, setting=setting))
    except BaseException:  # noqa: BLE001 - an assertion, or what a defect raises: told by the test that asked
        problem = traceback.format_exc()
    asked.send(problem)


def fork() -> int:
    """`os.fork` beside threads that libraries have: none of them runs what is run here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def leave_after(do: Callable[[], object]) -> NoReturn:
    """Do something and end this process, without what its parent would do at its end."""
    code = 1
    try:
        do()
        code = 0
    finally:
        os._exit(code)
