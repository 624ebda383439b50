"""A user's DBC and roles file: what they may say, and everything that is refused, at once and with its place."""

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest

from drivers.current_source import SourceFault, SourceState
from drivers.devices.dbc_file import DbcText, parse_dbc
from drivers.devices.ecu_description import UNNAMED_BITS, EcuDescription
from drivers.devices.ecu_roles import describe
from drivers.devices.source import current_source, source_problems
from drivers.roles import UNNAMED
from rig.errors import FileProblem
from rig.files.descriptions import entry_problems, problems_of
from rig.files.ecu_files import ecu_problems
from rig.files.network_text import dbc_text

EXAMPLES = Path(__file__).parents[2] / "examples"
DBC = (EXAMPLES / "coil-driver.dbc").read_text(encoding="utf-8")
ROLES = (EXAMPLES / "coil-driver-roles.toml").read_text(encoding="utf-8")
STATUS, HEALTH = 0x18FF2100, 0x18FF2200


def described(roles: str = ROLES, dbc: str = DBC) -> EcuDescription:
    return describe("driver", parse_dbc(dbc), tomllib.loads(roles))


def refused(roles: str = ROLES, dbc: str = DBC) -> str:
    table = tomllib.loads(roles)
    problems: list[Any] = problems_of("ecu-roles", table) or list(source_problems(DbcText("driver.dbc", dbc), table))
    return "\n".join(f"{'.'.join(map(str, problem[0]))}: {problem[1]}" for problem in problems)


def command(made: EcuDescription, current_A: float, enable: bool, count: int) -> str:
    (frame,) = made.sent
    data = frame.writer.write({"command": current_A, "enable": made.on_off["enable"][not enable], "clear_faults": 0})
    frame.protection.seal(data, count)
    return data.hex(" ").upper()


def test_the_examples_command_is_worked_out_by_hand() -> None:
    # Mode 2 in bits 15..13 of the DBC, reset bit 12, counter below: byte 1 is 0100 0011. 1.5 A are 6000 = 0x1770.
    # SlewRate 100 = 0x64. CRC-8 0x1D over A1 02 43 17 70 64 00 00 00, start 0, is 0x60.
    made = described()
    register = 0
    for byte in bytes.fromhex("A1 02 43 17 70 64 00 00 00"):
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ 0x1D) & 0xFF if register & 0x80 else register << 1
    assert command(made, 1.5, True, 3) == f"{register:02X} 43 17 70 64 00 00 00"
    assert command(made, 0.0, False, 15)[3:] == "00 00 00 64 00 00 00"
    assert (made.sent[0].identifier, made.sent[0].extended) == (0x18FF2000, True)
    assert (made.low_A, made.high_A) == (-5.0, 5.0)


def test_values_come_in_amperes_degrees_and_volts() -> None:
    made = described()
    status, health = made.heard[made.status], made.heard[HEALTH | 1 << 31]
    # -3.0 A are -12000 quarter mA = 0xD120; stage 4; uptime 513 half ms.
    assert status.reader.read(bytes.fromhex("00 40 D1 20 02 01 00 00")) == {
        "measured_current": -3.0, "state": 4, "clock": 0x0201,
    }
    assert made.tick_us == 500.0
    assert made.clock_modulus == 1 << 16
    # Page 1: 296.1 K = 2961 = 0x0B91; 20 + 40 = 0x3C; nine starts. Page 0: bits 0 and 8; 13.5 V = 2700 = 0x0A8C.
    page_1 = health.reader.read(bytes.fromhex("01 0B 91 3C 09 00 00 00"))
    assert page_1 == {"coil_temperature": pytest.approx(22.95), "ecu_temperature": 20.0, "boot_count": 9}
    assert health.reader.read(bytes.fromhex("00 01 01 0A 8C 00 00 00")) == {"faults": 0x0101, "supply_voltage": 13.5}
    assert made.timing == (0.005, pytest.approx(0.06), pytest.approx(0.06)), "three pages of 20 ms each"
    assert made.lacking == ()


def test_states_and_faults_get_the_rigs_meanings_and_unnamed_ones_are_never_taken_for_them() -> None:
    made = described()
    assert [made.state(code) for code in (0, 1, 4, 7, 8)] == [
        SourceState.INIT, SourceState.OFF, SourceState.ENABLED, SourceState.FAULT, SourceState.FAULT,
    ]
    assert (made.state(2), made.state(9)) == (UNNAMED + 2, 9)
    assert made.faults({"faults": 0x8101}) == SourceFault.RESTARTED | SourceFault.OPEN | SourceFault.OVER_TEMPERATURE
    assert made.faults({"faults": 0x0004}) == 0x4 << UNNAMED_BITS
    assert made.faults({"faults": 0x0400}) == 0x400


