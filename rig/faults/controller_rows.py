"""The actuator controller and its link: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="modbus-busy", fault="Modbus exception 06",
        where="wire", place="modbus", detected_by="limited number of retries",
        limit_s=0.15, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=30, detector="the controller is still busy after the last retry",
    ),
    FaultRow(
        slug="modbus-reject", fault="Exception 02/03/04 on write",
        where="wire", place="modbus", detected_by="no positive acknowledgement",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=31, detector="the controller rejected a write or a command while armed",
    ),
    FaultRow(
        slug="modbus-reset", fault="TCP reset during a response",
        where="wire", place="modbus", detected_by="the outcome is unknown: read back before sending again",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=32, detector="the connection to the controller was lost",
    ),
    FaultRow(
        slug="modbus-halfopen", fault="Half-open TCP connection",
        where="wire", place="modbus", detected_by="request deadline",
        limit_s=0.2, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=33, detector="two consecutive time-outs, or no status within stale_after",
    ),
    FaultRow(
        slug="modbus-wrong-tid", fault="Wrong transaction number",
        where="wire", place="modbus",
        detected_by="the first such answer is discarded; the second one causes a reconnection",
        limit_s=0.1, reaction="W", end=Ending.WARN, disk="J", resume="a",
        code=55, detector="answers with the transaction number of another request were discarded",
    ),
    FaultRow(
        slug="rtu-stale", fault="Late RTU answer without a transaction number",
        where="wire", place="rtu",
        detected_by="after a time-out, the line is drained and the effect of the request is verified",
        limit_s=0.2, reaction="P", end=Ending.INVALID, disk="J", resume="a",
        code=56, detector="late answers to an earlier request on the serial line were discarded",
    ),
    FaultRow(
        slug="rtu-crc", fault="RTU answer truncated, too long or with a wrong CRC",
        where="wire", place="rtu", detected_by="strict check of each frame; only reads are retried",
        limit_s=0.15, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=57, detector="answers were truncated or too long, or had a wrong checksum, in three consecutive polls",
    ),
    FaultRow(
        slug="modbus-mismatch", fault="Wrong unit, function or count",
        where="wire", place="modbus", detected_by="comparison with the request",
        limit_s=0.05, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=8, detector="answers did not match the request in three consecutive polls",
    ),
    FaultRow(
        slug="modbus-write-lost", fault="Write acknowledged, but register unchanged",
        where="wire", place="controller", detected_by="read-back and motion",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=29, detector="three consecutive status readings do not return the written counter or the stop command",
    ),
    FaultRow(
        slug="actuator-frozen", fault="Position register frozen",
        where="wire", place="controller", detected_by="heartbeat of the controller, disagreement with the LVDT",
        limit_s=0.1, reaction="SO", end=StopKind.HALT, disk="J", resume="c",
        code=34, detector="the controller's heartbeat or position does not change while time passes or the LVDT moves",
    ),
    FaultRow(
        slug="actuator-reboot", fault="Controller restarted with default settings",
        where="wire", place="controller", detected_by="boot counter, configuration hash",
        limit_s=0.05, reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=36,
        detector="the controller's clock ran backwards, its lease was lost, or its boot count or configuration changed",
    ),
    FaultRow(
        slug="host-silent", fault="Host stops refreshing the watchdog",
        where="process", place="silence", detected_by="the controller latches the trip",
        limit_s=0.5, reaction="controller S2", end=StopKind.FADE_OUT, disk="J/K", resume="c",
        code=39,
        detector="the controller's watchdog tripped, or the station was paused for longer than the time-out",
    ),
    FaultRow(
        slug="watchdog-absent", fault="Watchdog disabled or set to freeze",
        where="wire", place="controller", detected_by="deliberate triggering of the watchdog before each campaign",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="second-master", fault="Second Modbus master",
        where="wire", place="controller", detected_by="unexpected set-point or owner",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=37, detector="the controller's lease is held by another host, or another command has the number of this "
            "host's stop command",
    ),
    FaultRow(
        slug="stop-ignored", fault="Stop ignored",
        where="wire", place="controller", detected_by="LVDT velocity after the ramp",
        limit_s=0.1, occasion="ramp+", reaction="S1→trip", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=42, detector="the program continues past its end, or the rod does not stop within the stop's deadline",
    ),
    FaultRow(
        slug="setpoints-late", fault="Streamed set-points late",
        where="wire", place="modbus", detected_by="delay of each set-point",
        limit_s=0.2, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=66,
        detector="three set-points in a row or five out of a hundred were too late, or no set-point was accepted for "
            "too long",
    ),
    FaultRow(
        slug="setpoints-lost", fault="Streamed set-points not followed",
        where="wire", place="controller",
        detected_by="the device's own set-point, or the following error if it reports none",
        limit_s=0.15, reaction="SO", end=StopKind.HALT, disk="J", resume="c",
        code=67,
        detector="the device's own set-point or the rod position was too far from the commanded set-point three "
                 "times in a row",
    ),
    FaultRow(
        slug="hybrid-unstable", fault="Hybrid test diverges or does not track",
        where="process", place="process",
        detected_by="energy error and bounds of the computed motion, checked at each step",
        occasion="next step", reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=68,
        detector="the delay, computed motion or energy error of a hybrid test exceeds its bound, or there is no new "
            "force value",
    ),
    FaultRow(
        slug="register-layout", fault="Wrong word order or scale",
        where="wire", place="controller", detected_by="signature register",
        occasion="connect", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
)
