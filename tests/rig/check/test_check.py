"""A whole check on rigs with something wrong, in virtual time: the device, the cause and the fix are named."""

from __future__ import annotations

import re
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from scenario_campaign import LONGEST_S, Setting, serve

from drivers.current_source import SourceState
from rig.bench.model import Bench
from rig.check.check import check_bench
from rig.check.finding import CheckFinding, CheckReport
from simulators.scenarios.stage import Stage

EXAMPLES = Path(__file__).parents[3] / "examples"
Change = Callable[[str], str]


def unchanged(bench: str) -> str:
    return bench


def checked(folder: Path, *simulator: str, change: Change = unchanged, prove: bool = False) -> CheckReport:
    """What a check says of a rig with these arguments of `python -m simulators` and this change of its bench file."""
    returned: list[Any] = []
    with Stage(7, folder) as stage:
        path = serve(stage, folder, Setting(simulator, speed=1.0, real_time=True), truth=None)
        path.write_text(change(path.read_text(encoding="utf-8")), encoding="utf-8")
        (folder / "check").mkdir()

        def application() -> None:
            returned.append(check_bench(Bench.load(path), folder / "check", lambda _: None, prove=prove))

        process = stage.machine.start("application", application, stderr=folder / "application.log")
        last_ns = stage.kernel.now_ns + int(LONGEST_S * 1e9)
        stage.kernel.run(lambda: not process.alive or stage.kernel.now_ns > last_ns)
        assert returned, process.errors
        assert stage.at_rest
        assert abs(stage.rig.plant.value("position_m")) < 0.5e-3, "where it was before"
        if not simulator:
            # Off again, or never on where the check ended before; no fault is latched.
            assert stage.rig.ecu.state in {SourceState.OFF, SourceState.INIT}
    report: CheckReport = returned[0]
    return report


def verdicts(report: CheckReport) -> dict[str, str]:
    """Of the devices; a world's machine has no real-time priority to give."""
    return {device.name: device.verdict for device in report.devices if device.name != "host"}


def finding(report: CheckReport, device: str, slug: str) -> CheckFinding:
    findings = next(entry.findings for entry in report.devices if entry.name == device)
    assert slug in [one.slug for one in findings], findings
    return next(one for one in findings if one.slug == slug)


def test_a_healthy_rig_passes_its_watchdog_is_starved_and_nothing_moves(tmp_path: Path) -> None:
    report = checked(tmp_path)
    assert set(verdicts(report).values()) == {"ok"}, report.to_json()
    assert report.passed
    assert not report.proved
    assert finding(report, "host", "no-real-time")
    actuator, ecu, cell, lvdt, host = (device.to_json() for device in report.devices)
    assert [entry["name"] for entry in (actuator, ecu, cell, lvdt, host)] == [
        "actuator", "ecu", "load_cell", "lvdt", "host"]
    assert actuator["rate_Hz"] == pytest.approx(100.0, rel=0.02)
    assert ecu["rate_Hz"] == pytest.approx(100.0, rel=0.001)
    assert cell["rate_Hz"] == pytest.approx(250.0, rel=0.001)
    assert actuator["watchdog_ms"] == pytest.approx(500.0, abs=100.0)
    assert actuator["identity"]["serial_number"] == "SIM-ACT-1"
    # The simulated load cell: noise 5 N, steps of 0.05 N, the demo damper's gas force of -270 N.
    assert cell["noise"] == pytest.approx(5.0, rel=0.2)
    assert cell["resolution"] == pytest.approx(0.05, rel=1e-3)  # 32-bit numbers on its wire
    assert cell["at_rest"] == pytest.approx(-270.0, abs=2.0)
    assert lvdt["noise"] == pytest.approx(5e-6, rel=0.2)
    assert sum(count for _, count in cell["latency_histogram"]) == pytest.approx(750, abs=30)
    assert 0.0 < cell["latency_ms"] < 20.0


def test_swapped_words_are_shown_both_ways_with_the_order_that_fits(tmp_path: Path) -> None:
    report = checked(tmp_path, "--fault", "register-layout")
    seen = finding(report, "actuator", "register-layout")
    # 0x01020304 as two words in the other order is 0x03040102 (docs/wires.md: the signature registers).
    assert "0x03040102" in seen.text
    assert "16909060, signature_f32 1234.5" in seen.text
    assert 'word_order = "little"' in seen.fix
    assert verdicts(report) == {"actuator": "failed", "ecu": "ok", "load_cell": "ok", "lvdt": "ok"}


def test_garbled_bytes_are_called_a_wrong_baud_rate_and_hide_no_other_device(tmp_path: Path) -> None:
    report = checked(tmp_path, "--fault", "serial-baud")
    assert "0 valid samples" in finding(report, "load_cell", "serial-baud").text
    assert verdicts(report)["lvdt"] == "ok"
    assert not report.passed


def test_frames_that_fail_their_checks_are_distinguished_from_a_silent_ecu(tmp_path: Path) -> None:
    report = checked(tmp_path, "--fault", "ecu-crc")
    assert "every frame of CoilStatus has a wrong checksum" in finding(report, "ecu", "ecu-crc").text
    assert "data ID" in finding(report, "ecu", "ecu-crc").fix


