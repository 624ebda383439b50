"""Resuming a campaign that ended early: complete its files, determine the valid points, refuse changed inputs.

A campaign resumes at a point boundary, with its own matrix, specimen and seed, on a rig of the same configuration;
every check of the preflight is repeated. Valid points are kept, all others are repeated.
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from rig.bench.model import Bench
from rig.campaign.confirmation import EarlierStop
from rig.campaign.endurance import EnduranceBook
from rig.campaign.file_copies import kept_hashes
from rig.campaign.point_results import PointResults
from rig.campaign.results import CampaignOptions, PointResult
from rig.campaign.setup import campaign_hash, described
from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem, Refused
from rig.matrix.model import Matrix, load_matrix
from rig.recording.conversion.recovery import recover_held
from rig.recording.hdf5.reading import check_values
from rig.recording.journal.campaign_log import read_log
from rig.recording.journal.journal_lock import campaign_held
from rig.recording.point_files import FILE, OLD_FILE, names_in
from rig.recording.quality.point_quality import LoopQuality, PointQuality
from rig.recording.recorded_point import RecordedPoint
from rig.test_point import ENDURANCE, TestPoint
from rig.verdicts import INVALID, rank

SLOWEST, FASTEST = 0.01, 1000.0
"""Speeds of a simulated rig."""
SET_ASIDE = -1
"""Of files that were set aside: after any other, whatever their verdict."""
NOT_OURS = "the entry does not have the format of campaign files. Fix: repair the file or start a new campaign"


def as_before(folder: Path, options: CampaignOptions) -> CampaignOptions:
    """The options to continue a campaign with: what was not asked for anew is as it was.

    Args:
        folder: the campaign's directory.
        options: as asked for; without `bench_path` and `simulate` the campaign's own rig is used. `speed` and `seed`
            count only for a campaign that was not simulated before.

    Raises:
        FileProblem: the directory holds no campaign that was begun, or its description is damaged.
    """
    before = _simulated(folder)
    if options.bench_path is not None:
        return options
    if before is None:
        return options if options.simulate else replace(options, bench_path=CampaignFolder(folder).bench)
    kept, _ = before.arguments
    return replace(options, simulate=True, seed=before.seed, simulator_args=(*kept, *options.simulator_args))


def left_out(folder: Path) -> tuple[str, ...]:
    """Options of the earlier session's simulated rig that are not given again: faults, and where files went.

    Raises:
        FileProblem: as `as_before`.
    """
    before = _simulated(folder)
    return () if before is None else tuple(dict.fromkeys(before.arguments[1]))


@dataclass(frozen=True)
class _Simulated:
    """How a campaign was simulated; `arguments` are those to give again, and the names of those left out."""

    speed: float
    seed: int
    arguments: tuple[tuple[str, ...], tuple[str, ...]]


def _simulated(folder: Path) -> _Simulated | None:
    """How a campaign was simulated, None where it was not.

    Raises:
        FileProblem: the description holds something else than a simulated rig's options.
    """
    before = described(folder).get("simulated")
    if before is None:
        return None
    try:
        speed, seed, arguments = float(before["speed"]), int(before["seed"]), before.get("arguments", [])
        sorted_out = of_the_rig(arguments)
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise FileProblem(str(CampaignFolder(folder).description), [f"simulated: {error!r}; {NOT_OURS}"]) from error
    if not SLOWEST <= speed <= FASTEST or seed < 0:
        text = f"simulated: speed {speed:g}, seed {seed}; {NOT_OURS}"
        raise FileProblem(str(CampaignFolder(folder).description), [text])
    return _Simulated(speed, seed, sorted_out)


def speed_before(folder: Path) -> float:
    """The speed of the simulated rig a campaign was begun on; 1 for hardware.

    Raises:
        FileProblem: the directory holds no campaign that was begun.
    """
    before = _simulated(folder)
    return 1.0 if before is None else before.speed


def same_matrix(folder: Path, matrix: Matrix) -> None:
    """Refuse another matrix than the campaign's.

    Raises:
        FileProblem: the campaign's description cannot be read.
        Refused: the matrix is not the one the campaign was begun with (slug `matrix-changed`).
    """
    hashes = described(folder).get("hashes", {})
    if hashes.get("matrix") not in {matrix.digest, *matrix.earlier_digests}:
        changed = _changed(folder, hashes.get("files"))
        which = "" if not changed else f": changed {'is' if len(changed) == 1 else 'are'} {', '.join(changed)}"
        raise Refused(
            "matrix-changed",
            f"{CampaignFolder(folder).matrix} is not the matrix with which this campaign was started{which}; no "
            "motion was started. Fix: restore the file, or start a new campaign",
        )


def _changed(folder: Path, files: object) -> list[str]:
    """The kept files that do not hold what they held when the campaign was begun."""
    if not isinstance(files, dict):
        return []
    now = kept_hashes(folder)
    return [str(name) for name, sha256 in files.items() if now.get(name) != sha256]


def same_campaign(folder: Path, bench: Bench, matrix: Matrix) -> None:
    """Refuse to continue with another matrix or on another rig; addresses and time limits may differ.

    Raises:
        FileProblem: the campaign's description cannot be read.
        Refused: the matrix (slug `matrix-changed`) or the rig (`bench-changed`) is not the campaign's.
    """
    same_matrix(folder, matrix)
    hashes = {campaign_hash(bench, matrix, digest) for digest in (matrix.digest, *matrix.earlier_digests)}
    if not bench_is_new(folder) and described(folder).get("hash") not in hashes:
        raise Refused(
            "bench-changed",
            "the bench's limits, calibrations or device identities differ from those in "
            f"{CampaignFolder(folder).bench}; no motion was started. Fix: correct the bench file, or start a new "
            "campaign",
        )


def bench_is_new(folder: Path) -> bool:
    """The campaign was cut off before its rig was known.

    Raises:
        FileProblem: the campaign's description cannot be read.
    """
    return described(folder).get("hash") == ""


@dataclass(frozen=True)
class Stock:
    """What an earlier session left: results to keep, points to run, attempts already made of each point.

    `invalid` is what was recorded of points that are to be run again. `temperatures_degC` are the lowest and highest
    coil temperatures of everything recorded, kept or not; `confirmed` the stops whose repair the operator confirms
    by resuming.
    """

    remaining: tuple[TestPoint, ...]
    results: tuple[PointResult, ...] = ()
    invalid: tuple[PointResult, ...] = ()
    attempts: Mapping[str, int] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    temperatures_degC: tuple[float, ...] = ()
    confirmed: tuple[EarlierStop, ...] = ()

    def books(self, points: tuple[TestPoint, ...]) -> PointResults:
        """The books to go on with; `points` are all of the matrix, in planned order."""
        kept, invalid = ({result.id: result for result in results} for results in (self.results, self.invalid))
        return PointResults(points, kept, invalid)


def take_stock(folder: Path, points: Iterable[TestPoint]) -> Stock:
    """Finish what the earlier session left and sort the matrix's points into kept and remaining.

    A point is kept when one of its files opens and is not invalid: the one with the best verdict, then the latest
    attempt. Of a point that is to be run again the same is told, a record out of tolerance after any attempt, the last
    of several such, and files that were set aside last. The caller holds the campaign.

    Args:
        folder: the campaign's directory.
        points: the matrix's points in order.
    """
    place = CampaignFolder(folder).points
    place.mkdir(exist_ok=True)
    problems = [f"{finished.id}: {finished.error}" for finished in recover_held(folder) if finished.error]
    best: dict[str, tuple[tuple[int, bool, int], RecordedPoint]] = {}
    attempts: dict[str, int] = {}
    temperatures_degC: list[float] = []
    files = [file for ending in (FILE, OLD_FILE) for file in place.glob(f"*{ending}")]
    for file in sorted(files, key=lambda file: (len(file.name), file.name)):  # number 2 before number 10
        aside = file.name.endswith(OLD_FILE)
        try:
            recorded = RecordedPoint.open(file, whole=False)
        except FileProblem as error:  # of one that was set aside it was told then
            problems += [f"{place.name}/{file.name}: {problem}" for problem in error.problems if not aside]
            continue
        name = str(recorded.provenance.get("point", recorded.id))
        try:
            attempt = int(recorded.provenance.get("attempt", 1))
            ends_degC = (recorded.quality.coil_low_degC, recorded.quality.coil_high_degC)
            place_of = SET_ASIDE if aside else rank(recorded.verdict), not recorded.kept_apart, attempt
        except (TypeError, ValueError) as error:
            problems.append(f"{place.name}/{file.name}: the entry does not have the format of campaign files: {error}")
            continue
        attempts[name] = max(attempts.get(name, 0), attempt)
        if damaged := () if aside or recorded.verdict == INVALID else _damage(file):
            problems += [f"{place.name}/{file.name}: {problem}; the point is repeated" for problem in damaged]
            continue
        temperatures_degC += [end_degC for end_degC in ends_degC if end_degC is not None]
        if name not in best or place_of >= best[name][0]:
            best[name] = place_of, recorded
    points = tuple(points)
    kept = {name: recorded for name, ((verdict, *_), recorded) in best.items() if verdict > rank(INVALID)}
    return Stock(
        results=tuple(_result(point, kept[point.id]) for point in points if point.id in kept),
        remaining=tuple(point for point in points if point.id not in kept),
        invalid=tuple(
            replace(_result(point, best[point.id][1]), verdict=INVALID)  # whatever a file that was set aside says
            for point in points if point.id in best and point.id not in kept
        ),
        attempts=attempts,
        problems=tuple(problems),
        temperatures_degC=tuple(temperatures_degC),
    )


def attempts_begun(folder: Path) -> dict[str, int]:
    """How often each point was begun in all sessions, by the campaign's journal; empty where there is none.

    Raises:
        FileProblem: the journal cannot be read.
    """
    if not CampaignFolder(folder).journal.is_file():
        return {}
    return Counter(str(event.get("point")) for event in read_log(folder) if event["event"] == "point")


def renew_endurance(folder: Path) -> None:
    """Write `endurance.json` of a campaign that does not run anew, by the files of its blocks and its journal.

    Args:
        folder: the campaign's directory; without a matrix file, or without an endurance test, nothing is written.

    Raises:
        FileProblem: the matrix file or the journal cannot be read.
    """
    file = CampaignFolder(folder).matrix
    matrix = load_matrix(file) if file.is_file() else None
    if matrix is None or not matrix.endurance:
        return
    with contextlib.suppress(Refused), campaign_held(folder):  # a running campaign writes its own
        book = EnduranceBook(folder, matrix, attempts_begun(folder))
        recorded = names_in(CampaignFolder(folder).points)
        book.remaining(point for point in matrix.points() if point.kind == ENDURANCE or point.id not in recorded)
        book.save()


def with_blocks_counted(stock: Stock, points: tuple[TestPoint, ...], endurance: EnduranceBook) -> Stock:
    """What remains once the cycles of endurance tests are counted: a block is done when its cycles were run."""
    if not endurance:
        return stock
    blocks = {point.id for point in points if point.kind == ENDURANCE}
    to_run = blocks | {point.id for point in stock.remaining}
    remaining = endurance.remaining(point for point in points if point.id in to_run)
    left = {point.id for point in remaining}
    whole = (result for result in stock.invalid if result.id in blocks)  # all of their cycles were run
    return replace(
        stock, remaining=remaining,
        results=tuple(result for result in (*stock.results, *whole) if result.id not in left),
        invalid=tuple(result for result in (*stock.results, *stock.invalid) if result.id in left),
    )


def _damage(file: Path) -> tuple[str, ...]:
    """What of a file's values is not as it was written; a disk may keep a description and lose what it describes."""
    try:
        check_values(file)
    except FileProblem as error:
        return tuple(error.problems)
    return ()


