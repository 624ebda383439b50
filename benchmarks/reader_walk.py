"""How far a reader walks: the files through which one recorded point and one whole campaign pass.

    python benchmarks/reader_walk.py [--json]

Runs a campaign of one point on the simulated rig with the application's Python calls traced, and follows it as a
reader who sees the code for the first time: into each function where it is first called, depth first, and back to the
caller. Only functions of this project count, each once; what runs on import does not.

files: project files entered. doors: from which file into which other one, each pair once. climbs: doors that lead back
up, into a file met before the one they start from. returns: how often the walk comes back to a file that it had already
left. `own` counts the same inside the room in which the walk begins, whose other rooms are words to a reader. The walk
of the point is that of its finishing (journal to judged HDF5 file), the walk of the campaign is that of the
application's main thread from `run_campaign` to its result, without what the finishing and the station do in processes
of their own.
"""

from __future__ import annotations

import argparse
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

    def counts(self, room: str = "") -> dict[str, int]:
        """Files, doors, climbs and returns among the files below a folder."""
        visits = [visit for visit in self.visits if visit.startswith(room)]
        visits = [visit for visit, before in zip(visits, ["", *visits], strict=False) if visit != before]
        order = {name: place for place, name in enumerate(dict.fromkeys(visits))}
        doors = [(start, end) for start, end in self.calls if start in order and end in order]
        return {
            "files": len(order), "doors": len(doors),
            "climbs": sum(order[end] < order[start] for start, end in doors), "returns": len(visits) - len(order),
        }  # fmt: skip

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
        raise SystemExit(f"the campaign ended with exit code {result.exit_code}: nothing to walk")
    return walk, kept


def _keep(folder: Path, kept: Path, ended: threading.Event) -> None:
    """Link the point's journal as soon as it is there: its finishing deletes it."""
    while not ended.wait(0.01) and not kept.exists():
        for journal in folder.glob("out/*/points/*.journal"):
            os.link(journal, kept)


def walk_point(journal: Path) -> Walk:
    """Finish a point's journal."""
    walk = Walk()
    walk.run(lambda: finish_point(journal))
    return walk


def main() -> None:
    """Walk both and print what was met."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print the counts and the files as JSON")
    parser.add_argument("--walk", action="store_true", help="print the files in the order of the walk")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        campaign, journal = walk_campaign(Path(name))
        point = walk_point(journal)
    for key, walk, room in (("campaign", campaign, "rig/campaign/"), ("point", point, "rig/recording/")):
        counted = {"all": walk.counts(), "own": walk.counts(room)}
        if asked.json:
            print(json.dumps({"walk": key, **counted, "visits": walk.visits}))
            continue
        for scope, numbers in counted.items():
            print(f"{key:8}  {scope}  " + ", ".join(f"{count} {name}" for name, count in numbers.items()))
        if asked.walk:
            print("".join(f"  {visit}\n" for visit in walk.visits), end="")


if __name__ == "__main__":
    main()
