"""What happens behind the spring of `sprung_bouc_wen` and `thixotropic_bouc_wen`: the piston's law, speed, and steps.

The piston's speed follows from the spring's force, because the law rises with the speed. The spring's stretch is stiff
where the piston slides (k over the slope of the law is thousands per second), so it is integrated by the trapezoidal
rule and then by backward differences of second order over the whole step (TR-BDF2, Bank et al. 1985): it damps stiff
parts out, and both stages are of second order, so the force of a stiff spring does not depend on the step. The loop w
has a solution in closed form along any path, and each stage takes w where the stage ends. Steps are short where the
force turns round and long where the piston slides (docs/maintainers/decisions/a-spring-in-the-model.md).

Parameters p are those of `SprungBoucWenModel` in their order, the state is the spring's stretch (m), then w. The
thixotropic model has a parameter more, and a third state, the remembered speed (m/s); a model without memory
remembers `NOTHING`.
"""

from __future__ import annotations

import math

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import SATURATED

OFFSET, RHO, BEND, SPRING, MASS, CURVED = 3, 13, 14, 15, 16, 17  # where they are in p
REMEMBERS_S = 0.1  # time constant of the memory of the speed
HALVES_M_S = 0.1  # remembered speed that halves the force at 0 A
NOTHING = -1.0
IMPLICIT = 1.0 - math.sqrt(0.5)  # share of a step that each stage is implicit over
FIRST_ENDS = 2.0 * IMPLICIT  # of a step: half of the first stage is implicit
EXPLICIT = math.sqrt(0.125)  # share of a step that the second stage takes with each speed known before
AT_ONCE_S = 1e-6  # in which the piston's speed at an instant is found
TURNING = 8.0  # steps in the time in which the rod, from rest, goes as far as the force stretches the spring, / sqrt 2
LONGEST_PATH = 0.5  # of w in a step, in 1/rho
LONGEST_S = 1e-2  # step
MOST_STEPS = 400  # between two samples
CLOSE, NEAREST_M_S = 1e-4, 1e-10  # last change of the piston's speed, relative and in m/s: what is left is its square
FASTEST_M_S = 1e3  # speeds are looked for up to this one
PATIENT, MOST_TRIALS = 12, 120  # trials: by Newton's method alone, and at all
Numbers = tuple[float, float, float, float]
AtCurrent = tuple[float, float, float, float, float]
Stage = tuple[float, float, float, float, float]
"""Where the rod is (m), piston place (m) but for this stage's own part, that part (s), where the step began (m), w."""
Motion = tuple[float, float, float, float, float]
"""See `rig.dampers.kernel`."""


@njit()
def kept(speed: float) -> float:
    """Share of its force at 0 A that the fluid keeps after a remembered speed (m/s)."""
    return HALVES_M_S / (HALVES_M_S + speed) if speed >= 0.0 else 1.0


@njit()
def at_current(p: FloatArray, current: float, speed: float) -> AtCurrent:
    """Viscous damping (N s/m), yield force (N), its change along the stroke (N/m), logarithmic force (N), kxx (N/m^2).

    Args:
        p: parameters.
        current: coil current (A).
        speed: that the fluid remembers (m/s).
    """
    share, curved = kept(speed), 0.0
    if speed >= 0.0:
        curved = p[CURVED]
    viscous = max(share * p[1] + current * p[2], 0.0)
    yielding = share * p[4] + current * (p[5] + current * p[6])
    along = p[7] + p[8] * current
    thinning = max(p[9] + current * (p[10] + current * (p[11] + current * p[12])), 0.0)
    return viscous, yielding, along, thinning, curved


@njit()
def law(p: FloatArray, at: AtCurrent, u: float, v: float, w: float) -> Numbers:
    """Force (N) of the piston, f0 left out, at place u (m) and speed v (m/s), and its slopes over u, v and w."""
    viscous, yielding, along, thinning, curved = at
    force = (p[0] + curved * u) * u + viscous * v + (yielding + along * u) * w + thinning * math.asinh(v / p[BEND])
    by_v = viscous + thinning / math.hypot(v, p[BEND])
    return force, p[0] + 2.0 * curved * u + along * w, by_v, yielding + along * u


@njit()
def turned(w: float, path: float) -> tuple[float, float, float]:
    """The loop w after a path (rho times the way), and its slopes over w and path.

    With x = w in the path's direction: x' = 1 while it unloads, then x' = 1 - x^2.
    """
    direction = 1.0 if path >= 0.0 else -1.0
    x, left = w * direction, abs(path)
    if x + left <= 0.0:
        return w + path, 1.0, 1.0
    if x < 0.0:
        end = math.tanh(x + left)
        return direction * end, 1.0 - end * end, 1.0 - end * end
    bend = math.tanh(left)
    rest = 1.0 + x * bend
    end = (x + bend) / rest
    return direction * end, (1.0 - bend * bend) / (rest * rest), (1.0 - x * x) * (1.0 - bend * bend) / (rest * rest)