def _result(point: TestPoint, recorded: RecordedPoint) -> PointResult:
    loop = recorded.quality.loop
    shown = PointQuality(
        loop=LoopQuality(rebound_N=loop.rebound_N, compression_N=loop.compression_N),
        coil_low_degC=recorded.quality.coil_low_degC, coil_high_degC=recorded.quality.coil_high_degC,
    )
    return PointResult(
        point, recorded.path, recorded.verdict, recorded.reasons, recorded.lost_samples, shown.numbers,
        recorded.commanded.iterated,
    )


NAME = r"[a-z0-9_]{1,60}"
QUANTITY = r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?( ?[A-Za-z/%^0-9*]{1,12})?"
ASSIGNMENT = r"[a-z][a-z_]*(\.[A-Za-z0-9_]+)*=[^\x00-\x1f\x7f]{1,200}"
FLAG = ""
A_FILE = r"[^-\x00-\x1f\x7f][^\x00-\x1f\x7f]{{0,1000}}\.{}"
NAME_OR_FILE = f"[a-z0-9][a-z0-9-]{{0,60}}|{A_FILE.format('toml')}"
FILES = frozenset({
    "--config", "--specimens", "--force-format", "--displacement-format", "--register-map", "--dbc", "--ecu-roles",
    "--supply",
})
"""Options whose value may be a path, in any letters."""
INPUTS = ("delay", "bandwidth", "gain", "zero", "noise", "resolution")

