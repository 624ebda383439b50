"""The actuator controller and its link: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="modbus-busy", fault="Modbus exception 06",
        where="wire", place="modbus", detected_by="bounded retries",
        limit_s=0.15, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=30, detector="controller answers busy beyond the bounded retries",
    ),
    FaultRow(
        slug="modbus-reject", fault="Exception 02/03/04 on write",
        where="wire", place="modbus", detected_by="no positive ack",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=31, detector="controller refused a write or command while armed",
    ),
    FaultRow(
        slug="modbus-reset", fault="RST mid-response",
        where="wire", place="modbus", detected_by="outcome unknown: read back before resend",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=32, detector="connection to the controller ended",
    ),
    FaultRow(
        slug="modbus-halfopen", fault="Half-open TCP: blackhole",
        where="wire", place="modbus", detected_by="request deadline",
        limit_s=0.2, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=33, detector="second time-out in a row, or no status within its stale-after",
    ),
    FaultRow(
        slug="modbus-wrong-tid", fault="Wrong transaction id",
        where="wire", place="modbus", detected_by="discard; reconnect at second",
        limit_s=0.1, reaction="W", end=Ending.WARN, disk="J", resume="a",
        code=55, detector="answers with the transaction number of another request, discarded",
    ),
    FaultRow(
        slug="rtu-stale", fault="Stale RTU reply (no id)",
        where="wire", place="rtu", detected_by="drain after timeout; verify effect",
        limit_s=0.2, reaction="P", end=Ending.INVALID, disk="J", resume="a",
        code=56, detector="late answers to an earlier request on the serial line, discarded",
    ),
    FaultRow(
        slug="rtu-crc", fault="RTU CRC, truncated, extra bytes",
        where="wire", place="rtu", detected_by="strict frame; retry reads only",
        limit_s=0.15, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=57, detector="answers truncated, too long or with a wrong checksum, three polls in a row",
    ),
    FaultRow(
        slug="modbus-mismatch", fault="Wrong unit/function/count",
        where="wire", place="modbus", detected_by="match against request",
        limit_s=0.05, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=8, detector="answers that match no request, three polls in a row",
    ),
    FaultRow(
        slug="modbus-write-lost", fault="Write acked, register unchanged",
        where="wire", place="controller", detected_by="readback plus motion",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=29, detector="written counter or stop command not read back, three statuses in a row",
    ),
    FaultRow(
        slug="actuator-frozen", fault="Position register frozen",
        where="wire", place="controller", detected_by="controller heartbeat, LVDT disagreement",
        limit_s=0.1, reaction="SO", end=StopKind.HALT, disk="J", resume="c",
        code=34, detector="controller heartbeat or position unchanged while time or LVDT advance",
    ),
    FaultRow(
        slug="actuator-reboot", fault="Controller reboot, defaults",
        where="wire", place="controller", detected_by="boot counter, config hash",
        limit_s=0.05, reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=36, detector="controller clock went back, lease lost, boot count or configuration changed",
    ),
    FaultRow(
        slug="host-silent", fault="Host stops refreshing the watchdog",
        where="process", place="silence", detected_by="controller latches trip",
        limit_s=0.5, reaction="controller S2", end=StopKind.FADE_OUT, disk="J/K", resume="c",
        code=39, detector="controller's watchdog tripped, or the station did not run for as long",
    ),
    FaultRow(
        slug="watchdog-absent", fault="Watchdog disabled or 'freeze'",
        where="wire", place="controller", detected_by="trigger it before each campaign",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="second-master", fault="Second Modbus master",
        where="wire", place="controller", detected_by="setpoint/owner mismatch",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=37, detector="controller's lease is held by another host, or another command has the number of this "
            "host's stop",
    ),
    FaultRow(
        slug="stop-ignored", fault="Stop ignored",
        where="wire", place="controller", detected_by="LVDT velocity after ramp",
        limit_s=0.1, occasion="ramp+", reaction="S1→trip", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=42, detector="program continues past its end, or no standstill within the stop's deadline",
    ),
    FaultRow(
        slug="setpoints-late", fault="Streamed set-points late",
        where="wire", place="modbus", detected_by="lateness of each step",
        limit_s=0.2, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=66, detector="three set-points in a row, or five of a hundred, too late; or none accepted for longer",
    ),
    FaultRow(
        slug="setpoints-lost", fault="Streamed set-points not followed",
        where="wire", place="controller", detected_by="device's set-point, else following error",
        limit_s=0.15, reaction="SO", end=StopKind.HALT, disk="J", resume="c",
        code=67, detector="device's own set-point, or the rod, three times in a row too far from the set-point sent",
    ),
    FaultRow(
        slug="hybrid-unstable", fault="Hybrid test does not track, or diverges",
        where="process", place="process", detected_by="energy error, bounds of the computed motion, each step",
        occasion="next step", reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=68,
        detector="hybrid test: delay, computed motion or energy error beyond its bounds, or no new force value",
    ),
    FaultRow(
        slug="register-layout", fault="Word order/scale wrong",
        where="wire", place="controller", detected_by="signature register",
        occasion="connect", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
)
