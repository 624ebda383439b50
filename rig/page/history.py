"""The runs of a folder as the page of a bench lists them: what was tested, how it ended, whether there is a report.

From files alone, each read again when it has changed. Names from a browser are looked up in the list and never made
into paths; no link is followed.
"""

from __future__ import annotations

import math
import os
from datetime import datetime
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder, by_age
from rig.clock import utc_now
from rig.errors import FileProblem
from rig.page.ended_run import EndedRun
from rig.recording.tested_on import when_tested
from rig.recording.tested_specimens import TESTED, TITLES, TestedSpecimen, TestedSpecimens, counts
from rig.station.live_folder import LOCK, STATE, held, read_json
from rig.text_file import open_regular, stamp

MOST_RUNS = 100
LARGEST_REPORT_BYTES = 64_000_000
LONGEST_TEXT = 600


class History:
    """The runs of a folder, the newest first.

    Args:
        folder: where they are.
        simulated: whether runs on the simulated rig are those of this bench, or all others.
    """

    def __init__(self, folder: Path, *, simulated: bool) -> None:
        self.folder = folder
        self._simulated = simulated
        self._ended: dict[str, EndedRun] = {}
        self._read: dict[Path, tuple[tuple[int, int], dict[str, Any]]] = {}
        self.runs: list[dict[str, Any]] = []
        self.tested = TestedSpecimens(folder)
        self.today: dict[str, Any] = {}

    def look(self) -> list[dict[str, Any]]:
        """Read what has changed; the list."""
        names = [name for name in by_age(self.folder)[-MOST_RUNS:] if self._is_run(name)]
        self._ended = {name: self._ended.get(name) or EndedRun(self.folder / name) for name in names}
        self.runs = [self._entry(name) for name in reversed(names)]
        listed = {self.folder / name for name in names}
        self._read = {path: known for path, known in self._read.items() if path.parent in listed}
        self.today = _counters(self.tested.since(_midnight()))
        return self.runs

    def _json(self, path: Path) -> dict[str, Any]:
        """Content of a file of a run, cached until the file changes; empty if there is no file."""
        now = stamp(path)
        if now is None:
            return {}
        if path not in self._read or self._read[path][0] != now:
            self._read[path] = now, read_json(path)
        return self._read[path][1]

    def _is_run(self, name: str) -> bool:
        return name.isprintable() and not (self.folder / name).is_symlink()

    def newest(self) -> Path | None:
        """The newest run; None where there is none."""
        return self.folder / self.runs[0]["name"] if self.runs else None

    def entry(self, name: object) -> dict[str, Any] | None:
        """A listed run by its name; None for any other name."""
        return next((run for run in self.runs if run["name"] == name), None)

    def report(self, name: object, *, pdf: bool = False) -> bytes | None:
        """The report of a listed run, HTML or PDF; None where there is none that is a regular file of its folder.

        Raises:
            OSError: it cannot be read.
        """
        if self.entry(name) is None:
            return None
        run = CampaignFolder(self.folder / str(name))
        path = run.report_pdf if pdf else run.report
        if path.is_symlink():
            return None
        try:
            with open_regular(path) as file:
                content = file.read(LARGEST_REPORT_BYTES + 1)
        except (FileProblem, FileNotFoundError):
            return None
        return content if len(content) <= LARGEST_REPORT_BYTES else None

    def _entry(self, name: str) -> dict[str, Any]:
        run = CampaignFolder(self.folder / name)
        described, result = self._json(run.description), self._ended[name].result
        verdicts = [str(point.get("verdict", "")) for point in result["points"]]
        planned, total = described.get("points"), result.get("total")  # stated by a run that has ended
        if not isinstance(total, int) or "imported" in result:
            total = len(planned) if isinstance(planned, list) else 0
        total = max(total, len(verdicts))
        live = _live_folder(run)
        state = {} if live is None else read_json(live / STATE)
        valid, suspect, invalid = (
            int(state.get(name, verdicts.count(name))) for name in ("valid", "suspect", "invalid")
        )  # of the session that runs, where one does
        ended, slug = ("running", "") if live is not None else self._ending(run, result)
        simulated = isinstance(described.get("simulated"), dict)
        own, running = simulated is self._simulated, ended == "running"
        left = total - valid - suspect
        specimen = self._ended[name].specimen if live is None else verdict_before_report(live)
        return {
            "name": name, "specimen": _text(described.get("specimen"), 80),
            "started": _text(when_tested(described), 19), "bench": _text(described.get("bench"), 80),
            "simulated": simulated, "total": total, "valid": valid, "suspect": suspect,
            "invalid": invalid, "ended": ended, "slug": slug,
            "matrix": _text(described.get("matrix_file"), 120),
            "operator": _text(self._json(run.operator).get("operator"), 80), "resumed": int(result.get("resumed", 0)),
            "specimen_verdict": specimen.get("verdict", ""),
            "specimen_reason": _text(specimen.get("reason"), LONGEST_TEXT),
            "takt_s": self.tested.takt_s(name) if specimen else None,
            "rig_state": "" if running else _text(result.get("rig_state"), 20),
            "text": "" if running else _sentences(result.get("lines")),
            "report": not running and _is_own(run.report), "pdf": not running and _has_pdf(run),
            "recorded": _has_files(run.points),
            "resumable": own and left > 0 and not running and run.matrix.is_file(), "own": own, "left": left,
        }

    @staticmethod
    def _ending(run: CampaignFolder, result: dict[str, Any]) -> tuple[str, str]:
        """How a run that does not run ended: a word, and the code of what stopped it."""
        if not run.journal.is_file():
            return "imported", ""
        if result.get("refused"):
            return "refused", str(result["refused"])
        if result.get("cut_off"):
            return "interrupted", ""
        stopped = result.get("stopped_by")
        return ("stopped", str(stopped)) if stopped else ("finished", "")


