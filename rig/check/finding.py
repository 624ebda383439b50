"""Results of a check of a device: findings with cause and fix, numbers, and the resulting verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import IntEnum
from typing import Any

from rig.errors import clean_text
from rig.explanations.explanation import texts


class Severity(IntEnum):
    """How bad a finding is; the worst one makes the device's verdict."""

    NOTE = 0
    WARNING = 1
    FAILED = 2

    @property
    def verdict(self) -> str:
        """`ok`, `warning` or `failed`."""
        return ("ok", "warning", "failed")[self]


@dataclass(frozen=True)
class CheckFinding:
    """One thing that a check found.

    Attributes:
        slug: its name; `rig explain` says more.
        severity: how bad it is.
        text: what was seen and what was expected.
        fix: what to do.
    """

    slug: str
    severity: Severity
    text: str
    fix: str

    def to_json(self) -> dict[str, Any]:
        """Its fields; the severity in words."""
        return {**asdict(self), "severity": self.severity.name.lower()}


def failed(slug: str, text: str, fix: str = "") -> CheckFinding:
    """A finding with which the rig is refused; without a `fix`, what its explanation says to look at first."""
    return CheckFinding(slug, Severity.FAILED, clean_text(text), clean_text(fix or _look_at(slug)))


def warning(slug: str, text: str, fix: str = "") -> CheckFinding:
    """A finding that the operator should check; the rig runs with it."""
    return CheckFinding(slug, Severity.WARNING, clean_text(text), clean_text(fix or _look_at(slug)))


def note(slug: str, text: str, fix: str = "") -> CheckFinding:
    """Something worth knowing; it changes no verdict."""
    return CheckFinding(slug, Severity.NOTE, clean_text(text), clean_text(fix or _look_at(slug)))


def _look_at(slug: str) -> str:
    return "; ".join(texts()[slug]["look"]) if slug in texts() else f"rig explain {slug}"


@dataclass
class DeviceReport:
    """One device of the bench, or this machine (`host`).

    Attributes:
        name: as in the bench file.
        findings: what was found, worst first once the report is made.
        rate_Hz: values a second, on the device's own clock where it has one; None where nothing came.
        latency_ms: how long 99 of 100 answers took (controller), or how much later than the fastest one 99 of 100
            values arrived; None where it could not be measured.
        numbers: what else was measured, by name with unit.
        identity: what the device says of itself.
    """

    name: str
    findings: list[CheckFinding] = field(default_factory=list)
    rate_Hz: float | None = None
    latency_ms: float | None = None
    numbers: dict[str, object] = field(default_factory=dict)
    identity: Mapping[str, object] = field(default_factory=dict)

    @property
    def severity(self) -> Severity:
        """That of the worst finding."""
        return max((finding.severity for finding in self.findings), default=Severity.NOTE)

    @property
    def verdict(self) -> str:
        """`ok`, `warning` or `failed`."""
        return self.severity.verdict

    def to_json(self) -> dict[str, Any]:
        """One entry of `devices` in `rig check --json`."""
        worst_first = sorted(self.findings, key=lambda finding: -finding.severity)
        return {
            "name": self.name, "verdict": self.verdict, "findings": [finding.to_json() for finding in worst_first],
            "rate_Hz": self.rate_Hz, "latency_ms": self.latency_ms, "identity": dict(self.identity), **self.numbers,
        }


@dataclass(frozen=True)
class CheckReport:
    """What a check found of a whole bench; `proved`: the rod was moved for it, and the watchdog starved."""

    bench: str
    devices: tuple[DeviceReport, ...]
    proved: bool

    @property
    def passed(self) -> bool:
        """No device failed."""
        return all(device.severity is not Severity.FAILED for device in self.devices)

    def to_json(self) -> dict[str, Any]:
        """The answer of `rig check --json`."""
        devices = [device.to_json() for device in self.devices]
        return {"bench": self.bench, "devices": devices, "proved": self.proved, "passed": self.passed}
