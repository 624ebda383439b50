"""The world of every row of the fault matrix: what goes wrong in it, and how what comes of it is judged.

All run at speed 1 with the time limits of hardware, on one short point. A row that is not named here is a fault of the
devices, `FAULT_S` after the first cycle began, or there from the start where the row is refused.
"""

from __future__ import annotations

import errno
import signal
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from end_states import assert_never_moved, assert_no_current, assert_still
from matrices import HYBRID, ONE_LONG_POINT, ONE_POINT
from scenario_campaign import ScenarioCampaign, Setting
from watched_campaign import Ending

from protocols.quality import Quality
from rig.bench.model import Bench
from rig.faults.matrix import MATRIX
from rig.faults.row import Ending as Reaction
from rig.recording.conversion.recovery import recover

FAULT_S = 0.4
POINT_S = 2.0
"""The point's motion, from the start command to standstill."""
PERIOD_S = 0.25
ONCE = Setting(matrix=ONE_POINT, speed=1.0, real_time=True)
SLEPT_S = 3600.0

Around = Callable[[ScenarioCampaign], None]
Check = Callable[[ScenarioCampaign, Ending], None]


def nothing(*_: object) -> None:
    """Nothing is done, nothing more is asked."""


@dataclass(frozen=True)
class RowScenario:
    """A row's world.

    Attributes:
        setting: what the campaign begins with.
        around: what happens around its devices, while the point moves.
        begins: what is waited for before that.
        check: in place of what the row's reaction asks for.
        also: what must be true beside it.
        allowed_s: from the fault to the stop command, where the row counts from something else.
        settling_s: from the stop command to standstill, where it is not the fade-out's.
        named: what the program calls it, where a row has another name.
    """

    setting: Setting = ONCE
    around: Around | None = None
    begins: Around = ScenarioCampaign.move
    check: Check | None = None
    also: Check = nothing
    allowed_s: float | None = None
    settling_s: float | None = None
    named: str = ""


def scenario_of(slug: str) -> RowScenario:
    """The world of a row."""
    if slug in ROW_SCENARIOS:
        return ROW_SCENARIOS[slug]
    return RowScenario(faulty(slug if MATRIX[slug].end is Reaction.REFUSE else f"{slug}@{FAULT_S}"))


def faulty(fault: str, *more: str) -> Setting:
    """A setting whose devices have a fault."""
    return replace(ONCE, simulator=("--fault", fault, *more))


def sent(number: int) -> Around:
    """The application gets a signal."""
    return lambda campaign: campaign.send(number)


# What happens around the devices


def storm(campaign: ScenarioCampaign) -> None:
    """Ctrl-C, and again and again while the rig is stopped and its pressure taken away."""
    campaign.send(signal.SIGINT)
    for code in ("FADE_STOP", "HYDRAULICS_OFF"):
        campaign.wait_for(code)
        for _ in range(5):
            campaign.send(signal.SIGINT)


def stalled(campaign: ScenarioCampaign) -> None:
    """The application does not run until the station has stopped the rig."""
    campaign.send(signal.SIGSTOP)
    campaign.wait_for("FADE_STOP")
    campaign.send(signal.SIGCONT)


def silent(campaign: ScenarioCampaign) -> None:
    """The station does not run until the controller's watchdog has tripped a second time: the preflight starved it."""
    campaign.send(signal.SIGSTOP, "rig.station")
    campaign.wait_for("TRIP", "WATCHDOG", count=2)
    campaign.send(signal.SIGCONT, "rig.station")


def late(campaign: ScenarioCampaign) -> None:
    """The station does not run for somewhat longer than it may."""
    bench = Bench.load(campaign.campaign_folder / "bench.toml")
    campaign.hold("rig.station", 1.3 * bench.station.late_limit_s)


def slept(campaign: ScenarioCampaign) -> None:
    """The machine slept; its monotonic clock did not go on meanwhile."""
    campaign.stage.machine.suspended_ns += int(SLEPT_S * 1e9)


