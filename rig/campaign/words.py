"""The campaign's messages: one template per message, filled with its numbers.

Nothing depends on these texts: causes are distinguished by their slug and carry their numbers separately.
"""

from __future__ import annotations

from rig import errors

MESSAGES = {
    # At rest, before arming
    "few-samples": "{name}: {count} samples at rest, expected at least {fewest}, all with finite values",
    "flagged-samples": "{name}: {count} samples at rest with the sensor's overload or fault flag, expected none; "
    "check the sensor and its cable",
    "rest-value": "{what}: {value:.3g} {unit}, allowed {limit:.3g} {unit}{advice}",
    "force-zero": "the load cell and the controller's force input differ by {difference} N at rest, allowed "
    "{limit_N:.3g} N for this test's force (a fault of the bench, not of the damper){advice}",
    "current-zero": "the ECU reports {zero} mA while its output stage is off, allowed {limit_mA:.3g} mA (a fault of "
    "the bench, not of the damper){advice}",
    "supply-not-zero": "the supply delivers {zero} mA before any command, allowed {limit_mA:.3g} mA (a fault of the "
    "bench, not of the damper). Switch the output off at the supply. A supply that cannot be set to 0 A is not "
    "suitable for this coil; if only the supply's measurement has an offset, enter the offset as [checks] current_zero",
    "rest-position": "LVDT at rest: {value_mm:.3g} mm, allowed {low_mm:g}..{high_mm:g} mm{advice}",
    "few-rest-samples": "too few samples at rest",
    # The check move
    "lvdt-scale": "check move: the LVDT showed {shown_mm:.3g} mm, but the controller moved {moved_mm:.3g} mm; check "
    "the plugs, sign and sensitivity",
    "force-sign": "check move: the load cell showed {force_N:.3g} N less on the upward stroke than on the downward "
    "stroke, but a damper opposes motion; check the plugs, sign and sensitivity",
    "force-scale": "check move: the load cell showed a damper force of {force_N:.3g} N, but the controller showed "
    "{own_N:.3g} N; check the plugs, sign and sensitivity",
    "no-proof-move": "the actuator did not perform the check move",
    # Against the first session
    "no-signature": "the damper's force at 0 A could not be measured",
    "other-signature": "force at 0 A: {now}; in the campaign's first session: {first}",
    "stronger-damper": "force at 0 A: {now}, predicted for the expected damper: {expected}. The plan is not valid for "
    "this damper; mount the correct damper, or correct the specimen's `prior`",
    "other-device": "{device}: {name} is {now!r}, but was {first!r} in the campaign's first session",
    "no-coil-temperature": "the ECU does not report a coil temperature",
    "too-hot-to-resume": "the coil is at {now_degC:.1f} degC; earlier sessions ran at {lowest_degC:.1f} to "
    "{highest_degC:.1f} degC, and the campaign can be resumed at {from_degC:.1f} to {to_degC:.1f} degC: let the damper "
    "cool, then resume",
    "too-cold-to-resume": "the coil is at {now_degC:.1f} degC; earlier sessions ran at {lowest_degC:.1f} to "
    "{highest_degC:.1f} degC, and the campaign can be resumed at {from_degC:.1f} to {to_degC:.1f} degC: warm the room "
    "or the damper, then resume",
    # Preparing and running points
    "still-cold": "the coil is at {now_degC:.1f} degC after {warmed_s:.0f} s of warm-up; the temperature window starts "
    "at {low_degC:g} degC",
    "never-cool": "the coil is at {now_degC:.1f} degC and does not cool to {highest_degC:.1f} degC unaided",
    "cool-too-late": "the coil is at {now_degC:.1f} degC and needs {forecast_s:.0f} s to cool to {highest_degC:.1f} "
    "degC, longer than [temperature] longest allows",
    "cooling-overdue": "the damper did not cool within twice the predicted time",
    "no-temperature": "the ECU does not report a temperature",
    "no-negative-current": "the measured current does not follow the demagnetising sequence, which requires an ECU "
    "that drives currents of both signs",
    "current-not-settled": "the measured current did not reach {wanted_A:g} A in {limit_s:g} s",
    "current-not-zero": "the measured current did not return to 0 A",
    "no-full-cycle": "the trial motion did not contain a full cycle",
    "ended-by-another": "{point}: another master ended the motion ({how})",
    "program-overdue": "the motion program did not finish in time",
    "centre-overdue": "the actuator did not reach the centre",
    "rest-overdue": "the controller's clock does not advance",
    "standstill-overdue": "the actuator did not come to rest",
    "pause-overdue": "paused for {hours:g} h: pressure off",
    "unanswered": "{phase}: the station did not send a confirmation in time",
    # The rig software's own
    "finaliser-ended": "the file-writing process has ended; `rig recover` completes the files",
    "file-unfinished": "the point's file is not finished; `rig recover` or resuming the campaign completes it",
    "records-lost": "number of records overwritten before they were read: {count}",
    "station-silent": "the station has been inactive for at least {silent_s:g} s",
    "no-status": "no status from the controller for {silent_s:g} s",
    # Notes of the sequencer
    "paused": "paused before {point}",
    "page-stop": "Stop requested on the page by {by}",
    "operator-stop": "stopped by operator ({detail}): current to 0 A, motion ramps down",
    "stop": "{slug}: {detail}; stop {stop}: current to 0 A, end of motion",
    "refused": "refused: {slug}: {detail}",
    "spoiled": "{slug}: {detail}",
    "ask-current": "Set {wanted_A:.2f} A on the supply, then press Enter",
    "ask-zero": "Set 0 A on the supply and switch its output off, then press Enter",
    "set-by-hand": "{said_A:.2f} A set manually, confirmed by the operator",
    "current-left": "the operator did not confirm that the current was switched off, so current may still be flowing. "
    "Go to the supply and switch its output off",
    "by-hand-unanswered": "the operator was asked to set {wanted_A:g} A but did not confirm within {limit_s:g} s",
    "cooling-ecu": "waiting for the ECU to cool down: {cooled_s:g} s of at most {longest_s:g} s",
    "left-to-station": "no further commands are sent; the station's monitoring and the controller's watchdog stop the "
    "motion: {detail}",
    "state-unknown": "the rig's state is unknown: {detail}",
    "hydraulics-on": "the rig is at rest at 0 A, but its hydraulics could not be switched off: {detail}",
    "warming": "warming up from {from_degC:.1f} degC: {planned_s:.0f} s of motion",
    "cooling": "{point}: cooling down from {from_degC:.1f} to {to_degC:.1f} degC, about {planned_s:.0f} s on the rig's "
    "clock",
    "endurance-ended": "endurance test {test} ends after {cycles} cycles: the stop rule {rule} was reached",
    # Compensation of the amplitude
    "cannot-reach": "{reached_mm:.4g} mm of {wanted_mm:.4g} mm reached ({off:+.1f} %), centre off by {aside_mm:+.3f} "
    "mm, with a command of {command_mm:.4g} mm: {why}",
    "machine-cannot": "machine limit: {why}",
    "within-tolerance": "{point}: {reached_mm:.4g} mm of {wanted_mm:.4g} mm reached; within tolerance",
    "corrected": "{point}: {reached_mm:.4g} mm of {wanted_mm:.4g} mm reached; correction {step}: command "
    "{command_mm:.4g} mm",
    "no-motion": "no motion",
    "not-within": "still outside the tolerance of {percent:g} % after {steps} corrections",
    "beyond-room": "a command of {command_mm:.4g} mm about a centre of {centre_mm:.4g} mm would be needed, beyond "
        "{limit}",
    "beyond-shift": "the centre would have to be moved by {wanted_mm:.4g} mm, but only {allowed_mm:.4g} mm is allowed",
    "valve-saturated": "the valve is saturated: this speed requires more flow than the valve can pass",
    "no-answer": "the motion does not follow a larger command (following error up to {error_mm:.3g} mm)",
    # Iteration of the command of a signal
    "identifying": "{point}: identifying the response of the machine with noise",
    "response-identified": "{point}: response identified: coherent at {band}, delay {delay_ms:.3g} ms",
    "kept-drive": "{point}: the iteration starts from a stored command",
    "iterated": "{point}: iteration {number}: RMS error {percent:.3g} % of the target, delay {delay_ms:.3g} ms",
    "converged": "{point}: iteration {number}: RMS error {percent:.3g} % of the target, delay {delay_ms:.3g} ms; "
    "within tolerance",
    "iteration-ended": "{point}: {why}",
    "no-command": "no command could be calculated from the trial",
    "no-rod": "the trial was not recorded completely, so no command could be calculated from it",
    "command-overdue": "the next command was not calculated in time",
    "drive-not-kept": "{file}: the command and its errors could not be stored: {error}; the iteration continues",
    # What the operator reads beside the points
    "resume-confirms": "by resuming you confirm that the following was checked and fixed: {text}",
    "resuming": "resuming: {kept} points kept, {left} to run",
    "without-options": "the simulated rig is being started without these options of the previous session: {names}",
    "requalified": "requalified: {text}",
    "at-the-end": "at the end of the campaign: {error}",
    "pause-asked": "the campaign will pause after the current point; continue with Ctrl-Z in the terminal or with "
    "Resume on the page",
    "pause-over": "continuing",
    "clock-step": "the system time changed by {stepped_s:+.3f} s; recorded times (host_ns) are not affected",
    "station-late": "this computer was busy: monitoring paused for {late_ms:.0f} ms (pause {count}); queued samples "
    "are flagged",
    "points-files": "point files: {error}; `rig recover` completes the files",
    "verdict-changed": "{point}: {before} by itself, {after} with all points combined: {why}",
    "no-doubt": "no doubt is left",
    "own-skews": "the points keep their individual sensor delays: {why}",
    "recorder-left": "recorder: {error}; `rig recover` completes the files",
    "dropped": "the motion was out of tolerance; the record is kept as {kept} and the point is repeated",
    "rig-goes-on": "the simulated rig is still running (process {process}){why}",
    "drifted-apart": "the difference between {measured} and {own} at rest drifted by {drift:+.3g} {unit} between start "
    "and end (limit {limit:.3g} {unit}, largest measured {peak:.4g} {unit}): one of the two zeros drifted; check "
    "the cable, mounting and temperature of both sensors, tare both, and repeat the tests",
    "current-measured": "the coil current is still on: {left_A:.3g} A measured, 0 A expected; disconnect the coil's "
    "supply, then inspect the rig",
    "force-left": "0 A could not be measured after the stop, and the force at rest changed from {start:.4g} N to "
    "{end:.4g} N (limit {limit:.3g} N): current may still be flowing in the coil; disconnect the coil's supply, then "
    "check the current source and its connection",
    # Text from elsewhere: a device, the station, an exception
    "said": "{text}",
}
EXCHANGED = {
    "plugs": "the load cell and the LVDT are interchanged: swap their plugs",
    "force-sign": "the load cell's sign is wrong",
    "lvdt-sign": "the LVDT's sign is wrong",
}
ADVICE = {
    "rest-value": "; tare the sensor or check the sensor's cable",
    "force-zero": "; one of the two readings has an offset: tare the load cell and the controller's input, "
    "or set [checks] force_zero in the bench file",
    "current-zero": "; the ECU does not measure zero at 0 A: zero its current measurement, or set [checks] "
    "current_zero in the bench file",
    "rest-position": "; move the rod manually, or tare the sensor",
}
"""What to do, unless swapped sensors are the cause."""


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
    return errors.clean_text(MESSAGES[name].format(**values, advice=advice))
