"""What worlds are asked for: which seeds, the user's files, what happens; refused before any world begins."""

from __future__ import annotations

import math
import re
import shlex
import tempfile
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import click

from rig.bench.model import Bench
from rig.campaign.setup import accepted
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix, load_files, load_matrix
from rig.matrix.named_files import named, with_whole_names
from rig.text_file import read_text
from simulators.bench import Addresses, bench_text
from simulators.injection import NEEDS_AUXILIARY
from simulators.options import RigOptions
from simulators.scenarios.plan import (
    AT_THE_PANEL,
    STALLS,
    STREAMED_TICK_S,
    FaultEvent,
    Given,
    ScenarioPlan,
    drawn,
    given_for,
    happens_to_supply,
    happens_unmeasured,
)
from simulators.scenarios.user_bench import LARGEST_BENCH, UserBench, longest_s
from simulators.schedule import BY_ID, ONLY_BY_SUPPLY, ONLY_ON, STREAMED

LARGEST_MATRIX = 1 << 20
LATEST_S = 1e6
LASTS = (*STALLS, "pause", "slow-disk")
"""What happens around the devices for a time: in no time nothing of it does."""
NOTHING = "nothing"
"""In place of what happens: an undisturbed world."""
_SEEDS = re.compile(r"(\d{1,15})(?::(\d{1,15}))?", re.ASCII)


@dataclass(frozen=True)
class Files:
    """The user's files; None where what the seed draws, or the usual rig, takes their place."""

    matrix: Path | None = None
    bench: Path | None = None

    @property
    def options(self) -> list[str]:
        """As they are given on the command line."""
        given = (("--bench", self.bench), ("--matrix", self.matrix))
        return [word for name, path in given if path is not None for word in (name, str(path))]


@dataclass(frozen=True)
class ScenarioRequest:
    """What is the same for all worlds of a command.

    Attributes:
        given: the user's files and what follows from them.
        files: the user's.
        events: in place of what is drawn; None: drawn.
        until_s: when each world ends; None: with its campaign.
        options: of the command, as they are written to get one of these worlds again.
        substitutes: what of the user's bench a world has otherwise.
    """

    given: Given = field(default_factory=Given)
    files: Files = field(default_factory=Files)
    events: tuple[FaultEvent, ...] | None = None
    until_s: float | None = None
    options: tuple[str, ...] = ()
    substitutes: tuple[str, ...] = ()

    @property
    def named_files(self) -> tuple[Path, ...]:
        """Files named in the user's matrix, which every scenario reads."""
        names = named(tomllib.loads(self.given.matrix)).values()
        return tuple(Path(name) for several in names for name in several)

    def plan(self, seed: int) -> ScenarioPlan:
        """The world of a seed, with what was asked for in place of what is drawn."""
        if self.events is None:
            return drawn(seed, self.given)
        given, link = given_for(seed, self.given), _link(self.events)
        if given.kind and not all(given.may_have(item.what, given.actuator or link) for item in self.events):
            given = replace(self.given, usual=True)
        plan = drawn(seed, given)
        return replace(plan, events=self.events, actuator=given.actuator or link or plan.actuator)

    def again(self, seed: int) -> str:
        """The command that runs the world of a seed again."""
        return shlex.join(("rig", "scenarios", "--seeds", str(seed), *self.options))


def seeds_of(text: str) -> range:
    """`FIRST:END` (END itself is not among them), or one seed.

    Raises:
        BadParameter: not such a range.
    """
    match = _SEEDS.fullmatch(text)
    if match is None:
        raise click.BadParameter(
            f"{text!r}: expected FIRST:END with 0 <= FIRST < END, such as 0:1000, or a single seed",
            param_hint="--seeds",
        )
    first = int(match[1])
    end = first + 1 if match[2] is None else int(match[2])
    if end == first:
        raise click.BadParameter(f"{text!r}: the range is empty because END is excluded. Fix: write "
            f"{first}:{first + 1}",
                                 param_hint="--seeds")  # fmt: skip
    if end < first:
        raise click.BadParameter(f"{text!r}: FIRST is greater than END. Fix: write {end}:{first}", param_hint="--seeds")
    return range(first, end)


