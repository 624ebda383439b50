"""What an operator does at a bench before, between and after runs: choose a matrix, read its plan, start, resume.

This module never owns a run. It starts `rig run` as if it were typed, and finds whatever runs on the bench by its live
folder: started here, by an earlier page, or in a terminal. Whether anything moves is decided by `rig run` and the
station alone, with all their checks; this module adds what a person at a page must have seen before:

- a plan: `rig run` is given the digest of the files that it was made of, and refuses others (`plan-changed`);
- the stops to be confirmed before a run is resumed: `rig run` is given their codes, and refuses others
  (`stops-changed`).
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

from drivers.prepared import Prepared
from drivers.processes import own_program
from protocols.patterns import Pattern
from rig.campaign_folder import IDENTIFIER, IDENTIFIER_TEXT, CampaignFolder
from rig.clock import monotonic_ns, utc_now
from rig.page.commands import WORDS, one_line
from rig.page.history import History, verdict_before_report
from rig.page.matrices import LONGEST_NAME, Matrices
from rig.page.started_run import StartedRun
from rig.page.watched_run import WatchedRun
from rig.recording.tested_specimens import tested_before
from rig.station.live_folder import (
    APPLICATION_SOCKET,
    DEVICES,
    STATION_SOCKET,
    read_json,
    running_folders,
    send_message,
)

LOOK_EVERY_NS = 1_000_000_000
HISTORY_EVERY_NS = 10_000_000_000
ANSWER_S = 180.0
MOST_WAITING = 6
"""Requests of all browsers together, the one that is processed among them."""
SERIAL_NUMBER = re.compile(IDENTIFIER)
LONGEST_REQUALIFIED = 500
DIGEST = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Bench:
    """The bench of a page.

    Attributes:
        path: its file.
        name: as in the file.
        devices: names of its devices, by which its runs are recognised; unused for a simulated rig.
        matrices: folder of the matrix files.
        out: folder of the runs.
        simulate: runs are on a simulated rig with the bench's devices.
        speed: of that rig.
        state: folder of what is kept for the page of this bench.
    """

    path: Path
    name: str
    devices: frozenset[str]
    matrices: Path
    out: Path
    state: Path
    simulate: bool = False
    speed: float = 1.0

    def owns(self, rig: Mapping[str, Any]) -> bool:
        """Whether a campaign with this `devices.json` runs on this bench."""
        devices = rig.get("devices")
        named = {str(device) for device in devices} if isinstance(devices, list) else set()
        if self.simulate:
            return not named and rig.get("out") == str(self.out)
        return not self.devices.isdisjoint(named)


class Phase(StrEnum):
    """What a page of the bench says of it."""

    IDLE = "idle"
    STARTING = "starting"
    RUNNING = "running"
    EVALUATING = "evaluating"


def phase(*, live: bool, ended: bool, begun: bool, lives: bool, settled: bool) -> Phase:
    """The phase of a bench, which goes from one to the next in their order and back to idle alone.

    Args:
        live: a campaign runs, or is being evaluated.
        ended: its motion has ended.
        begun: a campaign was seen since the last start, or since the bench was idle.
        lives: what was started here has not ended, or waits to be started.
        settled: how the last run ended is known, and in the history.
    """
    if live:
        return Phase.EVALUATING if ended else Phase.RUNNING
    if settled and not lives:
        return Phase.IDLE
    return Phase.EVALUATING if begun else Phase.STARTING


class Refusal(Exception):
    """Why something is not done: a code, and words for the operator."""

    def __init__(self, slug: str, text: str) -> None:
        super().__init__(text)
        self.slug = slug


@dataclass(frozen=True)
class Requester:
    """The operator who sends a request.

    Attributes:
        by: the operator's name, for the run's files.
        may_start: whether this browser has control now.
        stopped: whether Stop was pressed since this was asked.
    """

    by: str
    may_start: Callable[[], bool]
    stopped: Callable[[], bool] = lambda: False


class BenchControl:
    """Control of one bench from its page.

    Args:
        bench: the bench.
        now_ns: monotonic time.
        place: where live folders are; by default shared memory.
    """

    def __init__(self, bench: Bench, now_ns: Any = monotonic_ns, place: Path | None = None) -> None:  # noqa: ANN401 - a clock
        self.bench = bench
        self.matrices = Matrices(bench.matrices)
        self.history = History(bench.out, simulated=bench.simulate)
        self.watched = WatchedRun(None)
        self.started = StartedRun.last(bench.state)
        self.outcome: dict[str, Any] = {}
        self._now_ns = now_ns
        self._place = place
        self._looked_ns = -LOOK_EVERY_NS
        self._listed_ns: int | None = None
        self._history_ns = self._now_ns()
        self._listing = asyncio.Lock()
        self._plans: dict[str, dict[str, Any]] = {}
        self._asking = asyncio.Lock()
        self._waiting = 0
        self._was: tuple[Path | None, bool, bool] = None, False, False
        self._changed = False
        self._begun = False
        self._settled = True
        self._pending: list[dict[str, str]] = []
        self._stops = 0
        self._stopped_by = ""
        self._prepared = Prepared("rig.cli.prepared_run", ("--simulate",) if bench.simulate else (), "rig run")
        self._in_line = False
        if self.started is not None and not self.started.lives:
            self.outcome = self.started.outcome()

    # What runs

    @property
    def live_folder(self) -> Path | None:
        """Of the campaign that runs on this bench; None: none does."""
        return self.watched.live_folder

    @property
    def starting(self) -> bool:
        """Something was started here and has not ended, whether its campaign is there yet or not."""
        return self.started is not None and self.started.lives

    @property
    def idle(self) -> bool:
        """Nothing runs, and nothing that was started here has yet to end."""
        return self.live_folder is None and not self.starting and not self._pending

    def settle(self) -> None:
        """The history has been read since the bench became idle."""
        if self.idle:
            self._settled, self._begun = True, False

    @property
    def phase(self) -> Phase:
        """What happens on the bench now."""
        live = self.live_folder
        if live is not None:
            self._begun, self._settled = True, False
        ended = live is not None and bool(self.watched.state().get("ended"))
        lives = self.starting or bool(self._pending) or (self.started is not None and not self.outcome)
        return phase(live=live is not None, ended=ended, begun=self._begun, lives=lives, settled=self._settled)

    def cancel(self, by: str) -> bool:
        """Stop what is being started and has no live folder yet; False where nothing is."""
        self._stops += 1
        interrupted = self.started is not None and not self._begun and self.started.interrupt()
        if interrupted:
            self._stopped_by = by  # also told to the campaign, should it begin all the same
        return interrupted or bool(self._pending)

    def look(self) -> bool:
        """Find what runs, about once a second; True where this has changed since the last call that returned it."""
        now_ns = self._now_ns()
        if now_ns - self._looked_ns >= LOOK_EVERY_NS:
            self._look(now_ns)
        changed, self._changed = self._changed, False
        return changed

    def _look(self, now_ns: int) -> None:
        self._looked_ns = now_ns
        if self.started is not None and not self.outcome and not self.started.lives:
            self.outcome = self._outcome(self.started)
            if self._in_line:  # the next specimen is mounted meanwhile
                self._prepared.prepare()
        live = self.live_folder
        if live is None and (live := self._found()) is not None:
            self.watched.close()
            self.watched = WatchedRun(None, live)
        decided = live is not None and bool(verdict_before_report(live))
        was, self._was = self._was, (live, self.starting, decided)
        self._changed = self._changed or was != self._was or (not self._settled and self.idle)
        if live is not None:
            self._begun, self._settled = True, False
            self._stop_late(live)
            self._send_words(live)

    def _outcome(self, started: StartedRun) -> dict[str, Any]:
        """How what was started ended; a start that was stopped before its campaign began is no failure."""
        outcome = started.outcome()
        if not self._stopped_by or self._begun or outcome["campaign"]:
            return outcome
        text = f"{started.title}: stopped by {self._stopped_by} before the rig was connected."
        return {**outcome, "refused": "operator", "text": text, "broken": False, "stopped": True}

    def _stop_late(self, live: Path) -> None:
        """A stop of a start reaches the campaign that has begun meanwhile, as any other stop does."""
        if self._stopped_by:
            message, self._stopped_by = {"do": "stop", "by": self._stopped_by}, ""
            send_message(live / STATION_SOCKET, message)
            send_message(live / APPLICATION_SOCKET, message)

    def _found(self) -> Path | None:
        """The live folder of a campaign on this bench; of several the newest."""
        own = [folder for folder in running_folders(self._place) if self.bench.owns(read_json(folder / DEVICES))]
        return own[-1] if own else None

    def _send_words(self, live: Path) -> None:
        """What the operator entered before the start goes into the files of the run, once, by its application."""
        started = self.started
        if started is None or not started.words or not started.lives or not self.watched.run:
            return
        if read_json(CampaignFolder(self.watched.run).live_link).get("pid") != started.pid:
            return  # this run was started in a terminal meanwhile
        if send_message(live / APPLICATION_SOCKET, {"do": "words", "by": started.by, **started.words}):
            self.started = replace(started, words={})
            self.started.keep()

    def finished(self, name: str) -> WatchedRun | None:
        """A listed run for the browser that shows it; None if it is not listed or the rig is in use.

        While a run is in progress, every browser shows it.
        """
        run = self.history.entry(name)
        return WatchedRun(self.bench.out / str(run["name"])) if run is not None and self.idle else None

    def show_newest(self) -> None:
        """Watch the newest run where none is watched yet."""
        newest = self.history.newest()
        if self.watched.run is None and newest is not None and self.live_folder is None:
            self.watched = WatchedRun(newest)

    def status(self) -> dict[str, Any]:
        """What a bench's page shows above its lists."""
        run, started = self.watched.run, self.started
        listed, note = self.matrices.listing
        phase = self.phase
        live = phase in {Phase.RUNNING, Phase.EVALUATING} and self.live_folder is not None
        begun = None if started is None else {"by": started.by, "title": started.title, "utc": started.utc}
        return {
            "type": "bench", "bench": self.bench.name, "file": self.bench.path.name, "simulate": self.bench.simulate,
            "speed": self.bench.speed, "folder": str(self.bench.matrices), "out": str(self.bench.out),
            "matrices": listed, "matrices_note": note, "running": live, "run": "" if run is None else run.name,
            "phase": str(phase), "starting": phase is Phase.STARTING,
            "started": self._pending[-1] if self._pending else begun,
            "outcome": self.outcome if phase is Phase.IDLE else {},
        }  # fmt: skip

    @property
    def matrices_due(self) -> bool:
        """Whether to read the folder of matrix files: once, then about once per second while no run is in progress."""
        if self._listing.locked():
            return False
        return self._listed_ns is None or (self._now_ns() - self._listed_ns >= LOOK_EVERY_NS and self.idle)

    def history_due(self) -> bool:
        """Whether to read the folder of runs again, about every 10 s while no run is in progress.

        Other programs write imported runs and reports there.
        """
        now_ns = self._now_ns()
        due = self.idle and now_ns - self._history_ns >= HISTORY_EVERY_NS
        if due:
            self._history_ns = now_ns
        return due

    async def list_matrices(self) -> None:
        """Read the folder of matrix files; a Stop does not wait for this."""
        async with self._listing:
            await asyncio.to_thread(self.matrices.look)
            self._listed_ns = self._now_ns()

    # What is asked of it

    async def answer(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        """Answer to one of `plan`, `questions`, `prepare`, `begin`, `resume`, `make-report`.

        Requests are answered one at a time, and few may wait, because the rig needs the processor. `of` names the
            matrix or run.
        """
        do = str(message["do"])
        reply = {"do": do, "of": one_line(message.get("matrix", message.get("run")), LONGEST_NAME)}
        answers = {
            "plan": self._plan, "questions": self._questions, "begin": self._begin, "resume": self._resume,
            "make-report": self._make_report, "prepare": self._prepare,
        }  # fmt: skip
        if self._waiting >= MOST_WAITING:
            return {**reply, "refused": "page-busy", "text": "Too many requests are waiting. Try again in a moment."}
        self._waiting += 1
        starts, stops = do in {"begin", "resume"}, self._stops
        requester = replace(requester, stopped=lambda: self._stops != stops)
        try:
            async with self._asking:
                try:
                    if starts:
                        self._announce(do, str(reply["of"]), requester)
                    return {**reply, **await answers[do](message, requester)}
                finally:
                    self._pending.clear()
        except Refusal as refusal:
            return {**reply, "refused": refusal.slug, "text": str(refusal)}
        finally:
            self._waiting -= 1

    def _announce(self, do: str, name: str, requester: Requester) -> None:
        """Show a start that is being checked; not where it will be refused because the rig is in use."""
        self._idle()
        title = f"resumed {name}" if do == "resume" else name
        self._pending.append({"by": requester.by, "title": title, "utc": utc_now().isoformat(timespec="seconds")})

    def _idle(self) -> None:
        """Refuse what must not be done while the rig is in use.

        Raises:
            Refusal: a run is in progress, starting, or being evaluated.
        """
        self._look(self._now_ns())
        if self.live_folder is not None:
            ended = self.watched.state().get("ended")
            run = "" if self.watched.run is None else self.watched.run.name
            if ended:
                raise Refusal("still-analysing", f"The report of {run} is being written. Try again in a moment.")
            raise Refusal("already-running", f"A run is in progress on this bench: {run or 'starting'}.")
        if self.starting and self.started is not None:
            if self._begun:  # its campaign has ended, its process has not
                raise Refusal("still-analysing", f"{self.started.title}: the run has ended and is still being "
                              "evaluated. Try again in a moment.")  # fmt: skip
            raise Refusal("already-running", f"{self.started.by} is starting a run: {self.started.title}.")

    async def _plan(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        del requester
        self._idle()
        await self.list_matrices()
        name = message.get("matrix")
        path = self._matrix(name)
        answer = await self._ask({"do": "plan", "matrix": str(path), "bench": str(self.bench.path)})
        line = answer.get("line")
        self._plans[str(name)] = {"planned": answer["planned"], "feasible": answer["feasible"], "line": line}
        if not self.bench.simulate:
            self.bench = replace(self.bench, devices=frozenset(map(str, answer["devices"])))
        return {"ok": True, "matrix": str(name), "line": line, **{key: answer[key] for key in (
            "planned", "feasible", "serial_number", "blocks"
        )}}  # fmt: skip

    def _matrix(self, name: object) -> Path:
        path = self.matrices.path(name)
        if path is None:
            raise Refusal("unknown-matrix", "This matrix file is no longer in the folder. Choose another one.")
        return path

    async def _prepare(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        """Load the first run of the production view, which has been opened; no device is opened and nothing starts."""
        del message, requester
        if self.idle:
            self._prepared.prepare()
        return {"ok": True}

    async def _begin(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        self._idle()
        name = str(message.get("matrix"))
        path, planned = self._matrix(name), str(message.get("planned"))
        known = self._plans.get(name)
        if known is None or known["planned"] != planned or not DIGEST.fullmatch(planned):
            raise Refusal("not-planned", "This plan is out of date. Read the new plan, then start.")
        if not known["feasible"]:
            raise Refusal("matrix-infeasible", "The plan contains points outside the limits of the bench.")
        serial_number = str(message.get("serial_number", "")).strip()
        if not SERIAL_NUMBER.fullmatch(serial_number):
            raise Refusal("bad-serial-number", f"Serial number: expected {IDENTIFIER_TEXT}.")
        if message.get("line"):
            self._next_of_line(known["line"], serial_number, message)
        rig = ("--simulate", f"--speed={self.bench.speed:g}") if self.bench.simulate else ()
        arguments = (
            str(path), f"--bench={self.bench.path}", *rig, f"--planned={planned}", f"--serial-number={serial_number}",
            f"--out={self.bench.out}",
        )  # fmt: skip
        self._start(arguments, requester, f"{name}, specimen {serial_number}", message)
        self._in_line = bool(message.get("line"))
        return {"ok": True}

    def _next_of_line(self, line: Mapping[str, str] | None, serial_number: str, message: Mapping[str, Any]) -> None:
        """Refuse a specimen that a production line does not test, or not now.

        Raises:
            Refusal: no bands, another serial number, tested before, or a stop that the operator has not confirmed.
        """
        if line is None:
            raise Refusal("no-bands", "This matrix has no acceptance bands ([acceptance]), so the production view "
                          "cannot show a verdict.")  # fmt: skip
        if line["serial"] and not Pattern(line["serial"]).fullmatch(serial_number):
            raise Refusal("bad-serial-number", f"{serial_number}: not a serial number of this line; expected "
                          f"{line['serial']} ([line] serial in the matrix file). Scan the code on the specimen.")
        last = self.history.runs[0] if self.history.runs else None
        if last is not None and message.get("after") != last["name"] and (
            last["ended"] in {"stopped", "interrupted"} or last["rig_state"] == "unknown"
        ):
            why = last["text"] or last["ended"]
            raise Refusal("line-stopped", f"The test of {last['specimen']} was stopped: {why} Inspect the rig, then "
                          "press Continue.")  # fmt: skip
        earlier = [] if message.get("retest") is True else self.history.tested.of(serial_number)
        if before := tested_before(earlier, line["retest"], utc_now()):
            raise Refusal("tested-before", f"{before}. To test it again, press Retest.")

    async def _questions(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        del requester
        self._idle()
        run = self._resumable(message.get("run"))
        answer = await self._ask({"do": "questions", "run": str(self.bench.out / run["name"])})
        return {"ok": True, "run": run["name"], **{key: answer[key] for key in ("stops", "requalify", "left_out")},
                "left": run["left"], "total": run["total"], "specimen": run["specimen"]}  # fmt: skip

    def _resumable(self, name: object) -> dict[str, Any]:
        run = self.history.entry(name)
        if run is None:
            raise Refusal("unknown-run", "This run is not in the list.")
        if not run["own"]:
            other = "the simulated rig" if run["simulated"] else "hardware"
            raise Refusal("another-rig", f"This run was recorded on {other}; this page operates a different rig.")
        if not run["resumable"]:
            raise Refusal("nothing-left", "This run has no points left to run.")
        return run

    async def _resume(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        self._idle()
        run = self._resumable(message.get("run"))
        name = str(run["name"])
        asked = await self._ask({"do": "questions", "run": str(self.bench.out / name)})
        given = message.get("confirmed")
        confirmed = {str(slug) for slug in given} if isinstance(given, list) else set()
        missing = [str(stop["slug"]) for stop in asked["stops"] if stop["slug"] not in confirmed]
        if missing:
            raise Refusal("not-confirmed", f"First confirm that you have checked the following: {', '.join(missing)}.")
        requalified = one_line(message.get("requalified"), LONGEST_REQUALIFIED)
        if asked["requalify"] and not requalified:
            raise Refusal("requalify", "State what was checked or replaced (1 to 500 characters).")
        self._idle()  # another browser may have started something meanwhile
        arguments = (
            f"--resume={self.bench.out / name}", f"--confirmed={','.join(str(one['slug']) for one in asked['stops'])}",
            *(() if self.bench.simulate else (f"--bench={self.bench.path}",)),
            *((f"--requalified={requalified}",) if requalified else ()),
        )  # fmt: skip
        self._start(arguments, requester, f"resumed {name}", message)
        return {"ok": True}

    async def _make_report(self, message: Mapping[str, Any], requester: Requester) -> dict[str, Any]:
        del requester
        self._idle()
        run = self.history.entry(message.get("run"))
        if run is None or not run["recorded"]:
            raise Refusal("unknown-run", "This run has no recorded points.")
        pdf = message.get("pdf") is True
        await self._ask({"do": "report", "run": str(self.bench.out / run["name"]), "pdf": pdf})
        return {"ok": True, "run": run["name"], "pdf": pdf}

    def _start(self, arguments: tuple[str, ...], requester: Requester, title: str, message: Mapping[str, Any]) -> None:
        """Start `rig run`; everything since the last look at what runs is done without waiting.

        Raises:
            Refusal: it cannot be started, or control was lost while the request waited.
        """
        if not requester.may_start():
            raise Refusal("no-lease", "Take control first.")
        if requester.stopped():
            raise Refusal("operator", "Stop was pressed: nothing was started.")
        by = requester.by
        texts = {key: one_line(message.get(key), WORDS[key]) for key in ("specimen", "note")}
        words = {"operator": by, **{key: text for key, text in texts.items() if text}}
        utc = utc_now().isoformat(timespec="seconds")
        try:
            self.started = StartedRun.start(
                self.bench.state, (*arguments, "--operated", "--json"), by=by, title=title, utc=utc, words=words,
                prepared=self._prepared,
            )
        except OSError as error:
            raise Refusal("not-started", f"`rig run` cannot be started: {error.strerror or error}") from error
        self.outcome, self._stopped_by, self._begun, self._settled = {}, "", False, False

    async def _ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The answer of `rig.cli.page_answers`, a process of its own.

        Raises:
            Refusal: it refuses, or does not answer.
        """
        try:
            process = await asyncio.create_subprocess_exec(
                *own_program("rig.cli.page_answers"), stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL, start_new_session=True,
            )
        except OSError as error:
            raise Refusal("page-no-answer", f"The files cannot be evaluated: {error.strerror or error}.") from error
        answer: Any = None
        try:
            async with asyncio.timeout(ANSWER_S):
                output, _ = await process.communicate(json.dumps(request).encode())
            with contextlib.suppress(ValueError, RecursionError):
                answer = json.loads(output)
        except TimeoutError:
            pass
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        if not isinstance(answer, dict):
            raise Refusal("page-no-answer", "The files could not be evaluated. Try the command in a terminal: "
                          "`rig plan` or `rig run --resume`.")
        if "refused" in answer:
            raise Refusal(str(answer["refused"]), str(answer.get("text", "")))
        return answer