def stepped(campaign: ScenarioCampaign) -> None:
    """The wall clock is set back by a day."""
    campaign.stage.machine.wall_step_s -= 86_400.0


def disk_full(campaign: ScenarioCampaign) -> None:
    """The disk takes no further byte."""
    campaign.stage.disk.refuses = errno.ENOSPC


def flush_fails(campaign: ScenarioCampaign) -> None:
    """No flush succeeds."""
    campaign.stage.disk.flush_fails = True


def disk_stalls(campaign: ScenarioCampaign) -> None:
    """No write gets through for a while; the ring is smaller than what comes meanwhile."""
    campaign.stage.disk.stalled_until_ns = campaign.now_ns + 400_000_000


def thread_dies(campaign: ScenarioCampaign) -> None:
    """A thread of the station ends by an error that nobody expects."""
    campaign.kill_thread("rig.station", "load_cell")


# What must be true


def stays_latched(_: ScenarioCampaign, ending: Ending) -> None:
    """The e-stop chain: the rod stands within 300 ms of its opening."""
    assert_still(ending.truth, ending.truth.first("FAULT", text="estop").time_s + 0.3)


def nothing_was_taken(_: ScenarioCampaign, ending: Ending) -> None:
    """Refused before the controller was taken."""
    assert not ending.truth.all("ACQUIRE")


def nothing_was_written(_: ScenarioCampaign, ending: Ending) -> None:
    """Refused before anything was written to the controller."""
    assert [line.code for line in ending.truth.log] == ["FAULT"]


def not_sent_twice(_: ScenarioCampaign, ending: Ending) -> None:
    """No command was executed twice."""
    assert len(ending.truth.all("START")) == 1


def recovered(campaign: ScenarioCampaign, ending: Ending) -> None:
    """The running point has no file; its journal recovers to an invalid one with samples."""
    assert ending.answer["points"][0]["file"] is None
    points = campaign.do(lambda: recover(ending.folder))
    assert [(point.id, point.verdict, point.error) for point in points] == [("p001", "invalid", "")]
    assert np.ptp(ending.point("p001").displacement_m) > 0.03


def joint_is_noticed(_: ScenarioCampaign, ending: Ending) -> None:
    """Within the cycle it happened in and one more."""
    loose, fade = ending.truth.first("FAULT"), ending.truth.first("FADE_STOP")
    assert fade.time_s - loose.time_s <= 2 * PERIOD_S + 0.2


def current_stays(campaign: ScenarioCampaign, ending: Ending) -> None:
    """0 A is commanded at the point's end, the current stays: pressure off, state unknown; the point is valid."""
    truth = ending.truth
    assert ending.exit_code == MATRIX["current-stuck"].exit_code == 7, ending.output
    assert ending.trips() == [("current-stuck", "S1")]
    assert_current_is_named(ending, truth.current_A[-1])
    stop = ending.answer["stop"]
    assert (stop["proved"], stop["current_zero"], stop["pressure_off"]) == (True, False, True)
    zero = truth.first("SET_CURRENT", text="0.000", after=truth.first("FAULT"))
    stop = truth.first("FADE_STOP", after=zero)
    assert (stop.host_ns - zero.host_ns) / 1e9 <= within_s("current-stuck")
    off = truth.first("HYDRAULICS_OFF", text="DONE", after=stop)
    assert truth.current_A[truth.since(off.time_s)].min() > 1.0, "the fault: current flows on, whatever is commanded"
    assert_still(truth, off.time_s + 0.3)
    assert_pressure_off(campaign)
    assert ending.verdicts() == {"p001": "valid"}


def assert_current_is_named(ending: Ending, current_A: float) -> None:
    """The state is unknown, and the current that still flows is named."""
    assert ending.answer["rig_state"] == "unknown"
    (left,) = ending.answer["findings"]
    assert left["slug"] == "current-left"
    assert left["values"]["measured"] == pytest.approx(current_A, abs=0.05)