def request_for(files: Files, texts: Iterable[str], until_s: float | None, actuator: str = "") -> ScenarioRequest:
    """Read and judge the user's files and words.

    Args:
        files: the user's.
        texts: in place of what is drawn; none: drawn.
        until_s: when each world ends; None: with its campaign.
        actuator: "tcp" or "rtu"; empty: as the bench says, else drawn.

    Raises:
        BadParameter: a happening or time that is none, or another link than the bench's.
        FileProblem: a file cannot be used, or no simulated rig can stand in for the bench.
        Refused: the matrix does not fit the bench.
    """
    if until_s is not None and not (math.isfinite(until_s) and until_s > 0.0):
        raise click.BadParameter(f"{until_s:g}: expected a number of seconds above 0", param_hint="--until")
    words = tuple(texts)
    events = () if words == (NOTHING,) else tuple(map(_event, words))
    given, substitutes = _given(files)
    if actuator and given.actuator not in {"", actuator}:
        raise click.BadParameter("this bench is connected to the controller over "
            f"{given.actuator}", param_hint="--actuator")
    given = replace(given, actuator=given.actuator or actuator)
    _check_events(events, given)
    options = [*files.options, *(word for text in words for word in ("--event", text))]
    if actuator:
        options += ["--actuator", actuator]
    if until_s is not None:
        options += ["--until", repr(until_s)]
    return ScenarioRequest(given, files, events if words else None, until_s, tuple(options), substitutes)


def _event(text: str) -> FaultEvent:
    try:
        event = FaultEvent.parse(text)
    except FileProblem as error:
        raise click.BadParameter("; ".join(error.problems), param_hint="--event") from None
    times_s = [time_s for time_s in (event.at_s, event.lasts_s) if time_s is not None]
    if not all(0.0 <= time_s <= LATEST_S for time_s in times_s):
        raise click.BadParameter(f"{text!r}: times must be from 0 to {LATEST_S:g} s", param_hint="--event")
    what, lasts_s = event.what, event.lasts_s
    if what in LASTS and not lasts_s:
        example = f"{what}@{event.at_s:g}+0.5"
        raise click.BadParameter(f"{text!r}: a duration is required, such as {example}", param_hint="--event")
    if event.around and lasts_s is not None and what not in (*LASTS, "clock-step"):
        words = f"{text!r}: this event has no duration. Fix: write {what}@{event.at_s:g}"
        raise click.BadParameter(words, param_hint="--event")
    return event


def _check_events(events: tuple[FaultEvent, ...], given: Given) -> None:
    """Refuse what cannot happen on this rig.

    Raises:
        BadParameter: with what to do.
    """
    links = {ONLY_ON.get(event.what.partition(":")[0], "") for event in events} - {""}
    link = given.actuator or _link(events)
    for event in events:
        slug = event.what.partition(":")[0]
        needed = ONLY_ON.get(slug)
        problem = ""
        if needed == BY_ID:
            problem = "named ports do not exist in a scenario; use `rig simulate --ports by-id`"
        elif given.streamed and event.what in AT_THE_PANEL:
            problem = "requires a controller with a function generator; this bench streams set-points"
        elif needed is not None and needed != link and not (needed == STREAMED and given.streamed):
            has = "a controller cannot have both connections" if len(links) > 1 else (
                f"this bench is connected over {link}"
            )
            problem = f"requires a controller connected over {needed}; {has}"
        elif given.supply and not happens_to_supply(event.what):
            problem = (
                "does not occur with a power supply as the current source: there is no bus, and the supply's current "
                "continues without the host"
            )
        elif event.what in ONLY_BY_SUPPLY and not given.supply:
            problem = "requires a power supply as the current source. Fix: use --bench with a bench that has one"
        elif given.unmeasured and not happens_unmeasured(event.what):
            problem = "does not occur if the current is not measured"
        elif event.what in NEEDS_AUXILIARY and not given.auxiliary:
            problem = "requires an auxiliary channel. Fix: use --bench with a bench that has one"
        if problem:
            raise click.BadParameter(f"{event.what!r}: {problem}", param_hint="--event")


def _link(events: Iterable[FaultEvent]) -> str:
    """The kind of link that these need; empty where any will do."""
    needed = (ONLY_ON.get(event.what.partition(":")[0], "") for event in events)
    return next((link for link in needed if link), "")