def test_a_wrong_data_id_is_named_with_those_that_fit(tmp_path: Path) -> None:
    """The ECU seals its status with 0x2A2; the host is told 0x2A3."""
    dbc, roles, wrong = EXAMPLES / "coil-driver.dbc", EXAMPLES / "coil-driver-roles.toml", tmp_path / "wrong.toml"
    wrong.write_text(roles.read_text(encoding="utf-8").replace("0x2A2", "0x2A3"), encoding="utf-8")
    report = checked(
        tmp_path, "--dbc", str(dbc), "--ecu-roles", str(roles),
        change=lambda bench: bench.replace(str(roles), str(wrong)),
    )
    seen = finding(report, "ecu", "e2e-data-id")
    assert "256 of 65536 data IDs match the frames" in seen.text
    assert "0x2A2 (674)" in seen.text
    assert "E2E data ID differs" in seen.text
    assert "[protection.DriverStatus]" in seen.text
    assert verdicts(report)["load_cell"] == "ok"


def test_commands_that_an_ecu_throws_away_without_a_word_are_found_by_a_small_current(tmp_path: Path) -> None:
    """The ECU wants the commands' data id 0x2A1, is sent 0x2A3, and its roles name no fault for it."""
    dbc, roles, wrong = EXAMPLES / "coil-driver.dbc", tmp_path / "mute.toml", tmp_path / "wrong.toml"
    text = (EXAMPLES / "coil-driver-roles.toml").read_text(encoding="utf-8").replace("command-check = 5\n", "")
    roles.write_text(text, encoding="utf-8")
    wrong.write_text(text.replace("0x2A1", "0x2A3"), encoding="utf-8")
    emulated = ("--dbc", str(dbc), "--ecu-roles", str(roles))
    (tmp_path / "right").mkdir()
    assert checked(tmp_path / "right", *emulated).passed
    (tmp_path / "astray").mkdir()
    seen = finding(
        checked(tmp_path / "astray", *emulated, change=lambda bench: bench.replace(str(roles), str(wrong))), "ecu",
        "ecu-command",
    )
    assert "0.2 A was commanded at rest, but the measured current does not follow" in seen.text
    assert "data ID" in seen.text
    assert "[protection.MESSAGE]" in seen.fix


def test_another_controller_is_refused_by_its_serial_number(tmp_path: Path) -> None:
    def expects_another(bench: str) -> str:
        assert 'serial_number = "SIM-ACT-1"' in bench
        return bench.replace('serial_number = "SIM-ACT-1"', 'serial_number = "ACT-77"')

    seen = finding(checked(tmp_path, change=expects_another), "actuator", "wrong-identity")
    assert "SIM-ACT-1" in seen.text
    assert "ACT-77" in seen.text


def test_a_watchdog_that_does_not_trip_fails_though_nothing_moves(tmp_path: Path) -> None:
    report = checked(tmp_path, "--fault", "watchdog-absent")
    assert "did not trip" in finding(report, "actuator", "watchdog-absent").text
    assert not report.passed


def test_a_reversed_lvdt_at_its_zero_shows_only_when_the_rod_is_moved(tmp_path: Path) -> None:
    wrong = ("--option", "lvdt.reversed=true")
    (tmp_path / "still").mkdir()
    (tmp_path / "moved").mkdir()
    assert checked(tmp_path / "still", *wrong).passed
    moved = checked(tmp_path / "moved", *wrong, prove=True)
    seen = finding(moved, "lvdt", "sensors-swapped")
    assert re.search(r"the LVDT showed -(4|3\.9\d) mm, but the controller moved (4|3\.9\d) mm", seen.text)
    assert 'polarity = "reversed" in [lvdt.calibration]' in seen.fix
    assert moved.proved


def test_a_load_cell_that_reads_the_other_sign_is_named_at_rest(tmp_path: Path) -> None:
    report = checked(tmp_path, "--option", "load_cell.reversed=true")
    assert 'polarity = "reversed" in [load_cell.calibration]' in finding(report, "load_cell", "sensors-swapped").fix
    assert verdicts(report)["lvdt"] == "ok"


def test_a_proved_rig_was_moved_by_2_mm_and_stands_without_pressure_at_the_end(tmp_path: Path) -> None:
    report = checked(tmp_path, prove=True)
    assert report.passed, report.to_json()
    assert report.proved


def test_a_check_that_is_killed_in_its_move_leaves_a_rig_at_rest_without_pressure(tmp_path: Path) -> None:
    with Stage(7, tmp_path) as stage:
        path = serve(stage, tmp_path, Setting(speed=1.0, real_time=True), truth=None)
        (tmp_path / "check").mkdir()
        process = stage.machine.start(
            "application", lambda: check_bench(Bench.load(path), tmp_path / "check", lambda _: None, prove=True) and 0,
            stderr=tmp_path / "application.log",
        )
        stage.kernel.run(lambda: abs(stage.rig.plant.value("velocity_m_s")) > 5e-3 or not process.alive)
        assert process.alive
        stage.machine.signal(process, signal.SIGKILL)
        last_ns = stage.kernel.now_ns + int(20e9)
        stage.kernel.run(lambda: stage.at_rest or stage.kernel.now_ns > last_ns)
        assert stage.at_rest


def test_a_device_that_is_not_there_is_reported_beside_what_the_others_show(tmp_path: Path) -> None:
    report = checked(tmp_path, "--fault", "loadcell-pulled")
    assert finding(report, "load_cell", "unreachable")
    assert {name: verdicts(report)[name] for name in ("ecu", "lvdt")} == {"ecu": "ok", "lvdt": "ok"}
    assert finding(report, "actuator", "watchdog-unproved")


def test_a_rate_that_is_not_the_bench_files_is_reported_with_the_one_that_is(tmp_path: Path) -> None:
    report = checked(tmp_path, change=lambda bench: bench.replace('rate = "250 Hz"', 'rate = "300 Hz"', 1))
    assert 'rate = "250 Hz" in [load_cell]' in finding(report, "load_cell", "sample-rate").fix
    assert not report.passed
