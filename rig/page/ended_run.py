"""What is left of a run that has ended, from its files: how it ended, its points' verdicts, and their loops.

The journal is the campaign's own; a session that says nothing at its end was killed or cut off, whatever an earlier
session said. Nothing here is read while a campaign runs.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from drivers.processes import own_program
from drivers.ring import Channel
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.page.samples import LOOP_F, LOOP_V, LOOP_X, RECORDED, packed, thinned
from rig.recording.quality.stopped_point import was_stopped
from rig.recording.tested_specimens import TITLES
from rig.station.live_folder import read_json
from rig.text_file import JSON_LIMIT_BYTES, open_regular, stamp
from rig.verdicts import rank

EVENTS = (b'"result"', b'"judged"', b'"connected"', b'"point"', b'"refused"', b'"resumed"')
"""Events of a journal that say how a run ended; other lines are not looked into."""
KEYS = ("valid", "total", "rig_state", "stopped_by", "points")
PEAK_FORCES = ("peak_force_rebound_N", "peak_force_compression_N")
REQUESTED = frozenset({"operator", "sigint", "sigterm"})
"""Codes of stops that were requested before the rig was connected: no refusals."""
LONGEST_REASON = 600
MOST_SHOWN = 4000
MOST_READ_BYTES = 1 << 27
"""Of a journal, from its end."""
READ_S = 60.0
CHANNELS = {
    Channel.FORCE: "force", Channel.DISPLACEMENT: "displacement", Channel.COIL_CURRENT: "current",
    Channel.COIL_TEMPERATURE: "coil_temperature", Channel.COMMANDED_CURRENT: "commanded_current",
}
LOOP = {LOOP_X: "displacement", LOOP_V: "velocity", LOOP_F: "force"}


class EndedRun:
    """One run, read again when its journal has changed.

    Args:
        run: its directory.
    """

    def __init__(self, run: Path) -> None:
        self._run = CampaignFolder(run)
        self._stamp: tuple[int, int] | None = None
        self._result: dict[str, Any] | None = None
        self._specimen: tuple[tuple[int, int] | None, dict[str, str]] = None, {}

    @property
    def specimen(self) -> dict[str, str]:
        """Verdict on the specimen: `verdict` and `reason`; empty without acceptance bands."""
        file = self._run.acceptance
        now = stamp(file)
        if now != self._specimen[0]:
            written = {} if now is None or file.is_symlink() else read_json(file)
            verdict = written.get("specimen")
            known = isinstance(verdict, str) and verdict in TITLES
            reason = str(written.get("reason", ""))[:LONGEST_REASON]
            self._specimen = now, {"verdict": str(verdict), "reason": reason} if known else {}
        return self._specimen[1]

    @property
    def result(self) -> dict[str, Any]:
        """How it ended: `valid`, `total`, `rig_state`, `stopped_by`, `points`, `lines`; or `cut_off`, with `points`.

        `resumed`, of a resumed run: how many times.

        With `refused` (a code) the last session did not begin, for the reason in `lines`; `points` are of those before.
        Of an imported run, which has no journal: `imported`, `valid`, `total`, `points`.
        """
        source = self._run.description if is_imported(self._run) else self._run.journal
        now = stamp(source)
        if now is None:
            return {"cut_off": True, "points": []}
        if self._result is None or now != self._stamp:
            self._stamp = now
            self._result = _result(source) if source == self._run.journal else _imported(self._run)
        return self._result

    @property
    def points(self) -> dict[str, dict[str, Any]]:
        """Verdicts by point, as sent to pages; `file` if there is one."""
        return {
            str(point.get("id")): {
                "verdict": str(point.get("verdict", "")), "reasons": _texts(point.get("reasons")),
                "stopped": was_stopped(str(point.get("verdict", "")), _texts(point.get("reasons"))),
                "file": self.file(point) is not None, "coil_degC": _coil_degC(point),
                **{name: _number(point.get(name)) for name in PEAK_FORCES},
            }
            for point in self.result["points"]
        }  # fmt: skip

    def file(self, point: Mapping[str, Any]) -> Path | None:
        """The file named by a point's `file`, in this run's folder even if the run was moved; None: not found."""
        named = Path(str(point.get("file") or "")).name
        path = self._run.points / named
        with contextlib.suppress(OSError):  # a name that is too long
            return path if named and path.is_file() else None
        return None

    def file_of(self, point_id: str) -> Path | None:
        """The file of a recorded point; None if there is none."""
        point = next((known for known in self.result["points"] if known.get("id") == point_id), None)
        return None if point is None else self.file(point)


def is_imported(run: CampaignFolder) -> bool:
    """Whether this run was imported from files of other programs."""
    return not run.journal.is_file() and read_json(run.description).get("imported") is True


def _imported(run: CampaignFolder) -> dict[str, Any]:
    points: list[dict[str, Any]] = []
    with contextlib.suppress(OSError, ValueError, RecursionError, subprocess.SubprocessError):
        points = _objects(json.loads(_read_apart("rig.recording.listing", run.path) or b"[]"))
    valid = sum(point.get("verdict") == "valid" for point in points)
    return {"imported": True, "valid": valid, "total": len(points), "points": points, "lines": []}


def _read_apart(module: str, path: Path) -> bytes | None:
    """What a separate process reads of a file or folder from outside; None if it fails."""
    silent = subprocess.DEVNULL
    command = own_program(module, str(path))
    done = subprocess.run(
        command, stdin=silent, stdout=subprocess.PIPE, stderr=silent, timeout=READ_S, check=False
    )
    return None if done.returncode else done.stdout


def _result(journal: Path) -> dict[str, Any]:
    result: dict[str, Any] | None = None
    refusal: dict[str, Any] | None = None
    points: dict[str, dict[str, Any]] = {}
    resumed = 0
    for event in _events(journal):
        kind = event.get("event")
        if kind == "result":
            result, points = event, {str(one.get("id")): one for one in _objects(event.get("points"))}
            refusal = refusal if refusal is not None and refusal.get("slug") == event.get("stopped_by") else None
        elif kind == "refused":
            refusal = event
        elif kind in {"connected", "point"}:
            result = refusal = None
        elif kind == "resumed":
            resumed += 1
        elif kind == "judged" and _rank(event) >= _rank(points.get(str(event.get("id")), {})):
            points[str(event.get("id"))] = event
    times = {"resumed": resumed} if resumed else {}
    if refusal is not None:
        slug, lines = str(refusal.get("slug") or "usage"), [str(refusal.get("text") or "")]
        cause = {"stopped_by": slug, "rig_state": "safe"} if slug in REQUESTED else {"refused": slug}
        return {**cause, "points": list(points.values()), "lines": lines, **times}
    if result is None:
        return {"cut_off": True, "points": list(points.values()), **times}
    stop = result.get("stop")
    state_text = str(stop.get("stands") or "") if isinstance(stop, dict) else ""
    lines = [text for text in (str(result.get("detail") or ""), state_text[:1].upper() + state_text[1:]) if text]
    lines += [str(one.get("text", "")) for one in _objects(result.get("findings"))]
    ending = {key: result.get(key) for key in KEYS}
    return {**ending, "points": list(points.values()), "lines": lines, **times}


def _objects(value: object) -> list[dict[str, Any]]:
    """The objects of a list; empty for anything else that a damaged journal may hold in its place."""
    return [one for one in value if isinstance(one, dict)] if isinstance(value, list) else []


def _texts(value: object) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list) else []


def _number(value: object) -> float | None:
    """A number of a journal; None for anything else."""
    with contextlib.suppress(OverflowError):  # an integer of more than 308 digits
        return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
    return None


def _coil_degC(point: Mapping[str, Any]) -> list[float] | None:
    """Lowest and highest temperature of the coil during a point; None: not recorded."""
    quality = point.get("quality")
    read = quality.get if isinstance(quality, dict) else dict[str, object]().get
    low_degC, high_degC = (_number(read(f"coil_temperature_{end}_degC")) for end in ("low", "high"))
    return None if low_degC is None or high_degC is None else [low_degC, high_degC]


def _rank(point: dict[str, Any]) -> tuple[int, bool]:
    """Of a point's attempts the best counts, then one with a file, then the latest."""
    return rank(point.get("verdict")), bool(point.get("file"))