def test_faults_may_have_signals_or_codes_of_their_own() -> None:
    roles = ROLES.replace("open = 0", 'open = "DriverStatus.Stage"').replace(
        "short = 1", 'short = {signal = "DriverStatus.Stage", value = ["ERROR", 8]}'
    )
    made = described(roles)
    assert made.faults({"faults": 0, "faults.open": 3, "faults.short": 3}) == SourceFault.OPEN
    assert made.faults({"faults": 0, "faults.open": 0, "faults.short": 8}) == SourceFault.SHORT
    coded = ROLES.replace('signal = "DriverHealth.ErrorWord"\nover-temperature = 8', 'signal = "DriverStatus.Stage"')
    coded = coded[: coded.index("undervoltage")] + 'short = "ERROR"\n' + coded[coded.index("[constants]") :]
    assert described(coded).faults({"faults": 7}) == SourceFault.SHORT


def test_the_smallest_roles_file_says_what_is_left_without_the_rest() -> None:
    made = describe("driver", parse_dbc(DBC), {
        "command": "DriverCommand.Target", "measured_current": "DriverStatus.Actual",
    })  # fmt: skip
    missing = dict(made.lacking)
    assert {"timeout", "faults", "enable", "counter", "checksum", "coil-temperature", "identity"} <= missing.keys()
    assert "continues to flow until the supply is switched off" in missing["timeout"]
    assert made.timing == (0.005, 0.0, 0.0)


def test_a_share_of_full_scale_and_units_of_ones_own() -> None:
    percent = DBC.replace('Target : 23|16@0- (0.25,0) [-5000|5000] "mA"', 'Target : 23|16@0+ (0.1,0) [0|100] "%"')
    message = refused(ROLES, percent)
    assert 'command.full_scale: is missing; the unit of the signal is %. Fix' in message
    with_scale = ROLES.replace('"DriverCommand.Target"', '{signal = "DriverCommand.Target", full_scale = "4 A"}')
    assert problems_of("ecu-roles", tomllib.loads(with_scale)) == []
    made = described(with_scale, percent)
    assert (made.low_A, made.high_A) == (0.0, 4.0)
    assert command(made, 1.0, True, 0)[6:11] == "00 FA", "25 % are 250 steps"
    unitless = DBC.replace('[-8000|8000] "mA"', '[-8000|8000] ""')
    assert "Actual has no unit in the DBC file; allowed: A, mA" in refused(ROLES, unitless)
    own = ROLES.replace('"DriverStatus.Actual"', '{signal = "DriverStatus.Actual", unit = "mA"}')
    assert described(own, unitless).heard[STATUS | 1 << 31].reader.read(bytes(8))["measured_current"] == 0.0


