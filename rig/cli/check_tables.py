"""A check of a bench as blocks of a document: devices, latencies, every finding with its fix."""

from __future__ import annotations

from rig.check.finding import CheckReport, DeviceReport
from rig.document.blocks import Blocks, Column, Head, Note, Paragraph, Row, table
from rig.document.words import FAIR, GOOD, PLAIN, POOR

SEVERITIES = {"warning": FAIR, "failed": POOR}
MARKS = {"note": "  ", "warning": "! ", "failed": "X "}


def check_blocks(report: CheckReport) -> Blocks:
    """A table of the devices, then every finding with what to do about it."""
    head: list[Head] = [Column("device"), Column("verdict"), *(
        Column(name, "", True) for name in ("rate", "latency", "jitter", "noise", "resolution", "at rest")
    )]  # fmt: skip
    rows = [
        Row((device.name, device.verdict, *_numbers(device)), SEVERITIES.get(device.verdict, PLAIN))
        for device in report.devices
    ]
    blocks: Blocks = [table(head, rows), *_histograms(report)]
    for device in report.devices:
        for finding in sorted(device.findings, key=lambda finding: -finding.severity):
            severity = finding.severity.name.lower()
            text = f"{MARKS[severity]}{device.name}: {finding.slug}: {finding.text}"
            blocks += [Note(SEVERITIES.get(severity, PLAIN), text), Paragraph(f"    -> {finding.fix}")]
    watchdog_ms = next((d.numbers["watchdog_ms"] for d in report.devices if "watchdog_ms" in d.numbers), None)
    if isinstance(watchdog_ms, float):
        blocks.append(Paragraph(f"watchdog test passed: the watchdog tripped after {watchdog_ms:.0f} ms"))
    if report.passed:
        done = "checked, with motion" if report.proved else "checked, without motion"
        return [*blocks, Note(GOOD, f"{report.bench}: {done}")]
    return [*blocks, Note(POOR, f"{report.bench}: `rig run` would not start on this rig")]


def _histograms(report: CheckReport) -> Blocks:
    """Of each device how many per cent of its answers or arrivals are in each bin of latency."""
    histograms = {device.name: device.numbers.get("latency_histogram") for device in report.devices}
    known = {name: bins for name, bins in histograms.items() if isinstance(bins, list)}
    if not known:
        return []
    edges = ("more" if edge is None else f"{edge:g}" for edge, _ in next(iter(known.values())))
    rows = []
    for name, bins in known.items():
        total = sum(count for _, count in bins) or 1
        rows.append([name, *(f"{100 * count / total:.0f}" if count else "." for _, count in bins)])
    head: list[Head] = ["up to (ms)", *(Column(edge, "", True) for edge in edges)]
    return [table(head, rows, title="latency, % of values")]


def _numbers(device: DeviceReport) -> tuple[str, ...]:
    """The table's numbers of one device; empty where there are none."""
    numbers, unit = device.numbers, str(device.numbers.get("unit", ""))

    def cell(value: object, unit: str, digits: int = 3) -> str:
        return f"{value:.{digits}g} {unit}" if isinstance(value, float) and value == value else ""

    return (
        cell(device.rate_Hz, "Hz", 4), cell(device.latency_ms, "ms"), cell(numbers.get("jitter_ms"), "ms"),
        cell(numbers.get("noise"), unit), cell(numbers.get("resolution"), unit), cell(numbers.get("at_rest"), unit),
    )
