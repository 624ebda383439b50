"""How far a reader walks: the files and rooms through which a command, a recorded point and a whole campaign pass.

    python benchmarks/reader_walk.py [--json] [--walk]

Calls are traced and followed as a reader who sees the code for the first time: into each function where it is first
called, depth first, and back to the caller. Only functions of this project count, each once; what runs on import does
not.

files, rooms: entered (a room is a package of `rig`, or `drivers`, `protocols`). stays: visits to rooms. returns: visits
to a room that was already left. climbs: calls from one file into a file met before it. Walks: `run_campaign` of one
point on the simulated rig (the application's main thread), finishing of its journal, reading its bench file, and the
commands `rig plan`, `rig identify`, `rig report` on it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TypeVar

from campaign_process import sines

from rig.bench.model import Bench
from rig.cli.main import main as rig
from rig.recording.conversion.conversion import finish_point

ROOT = Path(__file__).resolve().parent.parent
ROOMS = tuple(str(ROOT / room) + "/" for room in ("rig", "drivers", "protocols"))
MATRIX = sines(["4 Hz"], ["0.5 A"], "5 mm", 6, identify=False)

T = TypeVar("T")


class Walk:
    """The order in which a reader meets files, from calls as they happen.

    Attributes:
        files: project files by the order of their first visit.
        visits: files in the order of the walk, neighbours differ.
    """

    def __init__(self) -> None:
        self.visits: list[str] = []
        self.calls: set[tuple[str, str]] = set()
        self._read: set[object] = set()

    @property
    def files(self) -> list[str]:
        """Files by the order of their first visit."""
        return list(dict.fromkeys(self.visits))

    def counts(self) -> dict[str, int]:
        """Files, climbs between them, and rooms, stays and returns."""
        order = {name: number for number, name in enumerate(self.files)}
        stays = [_room(visit) for visit in self.visits]
        stays = [stay for stay, before in zip(stays, ["", *stays], strict=False) if stay != before]
        rooms = len(set(stays))
        return {
            "stays": len(stays), "rooms": rooms, "returns": len(stays) - rooms, "files": len(order),
            "climbs": sum(order[end] < order[start] for start, end in self.calls),
        }

    def run(self, function: Callable[[], T]) -> T:
        """Call a function with this thread's calls followed."""
        sys.setprofile(self._event)
        try:
            return function()
        finally:
            sys.setprofile(None)

    def _event(self, frame: FrameType, event: str, _argument: object) -> None:
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(ROOMS) and frame.f_code.co_name != "<module>":
            new = frame.f_code not in self._read
            if new:
                self._read.add(frame.f_code)
                caller = self._caller(frame)
                if caller:
                    self._visit(caller)
                self._visit(name)
                if caller and caller != name:
                    self.calls.add((_short(caller), _short(name)))

    def _caller(self, frame: FrameType) -> str:
        """The project's file from which the call comes, "" where there is none."""
        above = frame.f_back
        while above is not None and not above.f_code.co_filename.startswith(ROOMS):
            above = above.f_back
        return above.f_code.co_filename if above is not None else ""

    def _visit(self, name: str) -> None:
        if not self.visits or self.visits[-1] != _short(name):
            self.visits.append(_short(name))


def _short(name: str) -> str:
    return str(Path(name).relative_to(ROOT))


def _room(file: str) -> str:
    """The package that a file is in: `rig/recording`, `drivers`; a module of `rig` itself counts as one."""
    parts = file.split("/")
    return "/".join(parts[:2]) if parts[0] == "rig" else parts[0]


class Silent:
    """A display that shows nothing."""

    def __getattr__(self, _name: str) -> Callable[..., None]:
        return lambda *_arguments, **_named: None


def walk_campaign(folder: Path) -> tuple[Walk, Path]:
    """Run one point on the simulated rig; the campaign's walk and the point's journal, kept from deletion by a link."""
    from rig.campaign import CampaignOptions, run_campaign

    matrix = folder / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    kept = folder / "kept" / "points" / "p001.journal"
    kept.parent.mkdir(parents=True)
    ended = threading.Event()
    keeper = threading.Thread(target=_keep, args=(folder, kept, ended))
    keeper.start()
    walk = Walk()
    options = CampaignOptions(matrix, folder / "out", simulate=True, speed=10.0)
    try:
        result = walk.run(lambda: run_campaign(options, Silent()))
    finally:
        ended.set()
        keeper.join()
    if result.exit_code != 0:
        why = [reason for point in result.points for reason in point.reasons]
        raise SystemExit(f"the campaign ended with exit code {result.exit_code} ({result.detail}; {why})")
    return walk, kept


def _keep(folder: Path, kept: Path, ended: threading.Event) -> None:
    """Link the point's journal as soon as it is there: its finishing deletes it."""
    while not ended.wait(0.01) and not kept.exists():
        for journal in folder.glob("out/*/points/*.journal"):
            os.link(journal, kept)


def walked(function: Callable[[], object]) -> Walk:
    """The walk of a function."""
    walk = Walk()
    walk.run(function)
    return walk


def command(*arguments: str) -> Callable[[], int]:
    """A `rig` command in this process, its output thrown away."""

    def run() -> int:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            return rig(arguments)

    return run


def main() -> None:
    """Walk all and print what was met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the counts and the files as JSON")
    parser.add_argument("--walk", action="store_true", help="print the files in the order of the walk")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        campaign, journal = walk_campaign(Path(name))
        (run,) = (Path(name) / "out").iterdir()
        walks = {
            "run": campaign,
            "point": walked(lambda: finish_point(journal)),
            "bench": walked(lambda: Bench.load(run / "bench.toml")),
            "plan": walked(command("plan", str(run / "matrix.toml"), "--bench", str(run / "bench.toml"))),
            "identify": walked(command("identify", str(run))),
            "report": walked(command("report", str(run))),
        }
    for key, walk in walks.items():
        if given.json:
            print(json.dumps({"walk": key, **walk.counts(), "visits": walk.visits}))
            continue
        print(f"{key:8}  " + ", ".join(f"{count} {counted}" for counted, count in walk.counts().items()))
        if given.walk:
            print("".join(f"  {visit}\n" for visit in walk.visits), end="")


if __name__ == "__main__":
    main()