ALLOWED: dict[str, str] = {
    "--config": A_FILE.format("toml"),
    "--specimens": A_FILE.format("toml"),
    "--option": ASSIGNMENT,
    "--specimen": ASSIGNMENT,
    "--model": NAME,
    "--set": NAME,
    "--force-format": NAME_OR_FILE,
    "--displacement-format": NAME_OR_FILE,
    "--register-map": NAME_OR_FILE,
    "--dbc": A_FILE.format("dbc"),
    "--ecu-roles": A_FILE.format("toml"),
    "--supply": NAME_OR_FILE,
    "--by-hand": "off|low|on",
    "--rate": QUANTITY,
    "--auxiliary": r"[0-9]",
    "--ports": "pty|socket|by-id",
    "--actuator": "tcp|rtu|setpoints",
    "--real-time": FLAG,
    "--no-real-time": FLAG,
    "--drop-unread": FLAG,
    **{
        f"--{name}": QUANTITY
        for name in (
            "servo-stiffness", "load-train-stiffness", "actuator-friction", "load-cell-zero-drift", "hum", "crosstalk",
            "ecu-current-gain", "ecu-current-offset", "coil-sensor-offset", "coil-heat-capacity", "body-heat-capacity",
            "coil-to-body", "fluid-lag",
            *(f"actuator-{which}-{what}" for which in ("force", "position") for what in INPUTS),
            *(f"{sensor}-{what}" for sensor in ("load-cell", "lvdt") for what in INPUTS),
        )
    },
}
"""Option -> the shape of its value; a flag has none."""
OF_ONE_SESSION = {
    "--fault": True, "--fault-seed": True, "--fault-within": True, "--truth": True, "--bench": True, "--speed": True,
    "--seed": True, "--exit-when-idle": False, "--list-faults": False, "--json": False, "--help": False,
}  # fmt: skip
"""Option -> whether it has a value; these are left out."""


