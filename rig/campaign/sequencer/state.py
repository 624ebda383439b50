"""The state of a campaign: one frozen value, its phases, and the conditions under which points are measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache

from rig.bench.model import Bench
from rig.campaign.results import RigState
from rig.campaign.stop_cause import MOST_RETRIES, StopCause
from rig.faults.row import StopKind
from rig.matrix.feasibility import command_limit, command_room
from rig.matrix.forecast import forecaster
from rig.matrix.model import Matrix
from rig.matrix.order_by_heat import Load, Thermal, load_of, thermal_of, warm_up_point
from rig.signals.drive_iteration import IterationSettings, SignalDrives
from rig.test_point import TestPoint

DEMAGNETISING_RATIO = 0.7
DEMAGNETISED_A = 0.05
LONGEST_WARM_UP_PROGRAM_S = 60.0
FEWEST_WARM_UP_CYCLES = 3
UNKNOWN_WARM_UP_S = 10.0
LONGEST_GROWTH = 2.0
"""Of a warm-up program over the one before: a temperature read to 0.1 K says little of the pace."""
WARM_UP_MARGIN_K = 0.3
"""Warmed a little beyond the window's lower end, so that the rod's return does not cost another program."""


@dataclass(frozen=True)
class Ceiling:
    """What may be commanded.

    Attributes:
        amplitude_m: the largest amplitude that speed and acceleration allow, m; `what` limits it, in words.
        low_m: lowest position that may be commanded, m; `high_m` the highest; `where` they come from, in words.
    """

    amplitude_m: float = math.inf
    what: str = ""
    low_m: float = -math.inf
    high_m: float = math.inf
    where: str = ""


@dataclass(frozen=True)
class Drive:
    """How a motion is commanded.

    Attributes:
        waveform, amplitude_m, frequency_Hz: the motion wanted.
        current_A: the coil's current during it.
        command_m: the amplitude to command, m.
        shift_m: added to the centre, m.
        steps: corrections so far.
        settled: nothing more is to be tried: it is within tolerance, or the machine cannot.
        cannot: why the machine cannot; empty while it may.
        tried: commanded and reached amplitude (m) of the program before, None before the first.
    """

    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    command_m: float
    shift_m: float = 0.0
    steps: int = 0
    settled: bool = False
    cannot: str = ""
    tried: tuple[float, float] | None = None

    @property
    def gain(self) -> float:
        """Commanded over wanted amplitude."""
        return self.command_m / self.amplitude_m


Drives = tuple[Drive, ...]


@dataclass(frozen=True)
class ManualState:
    """A current that a person sets: the pressure meanwhile (off, low, on), and how long an answer may take (s)."""

    pressure: str
    answer_s: float


@dataclass(frozen=True, eq=False)
class Conditions:
    """What every point of a campaign must find. Made once and the same object ever after.

    Attributes:
        tolerance: allowed deviation of the amplitude, relative; None: the command is not compensated.
        iteration: how the commands of signals are iterated; None: they are not.
        ceilings: by point id, what may be commanded.
        thermal: temperature window and heat model; None without a window.
        loads: by point id, its heat.
        warm_up: the motion that warms; None without a window.
        longest_s: longest warming up or cooling down before a point or a restart (s, rig's clock).
        demagnetise: the coil's core is demagnetised before another current.
        hand: how a person is asked for the current; None where a device drives it.
        powered_test: whether the watchdog is tested under pressure.
    """

    tolerance: float | None = None
    iteration: IterationSettings | None = None
    ceilings: Mapping[str, Ceiling] = field(default_factory=dict)
    thermal: Thermal | None = None
    loads: tuple[tuple[str, Load], ...] = ()
    warm_up: TestPoint | None = None
    longest_s: float = 3600.0
    demagnetise: bool = False
    hand: ManualState | None = None
    powered_test: bool = False

    def highest_start(self, point: TestPoint) -> float:
        """Largest temperature (degC) at which the point may begin; inf without a window."""
        if self.thermal is None:
            return math.inf
        return self.thermal.highest_start(dict(self.loads).get(point.id, Load(point.motion_s, 0.0)))

    def warm_up_program(
        self, now_degC: float, before: tuple[float, float] | None = None
    ) -> tuple[TestPoint, float] | None:
        """The next warm-up program from a temperature (degC), and its motion (s); None without a window.

        The forecast is corrected by doing: where `before`, the last program's motion (s) and the temperature it began
        at (degC), warmed less than forecast, the next one is longer, up to twice as long. A damper near the temperature
        that the motion can hold would never arrive by programs that shorten as it comes closer.
        """
        if self.thermal is None or self.warm_up is None:
            return None
        thermal, period_s = self.thermal, 1.0 / self.warm_up.frequency_Hz
        goal_degC = min(thermal.low_degC + WARM_UP_MARGIN_K, 0.5 * (thermal.low_degC + thermal.high_degC))
        needed_s = thermal.heat.time_to(goal_degC, now_degC, thermal.warm_up_W)
        needed_s = UNKNOWN_WARM_UP_S if math.isinf(needed_s) else needed_s
        if before is not None:
            needed_s = max(needed_s, _at_the_pace_of(before, now_degC, goal_degC))
        needed_s = min(needed_s, LONGEST_WARM_UP_PROGRAM_S)
        program = replace(self.warm_up, cycles=max(FEWEST_WARM_UP_CYCLES, math.ceil(needed_s / period_s)))
        return program, program.motion_s


def _at_the_pace_of(before: tuple[float, float], now_degC: float, goal_degC: float) -> float:
    """How long the motion takes to a goal if it warms as it last did (s); at most twice what it last took."""
    lasted_s, from_degC = before
    longest_s = LONGEST_GROWTH * lasted_s
    gained_K = now_degC - from_degC
    return longest_s if gained_K <= 0.0 else min(longest_s, lasted_s * (goal_degC - now_degC) / gained_K)


NO_CONDITIONS = Conditions()


def _pressure_while_asked(bench: Bench) -> str:
    """The pressure while the operator is at the supply: off in place of a low one that the controller does not have."""
    pressure = bench.ecu.pressure_while_asked
    return "off" if pressure == "low" and not bench.actuator.has_low_pressure else pressure


def conditions_of(matrix: Matrix, bench: Bench) -> Conditions:
    """The conditions a matrix asks for on a bench."""
    points, temperature = matrix.points(), matrix.temperature
    ceiling = cache(lambda motion: _ceiling(motion, matrix, bench))  # an endurance test has thousands of equal motions
    conditions = Conditions(
        tolerance=matrix.sweep.amplitude_tolerance if matrix.sweep.adapt_amplitude else None,
        iteration=matrix.sweep.iteration,
        ceilings={point.id: ceiling(point.without_name) for point in points if point.adapts},
        demagnetise=matrix.campaign.demagnetise,
        powered_test=bench.actuator.watchdog_tested != "off",
        hand=ManualState(_pressure_while_asked(bench), bench.ecu.answer_within_s) if bench.ecu.by_hand else None,
    )
    if temperature is None:
        return conditions
    forecast = forecaster(matrix.specimen)
    return replace(
        conditions,
        thermal=thermal_of(points, forecast, temperature),
        loads=tuple((point.id, load_of(point, forecast)) for point in points),
        warm_up=warm_up_point(points, forecast, temperature),
        longest_s=temperature.longest_s,
    )


def _ceiling(point: TestPoint, matrix: Matrix, bench: Bench) -> Ceiling:
    amplitude_m, what = command_limit(point, matrix, bench)
    low_m, high_m, where = command_room(matrix, bench)
    return Ceiling(amplitude_m, what, low_m, high_m, where)


def demagnetising_currents(largest_A: float) -> tuple[float, ...]:
    """Currents (A) of alternating sign and falling size that take a core's remanence away, 0 last."""
    steps = max(0, math.ceil(math.log(DEMAGNETISED_A / largest_A) / math.log(DEMAGNETISING_RATIO)))
    sizes = [largest_A * DEMAGNETISING_RATIO**number for number in range(1, steps + 1)]
    return (*(size if number % 2 else -size for number, size in enumerate(sizes)), 0.0)


class Phase(StrEnum):
    """What the campaign waits for."""

    NEW = "new"
    CONNECTING = "connecting"
    ARMING = "arming"
    PROVING_WATCHDOG = "testing watchdog"
    CHECKING_ZEROS = "checking zeros"
    PRESSURE_LOW = "hydraulics to low pressure"
    PRESSURE_ON = "hydraulics to full pressure"
    PROVING_SENSORS = "checking the sensors with a slow move"
    CENTRING = "centring"
    GATING = "reading the temperature"
    COOLING = "cooling down"
    YIELDING = "lowering the pressure while the operator sets the supply"
    ASKING = "waiting for the operator to set the current"
    CURRENT_SET = "recording the manually set current"
    DEMAGNETISING = "demagnetising"
    SETTLING = "settling the current"
    WARMING = "warming up"
    ADAPTING = "adapting the amplitude"
    ITERATING = "iterating the command"
    CORRECTING = "calculating the next command"
    RUNNING = "running"
    STEPPING = "stepping the current"
    CLEARING = "back to 0 A"
    RESTING = "resting"
    PAUSED = "paused"
    EVALUATING = "waiting for verdicts"
    STOPPING = "stopping"
    COOLING_DOWN = "waiting at rest for the ECU to cool down"
    RESETTING = "resetting after a stop"
    STANDING = "coming to rest"
    CHECKING_RETURN = "checking zeros again"
    FINISHING = "hydraulics off"
    TAKING_AWAY = "waiting for the operator to switch the current off"
    TAKEN_AWAY = "recording that the current is 0 A"
    ENDED = "ended"


class PhaseKind(StrEnum):
    """Kind of a phase, for displays."""

    PREPARING = "preparing"
    """Before the first point; nothing has been verified yet."""
    AT_REST = "at rest"
    MOVING = "moving"
    PAUSED = "paused"
    STOPPING = "stopping"
    ENDED = "ended"


_KINDS: Mapping[str, PhaseKind] = {
    **dict.fromkeys(Phase, PhaseKind.AT_REST),
    **dict.fromkeys((Phase.RUNNING, Phase.STEPPING, Phase.WARMING, Phase.ADAPTING, Phase.ITERATING, Phase.CENTRING),
                    PhaseKind.MOVING),
    **dict.fromkeys((
        Phase.NEW, Phase.CONNECTING, Phase.ARMING, Phase.PROVING_WATCHDOG, Phase.CHECKING_ZEROS, Phase.PRESSURE_LOW,
        Phase.PRESSURE_ON, Phase.PROVING_SENSORS,
    ), PhaseKind.PREPARING),
    Phase.PAUSED: PhaseKind.PAUSED, Phase.STOPPING: PhaseKind.STOPPING, Phase.ENDED: PhaseKind.ENDED,
}  # fmt: skip


def phase_kind(text: str) -> PhaseKind:
    """Return the kind of a phase for displays; phases before the sequence (start of the station) are `PREPARING`."""
    return _KINDS.get(text, PhaseKind.PREPARING)


@dataclass(frozen=True)
class Latch:
    """The first cause of a stop; later causes never replace it."""

    stop: StopKind
    cause: StopCause


@dataclass(frozen=True)
class State:
    """A campaign's state; made by `start_state`, changed only by `rig.campaign.sequencer.step`.

    Attributes:
        queue: the points still to be done; the first one is the current one.
        retries: how often a point may be repeated without the operator (0..2).
        phase: what the campaign waits for.
        attempts: point ids, one entry for each attempt begun.
        unjudged: ids whose file is being written and judged; only kept when a bad verdict could lead to a repeat.
        given_back: points kept for a repeat while their verdict is awaited.
        held_at_m: the centre at which the actuator is known to hold, None when not known.
        rest_s: rest still to be taken after the point that just ran (s, rig's clock).
        recording: the current point's journal is open.
        armed: the station was asked to arm; only a proved disarm undoes it.
        proved: watchdog and zeros were proved since the last arming.
        pressurised: pressure was asked for, and is not proved gone.
        powered: the hydraulics are at full pressure.
        moved: something was moved in this campaign.
        pause_requested: stop at the next point boundary.
        spoiled: why the running point cannot be valid, though it was not stopped.
        latch: the stop under way or done; None while nothing is wrong.
        restart_withdrawn: something came up during the stop after which no restart may follow.
        stopped: standstill and 0 A were proved after the latch.
        cooled_s: how long the stopped rig has waited for the ECU to cool down (s, rig's clock).
        refused: why the campaign was refused before anything moved.
        left_to_station: the link was closed; whether the rig is safe is proved by how the station ends.
        rig_state: what is known about the rig.
        conditions: under what conditions points are measured.
        drives: how motions are commanded, as far as they were tried.
        signal_drives: the same of signals whose command is iterated.
        stored_drives: of an earlier session or run; their commands are checked before they are run.
        warming: the warm-up program that comes before the current point, None when there is none.
        warmed_s: motion of warm-up programs before the current point (s).
        warmed_with: the last of them (s) and the temperature it began at (degC), None before the first.
        steps_left: currents still to come of a current-step point (A).
        demagnetising: currents still to come of the demagnetising sequence (A).
        magnetised_A: the largest current since the last demagnetising (A).
        last_current_A: the current of the last program (A).
        hand_A: the current that the operator has confirmed (A); None before the first answer.
        requested_A: the one that is asked for (A); None while nothing is asked.
        yielded: the pressure was lowered for the operator at the supply.
    """

    queue: tuple[TestPoint, ...]
    retries: int
    phase: Phase = Phase.NEW
    attempts: tuple[str, ...] = ()
    unjudged: tuple[str, ...] = ()
    given_back: tuple[TestPoint, ...] = ()
    held_at_m: float | None = None
    rest_s: float = 0.0
    recording: bool = False
    armed: bool = False
    proved: bool = False
    pressurised: bool = False
    powered: bool = False
    moved: bool = False
    pause_requested: bool = False
    spoiled: StopCause | None = None
    latch: Latch | None = None
    restart_withdrawn: bool = False
    stopped: bool = False
    cooled_s: float = 0.0
    refused: StopCause | None = None
    left_to_station: bool = False
    rig_state: RigState = RigState.SAFE
    conditions: Conditions = NO_CONDITIONS
    drives: Drives = ()
    signal_drives: SignalDrives = ()
    stored_drives: SignalDrives = ()
    warming: TestPoint | None = None
    warmed_s: float = 0.0
    warmed_with: tuple[float, float] | None = None
    steps_left: tuple[float, ...] = ()
    demagnetising: tuple[float, ...] = ()
    magnetised_A: float = 0.0
    last_current_A: float = 0.0
    hand_A: float | None = None
    requested_A: float | None = None
    yielded: bool = False

    @property
    def resting_A(self) -> float:
        """What the coil goes back to after a program (A): 0, or the manual current, which is not removed here."""
        return self.hand_A or 0.0

    @property
    def hand_flows(self) -> bool:
        """A current set by hand flows, or may."""
        return bool(self.hand_A or self.requested_A)

    @property
    def point(self) -> TestPoint:
        """The current point."""
        return self.queue[0]

    def without_last_attempt(self) -> State:
        """The state as if the current point's last attempt had not been begun."""
        last = len(self.attempts) - 1 - self.attempts[::-1].index(self.point.id)
        return replace(self, attempts=self.attempts[:last] + self.attempts[last + 1 :])

    def unlatched(self) -> State:
        """The state after an explicit reset: nothing is proved any more, the position is not known."""
        return replace(
            self, latch=None, stopped=False, proved=False, powered=False, held_at_m=None, rest_s=0.0, warming=None,
            warmed_with=None, cooled_s=0.0, yielded=False,
        )


def campaign_state(
    queue: tuple[TestPoint, ...], matrix: Matrix, bench: Bench, stored_drives: SignalDrives = ()
) -> State:
    """The state before the points of a queue, under the conditions that the matrix asks for on this bench.

    Args:
        queue: the points still to be run.
        matrix: of the campaign.
        bench: the rig.
        stored_drives: of iterated signals, from an earlier session or run.

    Raises:
        ValueError: as `start_state`.
    """
    state = start_state(queue, matrix.campaign.retries, conditions_of(matrix, bench))
    return replace(state, stored_drives=stored_drives)


def start_state(points: tuple[TestPoint, ...], retries: int, conditions: Conditions = NO_CONDITIONS) -> State:
    """The state before anything has happened.

    Args:
        points: the planned points in order.
        retries: automatic repeats of a point, 0..2.
        conditions: under what conditions points are measured; by default none.

    Raises:
        ValueError: no points, two points with one id, or `retries` out of range.
    """
    ids = [point.id for point in points]
    if not points or len(set(ids)) != len(ids):
        raise ValueError(f"points: got {ids}, expected at least one point and unique IDs")
    if not 0 <= retries <= MOST_RETRIES:
        raise ValueError(f"retries: got {retries}, expected 0 to {MOST_RETRIES}")
    return State(queue=points, retries=retries, conditions=conditions)