def _given(files: Files) -> tuple[Given, tuple[str, ...]]:
    """What the user's files say, and what of the bench a world has otherwise.

    Raises:
        FileProblem: a file cannot be used, or no simulated rig can stand in for the bench.
        Refused: the matrix does not fit the bench.
    """
    if files.bench is None:
        return (Given(), ()) if files.matrix is None else (_on_the_usual_rig(files.matrix), ())
    text = read_text(files.bench, LARGEST_BENCH)
    if files.matrix is None:
        return _drawn_matrices(files.bench, text)
    matrix, bench = load_files(files.matrix, files.bench)
    user = UserBench.load(files.bench, matrix)
    given = _forecast(matrix, bench, _text_of(files.matrix))
    return _on_bench(given, text, user), user.substitutes


def _drawn_matrices(path: Path, text: str) -> tuple[Given, tuple[str, ...]]:
    """A user's bench with the matrices that seeds draw: the largest of them must fit.

    Raises:
        FileProblem: as `_given`.
        Refused: they do not.
    """
    bench = Bench.load(path)
    with tempfile.TemporaryDirectory(prefix="worlds-") as folder:
        matrix = _loaded(LARGEST_DRAWN, Path(folder) / "matrix.toml")
    user = UserBench.load(path, matrix)
    try:
        accepted(matrix, bench)
    except Refused as error:
        raise Refused(error.slug, f"{path}: randomly drawn matrices do not fit this bench. "
            f"Fix: specify a matrix with --matrix FILE\n{error}") from error  # fmt: skip
    return _on_bench(Given(), text, user), user.substitutes


def _on_bench(given: Given, text: str, user: UserBench) -> Given:
    """The same on a user's bench."""
    auxiliary = bool(user.auxiliaries)
    return replace(
        given, bench=user.portable(text), actuator=user.actuator, auxiliary=auxiliary,
        tick_s=min(user.tick_s, STREAMED_TICK_S if user.streamed else user.tick_s),
        supply=bool(user.supply), unmeasured=user.unmeasured, streamed=user.streamed,
    )


LARGEST_DRAWN = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["sine", "triangle"]
amplitude = ["10 mm"]
frequency = ["4 Hz"]
current = ["1.0 A"]
cycles = 12
"""


def _on_the_usual_rig(path: Path) -> Given:
    """A user's matrix on the usual simulated rig."""
    matrix = load_matrix(path)
    addresses = Addresses("modbus-tcp://127.0.0.1:1", 2, "socket://127.0.0.1:3", "socket://127.0.0.1:4", ())
    with tempfile.TemporaryDirectory(prefix="worlds-") as folder:
        bench = Path(folder) / "bench.toml"
        bench.write_text(bench_text(RigOptions(), addresses, 1.0, relaxed=False), encoding="utf-8")
        return _forecast(matrix, Bench.load(bench), _text_of(path))


def _text_of(path: Path) -> str:
    """A matrix file's text for another folder: the roads and records that it names are whole paths."""
    return with_whole_names(read_text(path, LARGEST_MATRIX), path.parent)


def _loaded(text: str, path: Path) -> Matrix:
    path.write_text(text, encoding="utf-8")
    return load_matrix(path)


def _forecast(matrix: Matrix, bench: Bench, text: str) -> Given:
    """A matrix that fits a bench, and how long it takes.

    Raises:
        Refused: it does not fit; or, where the file does not say which damper it is, the simulated one does not.
    """
    plan = accepted(matrix, bench)
    if matrix.specimen.prior is None:
        stated = matrix.specimen.model_copy(update={"prior": "demo", "max_force_N": None})
        try:
            accepted(matrix.model_copy(update={"specimen": stated}), bench)
        except Refused as error:
            raise Refused(error.slug, "the damper of the simulated rig (set demo) is too "
                "strong for this bench. Fix: specify a weaker damper with "
                f"specimen.prior\n{error}") from error  # fmt: skip
    motion_s = math.fsum(item.duration_s for item in plan.points)
    lasts_s = longest_s(plan.duration_s, motion_s, matrix.campaign.retries)
    return Given(matrix=text, motion_s=motion_s, lasts_s=lasts_s)
