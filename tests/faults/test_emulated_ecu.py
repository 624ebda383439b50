"""The rows of the ECU and its bus on a rig whose ECU is a user's, by DBC and roles file; and a wrong data id."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from end_states import assert_never_moved
from matrices import ONE_POINT
from row_scenarios import FAULT_S, scenario_of
from test_every_row import assert_stopped_in_time

from rig.faults.matrix import MATRIX

if TYPE_CHECKING:
    from conftest import Run, Start

EXAMPLES = Path(__file__).parents[2] / "examples"
DBC, ROLES = EXAMPLES / "coil-driver.dbc", EXAMPLES / "coil-driver-roles.toml"
EMULATED = ("--dbc", str(DBC), "--ecu-roles", str(ROLES))
FD_DBC = """VERSION ""
BU_: Host Amp
BO_ 768 AmpOrder: 12 Host
 SG_ Share : 24|16@1- (0.01,0) [-100|100] "%" Amp
 SG_ Go : 40|1@1+ (1,0) [0|1] "" Amp
BO_ 769 AmpState: 24 Amp
 SG_ Amperes : 32|32@1- (1,0) [0|0] "A" Host
 SG_ Broken : 64|1@1+ (1,0) [0|1] "" Host
 SG_ Celsius : 79|32@0- (1,0) [0|0] "degC" Host
SIG_VALTYPE_ 769 Amperes : 1;
SIG_VALTYPE_ 769 Celsius : 1;
"""
FD_ROLES = """command = {signal = "AmpOrder.Share", full_scale = "4 A"}
enable = "AmpOrder.Go"
measured_current = "AmpState.Amperes"
coil_temperature = "AmpState.Celsius"
command_timeout = "100 ms"
faults = {open = "AmpState.Broken"}
periods = {AmpState = "10 ms"}
protection = {AmpOrder = {profile = "e2e-5", data_id = 7}, AmpState = {profile = "e2e-5", data_id = 0xFEDC}}
"""
ROWS = ("ecu-silent", "ecu-late", "ecu-crc", "ecu-restart", "ecu-overtemp", "coil-open-short", "current-stuck",
        "can-busoff", "can-malformed", "can-babble", "can-foreign")  # fmt: skip


@pytest.mark.nightly
@pytest.mark.apart
@pytest.mark.parametrize("slug", ROWS)
def test_a_row_of_the_ecu_ends_the_same_with_a_users_files(slug: str, begin_scenario: Start) -> None:
    here = scenario_of(slug)
    campaign = begin_scenario(replace(here.setting, simulator=(*here.setting.simulator, *EMULATED)))
    assert here.around is None
    assert MATRIX[slug].stop is not None
    ending = campaign.finish(None)
    if here.check is not None:
        here.check(campaign, ending)
    else:
        assert_stopped_in_time(campaign, ending, slug, here)


@pytest.mark.few(1)
@pytest.mark.parametrize("slug", ["", "ecu-silent", "ecu-crc", "coil-open-short"])
def test_can_fd_with_floats_profile_5_and_a_share_of_full_scale(slug: str, run: Run, tmp_path: Path) -> None:
    dbc, roles = tmp_path / "amp.dbc", tmp_path / "amp.toml"
    dbc.write_text(FD_DBC, encoding="utf-8")
    roles.write_text(FD_ROLES, encoding="utf-8")
    files = ("--dbc", str(dbc), "--ecu-roles", str(roles))
    ending = run(*([f"{slug}@{FAULT_S}"] if slug else []), simulator=files, matrix=ONE_POINT, speed=1.0)
    assert ending.exit_code == (4 if slug else 0), ending.output
    assert slug in {"", ending.answer.get("stopped_by")}
    missing = {line["slug"] for line in ending.log if str(line.get("slug", "")).startswith("ecu-without")}
    assert missing == {f"ecu-without-{name}" for name in ("supply", "state", "restart", "clock", "identity", "layout")}


@pytest.mark.parametrize(
    ("known", "slug", "named"),
    [("0x2A2", "e2e-data-id", ("DriverStatus", "E2E data ID differs")),
     ("0x2A1", "ecu-command", ("COMMAND_CHECK", "E2E data ID"))],
    ids=["of the status", "of the commands, which the ECU discards"],
)  # fmt: skip
def test_a_wrong_data_id_is_refused_and_nothing_moves(
    run: Run, tmp_path: Path, known: str, slug: str, named: tuple[str, ...]
) -> None:
    wrong = tmp_path / "wrong-roles.toml"
    wrong.write_text(ROLES.read_text(encoding="utf-8").replace(known, "0x2A3"), encoding="utf-8")
    ending = run(simulator=EMULATED, bench_edit=(str(ROLES), str(wrong)))
    assert ending.exit_code == 3, ending.output
    assert ending.answer["stopped_by"] == slug
    assert [text for text in named if text not in ending.output] == []
    assert_never_moved(ending.truth, 1e-6)