def _events(journal: Path) -> Iterator[dict[str, Any]]:
    with contextlib.suppress(OSError, FileProblem), open_regular(journal) as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - MOST_READ_BYTES))
        for line in iter(lambda: file.readline(JSON_LIMIT_BYTES), b""):
            if any(word in line for word in EVENTS):
                with contextlib.suppress(ValueError, RecursionError):
                    event = json.loads(line)
                    if isinstance(event, dict) and isinstance(event.get("event"), str):
                        yield event


def trials_of(drives: Path) -> dict[str, Any] | None:
    """The trials in the newest file of a folder of drives (`rig.recording.drive_excerpt`); None if there are none.

    A separate process reads the file, as for `recorded_frame`.
    """
    with contextlib.suppress(OSError, ValueError, RecursionError, subprocess.SubprocessError):
        files = [path for path in drives.glob("*.h5") if path.is_file() and not path.is_symlink()]
        newest = max(files, key=lambda path: path.stat().st_mtime_ns, default=None)
        if newest is None:
            return None
        written = _read_apart("rig.recording.drive_excerpt", newest)
        trials = None if written is None else json.loads(written)
        return trials if isinstance(trials, dict) else None
    return None


def recorded_frame(path: Path) -> bytes | None:
    """The last cycles of a recorded point and its last 20 s as one frame; None if the file cannot be read.

    A separate process with low priority reads the file: no file can harm the page, and a running rig does not
    wait for it. Recorded files are only ever replaced as a whole, so reading does not disturb the campaign.
    """
    with contextlib.suppress(OSError, KeyError, ValueError, IndexError, subprocess.SubprocessError, BadZipFile):
        return _frame(path)
    return None


def _frame(path: Path) -> bytes | None:
    excerpt = _read_apart("rig.recording.excerpt", path)
    if excerpt is None:
        return None
    arrays = np.load(io.BytesIO(excerpt), allow_pickle=False)
    shown = {
        int(channel): thinned(arrays[f"time_{name}"], arrays[name], MOST_SHOWN) for channel, name in CHANNELS.items()
    }
    shown |= {channel: (arrays["loop_time"], arrays[f"loop_{name}"]) for channel, name in LOOP.items()}
    return packed(shown, float(arrays["time_force"][-1]), RECORDED)
