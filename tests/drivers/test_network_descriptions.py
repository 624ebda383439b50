"""The messages of one CAN network, read from each of the formats that describe it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers.devices.dbc_file import DbcMessage, can_database, parse_dbc

DBC = (Path(__file__).parents[2] / "examples" / "can-sensors.dbc").read_text(encoding="utf-8")


def tag(name: str, *content: object, of: str = "") -> str:
    """An element; with `of`, a reference to an element of that kind."""
    return f"<{name}{f' DEST={of!r}' if of else ''}>{''.join(map(str, content))}</{name}>"


def scale_of(signal: Any) -> str:  # noqa: ANN401 - cantools has no types
    """Scale and offset (AUTOSAR: rational coefficients), or the names of its numbers."""
    if signal.choices:
        scales = (
            tag("COMPU-SCALE", tag("LOWER-LIMIT", number), tag("UPPER-LIMIT", number),
                tag("COMPU-CONST", tag("VT", name)))
            for number, name in signal.choices.items()
        )  # fmt: skip
    else:
        above, below = tag("V", signal.offset) + tag("V", signal.scale), tag("V", 1)
        ratio = tag("COMPU-RATIONAL-COEFFS", tag("COMPU-NUMERATOR", above), tag("COMPU-DENOMINATOR", below))
        scales = iter([tag("COMPU-SCALE", ratio)])
    return tag("COMPU-INTERNAL-TO-PHYS", tag("COMPU-SCALES", *scales))


def definition(*references: str, kind: str) -> str:
    """Properties of a signal."""
    return tag(kind, tag("SW-DATA-DEF-PROPS-VARIANTS", tag("SW-DATA-DEF-PROPS-CONDITIONAL", *references)))


def arxml() -> str:
    """The network of the example as an AUTOSAR 4 system description."""
    triggers, elements = list[str](), list[str]()
    for message in can_database(DBC).messages:
        name, mappings = message.name, list[str]()
        for signal in message.signals:
            own = f"{name}_{signal.name}"
            order = "FIRST" if signal.byte_order == "big_endian" else "LAST"
            mappings.append(tag(
                "I-SIGNAL-TO-I-PDU-MAPPING", tag("SHORT-NAME", f"at_{own}"),
                tag("I-SIGNAL-REF", f"/net/{signal.name}", of="I-SIGNAL"),
                tag("PACKING-BYTE-ORDER", f"MOST-SIGNIFICANT-BYTE-{order}"), tag("START-POSITION", signal.start),
            ))  # fmt: skip
            base = tag("BASE-TYPE-REF", f"/net/{'signed' if signal.is_signed else 'unsigned'}", of="SW-BASE-TYPE")
            method = tag("COMPU-METHOD-REF", f"/net/c_{own}", of="COMPU-METHOD")
            elements += [
                tag("I-SIGNAL", tag("SHORT-NAME", signal.name), tag("LENGTH", signal.length),
                    definition(base, kind="NETWORK-REPRESENTATION-PROPS"),
                    tag("SYSTEM-SIGNAL-REF", f"/net/s_{own}", of="SYSTEM-SIGNAL")),
                tag("SYSTEM-SIGNAL", tag("SHORT-NAME", f"s_{own}"), definition(method, kind="PHYSICAL-PROPS")),
                tag("COMPU-METHOD", tag("SHORT-NAME", f"c_{own}"),
                    tag("CATEGORY", "TEXTTABLE" if signal.choices else "LINEAR"),
                    tag("UNIT-REF", f"/net/{signal.unit}", of="UNIT") * bool(signal.unit), scale_of(signal)),
                *([tag("UNIT", tag("SHORT-NAME", signal.unit), tag("DISPLAY-NAME", signal.unit))] * bool(signal.unit)),
            ]  # fmt: skip
        pdu = tag("PDU-REF", f"/net/u_{name}", of="I-SIGNAL-I-PDU")
        frame = tag("PDU-TO-FRAME-MAPPING", tag("SHORT-NAME", "m"), pdu)
        elements += [
            tag("CAN-FRAME", tag("SHORT-NAME", name), tag("FRAME-LENGTH", message.length),
                tag("PDU-TO-FRAME-MAPPINGS", frame)),
            tag("I-SIGNAL-I-PDU", tag("SHORT-NAME", f"u_{name}"), tag("LENGTH", message.length),
                tag("I-SIGNAL-TO-PDU-MAPPINGS", *mappings)),
        ]  # fmt: skip
        triggers.append(tag(
            "CAN-FRAME-TRIGGERING", tag("SHORT-NAME", f"t_{name}"), tag("FRAME-REF", f"/net/{name}", of="CAN-FRAME"),
            tag("CAN-ADDRESSING-MODE", "STANDARD"), tag("IDENTIFIER", message.frame_id),
        ))  # fmt: skip
    elements += [
        tag("SW-BASE-TYPE", tag("SHORT-NAME", name), tag("BASE-TYPE-ENCODING", encoding))
        for name, encoding in (("signed", "2C"), ("unsigned", "NONE"))
    ]
    channel = tag("CAN-PHYSICAL-CHANNEL", tag("SHORT-NAME", "channel"), tag("FRAME-TRIGGERINGS", *triggers))
    bus = tag("CAN-CLUSTER-VARIANTS", tag("CAN-CLUSTER-CONDITIONAL", tag("PHYSICAL-CHANNELS", channel)))
    package = tag("SHORT-NAME", "net") + tag("ELEMENTS", tag("CAN-CLUSTER", tag("SHORT-NAME", "bus"), bus), *elements)
    return (
        '<AUTOSAR xmlns="http://autosar.org/schema/r4.0">'
        f"{tag('AR-PACKAGES', tag('AR-PACKAGE', package))}</AUTOSAR>"
    )


def compared(messages: dict[str, DbcMessage]) -> dict[str, DbcMessage]:
    """Without what only a DBC file has: lines, and ranges that another format states in its own way."""
    return {
        name: replace(message, line=0, period_s=0.0, signals={
            key: replace(signal, line=0, minimum=None, maximum=None) for key, signal in sorted(message.signals.items())
        })
        for name, message in messages.items()
    }  # fmt: skip


@pytest.mark.parametrize("kind", ["kcd", "sym", "arxml"])
def test_a_network_has_the_same_messages_in_each_format(kind: str) -> None:
    text = arxml() if kind == "arxml" else getattr(can_database(DBC), f"as_{kind}_string")()
    assert compared(parse_dbc(text, kind)) == compared(parse_dbc(DBC))