def left_as_it_was(campaign: ScenarioCampaign, ending: Ending) -> None:
    """Refused by name before anything was set or taken: the current that nobody here can take away is not increased."""
    truth = ending.truth
    assert ending.exit_code == MATRIX["supply-not-zero"].exit_code == 7, ending.output
    assert ending.answer["stopped_by"] == "supply-not-zero"
    assert_current_is_named(ending, truth.current_A[-1])
    assert [line["slug"] for line in ending.log if line["event"] == "refused"] == ["supply-not-zero"]
    assert not truth.all("ACQUIRE", "START")
    assert np.ptp(truth.displacement_m) <= 1e-6
    assert 0.25 < truth.current_A[-1] <= truth.current_A.max() < 0.35, "the fault"
    assert_pressure_off(campaign)


def stops_without_set_points(campaign: ScenarioCampaign, ending: Ending) -> None:
    """No stop command, and no set-point over a link so slow that the measured rod may have stopped meanwhile."""
    truth = ending.truth
    assert ending.exit_code == 4, ending.output
    assert ending.trips() == [("setpoints-late", "S2")]
    assert ending.answer["rig_state"] == "safe"
    fault = truth.first("FAULT")
    sent_ns = next(line["t_ns"] for line in ending.log if line.get("what") == "sent")
    assert (sent_ns - fault.host_ns) / 1e9 <= within_s("setpoints-late")
    fade_s = fault.time_s + (sent_ns - fault.host_ns) / 1e9
    assert not truth.all("FADE_STOP", "HALT")
    assert_still(truth, fade_s + 0.3)
    assert np.abs(truth.displacement_m[truth.since(fault.time_s)]).max() < 0.021, "no farther than the sine's 20 mm"
    assert_no_current(truth, truth.first("SET_CURRENT", text="0.000", after=fault).time_s)
    assert_pressure_off(campaign)
    assert ending.verdicts() == {"p001": "invalid"}
    counts = ending.answer["setpoints"]
    assert counts["late"] >= 3
    assert counts["steps"] >= counts["late"] + counts["skipped"] // 2
    assert 0.01 < counts["worst_s"] < 0.1


def servo_slows(campaign: ScenarioCampaign) -> None:
    """On the road of a hybrid test the actuator follows ten times as late: cold oil, a worn valve."""
    campaign.run_on(0.6)
    campaign.stage.rig.plant.constants["servo_rad_s"][0] *= 0.1


def hybrid_test_is_ended(campaign: ScenarioCampaign, ending: Ending) -> None:
    """Its own watch ends it by what following late brings into the car; the set-points end in a halt."""
    truth = ending.truth
    assert ending.exit_code == 4, ending.output
    assert ending.trips() == [("hybrid-unstable", "S2")]
    assert ending.answer["rig_state"] == "safe"
    assert ending.stopped_from_ns is not None
    (trip,) = (line for line in ending.log if line.get("what") == "trip")
    took_s = (trip["t_ns"] - ending.stopped_from_ns) / 1e9
    assert 0.0 < took_s < 1.5, (took_s, trip["detail"])
    zero = truth.all("SET_CURRENT", text="0.000")[-1]
    assert (zero.host_ns - trip["t_ns"]) / 1e9 < 0.1
    assert_still(truth, zero.time_s + 0.4)
    assert_no_current(truth, zero.time_s)
    assert_pressure_off(campaign)
    assert ending.verdicts() == {"hybrid-model": "invalid"}


def program_runs_on(campaign: ScenarioCampaign, ending: Ending) -> None:
    """Not over when it should be: stopped by command, and as that is ignored too, by taking the pressure away."""
    truth = ending.truth
    assert ending.exit_code == 4, ending.output
    assert ending.trips() == [("stop-ignored", "S1")]
    assert ending.answer["rig_state"] == "safe"
    over_s = truth.first("START").time_s + POINT_S
    fade, off = truth.first("FADE_STOP"), truth.first("HYDRAULICS_OFF")
    assert over_s <= fade.time_s <= over_s + within_s("stop-ignored")
    assert fade.time_s + PERIOD_S <= off.time_s
    assert_still(truth, off.time_s + 0.3)
    assert_no_current(truth, fade.time_s)
    assert_pressure_off(campaign)
    assert ending.verdicts() == {"p001": "invalid"}


