"""A description that cannot serve its device is refused before anything is asked of it, in one line with its place."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from drivers.catalogue import check_current_source
from drivers.devices import source as sources
from protocols.errors import LocalProtocolError

ECU = (sources.FOLDER / "demo_ecu.toml").read_text(encoding="utf-8")
DBC = (sources.FOLDER / "demo_ecu.dbc").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(sources, "FOLDER", tmp_path)
    yield tmp_path
    sources.current_source.cache_clear()


@pytest.mark.parametrize(
    ("toml", "dbc", "message"),
    [
        (("layout = 1 ", ""), (), "layout is missing"),
        (("tick_us = 100", "tick_us = 0"), (), "must be a whole number of 1 to"),
        (("CoilStatus = 0x0121", "CoilStatu = 0x0121"), (), "did you mean CoilStatus"),
        ((", CoilStatus = 0x0121", ""), (), "'CoilStatus' is missing; the checksum of command and status"),
        (("fault = 3", "fault = 16"), (), "must be a whole number of 0 to 15"),
        (("restarted = 6", "restarted = 5"), (), "command-check and restarted are both 5"),
        (('current_A = "Current"', 'current = "Current"'), (), "did you mean current_A"),
        (('"demo_ecu.dbc"', '"another.dbc"'), (), "another.dbc: there is no such file"),
        ((), ("BO_ 290 ", "BO_ 289 "), "are both frame 0x121"),
        ((), ("(0.0001,0)", "(0.001,0)"), "counts in steps of 1000 us"),
        ((), ('(0.001,0) [-32.768|32.767] "A" Ecu', '(1,0) [0|0] "mA" Ecu'), "must be in A"),
        ((), ('(0.001,0) [-32.768|32.767] "A" Ecu', '(0,0) [0|0] "A" Ecu'), "must be more than 0"),
        ((), ("Counter : 8|4@1+ (1,0) [0|14] \"\" Ecu", "Counter : 32|4@1+ (1,0) [0|14] \"\" Ecu"), "elsewhere"),
        ((), ("Faults : 32|8", "Faults : 24|8"), "overlapping"),
        ((), ("Current : 16|16@1-", "Current : 23|16@0-"), "only little-endian"),
        ((), ("CoilStatus: 8 Ecu", "CoilStatus: 64 Ecu"), "at most 8 bytes"),
        ((), (DBC, "hello"), "not a DBC file"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_a_current_source_that_its_files_cannot_serve_is_refused_by_place(
    folder: Path, toml: tuple[str, str] | tuple[()], dbc: tuple[str, str] | tuple[()], message: str
) -> None:
    (folder / "other_ecu.toml").write_text(ECU.replace(*toml) if toml else ECU, encoding="utf-8")
    (folder / "demo_ecu.dbc").write_text(DBC.replace(*dbc) if dbc else DBC, encoding="utf-8")
    with pytest.raises(LocalProtocolError, match=message) as refused:
        check_current_source("other")
    assert str(folder / "other_ecu.toml") in str(refused.value)


def test_a_dbc_as_most_tools_write_it_is_read(folder: Path) -> None:
    (folder / "other_ecu.toml").write_text(ECU, encoding="utf-8")
    (folder / "demo_ecu.dbc").write_bytes(DBC.replace('"degC"', '"°C"').encode("cp1252"))
    check_current_source("other")


def test_a_fault_bit_without_a_name_is_never_taken_for_a_named_one(folder: Path) -> None:
    toml = ECU.replace("over-temperature = 0", "over-temperature = 7")
    (folder / "other_ecu.toml").write_text(toml, encoding="utf-8")
    (folder / "demo_ecu.dbc").write_text(DBC, encoding="utf-8")
    other = sources.current_source("other")
    assert other.faults(1) > sources.SourceFault.RESTARTED
    assert other.faults(0x80) == sources.SourceFault.OVER_TEMPERATURE
