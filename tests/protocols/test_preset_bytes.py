"""Presets read what their makers' documents say: bytes by hand from each, with the page, at every split point."""

from __future__ import annotations

import math

import pytest

from protocols.binary_decoder import BinaryDecoder
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT, Reading
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import preset
from protocols.sensor_presets import DOCUMENTS, TABLES

OWN = {"signed-decimal"}
NAN = math.nan
BYTES: list[tuple[str, bytes, list[tuple[float, int]]]] = [
    # Laumas WLIGHT manual page 29: xxxxxxCRLF, first character "-" for negative, alarm texts in place of the weight.
    ("laumas-fast", b"99\r\n001234\r\n-01234\r\n ErOL \r\n",
     [(1234.0, 0), (-1234.0, 0), (NAN, STATUS_OVERLOAD)]),
    # TLB Profi manual page 30: &TzzzzzzPzzzzzz\ckckCR, XOR between & and \. T 54, P 50, digits equal: 54^50 = 04.
    ("laumas-checksummed", b"\\00\r&T001234P001234\\04\r&T-00050P-00050\\04\r", [(1234.0, 0), (-50.0, 0)]),
    # HBM AD104 manual page 21: COF3 value (8) CRLF; COF9 value (8), address (2), status (3).
    ("hbm-aed", b"5\r\n+0012345\r\n-0000012,31,000\r\n", [(12345.0, 0), (-12.0, 0)]),
    # Flintec LDU 68.1 manual page 20: SG answers G+01.100, gross value 1,100 d.
    ("flintec", b"0\r\nG+01.100\r\nG-123.45\r\n", [(1.1, 0), (-123.45, 0)]),
    # HBM ClipX manual page 112: answers end with CRLF, a question mark in place of a number is no number.
    ("hbm-clipx", b"12.5\r\n-3.25e+02\r\n?\r\n", [(12.5, 0), (-325.0, 0), (NAN, STATUS_SENSOR_FAULT)]),
    # Mantracourt DSC manual page 50: !001:SOUT? of 32.1 with DP=3 and DPB=5 is answered +00032.100 CR.
    ("mantracourt", b"+00032.100\r-00000.001\r", [(32.1, 0), (-0.001, 0)]),
    # eNod4-F manual 4.4.2: STX, status word, 3 bytes MSB first, sum with b7 set, ETX; DLE before 02, 03 and 10.
    # 9.1.6: b3 b2 00 OK, 01 defect, 11 beyond the converter; b7 and b15 are 1, b4 no motion: 8090.
    # 02+80+90+00+01+02 = 115 -> 95; 02+80+90+FF+FF+FE = 40E -> 8E; 02+80+9C+7F+FF+FF = 39B -> 9B; 02+80+94 = 116 -> 96.
    ("scaime-scmbus", bytes.fromhex(
        "95 03 02 8090 00 01 1002 95 03 02 8090 FFFFFE 8E 03 02 809C 7FFFFF 9B 03 02 8094 000000 96 03"),
     [(258.0, 0), (-2.0, 0), (NAN, STATUS_OVERLOAD), (NAN, STATUS_SENSOR_FAULT)]),
    # IF2030/ENETIP manual A 3.11, its own example: 0.88 V, scaled value 0.
    ("msc7xxx", bytes.fromhex("68 0B 0B 68 01 7E 08 AE 47 61 3F 00 00 00 00 1C 16"), [(0.88, 0)]),
    ("msc7xxx-scaled", bytes.fromhex("68 0B 0B 68 01 7E 08 AE 47 61 3F 00 00 00 00 1C 16"), [(0.0, 0)]),
    # Modbus TCP answers to function 3: header, unit 1, 4 bytes; LabJack floats are IEEE, high word first.
    ("labjack-t", bytes.fromhex("0001 0000 0007 01 03 04 40200000 0001 0000 0007 01 03 04 C61C3C00"),
     [(2.5, 0), (NAN, STATUS_OVERLOAD)]),
    # optoNCDT 1420 manual 8.2: L 00 D5..D0, M 01 D11..D6, H 10 D17..D12; 7.5.2.1: start of range 643, end 64877; error
    # values have 18 bits. 643 = 000000 001010 000011; 32760 = 000111 111111 111000; 262075 = 111111 111111 111011.
    ("optoncdt", bytes.fromhex("87 034A80 387F87 3B7FBF"), [(643.0, 0), (32760.0, 0), (NAN, STATUS_OVERLOAD)]),
    # optoNCDT 1402 manual 8.1.1: H 1 D13..D7, L 0 D6..D0. 2099 = 0010000 0110011.
    ("optoncdt-1402", bytes.fromhex("33 9033 FF7F"), [(2099.0, 0), (16383.0, 0)]),
]  # fmt: skip
REQUESTS = {
    "hbm-clipx": b"SDO? 0x44f0,4\n",
    "mantracourt": b"!001:SOUT?\r",
    "labjack-t": bytes.fromhex("0001 0000 0006 01 03 0000 0002"),
    # MSC7xxx manual A 4.4: short frame 10, destination 7E, source 01, 4C, sum of these three, 16.
    "msc7xxx": bytes.fromhex("10 7E 01 4C CB 16"),
    "msc7xxx-scaled": bytes.fromhex("10 7E 01 4C CB 16"),
}


def read(name: str, parts: list[bytes]) -> list[Reading]:
    layout = preset(name)
    answers = bool(layout.exchange.request)
    if isinstance(layout, LineFormat):
        decoder: LineDecoder | BinaryDecoder = LineDecoder(layout, answers=answers)
    else:
        decoder = BinaryDecoder(layout, answers=answers)
    return [reading for part in parts for reading in decoder.feed(part)]


@pytest.mark.parametrize(("name", "data", "expected"), BYTES)
def test_a_preset_reads_its_document_s_bytes_however_they_are_cut(
    name: str, data: bytes, expected: list[tuple[float, int]]
) -> None:
    for at in range(len(data) + 1):
        got = [(value, status) for _, _, value, status, _ in read(name, [data[:at], data[at:]])]
        assert got == [(pytest.approx(value, nan_ok=True), status) for value, status in expected], at
    assert len(read(name, [bytes([byte]) for byte in data])) == len(expected)


def test_every_preset_has_its_document_and_its_bytes() -> None:
    assert {name for name, _, _ in BYTES} == TABLES.keys() - OWN
    assert DOCUMENTS.keys() == TABLES.keys() - OWN


def test_polled_presets_send_their_document_s_request() -> None:
    requests = {name: preset(name).exchange.request for name in TABLES}
    assert {name: request for name, request in requests.items() if request} == REQUESTS


@pytest.mark.parametrize(("name", "data", "expected"), [one for one in BYTES if one[0] in {"scaime-scmbus", "msc7xxx"}])
def test_a_flipped_bit_of_a_checked_frame_never_makes_another_value(
    name: str, data: bytes, expected: list[tuple[float, int]]
) -> None:
    right = {value for value, _ in expected if math.isfinite(value)}
    # eNod4's sum has seven bits: its maker gave the highest one away.
    seen = [bit for bit in range(8 * len(data)) if name != "scaime-scmbus" or bit % 8 != 7]
    for bit in seen:
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << bit % 8
        values = [value for _, _, value, _, _ in read(name, [bytes(damaged)]) if math.isfinite(value)]
        assert all(any(value == pytest.approx(one) for one in right) for value in values), bit