AT_ONCE_S = 0.1


def stops_without_its_application(campaign: ScenarioCampaign, ending: Ending) -> None:
    """Killed: the station stops the rig by itself, and what was flushed is an invalid point."""
    truth = ending.truth
    assert ending.exit_code == -signal.SIGKILL
    stop, zero = truth.first("FADE_STOP"), truth.all("SET_CURRENT", text="0.000")[-1]
    assert ending.stopped_from_ns is not None
    stopped_s = (stop.host_ns - ending.stopped_from_ns) / 1e9
    assert stopped_s <= min(within_s("sigkill"), AT_ONCE_S), "by the link's end, not by a heart that beats no more"
    assert_no_current(truth, zero.time_s)
    assert_still(truth, stop.time_s + PERIOD_S + 0.2)
    assert_pressure_off(campaign)
    campaign.do(lambda: recover(ending.folder))
    broken = ending.point("p001")
    assert (broken.verdict, broken.quality.recovered) == ("invalid", True)
    assert broken.reasons[0].startswith("INTERRUPTED")
    assert np.ptp(broken.displacement_m) > 0.035, "what was flushed before the kill is there"


def spikes_are_flagged(ending: Ending, point: str = "p001", channel: str = "force") -> None:
    """The single ones before the stop too, among the samples as they came."""
    assert "sensor-spike" in ending.warned()
    raw = ending.point(point).raw(channel)
    assert raw is not None
    assert (raw["flags"] & Quality.SPIKE).astype(bool).sum() >= 3


def step_is_logged(_: ScenarioCampaign, ending: Ending) -> None:
    """Logged within a second with its size, and nothing else happens."""
    assert ending.exit_code == 0, ending.output
    lines = [line for line in ending.log if line.get("slug") == "clock-step"]
    assert [round(line["stepped_s"]) for line in lines] == [-86_400]
    assert ending.stopped_from_ns is not None
    assert (lines[0]["host_ns"] - ending.stopped_from_ns) / 1e9 <= within_s("clock-step")
    assert not ending.trips()
    assert ending.verdicts() == {"p001": "valid"}


def nothing_was_touched(_: ScenarioCampaign, ending: Ending) -> None:
    """Refused by name before anything was connected."""
    assert_never_moved(ending.truth)
    assert not ending.truth.log
    assert not ending.folder.exists() or not list(ending.folder.iterdir())


def second_is_refused(campaign: ScenarioCampaign, ending: Ending) -> None:
    """Undisturbed, whatever the other one tried."""
    assert ending.exit_code == 0, ending.output
    assert ending.verdicts() == {"p001": "valid"}
    assert len(ending.truth.all("START")) == 1
    assert_pressure_off(campaign)


def second_instance(campaign: ScenarioCampaign) -> None:
    """Another campaign on the same rig."""
    other = campaign.out.with_name("other")
    other.mkdir()
    code, answer = campaign.another(out=other, bench_path=campaign.out.with_name("bench.toml"))
    assert (code, answer.get("slug")) == (MATRIX["two-instances"].exit_code, "two-instances")


def changed_matrix_is_refused(campaign: ScenarioCampaign, ending: Ending) -> None:
    """A campaign whose matrix was changed is not resumed; nothing is connected."""
    matrix = ending.folder / "matrix.toml"
    matrix.write_text(matrix.read_text(encoding="utf-8").replace('"20 mm"', '"25 mm"'), encoding="utf-8")
    code, answer = campaign.resumed()
    assert (code, answer.get("slug")) == (MATRIX["matrix-changed"].exit_code, "matrix-changed")
    assert not campaign.stage.rig.plant.command["pressure"][0]


def assert_pressure_off(campaign: ScenarioCampaign) -> None:
    """In truth, not by what the controller says."""
    assert campaign.stage.rig.plant.command["pressure"][0] == 0


COARSE_S = 0.025
"""What a world's devices hand over late (5 ms) and the slowest of them says seldom (20 ms), on top of a row's time."""