def _live_folder(run: CampaignFolder) -> Path | None:
    """Of a campaign that runs; None where it does not."""
    live = str(read_json(run.live_link).get("folder", ""))
    return Path(live) if live and held(Path(live) / LOCK) else None


def verdict_before_report(live: Path) -> dict[str, str]:
    """Verdict on the specimen before the report is written: `verdict`, `reason`; empty until it is known.

    Args:
        live: its live folder.
    """
    ended = read_json(live / STATE).get("ended") or {}
    specimen = ended.get("specimen") or {}
    complete = ended.get("valid") == ended.get("total") and ended.get("rig_state") == "safe"
    known = complete and not ended.get("stopped_by") and specimen.get("verdict") in TITLES
    return {name: str(specimen.get(name, "")) for name in ("verdict", "reason")} if known else {}


def _midnight() -> datetime:
    """Beginning of the local day (UTC)."""
    return utc_now().astimezone().replace(hour=0, minute=0, second=0, microsecond=0)


def _counters(tested: list[TestedSpecimen]) -> dict[str, Any]:
    """Number of specimens by last verdict, and the takt: time from the start of a campaign to its verdict (s)."""
    takts_s = [one.cycle_s for one in tested if one.verdict in TESTED]
    return {
        **counts((one.serial_number, one.verdict) for one in tested),
        "takt_last_s": takts_s[-1] if takts_s else None,
        "takt_mean_s": math.fsum(takts_s) / len(takts_s) if takts_s else None,
    }


def _sentences(lines: object) -> str:
    """Lines in one, each with its end."""
    texts = [str(line).strip() for line in lines] if isinstance(lines, list) else []
    return " ".join(text if text[-1] in ".!?:;" else f"{text}." for text in texts if text)[:LONGEST_TEXT]


def _text(value: object, most: int) -> str:
    return "".join(sign for sign in str(value or "")[:most] if sign.isprintable())


def _is_own(file: Path) -> bool:
    return file.is_file() and not file.is_symlink()


def _has_pdf(run: CampaignFolder) -> bool:
    """Whether there is a PDF that is not older than the report, which a later fit writes again."""
    try:
        return _is_own(run.report_pdf) and run.report_pdf.stat().st_mtime_ns >= run.report.stat().st_mtime_ns
    except OSError:
        return False


def _has_files(points: Path) -> bool:
    try:
        with os.scandir(points) as entries:
            return any(entry.name.endswith(".h5") for entry in entries)
    except OSError:
        return False
