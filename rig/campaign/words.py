"""The campaign's messages: one template for each thing that can be said of a cause, filled with its numbers.

Nothing is decided by what stands here: causes are told apart by their slug, and carry their numbers beside the words.
"""

from __future__ import annotations

from rig import errors

MESSAGES = {
    # At rest, before arming
    "few-samples": "{name}: {count} samples at rest, expected {fewest} or more, all finite",
    "flagged-samples": "{name}: {count} samples at rest with the sensor's own overload or fault flag, expected none; "
    "check it and its cable",
    "rest-value": "{what}: {value:.3g} {unit}, allowed {limit:.3g} {unit}{advice}",
    "force-zero": "load cell against the controller's own force input: {difference} N at rest, allowed {limit_N:.3g} N "
    "for this test's force (blame: bench){advice}",
    "current-zero": "the ECU reports {zero} mA while its output stage is off, allowed {limit_mA:.3g} mA (blame: bench)"
    "{advice}",
    "supply-not-zero": "the supply gives {zero} mA though nothing was set, allowed {limit_mA:.3g} mA (blame: bench); "
    "switch its output off at the supply; one that cannot give 0 A cannot drive this coil; an offset of its "
    "measurement goes into [checks] current_zero",
    "rest-position": "LVDT at rest: {value_mm:.3g} mm, allowed {low_mm:g}..{high_mm:g} mm{advice}",
    "few-rest-samples": "too few samples from the resting rig",
    # The proof move
    "lvdt-scale": "proof move: the LVDT shows {shown_mm:.3g} mm where the controller moved {moved_mm:.3g} mm; check "
    "plugs, sign and sensitivity",
    "force-sign": "proof move: the load cell shows {force_N:.3g} N less on the way up than down, but a damper resists; "
    "check plugs, sign and sensitivity",
    "force-scale": "proof move: the load cell shows a force of motion of {force_N:.3g} N, the controller {own_N:.3g} "
    "N; check plugs, sign and sensitivity",
    "no-proof-move": "the actuator did not carry out the proof move",
    # Against the first session
    "no-signature": "its 0 A signature could not be measured",
    "other-signature": "0 A signature {now}, in the campaign's first session {first}",
    "stronger-damper": "0 A signature {now}, the prior predicts {expected}: the plan does not hold for this damper; "
    "mount the right one, or correct the specimen's prior",
    "other-device": "{device}: {name} {now!r}, in the campaign's first session {first!r}",
    "no-coil-temperature": "the ECU reports no coil temperature",
    "too-hot-to-resume": "coil at {now_degC:.1f} degC; this campaign saw {lowest_degC:.1f} to {highest_degC:.1f} degC "
    "and continues from {from_degC:.1f} to {to_degC:.1f} degC: let it cool down, then resume",
    "too-cold-to-resume": "coil at {now_degC:.1f} degC; this campaign saw {lowest_degC:.1f} to {highest_degC:.1f} degC "
    "and continues from {from_degC:.1f} to {to_degC:.1f} degC: warm the room or the damper, then resume",
    # Preparing and running points
    "still-cold": "{now_degC:.1f} degC after {warmed_s:.0f} s of warming up; the window begins at {low_degC:g} degC",
    "never-cool": "{now_degC:.1f} degC; never cools to {highest_degC:.1f} degC by itself",
    "cool-too-late": "{now_degC:.1f} degC; cools to {highest_degC:.1f} degC in {forecast_s:.0f} s, later than "
    "[temperature] longest allows",
    "cooling-overdue": "the damper did not cool down in twice the forecast time",
    "no-temperature": "the ECU reports no temperature",
    "no-negative-current": "the measured current does not follow the demagnetising sequence; it needs an ECU that "
    "drives both signs",
    "current-not-settled": "measured current did not reach {wanted_A:g} A in {limit_s:g} s",
    "current-not-zero": "the measured current did not return to 0 A",
    "no-full-cycle": "the trial program showed no full cycle",
    "ended-by-another": "{point}: the motion was ended by another master: {how}",
    "program-overdue": "the motion program did not run to its end in time",
    "centre-overdue": "the actuator did not reach the centre",
    "rest-overdue": "the controller's clock stands still",
    "standstill-overdue": "the actuator did not come to rest",
    "pause-overdue": "paused for {hours:g} h: pressure off",
    "unanswered": "{phase}: no proof from the station in time",
    # The application's own
    "finaliser-ended": "the finaliser process has ended; `rig recover` finishes what it left",
    "file-unfinished": "its file is not finished; `rig recover` or resuming will finish it",
    "records-lost": "{count} records overwritten unread",
    "station-silent": "the station has not run for {silent_s:g} s or longer",
    "no-status": "no status of the controller for {silent_s:g} s",
    # Notes of the sequencer
    "paused": "paused before {point}",
    "page-stop": "Stop on the page, {by}",
    "operator-stop": "stopped by operator ({detail}): current to 0 A, motion fades out",
    "stop": "{slug}: {detail}; stop {stop}: current to 0 A, motion ends",
    "refused": "refused: {slug}: {detail}",
    "spoiled": "{slug}: {detail}",
    "ask-current": "Set {wanted_A:.2f} A on the supply, then press Enter",
    "ask-zero": "Set 0 A on the supply and switch its output off, then press Enter",
    "set-by-hand": "{said_A:.2f} A set by hand, confirmed by the operator",
    "current-left": "nobody has confirmed that the current set by hand was taken away: it may still flow. Go to the "
    "supply and switch its output off",
    "by-hand-unanswered": "{wanted_A:g} A were asked for, and nobody confirmed it in {limit_s:g} s",
    "cooling-ecu": "waiting for the ECU to cool down: {cooled_s:g} s of at most {longest_s:g} s",
    "left-to-station": "nothing more is asked of the station; its own watch and the controller's watchdog end the "
    "motion: {detail}",
    "state-unknown": "the rig's state is not known: {detail}",
    "hydraulics-on": "the rig stands still at 0 A, but its hydraulics could not be switched off: {detail}",
    "warming": "warming up from {from_degC:.1f} degC: {planned_s:.0f} s of motion",
    "cooling": "{point}: cooling down from {from_degC:.1f} to {to_degC:.1f} degC, about {planned_s:.0f} s of the rig's "
    "time",
    # Compensation of the amplitude
    "cannot-reach": "{reached_mm:.4g} mm of {wanted_mm:.4g} mm reached ({off:+.1f} %), {aside_mm:+.3f} mm beside the "
    "centre, with a command of {command_mm:.4g} mm: {why}",
    "machine-cannot": "machine cannot: {why}",
    "within-tolerance": "{point}: {reached_mm:.4g} mm of {wanted_mm:.4g} mm reached; within tolerance",
    "corrected": "{point}: {reached_mm:.4g} mm of {wanted_mm:.4g} mm reached; correction {step}: command "
    "{command_mm:.4g} mm",
    "no-motion": "nothing moved",
    "not-within": "not within {percent:g} % after {steps} corrections",
    "beyond-room": "a command of {command_mm:.4g} mm about {centre_mm:.4g} mm would be needed, beyond {limit}",
    "beyond-shift": "the centre would have to be moved by {wanted_mm:.4g} mm; {allowed_mm:.4g} mm are allowed",
    "valve-saturated": "the valve is saturated: the speed needs more flow than it passes",
    "no-answer": "the motion does not follow a larger command (following error up to {error_mm:.3g} mm)",
    # What the operator reads beside the points
    "resume-confirms": "resuming confirms that this was looked at and mended: {text}",
    "resuming": "resuming: {kept} points kept, {left} to run",
    "without-options": "the simulated rig is started without the earlier session's {names}",
    "requalified": "requalified: {text}",
    "at-the-end": "at the campaign's end: {error}",
    "pause-asked": "pausing after the running point; Ctrl-Z again, or Start on the page, continues",
    "pause-over": "continuing",
    "clock-step": "the wall clock stepped by {stepped_s:+.3f} s; host_ns is not affected",
    "station-late": "this computer was busy: monitoring paused for {late_ms:.0f} ms (pause {count}); samples that "
    "waited are flagged",
    "points-files": "the points' files: {error}; `rig recover` finishes what is left",
    "own-skews": "every point keeps its own skew: {why}",
    "recorder-left": "the recorder: {error}; `rig recover` finishes what it left",
    "dropped": "the motion was out of tolerance; its record is kept as {kept}, the point is run again",
    "rig-goes-on": "the simulated rig still runs (process {process}){why}",
    "drifted-apart": "{measured} and {own} drifted apart by {drift:+.3g} {unit} between start and end, both at rest "
    "(limit {limit:.3g} {unit}, largest measured {peak:.4g} {unit}): one of the two zeros moved; check cable, mounting "
    "and temperature of both, tare, and repeat the tests",
    "force-left": "0 A could not be measured after the stop, and the force at rest went from {start:.4g} N to "
    "{end:.4g} N (limit {limit:.3g} N): the coil may still have current; cut its supply, then look at the current "
    "source and the way to it",
    # Words from elsewhere: a device's, the station's, an exception's
    "said": "{text}",
}
EXCHANGED = {
    "plugs": "load cell and LVDT are exchanged: swap their plugs",
    "force-sign": "the load cell's sign is wrong",
    "lvdt-sign": "the LVDT's sign is wrong",
}
ADVICE = {
    "rest-value": "; tare it or check its cable",
    "force-zero": "; one of the two is not zeroed, neither is proved: tare the load cell and the controller's input, "
    "or write [checks] force_zero into the bench file",
    "current-zero": "; its measurement and its command of 0 A disagree: have the ECU's current measurement zeroed, or "
    "write [checks] current_zero into the bench file",
    "rest-position": "; move the rod by hand or tare it",
}
"""What to do, where the cause is not an exchange of sensors."""


def say(name: str, **values: object) -> str:
    """A message of `MESSAGES`, filled with these values."""
    return message(name, values)


def message(name: str, values: dict[str, object], instead: str | None = None) -> str:
    """A message of `MESSAGES`.

    Args:
        name: which one.
        values: what it is filled with.
        instead: a key of `EXCHANGED`: what explains the finding, in place of the advice.
    """
    advice = ADVICE.get(name, "") if instead is None else f"; {EXCHANGED[instead]}"
    return errors.told(MESSAGES[name].format(**values, advice=advice))