class StrangeArgument(ValueError):
    """An argument that no simulated rig of a resumed campaign is given."""


def of_the_rig(arguments: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sort an earlier session's arguments.

    Args:
        arguments: as they were given, each an own text.

    Returns:
        Those to be given again, as `--name=value`; and the names of those that are left out.

    Raises:
        StrangeArgument: one is no option of a rig, or its value has not the shape of one.
    """
    kept: list[str] = []
    left_out: list[str] = []
    waiting = list(arguments)
    for argument in waiting:
        if not isinstance(argument, str):
            raise StrangeArgument(f"{argument!r:.60} is not a string")
    while waiting:
        argument = waiting.pop(0)
        name, equals, value = argument.partition("=")
        if name not in ALLOWED and name not in OF_ONE_SESSION:
            raise StrangeArgument(f"{name[:60]!r} is not a valid option for a resumed simulated rig")
        if not equals and (OF_ONE_SESSION.get(name, False) or ALLOWED.get(name, FLAG) != FLAG):
            if not waiting:
                raise StrangeArgument(f"{name}: the value is missing")
            value = waiting.pop(0)
        if name in OF_ONE_SESSION:
            left_out.append(name)
            continue
        if not re.fullmatch(ALLOWED[name], value, 0 if name in FILES else re.ASCII):
            raise StrangeArgument(f"{name}: got {value[:60]!r}, which is not a valid value")
        kept.append(name if ALLOWED[name] == FLAG else f"{name}={value}")
    return tuple(kept), tuple(left_out)
