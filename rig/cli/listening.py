"""`rig check --listen`: traffic on a port or a CAN bus, and the lines of a bench file that read it. Nothing is sent."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from drivers.can_sniffing import decoded, listen_to_can
from drivers.connection import CanAddress, LineSettings
from drivers.errors import DriverError
from drivers.port_causes import with_fix
from protocols.errors import LocalProtocolError
from protocols.guess_can import CanFrame, read_candump, summaries
from rig import units
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, FileProblem, RigError, some
from rig.files.described import described
from rig.files.network_text import LARGEST_NETWORK_BYTES, dbc_text

if TYPE_CHECKING:
    from drivers.sniffing import Heard, Match
    from protocols.guess_can import CanLog

SHOWN = 5
LARGEST_FILE_BYTES = 1 << 20
DEFAULTS = {"parity": "N", "bitrate": 500_000, "seconds": 1.0}
FILE = click.Path(path_type=Path, exists=True, dir_okay=False)


class NothingHeard(RigError):
    """The port or the bus cannot be listened to."""


def listen_options(function: Callable[..., int]) -> Callable[..., int]:
    """The options of `rig check --listen`."""
    for option in reversed((
        click.option("--listen", is_flag=True,
                     help=(
                         "Show the data received from a port or CAN bus (given instead of BENCH), and suggest lines "
                         "for a bench file."
                     )),
        click.option("--from", "captured", type=FILE, hidden=True),
        click.option("--format", "given", metavar="FORMAT",
                     help="With --listen: decode the data with this format (a name or a file) instead of detecting "
                          "the format."),
        click.option("--dbc", type=FILE, help="With --listen: decode CAN frames with a DBC, KCD, SYM or ARXML file."),
        click.option("--baud", type=click.IntRange(300, 12_000_000),
                     help="With --listen: baud rate. By default, several baud rates are tried."),
        click.option("--parity", type=click.Choice(["N", "E", "O"]),
                     help="With --listen and --baud: parity. The default is N."),
        click.option("--bitrate", type=click.IntRange(10_000, 1_000_000),
                     help="With --listen: bit rate of the CAN bus. The default is 500000."),
        click.option("--seconds", type=click.FloatRange(0.1, 600.0),
                     help="With --listen: listening time at each baud rate. The default is 1 s."),
    )):  # fmt: skip
        function = option(function)
    return function


def listen(source: str | None, options: Mapping[str, Any], *, as_json: bool) -> int:
    """Listen to a port or a CAN bus, or read captured traffic, and show what it is. Nothing is sent.

    Args:
        source: a serial port, `socket://HOST:PORT`, a CAN bus as INTERFACE:CHANNEL, or a file of captured bytes or of
            `candump -l`.
        options: by the names of `listen_options`; None where not given.
        as_json: print one JSON object.

    Returns:
        0 when a format was found or fits, 5 when not.

    Raises:
        UsageError: there is no source, or there are two.
        NothingHeard: the port or the bus cannot be opened.
        FileProblem: a file cannot be used.
    """
    options = {**options, **{name: value for name, value in DEFAULTS.items() if options[name] is None}}
    captured = options["captured"]
    if source is None and captured is None:
        raise click.UsageError("no source specified. Fix: run rig check --listen with a port or a file of bytes")
    if source is not None and captured is not None:
        raise click.UsageError(f"specify either a port or a file of captured bytes, not both {source} and {captured}")
    if captured is None and source is not None and Path(source).is_file():
        captured, source = Path(source), None
    options["captured"] = captured
    if captured is not None:
        _refuse_bench(captured)
    log = _can_log(source, options)
    words = _words
    if log is None:
        answer = _sensor(source, options)
    elif options["given"] is None:
        answer, words = _can(log, options["dbc"]), _can_words
    else:
        answer = _sensor_on_bus(str(source or captured), log.frames, options)
    if as_json:
        write_json(answer)
    else:
        say("\n".join(words(answer)))
    return EXIT_DONE if answer["found"] else EXIT_NOT_ALL_VALID


def _refuse_bench(captured: Path) -> None:
    """Refuse a file of settings in place of captured traffic.

    Raises:
        FileProblem: it is TOML; with the command for a bench file.
    """
    try:
        tables = tomllib.loads(_read(captured).decode("utf-8"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError):
        return
    if any(isinstance(table, dict) for table in tables.values()):
        raise FileProblem(str(captured), [
            f"--listen: got a TOML file ({', '.join(f'[{name}]' for name in list(tables)[:3])} ...), expected a serial "
            "port, socket://HOST:PORT, a CAN bus as INTERFACE:CHANNEL, or a file of captured bytes. Fix: to check "
            f"the devices in a bench file, use `rig check {captured}`; --listen requires the port of one device",
        ])  # fmt: skip


def _can_log(port: str | None, options: Mapping[str, Any]) -> CanLog | None:
    """Read a bus or a log; None if the source is a byte stream of a sensor.

    Raises:
        NothingHeard: the bus cannot be opened.
    """
    from rig.bench.address import INTERFACES

    if options["captured"] is not None:
        log = read_candump(_read(options["captured"]).decode("utf-8", "replace"))
        return None if log.is_empty else log
    interface, colon, channel = (port or "").partition(":")
    if not colon or interface not in INTERFACES:
        return None
    try:
        return listen_to_can(CanAddress(interface, channel, options["bitrate"]), max(1.0, options["seconds"]))
    except DriverError as error:
        raise NothingHeard(with_fix(error)) from error


def _read(path: Path) -> bytes:
    """Captured bytes.

    Raises:
        FileProblem: the file cannot be read, or is empty.
    """
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE_BYTES)
    except OSError as error:
        raise FileProblem(str(path), [f"cannot be read: {error.strerror}"]) from error
    if not data:
        raise FileProblem(str(path), ["the file is empty, expected captured bytes"])
    return data


def _sensor(port: str | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """What came from a sensor, and its format.

    Raises:
        NothingHeard: the port cannot be opened.
        UsageError: a parity without a rate.
    """
    from drivers.sniffing import Heard, listened

    if port is None:
        rounds = [Heard(0, _read(options["captured"]), 0.0, None)]
        return _answer(str(options["captured"]), rounds, options["given"], None)
    baud = options["baud"]
    if options["parity"] != "N" and baud is None:
        raise click.UsageError("--parity requires --baud")
    line = None if baud is None else LineSettings(baud, parity=options["parity"])
    try:
        rounds = listened(port, line, options["seconds"])
    except DriverError as error:
        raise NothingHeard(with_fix(error)) from error
    return _answer(port, rounds, options["given"], port)


def _sensor_on_bus(source: str, frames: list[CanFrame], options: Mapping[str, Any]) -> dict[str, Any]:
    """Readings of a sensor on a bus, decoded with its format.

    Raises:
        FileProblem: the format cannot be used, or is not that of a CAN message.
    """
    # loads pyserial: not needed for the help
    from drivers.sensor_formats import described_format
    from drivers.sniffing import Heard

    given = options["given"]
    try:
        message = getattr(described_format(described("sensor-format", given)), "can", None)
    except LocalProtocolError as error:
        raise FileProblem("--format", [str(error)]) from error
    if message is None:
        raise FileProblem("--format", [f"{given} is not the format of a CAN message. Fix: use a format with dbc and "
            "signal, or with id; see docs/how-to/add-a-sensor-format.md"])  # fmt: skip
    own = [data for _, identifier, data, extended in frames if message.is_own(identifier, extended=extended)]
    seconds = frames[-1][0] - frames[0][0] if frames else 0.0
    return _answer(source, [Heard(0, b"".join(map(message.row, own)), seconds, None)], given, None)


def _answer(source: str, rounds: list[Heard], given: str | None, url: str | None) -> dict[str, Any]:
    # loads pyserial: not needed for the help
    from drivers.sniffing import entries, guessed

    heard = rounds[-1]
    match = _tried(heard.data, given) if given is not None else heard.match or guessed(heard.data)
    answer: dict[str, Any] = {
        "source": source, "bytes": len(heard.data), "seconds": heard.seconds, "baudrate": heard.baudrate,
        "tried_rates": [{"baudrate": one.baudrate, "bytes": len(one.data)} for one in rounds],
        "found": match is not None and match.believed, "start": heard.data[:48].hex(" "),
    }  # fmt: skip
    if match is None:
        return answer
    rate_Hz = len(match.readings) / heard.seconds if heard.seconds else None
    answer |= {
        "format": match.name, "matched_bytes": match.matched, "readings": len(match.readings),
        "damaged": match.damaged, "rate_Hz": rate_Hz,
        "examples": [{"value": value, "status": status} for value, status in match.readings[:SHOWN]],
        "missed": [{"offset": end - count, "bytes": count} for end, count in match.missed],
    }  # fmt: skip
    if given is None:
        answer["toml"] = _toml(entries(match), heard, url, rate_Hz)
    return answer


def _tried(data: bytes, given: str) -> Match:
    """A format tried on bytes.

    Raises:
        FileProblem: the format cannot be used; with every reason.
    """
    # loads pyserial: not needed for the help
    from drivers.sniffing import tried
    try:
        return tried(data, described("sensor-format", given), given)
    except LocalProtocolError as error:
        raise FileProblem("--format", [str(error)]) from error


def _toml(given: Mapping[str, Any] | str, heard: Heard, url: str | None, rate_Hz: float | None) -> str:
    """The lines of a bench file that read this."""
    lines = [
        "[load_cell]                   # or [lvdt]",
        f"url = {json.dumps(url or '/dev/ttyUSB0')}",
        f"baudrate = {heard.baudrate or 115200}" if url is None or "://" not in url else "",
        f'rate = "{_rounded(rate_Hz):g} Hz"' if rate_Hz else 'rate = "100 Hz"               # as set on the device',
        'range = "10 kN"               # range of the sensor',
    ]
    lines = [line for line in lines if line]
    if isinstance(given, str):
        lines.append(f'format = "{given}"')
    calibration = [
        "[load_cell.calibration]",
        f"sensitivity = {_per_unit(given)!r}          # N per transmitted unit; or points, or rated_output and "
        "capacity",
        'serial_number = "..."',
    ]
    if isinstance(given, str):
        return "\n".join([*lines, *calibration])
    top = [f"{key} = {_value(value)}" for key, value in given.items() if key != "fields"]
    if "status" in given:
        top.append("# check the meaning of each status: ok, overload or fault. A line with another status is rejected")
    tables = [
        f"[load_cell.format.fields.{name}]\n" + "\n".join(f"{key} = {_value(value)}" for key, value in entry.items())
        for name, entry in given.get("fields", {}).items()
    ]
    return "\n".join([*lines, "[load_cell.format]", *top, *tables, *calibration])


def _per_unit(given: Mapping[str, Any] | str) -> float:
    """SI for one of the unit that a line shows; 1 where it shows none, or one that is not known."""
    unit = "" if isinstance(given, str) else str(given.get("unit", ""))
    known = units.unit_named(unit)
    return known.scale if known is not None and known.dimension in {"force", "length"} else 1.0


def _rounded(rate_Hz: float) -> float:
    """A rate as a user would set it: two digits."""
    return float(f"{rate_Hz:.2g}")


def _value(value: object) -> str:
    """A value as TOML: patterns in single quotes, bytes in hexadecimal."""
    if isinstance(value, list) and value and all(type(item) is int for item in value):
        return "[" + ", ".join(f"0x{item:02X}" if item > 9 else str(item) for item in value) + "]"
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_value(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, str) and "\\" in value and "'" not in value and value.isprintable():
        return f"'{value}'"
    return json.dumps(value)


def _words(answer: Mapping[str, Any]) -> list[str]:
    heard = f"{answer['source']}: {answer['bytes']} bytes"
    if answer["seconds"]:
        heard += f" in {answer['seconds']:g} s" + (f" at {answer['baudrate']} Bd" if answer["baudrate"] else "")
    lines = [heard]
    if len(answer["tried_rates"]) > 1:
        lines.append("rates tried: " + ", ".join(str(one["baudrate"]) for one in answer["tried_rates"]))
    if not answer["bytes"]:
        return [*lines, "nothing received. Fix: check the port, and check that the device is on. A device that "
            "must be polled stays silent because no requests are sent; the format of such a device must define the "
            "request"]  # fmt: skip
    if "format" not in answer:
        return [*lines, f"no format matches; the data start with {answer['start']}",
                "Fix: use --baud and --parity as set on the device, listen longer (--seconds 5), or "
                "write a format (see docs/how-to/add-a-sensor-format.md)"]  # fmt: skip
    verdict = "" if answer["found"] else "  (too few readings to be certain)"
    rate = f", {answer['rate_Hz']:.4g} per second" if answer["rate_Hz"] else ""
    lines.append(
        f"format {answer['format']}: {answer['matched_bytes']} of {answer['bytes']} bytes are {answer['readings']} "
        f"readings{rate}; {answer['damaged']} damaged{verdict}"
    )
    shown = ", ".join(f"{one['value']:g}" + (f" (status {one['status']})" if one["status"] else "")
                      for one in answer["examples"])  # fmt: skip
    lines.append(f"readings: {shown}")
    if answer["missed"]:
        places = some([f"{one['bytes']} at {one['offset']}" for one in answer["missed"]], most=SHOWN)
        lines.append(f"bytes that do not belong to any reading: {places}")
    if "toml" in answer:
        lines += ["", "lines for a bench file:", "", answer["toml"]]
    return lines


def _can(log: CanLog, dbc: Path | None) -> dict[str, Any]:
    """What came on a bus.

    Raises:
        FileProblem: the DBC cannot be read.
    """
    frames = log.frames
    answer: dict[str, Any] = {
        "frames": len(frames), "found": bool(frames), "identifiers": [], "error_frames": dict(log.errors),
        "remote_frames": [{"identifier": identifier, "frames": count} for identifier, count in log.remote.items()],
        "other_lines": log.other_lines,
    }  # fmt: skip
    known: dict[int, dict[str, Any]] = {}
    if dbc is not None:
        try:
            known, answer["unknown_identifiers"] = decoded(frames, dbc_text(dbc, LARGEST_NETWORK_BYTES))
        except LocalProtocolError as error:
            raise FileProblem("--dbc", [str(error)]) from error
    for one in summaries(frames):
        entry: dict[str, Any] = {
            "identifier": one.identifier, "extended": one.extended, "frames": one.count,
            "period_ms": 1e3 * one.period_s, "jitter_ms": 1e3 * one.jitter_s, "lengths": list(one.lengths),
            "changing": list(one.changing),
            "counters": [{"byte": at, "lowest_bit": low, "bits": bits} for at, low, bits in one.counters],
            "likely_checksums": list(one.checksums), "last": one.last.hex(" "), "fd": one.identifier in log.fd,
        }  # fmt: skip
        answer["identifiers"].append(entry | known.get(one.identifier, {}))
    return answer


def _can_words(answer: Mapping[str, Any]) -> list[str]:
    others = _other_frames(answer)
    if not answer["frames"]:
        return [
            "no data frame received. Fix: check the bit rate and the termination of the bus, and check that a node is "
            "sending", *others,
        ]
    lines = [f"{answer['frames']} frames", *others, "identifier  frames    period   data"]
    for one in answer["identifiers"]:
        name = f"{one['identifier']:08X}" if one["extended"] else f"{one['identifier']:03X}"
        lengths = "/".join(map(str, one["lengths"]))
        lines.append(
            f"{name:>10}  {one['frames']:6}  {one['period_ms']:6.1f} ms  {lengths} bytes{', CAN FD' * one['fd']}, last "
            + one["last"]
            + (f"   {one['message']}" if "message" in one else "")
        )
        parts = [f"changing bytes: {', '.join(map(str, one['changing']))}"] if one["changing"] else []
        parts += [
            f"counter in byte {place['byte']}, bits {place['lowest_bit']} to {place['lowest_bit'] + place['bits'] - 1}"
            for place in one["counters"]
        ]
        parts += [f"byte {at}: possibly a checksum" for at in one["likely_checksums"]]
        if parts:
            lines.append(" " * 12 + "; ".join(parts))
        for signal, (low, high) in one.get("signals", {}).items():
            lines.append(" " * 12 + (f"{signal} = {low:g}" if low == high else f"{signal} = {low:g} to {high:g}"))
    return lines


def _other_frames(answer: Mapping[str, Any]) -> list[str]:
    """Lines on remote frames, error frames and lines that are not frames."""
    lines = [
        f"remote frames: {one['frames']} for {one['identifier']:03X} (a node requests this identifier)"
        for one in answer["remote_frames"]
    ]
    lines += [f"error frames: {count} ({text})" for text, count in answer["error_frames"].items()]
    if answer["error_frames"]:
        lines.append("  Fix: check the bit rate (for CAN FD, also the data bit rate), the termination and the cable")
    if answer["other_lines"]:
        lines.append(f"lines that are not frames: {answer['other_lines']}")
    return lines