def within_s(slug: str) -> float:
    """The row's time in a world."""
    limit_s = MATRIX[slug].limit_s
    return COARSE_S + (0.1 if limit_s is None else limit_s)


ALONE_HYBRID = replace(
    ONCE, simulator=("--actuator", "setpoints"), matrix=HYBRID.replace('"model", "ats"', '"model"')
)
NO_FOLDER = replace(ONCE, out="matrix.toml/runs")
BEYOND = replace(ONCE, matrix=ONE_POINT.replace('"20 mm"', '"90 mm"'))

ROW_SCENARIOS: dict[str, RowScenario] = {
    "modbus-reset": RowScenario(faulty(f"modbus-reset@{FAULT_S}"), also=not_sent_twice),
    "register-layout": RowScenario(faulty("register-layout"), also=nothing_was_written),
    "stop-ignored": RowScenario(faulty(f"stop-ignored@{FAULT_S}"), check=program_runs_on),
    "host-silent": RowScenario(around=silent),
    "setpoints-late": RowScenario(faulty(f"setpoints-late@{FAULT_S}"), check=stops_without_set_points),
    "hybrid-unstable": RowScenario(
        ALONE_HYBRID, around=servo_slows, begins=ScenarioCampaign.on_the_road, check=hybrid_test_is_ended
    ),
    "current-stuck": RowScenario(faulty(f"current-stuck@{FAULT_S}"), check=current_stays),
    "supply-not-zero": RowScenario(faulty("supply-not-zero", "--supply", "generic-scpi"), check=left_as_it_was),
    # Three polls, each behind two waits for what the devices hand over in a world.
    "rtu-crc": RowScenario(faulty(f"rtu-crc@{FAULT_S}"), allowed_s=0.19),
    # Two single spikes come first, which only warn.
    "sensor-spike": RowScenario(
        faulty(f"sensor-spike@{FAULT_S}"), also=lambda _, ending: spikes_are_flagged(ending), allowed_s=0.8
    ),
    "clock-drift": RowScenario(replace(faulty("clock-drift"), matrix=ONE_LONG_POINT)),
    "slow-consumer": RowScenario(replace(ONCE, ring_records=512), around=disk_stalls),
    "usb-renumber": RowScenario(faulty(f"usb-renumber@{FAULT_S}", "--ports", "by-id")),
    "sensors-swapped": RowScenario(faulty("sensors-swapped"), also=nothing_was_taken),
    "not-tared": RowScenario(faulty("not-tared"), also=nothing_was_taken),
    "sigint": RowScenario(around=sent(signal.SIGINT)),
    "sigint-storm": RowScenario(around=storm, named="sigint"),
    "sigterm": RowScenario(around=sent(signal.SIGTERM)),
    "sigkill": RowScenario(around=sent(signal.SIGKILL), check=stops_without_its_application),
    "host-stalled": RowScenario(around=stalled),
    "host-late": RowScenario(around=late, allowed_s=0.1),
    "host-suspend": RowScenario(around=slept),
    "clock-step": RowScenario(around=stepped, check=step_is_logged),
    "disk-full": RowScenario(around=disk_full, also=recovered),
    "dir-readonly": RowScenario(NO_FOLDER, also=nothing_was_touched),
    "fsync-error": RowScenario(around=flush_fails, also=recovered),
    "two-instances": RowScenario(around=second_instance, check=second_is_refused),
    "task-dies": RowScenario(around=thread_dies),
    "config-absurd": RowScenario(replace(ONCE, bench_edit=("5000 N", "5000 mm")), also=nothing_was_touched),
    "matrix-infeasible": RowScenario(BEYOND, also=nothing_was_touched),
    "matrix-changed": RowScenario(around=sent(signal.SIGINT), check=changed_matrix_is_refused),
    "estop": RowScenario(faulty(f"estop@{FAULT_S}"), also=stays_latched, settling_s=0.3),
    "load-train": RowScenario(faulty(f"load-train@{FAULT_S}"), also=joint_is_noticed, allowed_s=2 * PERIOD_S + 0.2),
}
