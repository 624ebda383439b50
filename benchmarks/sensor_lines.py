"""How fast sensor formats are decoded: lines, frames and packed streams, in chunks as a port gives them.

.venv/bin/python benchmarks/sensor_lines.py
"""

from __future__ import annotations

import time

from protocols.binary_decoder import BinaryDecoder
from protocols.line_format import LineDecoder, LineFormat
from protocols.sensor_format import from_description

COUNT, CHUNK = 200_000, 4096
FORMATS = {
    "laumas-fast": ({"base": "laumas-fast"}, b"001234\r\n"),
    "signed-decimal with unit": ({"base": "signed-decimal"}, b"+0001234.5 N\r\n"),
    "laumas-checksummed": ({"base": "laumas-checksummed"}, b"&T001234P000000\\00\r"),
    "columns with status, comma": (
        {"columns": {"status": [1, 2], "value": [4, 11], "unit": [13, 14]}, "status": {"ST": "ok"}, "unit": "kN",
         "decimal_mark": ","}, b"ST,+001,250 kN\r\n"),
    "frame with CRC-16 (modbus)": (
        {"sync": [0xAA, 0x55], "length": 8, "checksum": "crc16-modbus", "fields": {"value": {"at": 2, "type": "i32"}}},
        bytes.fromhex("AA55 01020304 B512")),
    "frame with sum8": (
        {"sync": [0xAA, 0x55], "length": 7, "checksum": "sum8", "fields": {"value": {"at": 2, "type": "i32"}}},
        bytes.fromhex("AA55 01020304 09")),
    "packed, 3 bytes": ({"packed": ["00vvvvvv", "01vvvvvv", "10vvvvvv"], "order": "little"}, bytes.fromhex("387F87")),
}  # fmt: skip


def main() -> None:
    """Print readings a second of each format."""
    for name, (table, one) in FORMATS.items():
        made = from_description(table)
        decoder = LineDecoder(made) if isinstance(made, LineFormat) else BinaryDecoder(made)
        data = one * COUNT
        begin = time.process_time()
        got = sum(len(decoder.feed(data[at : at + CHUNK])) for at in range(0, len(data), CHUNK))
        taken_s = time.process_time() - begin
        print(f"{name:30} {got / taken_s:10.0f} readings a second of one core  ({decoder.bad_frames} damaged)")


if __name__ == "__main__":
    main()