@njit()
def piston_speed(p: FloatArray, at: AtCurrent, stage: Stage, guess: float) -> float:
    """The piston's speed (m/s) at which its law takes the spring's force: Newton's method, else bisection.

    The law bends at 0, where a step from beyond would overshoot, back and forth: so no step goes past 0 at once. A
    step that comes late and is not half as long as the one before is replaced by bisection.
    """
    rod, base, part, began, w = stage
    k, rho, v = p[SPRING], p[RHO], guess
    low, high, change, trials = -FASTEST_M_S, FASTEST_M_S, 1.0, 0
    while abs(change) > CLOSE * abs(v) + NEAREST_M_S and trials < MOST_TRIALS:
        u = base + part * v
        loop = turned(w, rho * (u - began))
        force, by_u, by_v, by_w = law(p, at, u, v, loop[0])
        over = force - k * (rod - u)
        slope = by_v + part * (by_u + k + by_w * loop[2] * rho)
        if over > 0.0:
            high = v
        else:
            low = v
        nearer = v - over / slope if slope > 0.0 else high
        if nearer * v < 0.0:
            nearer = 0.0
        if nearer <= low or nearer >= high or (trials > PATIENT and abs(nearer - v) > 0.5 * abs(change)):
            nearer = 0.5 * (low + high) if over != 0.0 else v
        change = nearer - v
        v = nearer
        trials += 1
    return v


@njit()
def rod_at(motion: Motion, t: float) -> float:
    """Where the rod is (m) after t (s) of a motion."""
    rest = motion[2] / 2.0 + t * (motion[3] / 3.0 + t * motion[4] / 4.0)
    return float(motion[0] + t * (motion[1] + t * rest))


@njit()
def rod_speed(motion: Motion, t: float) -> float:
    """How fast the rod is (m/s) after t (s) of a motion."""
    return float(motion[1] + t * (motion[2] + t * (motion[3] + t * motion[4])))


@njit()
def steps_in(p: FloatArray, at: AtCurrent, w: float, motion: Motion, dt: float) -> int:
    """How many equal steps a motion of dt (s) is cut into."""
    v_0, v_1 = motion[1], rod_speed(motion, dt)
    faster = max(abs(v_0), abs(v_1))
    reach = (abs(at[1]) + 5.0 * at[3] + at[0] * faster) / p[SPRING]
    turning = max(abs(motion[2]), abs(v_1 - v_0) / dt)
    sliding = v_0 * v_1 > 0.0 and v_0 * w > SATURATED * abs(v_0) and v_1 * v_1 > 8.0 * reach * turning
    least = math.ceil(dt / LONGEST_S)
    if sliding and v_0 * v_0 > 8.0 * reach * turning:
        return int(min(MOST_STEPS, least))
    count = max(float(least), TURNING * dt * math.sqrt(turning / max(reach, 1e-12)))
    return int(min(float(MOST_STEPS), math.ceil(max(count, p[RHO] * faster * dt / LONGEST_PATH))))


@njit()
def at_once(state: FloatArray, motion: Motion) -> Stage:
    """A stage so short that the piston's speed there is that where the motion begins."""
    began = motion[0] - state[0]
    return rod_at(motion, AT_ONCE_S), began, AT_ONCE_S, began, state[1]


@njit()
def first_stage(state: FloatArray, motion: Motion, t: float, h: float, v: float) -> Stage:
    """The first stage of a step of length h (s) that begins at t (s) with the piston's speed v (m/s)."""
    part, began = IMPLICIT * h, rod_at(motion, t) - state[0]
    return rod_at(motion, t + FIRST_ENDS * h), began + part * v, part, began, state[1]


@njit()
def second_stage(early: Stage, motion: Motion, t: float, h: float, both: float) -> Stage:
    """The second one; `both` (m/s) is the sum of the piston's speeds where the step begins and at the first stage."""
    part, began, w = early[2], early[3], early[4]
    return rod_at(motion, t + h), began + EXPLICIT * h * both, part, began, w


@njit()
def remembered(state: FloatArray) -> float:
    """The speed (m/s) that the fluid remembers."""
    return float(state[2]) if state.size > 2 else NOTHING


@njit()
def remembering(state: FloatArray, motion: Motion, t: float, h: float) -> tuple[float, float]:
    """The remembered speeds (m/s) at both stages of a step of length h (s) from t (s), where `state` is."""
    if state.size <= 2:
        return NOTHING, NOTHING
    rod = abs(rod_speed(motion, t + 0.5 * h))
    before = state[2] - rod
    return rod + before * math.exp(-FIRST_ENDS * h / REMEMBERS_S), rod + before * math.exp(-h / REMEMBERS_S)


@njit()
def remember(state: FloatArray, speed: float) -> None:
    """Puts a remembered speed (m/s) into the state, if it has a place for it."""
    if state.size > 2:
        state[2] = speed


@njit()
def moved(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
    """See `Kernel.step`."""
    if dt <= 0.0:
        return True
    at = at_current(p, current, remembered(state))
    count = steps_in(p, at, state[1], motion, dt)
    h = dt / count
    begins = at_once(state, motion)
    v = piston_speed(p, at, begins, motion[1])
    for k in range(count):
        t = k * h
        rods = rod_speed(motion, t), rod_speed(motion, t + FIRST_ENDS * h), rod_speed(motion, t + h)
        speeds = remembering(state, motion, t, h)
        at = at_current(p, current, speeds[0])
        early = first_stage(state, motion, t, h, v)
        first = piston_speed(p, at, early, v + rods[1] - rods[0])
        at = at_current(p, current, speeds[1])
        late = second_stage(early, motion, t, h, v + first)
        v = piston_speed(p, at, late, first + rods[2] - rods[1])
        rod, base, part, began, w = late
        now = base + part * v
        state[0] = rod - now
        end = turned(w, p[RHO] * (now - began))
        state[1] = end[0]
        remember(state, speeds[1])
    return True