def test_commands_on_pages_go_out_as_one_frame_a_page() -> None:
    dbc = """VERSION ""
BU_: A
BO_ 16 Order: 4 A
 SG_ What M : 0|8@1+ (1,0) [0|0] "" A
 SG_ Amps m1 : 8|16@1- (0.01,0) [0|0] "A" A
 SG_ On m7 : 8|1@1+ (1,0) [0|0] "" A
 SG_ Key : 24|8@1+ (1,0) [0|0] "" A
BO_ 17 Told: 4 A
 SG_ Amps : 0|32@1- (1,0) [0|0] "A" A
BA_DEF_ SG_ "GenSigStartValue" FLOAT 0 1000;
BA_DEF_DEF_ "GenSigStartValue" 0;
BA_ "GenSigStartValue" SG_ 16 Key 90;
SIG_VALTYPE_ 17 Amps : 1;
"""
    made = describe("pages", parse_dbc(dbc), {
        "command": "Order.Amps", "enable": "Order.On", "measured_current": "Told.Amps",
    })  # fmt: skip
    frames = [frame.writer.write({"command": 1.5, "enable": 1}).hex() for frame in made.sent]
    assert frames == ["0196005a", "0701005a"]
    assert made.heard[17].reader.read(bytes.fromhex("0000c0bf")) == {"measured_current": -1.5}
    assert math.isclose(made.high_A, 327.67)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('command = "DriverCommand.Target"', "", "command: missing"),
        ("DriverStatus.Actual", "DriverState.Actual", "no message 'DriverState'; nearest: DriverStatus"),
        ("DriverStatus.Actual", "DriverStatus.Actuel", "has no signal 'Actuel'; nearest: Actual"),
        ("DriverStatus.Actual", "DriverStatus", 'must be a string of the form "Message.signal"'),
        ("measured_current", "mesured_current", "unknown key; did you mean measured_current?"),
        ('"CURRENT_CONTROL"', '"CURENT_CONTROL"', "no value named 'CURENT_CONTROL'; nearest: CURRENT_CONTROL"),
        ('off = "STANDBY"', 'off = "CURRENT_CONTROL"', "on and off are both 2"),
        ("open = 0", "open = 16", "ErrorWord has only bits 0 to 15"),
        ("open = 0", "open = 1", "bit 1 is already used for open"),
        ("short = 1", 'short = "DriverStatus.Shorted"', "has no signal 'Shorted'"),
        ("value = 3", "value = 300", "the raw range of FrameVersion is 0 to 255"),
        ("data_id = 0x2A1", "", "protection.DriverCommand.data_id: missing"),
        ("data_id = 0x2A1", "data_id = 0x12A1F", "must be a whole number from 0 to 65535 (0xFFFF)"),
        ('"e2e-1"\ndata_id = 0x2A2', '"e2e-3"\ndata_id = 0x2A2', "must be one of none, counter, counter+"),
        ('counter = "Alive"', 'counter = "Mode"', "e2e-1 requires a counter of 4 bits; Mode has 3"),
        ('crc = "Checksum"', 'crc = "Alive"', "e2e-1 requires a checksum of 8 bits in whole bytes"),
        ("[protection.DriverStatus]", "[protection.DriverStatu]", "did you mean DriverStatus?"),
        ('"60 ms"', '"60"', '60 has no unit; a time is written as, for example, "10 ms"'),
        ('"DriverCommand.SlewRate" = 100', '"DriverCommand.SlewRate" = 256', "the raw range of SlewRate is 0 to 255"),
        ('"DriverCommand.SlewRate" = 100', '"DriverCommand.Target" = 1', "has the role command, so its value"),
        ('"DriverCommand.SlewRate" = 100', '"DriverStatus.Stage" = 1', "'DriverStatus' is both sent and received"),
        ('counter = "Alive"\ncrc = "Checksum"\n\n', "offset = 2\n\n", "Target and the checksum of [protection."),
        ("command_timeout", 'sending = "on-change"\ncommand_timeout', "Fix: use cyclic transmission"),
        ("[constants]", '[requests]\nDriverCommand = "remote"\n[constants]', "'DriverCommand' is not received"),
        ("[constants]", '[requests]\nDriverStat = "remote"\n[constants]', "did you mean DriverStatus?"),
        ("[constants]", '[requests]\nDriverStatus = "data"\n[constants]', "requests.DriverStatus"),
        ("[constants]", "[requests]\nDriverStatus = {id = 0x18FF2100}\n[constants]", "taken for the answer"),
        ("[constants]", "[requests]\nDriverStatus = {id = 0x18FF2200}\n[constants]", "of message 'DriverHealth'"),
        ("[constants]", "[requests]\nDriverStatus = {id = 0x18FF2000}\n[constants]", "of message 'DriverCommand'"),
    ],
)
def test_a_roles_file_that_cannot_be_used_is_refused_by_place(old: str, new: str, message: str) -> None:
    assert old in ROLES
    assert message in refused(ROLES.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(0.25,0) [-5000|5000]", "(0,0) [-5000|5000]", "its scale is 0; the scale must be finite and not 0"),
        ("@0- (0.25,0) [-5000|5000]", "@0+ (0.25,500) [0|0]", "cannot represent 0 A"),
        ("[-5000|5000]", "[200|5000]", "cannot represent 0 A, so the coil could not be switched off"),
        ("Actual : 23|16", "Actual : 62|16", "extends beyond the 8 bytes of DriverStatus"),
        ("Actual : 23|16", "Actual : 7|16", "Actual and the checksum of [protection.DriverStatus] overlap"),
        ("2566856960", "2566856704", "have the same identifier, 0x18FF2000"),
        ('"mA" Host', '"Nm" Host', "Actual is in 'Nm'; allowed: A, mA"),
    ],
)
def test_a_dbc_that_the_roles_cannot_use_is_refused_by_place(old: str, new: str, message: str) -> None:
    assert old in DBC
    assert message in refused(ROLES, DBC.replace(old, new))


