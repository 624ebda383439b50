"""Checks of an `[ecu]` table with manual current (`by_hand = true`): allowed and forbidden entries."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from protocols.descriptions import Problem

_NOT_BESIDE = (
    "interface", "channel", "roles", "serial_number", "url", "supply", "baudrate", "voltage_limit_V", "identity",
)  # fmt: skip


class ManualEntries(Protocol):
    """The entries of `[ecu]` that belong to a current set by hand."""

    @property
    def by_hand(self) -> bool:
        """A person sets the current."""

    @property
    def pressure_while_asked(self) -> str:
        """The pressure while the operator is at the supply: off, low or on."""

    @property
    def rehearsal(self) -> str | None:
        """The simulated supply that is turned in a person's place."""

    @property
    def interface_options(self) -> dict[str, Any]:
        """Further arguments of a CAN interface."""

    @property
    def dbc_name(self) -> str:
        """The kind of a current controller."""


def manual_problems_of(config: ManualEntries) -> Iterator[Problem]:
    """Entries of another kind of current source beside `by_hand = true`, and its own without it."""
    if not config.by_hand:
        if config.rehearsal is not None:
            yield ("rehearsal",), "applies only with by_hand = true on a simulated rig. Fix: remove this entry"
        if config.pressure_while_asked != "off":
            yield ("pressure_while_asked",), "applies only with by_hand = true. Fix: remove this entry"
        return
    if config.rehearsal is not None and "//127.0.0.1:" not in config.rehearsal:
        yield ("rehearsal",), (
            "must refer to a simulated rig on this computer (127.0.0.1). Fix: remove this entry from the bench file "
            "of a real rig"
        )
    for name in _NOT_BESIDE:
        if getattr(config, name) is not None:
            written = name.removesuffix("_V")
            yield (written,), f"cannot be combined with by_hand = true. Fix: remove {written} or by_hand"
    if config.interface_options or config.dbc_name != "demo":
        name = "interface_options" if config.interface_options else "dbc"
        yield (name,), f"cannot be combined with by_hand = true. Fix: remove {name} or by_hand"
