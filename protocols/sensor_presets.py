"""Sensor formats that are included, in the form in which a user would write them.

`DOCUMENTS` names the source of each; bytes from those documents are in `tests/protocols/test_preset_bytes.py`, typed
manually. None was tested with a device.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_NINE_CHARACTERS = "|".join(rf"\d{{{whole}}}\.\d{{{8 - whole}}}" for whole in range(1, 8))
"""Digits with one decimal point among them: a line that lost a character does not match."""
_SIX_CHARACTERS = r"\d{6}|" + "|".join(rf"\d{{{whole}}}\.\d{{{5 - whole}}}" for whole in range(1, 6))
_LAUMAS_NUMBER = r"[-\d]\d{5}"
_LAUMAS_WORDS = {
    "overload_tokens": ["ErOL", "Er OL", "^^^^^^", "------"],
    "fault_tokens": ["ErCEL", "Er CEL", "ErAD", "Er AD"],
}

_MSC: dict[str, Any] = {
    "sync": [0x68, 0x0B, 0x0B, 0x68, 0x01, 0x7E, 0x08],
    "end": [0x16],
    "length": 17,
    "checksum": "sum8",
    "checksum_over": [4, 14],
    "request": [0x10, 0x7E, 0x01, 0x4C, 0xCB, 0x16],
    "answer_timeout_ms": 20,
    "nominal_rate_Hz": 100.0,
}

TABLES: Mapping[str, Mapping[str, Any]] = {
    "signed-decimal": {
        "description": "this project's own format, such as +0001234.5 N",
        "pattern": rf"(?P<value>[+-](?:{_NINE_CHARACTERS}))(?: (?P<unit>[^\d\s]\S*))?",
        "template": "{value:+010.1f} {unit}",
        "unit": "N",
    },
    "laumas-fast": {
        "description": "Laumas W, TLB, LCB: fast continuous transmission, gross weight in 6 characters",
        "pattern": rf"(?P<value>{_LAUMAS_NUMBER}|[ -~]{{6}})",
        **_LAUMAS_WORDS,
        "nominal_rate_Hz": 300.0,
        "template": "{value:06.0f}",
    },
    "laumas-checksummed": {
        "description": "Laumas TLB, WLIGHT: fast continuous transmission with checksum, &TzzzzzzPzzzzzz\\ckck",
        "pattern": rf"&T(?P<value>{_LAUMAS_NUMBER}|[ -~]{{6}})P[ -~]{{6}}\\(?P<checksum>[0-9A-Fa-f]{{2}})",
        "terminator": "\r",
        **_LAUMAS_WORDS,
        "checksum": "xor-hex",
        "checksum_from": "&",
        "checksum_to": "\\",
        "template": "&T{value:06.0f}P000000\\{checksum}",
    },
    "hbm-aed": {
        "description": "HBM AED, FIT, AD104: MSV?0; in ASCII (COF1, COF3, COF9, COF11), 8 characters",
        "pattern": r"(?P<value>[+-]\d{7})(?:,\d{2})?(?:,\d{3})?",
        "start_command": "MSV?0;",
        "stop_command": "STP;",
        "template": "{value:+08.0f}",
    },
    "flintec": {
        "description": "Flintec LDU 68, 69, 78: continuous gross value, command SG",
        "pattern": rf"G(?P<value>[+-](?:{_SIX_CHARACTERS}))",
        "start_command": "SG\r",
        "template": "G{value:+07.3f}",
    },
    "hbm-clipx": {
        "description": "HBM ClipX over TCP, port 55000: object 0x44F0.4, the gross value, requested by SDO",
        "pattern": r"(?P<value>[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?|\?)",
        "number": "scientific",
        "fault_tokens": ["?"],
        "request": "SDO? 0x44f0,4\n",
        "answer_timeout_ms": 100,
        "nominal_rate_Hz": 100.0,
    },
    "mantracourt": {
        "description": "Mantracourt DSC, DCell in ASCII: SOUT of station 001, with DP and DPB as set in the device",
        "pattern": r"(?P<value>[+-]\d{1,8}\.\d{1,8})",
        "terminator": "\r",
        "request": "!{address}:SOUT?\r",
        "address": "001",
        "answer_timeout_ms": 50,
        "nominal_rate_Hz": 100.0,
    },
    "scaime-scmbus": {
        "description": "Scaime eNod4: fast SCMBus, continuous transmission",
        "sync": [0x02],
        "end": [0x03],
        "stuffing": "escape",
        "escape": 0x10,
        "length": 8,
        "order": "big",
        "checksum": "sum8-bit7",
        "fields": {
            "status": {"at": 1, "type": "u16", "bits": [2, 3], "fault_values": [1], "overload_values": [2, 3]},
            "value": {"at": 3, "type": "i24"},
        },
    },
    "labjack-t": {
        "description": "LabJack T4, T7, T8 over Modbus TCP: the voltage at AIN0; AINn has the address 2 n",
        "kind": "modbus", "function": "holding", "address": 0, "type": "f32", "unit": "V",
        # The widest range is +-11 V (T8; T7: +-10 V; T4: +-10 V or 0 to 2.5 V). -9999 means: no valid voltage.
        "valid": [-13.0, 13.0],
        # AIN0 to AIN7 exist on every device and can be read together.
        "largest_gap": 12,
        "nominal_rate_Hz": 200.0,
    },
    "msc7xxx": {
        "description": "Micro-Epsilon MSC7401, MSC7602, MSC7802 over RS485, 256 kBd 8E1: the unscaled value in V",
        **_MSC,
        "fields": {"value": {"at": 7, "type": "f32"}},
    },
    "msc7xxx-scaled": {
        "description": "Micro-Epsilon MSC7401, MSC7602, MSC7802 over RS485: the scaled value, which is 0 in a "
        "controller that has not been set up",
        **_MSC,
        "fields": {"value": {"at": 11, "type": "f32"}},
    },
    "optoncdt": {
        "description": "Micro-Epsilon optoNCDT 1320, 1420 over RS422: distance only; 0 to 65520 is -1 to 101 % of "
            "range",
        "packed": ["00vvvvvv", "01vvvvvv", "10vvvvvv"],
        "order": "little",
        "fields": {"value": {"valid": [0, 65520]}},
        "nominal_rate_Hz": 4000.0,
    },
    "optoncdt-1402": {
        "description": "Micro-Epsilon optoNCDT 1401, 1402 over RS422: binary, 14 bits in two bytes",
        "packed": ["1vvvvvvv", "0vvvvvvv"],
        "order": "big",
    },
}
"""By the name a bench file uses."""

_LAUMAS = "Laumas TLB Profi and WLIGHT manuals, fast continuous transmission"
_MSC_DOCUMENT = "Micro-Epsilon MSC7xxx manual, A 4.4; IF2030/ENETIP manual, A 3.11"
DOCUMENTS: Mapping[str, str] = {
    "laumas-fast": _LAUMAS,
    "laumas-checksummed": _LAUMAS,
    "hbm-aed": "HBM AD104-R2 manual ba_aed104_8_e, commands MSV and COF",
    "flintec": "Flintec LDU 68.1/68.2 technical manual, rev. 12 January 2010, 8.7.1",
    "hbm-clipx": "HBM ClipX manual A04643, framing and the question mark; object number from a user's driver",
    "mantracourt": "Mantracourt DSC user manual, page 50",
    "scaime-scmbus": "Scaime eNod4-F manual NU-Soft-eNod4F-E-0716, 4.4.2 and 9.1.6",
    "labjack-t": "LabJack T-Series datasheet, 3.1 Modbus map and 14.0 AIN; ljm_constants.json",
    "msc7xxx": _MSC_DOCUMENT,
    "msc7xxx-scaled": _MSC_DOCUMENT,
    "optoncdt": "Micro-Epsilon optoNCDT 1420 manual, 7.5.2.1 and 8.2",
    "optoncdt-1402": "Micro-Epsilon optoNCDT 1402 manual, 8.1.1",
}
"""What each preset was read from."""
