"""The recorder: from the station's ring to the running point's journal, on a separate thread.

The thread runs as long as the campaign, advances its cursor in the ring (which the station monitors), and writes while
a point is open. A failed write makes it unhealthy, which it reports; it never drops data silently.
"""

from __future__ import annotations

import threading
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path

from drivers.clock import back_whenever, back_within
from rig.recording.journal.journal_file import JournalWriter
from rig.recording.journal.ring_reader import RingReader
from rig.recording.layout import PointContext
from rig.recording.point_files import JOURNAL, free_out_of_tolerance_name, journal_name
from rig.recording.ring_records import RECORD_DTYPE

WRITE_PERIOD_S = 0.02
JOIN_TIMEOUT_S = 5.0


class RecorderFailed(OSError):
    """The journal cannot be written (disk full, read-only, flush failed); do not trust the point."""


@dataclass(frozen=True)
class PointJournal:
    """A finished point's journal, ready for the finaliser: `lost_records` were overwritten in the ring unread."""

    id: str
    path: Path
    records: int
    lost_records: int


def kept_apart(journal: PointJournal, ids: Collection[str]) -> PointJournal:
    """Give the closed journal of a motion out of tolerance a name of its own, so that the point can be run again.

    Args:
        journal: as `PointRecorder.end` gave it, with a remark `point_names.OUT_OF_TOLERANCE` in it.
        ids: of all points of the campaign.

    Raises:
        OSError: it cannot be renamed.
    """
    point_id, folder = journal_name(journal.path), journal.path.parent
    path = folder / f"{free_out_of_tolerance_name(folder, point_id, ids)}{JOURNAL}"
    journal.path.rename(path)
    return replace(journal, id=journal_name(path), path=path)


class PointRecorder:
    """Records one point after the other.

    Args:
        ring_path: the station's ring.
        folder: where journals go: `points/` of the campaign.

    Raises:
        RingProblem: the ring cannot be read.
    """

    def __init__(self, ring_path: Path, folder: Path) -> None:
        self.folder = folder
        self._ring = RingReader(ring_path, recorder=True)
        self._lock = threading.Lock()
        self._journal: JournalWriter | None = None
        self._id = ""
        self._lost_before = 0
        self._error: OSError | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def healthy(self) -> bool:
        """False once something could not be written or the thread has ended."""
        return self._error is None and self._thread.is_alive()

    @property
    def failure(self) -> OSError | None:
        """What the disk refused; None while it refuses nothing."""
        return self._error

    @property
    def error(self) -> str:
        """Why the recorder is not healthy; empty while it is."""
        if self._error is not None:
            return str(self._error)
        return "" if self._thread.is_alive() else "the recorder thread has stopped"

    def begin(self, context: PointContext, *, expected_s: float = 0.0) -> Path:
        """Open the journal of the point in `context` and record from here on.

        Args:
            context: the journal's header; `context.point.id` names the file.
            expected_s: wall time the point will take; so much room is taken on the disk beforehand.

        Returns:
            The journal's path.

        Raises:
            RecorderFailed: there is no room for the point, or the folder cannot be written.
            RuntimeError: the point before was not ended.
        """
        if self._journal is not None:
            raise RuntimeError(f"point {self._id} is still being recorded. Fix: call end() first")
        self._id = context.point.id
        path = self.folder / f"{self._id}{JOURNAL}"
        try:
            journal = JournalWriter(path, context.to_json(), reserve_bytes=self._room(context, expected_s))
        except OSError as error:
            raise RecorderFailed(f"{path}: cannot record point {self._id}: {error}") from error
        with self._lock:
            self._ring.skip_to_newest()
            self._lost_before = self._ring.lost
            self._journal = journal
        return path

    @staticmethod
    def _room(context: PointContext, expected_s: float) -> int:
        rate_Hz = sum(sensor.rate_Hz for sensor in context.sensors.values()) * context.device_rate
        status_Hz = 20 * (100.0 + 100.0 * context.device_rate)
        return int(1.2 * expected_s * (rate_Hz + status_Hz) * RECORD_DTYPE.itemsize)

    def note(self, code: str, text: str, time_ns: int) -> None:
        """Put an event into the running point's journal (`time_ns` host monotonic); nothing while no point runs."""
        with self._lock:
            if self._journal is not None and self._error is None:
                try:
                    self._journal.event(time_ns, code, text)
                except OSError as error:
                    self._error = error

    def end(self, stopped_by: str | None = None) -> PointJournal:
        """Write what has arrived, close the journal and hand it over.

        Args:
            stopped_by: slug of the trip or stop that ended the point early; None when it ran to its end.

        Raises:
            RecorderFailed: something of this point could not be written; the journal keeps what could be.
            RuntimeError: no point is being recorded.
        """
        with self._lock:
            if self._journal is None:
                raise RuntimeError("no point is being recorded. Fix: call begin() first")
            self._drain()
            journal, self._journal = self._journal, None
            lost = self._ring.lost - self._lost_before
            failed = self._error
            try:
                journal.close(stopped_by=stopped_by, lost_records=lost)
            except OSError as error:
                failed = self._error = failed or error
        if failed is not None:
            raise RecorderFailed(f"{journal.path}: point {self._id} was not recorded completely: {failed}") from failed
        return PointJournal(self._id, journal.path, journal.records, lost)

    def close(self) -> None:
        """End the thread; a point still open is closed as interrupted, and what the disk refuses of it is `failure`."""
        self._stop.set()
        self._thread.join(JOIN_TIMEOUT_S)
        with self._lock:
            if self._journal is not None:
                self._drain()
                journal, self._journal = self._journal, None
                try:
                    journal.close(stopped_by="interrupted", lost_records=self._ring.lost - self._lost_before)
                except OSError as error:
                    self._error = self._error or error
            self._ring.close()

    def _work(self) -> None:
        while not self._waited():
            with self._lock:
                self._drain()
        back_whenever()

    def _waited(self) -> bool:
        """Wait for the next look at the ring; True once there is none."""
        back_within(WRITE_PERIOD_S)
        return self._stop.wait(WRITE_PERIOD_S)

    def _drain(self) -> None:
        """Take what the ring holds; an open journal gets it, unless an earlier write failed."""
        records = self._ring.read()
        if len(records) and self._journal is not None and self._error is None:
            try:
                self._journal.append(records)
            except OSError as error:
                self._error = error