def test_every_problem_is_reported_at_once_with_file_line_and_entry(tmp_path: Path) -> None:
    (tmp_path / "ecu.dbc").write_text(DBC.replace("(0.25,0) [-8000", "(0,0) [-8000"), encoding="utf-8")
    path = tmp_path / "roles.toml"
    path.write_text(ROLES.replace("0x2A2", '"x"').replace("open = 0", "opn = 0"), encoding="utf-8")
    assert [text.partition(" = ")[0] for _, text in entry_problems("ecu-roles", str(path))] == [
        "roles.toml: line 25: faults.opn", "roles.toml: line 42: protection.DriverStatus.data_id",
    ]  # fmt: skip
    roles = ROLES.replace("CoilTemp", "CoilTmp").replace("open = 0", "open = 16").replace("0x2A2", "0x12A2F")
    path.write_text(roles, encoding="utf-8")
    problems = ecu_problems(str(tmp_path / "ecu.dbc"), str(path))
    assert {place for place, _ in problems} == {("roles",)}
    wrong = ("Tmp", "0x12A2F", "open = 16")
    lines = {number for number, line in enumerate(roles.splitlines(), 1) if any(item in line for item in wrong)}
    text = "\n".join(message for _, message in problems)
    assert all(f"roles.toml: line {number}: " in text for number in lines)
    assert "(line 21 of the DBC file): its scale is 0" in text
    assert len(problems) == 4


@pytest.mark.filterwarnings("ignore")
def test_files_that_are_none_of_that_kind_are_refused(tmp_path: Path) -> None:
    (tmp_path / "ecu.dbc").write_text("hello", encoding="utf-8")
    (tmp_path / "roles.toml").write_text("a = = 1", encoding="utf-8")
    dbc, roles = str(tmp_path / "ecu.dbc"), str(tmp_path / "roles.toml")
    ((_, message),) = entry_problems("ecu-roles", roles)
    assert "not valid TOML" in message
    ((place, message),) = ecu_problems(dbc, {"command": "A.b", "measured_current": "A.c"})
    assert (place, "not a readable DBC file" in message) == (("dbc",), True)
    with pytest.raises(FileProblem, match="there is no such file"):
        dbc_text(tmp_path / "no.dbc")


def test_a_dbc_as_most_tools_write_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "ecu.dbc").write_bytes(DBC.replace('"degC"', '"°C"').encode("cp1252"))
    assert current_source(dbc_text(tmp_path / "ecu.dbc"), tomllib.loads(ROLES)).low_A == -5.0


def test_a_scale_in_a_role_replaces_what_the_dbc_does_not_say() -> None:
    """Raw counts of 0.5 mA around 2048 for the measured current; a set-point that counts the other way round."""
    raw = DBC.replace('Target : 23|16@0- (0.25,0) [-5000|5000] "mA"', 'Target : 23|16@0- (1,0) [-10000|20000] ""')
    raw = raw.replace('Actual : 23|16@0- (0.25,0) [-8000|8000]', 'Actual : 23|16@0+ (1,0) [0|4095]')
    roles = ROLES.replace(
        '"DriverCommand.Target"', '{signal = "DriverCommand.Target", scale = -0.25, unit = "mA"}'
    ).replace('"DriverStatus.Actual"', '{signal = "DriverStatus.Actual", scale = 0.5, offset = -1024.0, unit = "mA"}')
    made = described(roles, raw)
    assert (made.low_A, made.high_A) == (-5.0, 2.5)
    assert command(made, 1.0, True, 3)[6:11] == "F0 60", "-4000 counts"
    read = made.heard[made.status].reader.read(bytes.fromhex("00 40 08 64 02 01 00 00"))
    assert read is not None
    assert read["measured_current"] == pytest.approx(0.05), "2148 counts: 100 counts of 0.5 mA"
    unit = refused(roles.replace('scale = -0.25, unit = "mA"', "scale = -0.25"), raw)
    assert "the unit after scaling must be specified" in unit
    assert "scale: must not be 0" in refused(roles.replace("scale = 0.5", "scale = 0.0"), raw)
