r"""Sensor formats that come with the project, as a user would write them; each with the document it is read from.

`verified` in the document's line below means: golden bytes from that document, by hand, in `tests/protocols`; no
device was ever at the other end.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_LAUMAS_NUMBER = r"[-\d]\d{5}"
_LAUMAS_WORDS = {
    "overload_tokens": ["ErOL", "Er OL", "^^^^^^", "------"],
    "fault_tokens": ["ErCEL", "Er CEL", "ErAD", "Er AD"],
}

TABLES: Mapping[str, Mapping[str, Any]] = {
    "signed-decimal": {
        "description": "the project's own line, +0001234.5 N",
        "pattern": r"(?P<value>[+-](?=[\d.]{9}(?: |$))\d+\.\d+)(?: (?P<unit>[^\d\s]\S*))?",
        "template": "{value:+010.1f} {unit}",
        "unit": "N",
    },
    "laumas-fast": {
        "description": "Laumas W, TLB, LCB: fast continuous transmission, 6 characters of gross weight",
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
        "description": "Flintec LDU 68, 69, 78: SG, gross value continuously",
        "pattern": r"G(?P<value>[+-](?=[\d.]{6}$)\d+\.?\d*)",
        "start_command": "SG\r",
        "template": "G{value:+07.3f}",
    },
}
"""By the name a bench file uses."""
