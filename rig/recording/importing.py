"""Conversion of tests of other programs to a run: files with named columns and units become points in the same format.

Nothing is filtered or resampled; ramps and rests at both ends remain. Values that the files do not contain are stated
as unknown.
"""

from __future__ import annotations

import json
import re
import secrets
import shutil
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import rig
from rig.campaign_folder import CampaignFolder
from rig.clock import utc_now
from rig.display import Positive
from rig.errors import DataWarning, FileProblem
from rig.recording.atomic_write import inner_folder, write_durably, write_text_durably
from rig.recording.external_tests import ImportedTest, ImportSettings, read_tests
from rig.recording.file_formats.table_file import Dialect
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.import_preset import KEY, ImportPreset
from rig.recording.imported_quality import TestSamples, assess
from rig.recording.imported_signs import doubtful_signs, signed_loops
from rig.recording.layout import AlignedChannel, PointFile
from rig.recording.motion_parts import TestPart, every_part
from rig.recording.point_attributes import point_fields
from rig.recording.quality.point_quality import MotionQuality, PointQuality, SkewQuality, time_quality
from rig.recording.recorded_point import RecordedPoint
from rig.recording.tested_on import TESTED, tested_on
from rig.signals.cycles import MeasuredMotion
from rig.signals.derivatives import velocity_of
from rig.signals.free_motion import RANDOM, mean_rate_Hz
from rig.signals.waveform import SINE
from rig.text_file import LARGEST_NAMED_FILE_BYTES, read_text

SOFTWARE = f"mr-damper-rig {rig.__version__}"
LONGEST_NAME = 100
"""Characters of a point's id that come from the file's name; a point's id has at most 150."""
NOT_IN_A_NAME = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True)
class Described:
    """What the user says of all tests.

    Attributes:
        waveform: `sine`, `triangle`, or `random` for motion without cycles.
        specimen: serial number of the damper; becomes part of the directory's name.
        mid_stroke_m: mid-stroke in the coordinate of the displacement column; None: unknown.
        options: with which the tests were read, to be kept for `--like`; None: not kept.
        differences: from the files of an earlier import.
        positive: direction in which the displacement column is positive, and thus `mid_stroke_m`.
        details: file with `[report]` and `[display]` that the run keeps; None: none.
        tested: date or time of the tests (ISO 8601); empty: not known.
    """

    waveform: str = SINE.name
    specimen: str = "imported"
    mid_stroke_m: float | None = None
    options: ImportPreset | None = None
    differences: tuple[str, ...] = ()
    positive: Positive = "rebound"
    details: Path | None = None
    tested: str = ""

    @classmethod
    def of(
        cls, preset: ImportPreset, specimen: str, differences: Sequence[str], details: Path | None = None,
        date: str | None = None,
    ) -> Described:
        """What the options of an import state of its tests.

        Raises:
            FileProblem: `date` is no date, or not one of the past.
        """
        return cls(
            preset.waveform, specimen, preset.mid_stroke_m, preset, tuple(differences), preset.settings.positive,
            details, "" if date is None else tested_on(date),
        )

    @property
    def mid_extension_m(self) -> float | None:
        """Mid-stroke in the coordinate of the recorded displacement, which is positive in extension."""
        inverted = self.positive == "compression" and self.mid_stroke_m is not None
        return -(self.mid_stroke_m or 0.0) if inverted else self.mid_stroke_m


def import_tests(
    files: Sequence[Path | str], *, columns: Mapping[str, str] | None = None, out: Path | str,
    current_A: float | None = None, current_from_name: str | None = None, waveform: str | None = None,
    specimen: str = "imported", mid_stroke_m: float | None = None, rate_Hz: float | None = None,
    dialect: Dialect | None = None, accept: Sequence[str] | None = None, ampere_per_volt: float | None = None,
    scales: Mapping[str, str | float] | None = None, no_value: Sequence[float] | None = None,
    like: Path | str | None = None, positive: Positive | None = None,
    details: Path | str | None = None, date: str | None = None,
) -> Path:
    """Make a run from files of other programs, one point for each file or steady motion in it, all or none.

    Args:
        files: the tests.
        columns: `displacement`, `force` and, if known, `time`, `current` (measured) and `commanded_current` or
            `voltage` (of the driver, a command) -> column with its unit: after a colon (`x:mm`), as the file says it,
            or as a suffix of the name (`x_mm`).
        out: folder in which the run's directory is made.
        current_A: coil current of all tests, where the files have no column of it.
        current_from_name: regular expression with a group `current` (in A) to be found in each file's name.
        waveform: `sine` (also where it is None), `triangle`, or `random` for motion without cycles.
        specimen: serial number of the damper; becomes part of the directory's name.
        mid_stroke_m: mid-stroke in the coordinate of the displacement column; None: unknown.
        rate_Hz: sample rate, where neither a column nor the format has a time.
        dialect: how text files and workbooks are written, where the guess is wrong.
        accept: slugs of doubts (`units-force`, ...) about sizes that are right all the same.
        ampere_per_volt: current that the driver commands for a volt of `voltage`; None: 1.
        scales: quantity -> factor of its column (-1 turns the sign) or sensitivity (`500 N/V`, `0.25 N/count`).
        no_value: numbers that stand for no value; None: -9999 and other usual ones, where no other value is near them.
        like: directory of an imported run whose options are used where none are given here, except for the current and
            the specimen; a `UserWarning` names each difference of a file's layout.
        positive: direction in which displacement and force are positive in the files after `scales` was applied:
            `rebound` (extension; also where it is None) or `compression`, for which both signs are inverted. A
            `DataWarning` is issued if the force at the ends of the stroke suggests the other direction.
        details: TOML file with `[report]` and `[display]`, of which the run keeps a copy for its reports.
        date: of the tests, such as "2026-03-05" or "2026-03-05 14:30" (local time); None: not known.

    Returns:
        The run's directory.

    Raises:
        FileProblem: one line for each thing that does not fit: file, line, column, value. Nothing is written then.
    """
    given = {name: value for name, value in {
        "columns": columns, "current_A": current_A, "current_from_name": current_from_name, "rate_Hz": rate_Hz,
        "accept": None if accept is None else tuple(accept), "ampere_per_volt": ampere_per_volt, "scales": scales,
        "no_value": no_value, "waveform": waveform, "mid_stroke_m": mid_stroke_m, "positive": positive,
        **({} if dialect is None else changed_from(Dialect(), dialect)),
    }.items() if value is not None}  # fmt: skip
    tests, preset, differences = read_like([Path(file) for file in files], given, None if like is None else Path(like))
    for text in differences:
        warnings.warn(f"differs from {preset.run}: {text}", UserWarning, stacklevel=2)
    for text in doubtful_signs(signed_loops(tests, preset.waveform), preset.settings.positive):
        warnings.warn(text, DataWarning, stacklevel=2)
    return write_run(tests, Path(out), Described.of(
        preset, specimen, differences, None if details is None else Path(details), date
    ))


def changed_from(usual: Dialect, dialect: Dialect) -> dict[str, Any]:
    """The fields of a dialect that differ from the usual ones."""
    return {name: value for name, value in vars(dialect).items() if value != getattr(usual, name)}


def read_like(
    files: Sequence[Path], given: Mapping[str, Any], like: Path | None
) -> tuple[list[ImportedTest], ImportPreset, list[str]]:
    """Read tests with options, those that are not given taken from an earlier import; nothing is written.

    Args:
        files: the tests.
        given: see `ImportPreset.updated`.
        like: directory of the run of the earlier import; None: there is none.

    Returns:
        The tests, all options, and how the files differ from those of the earlier import.

    Raises:
        FileProblem: one line for each thing that does not fit.
    """
    earlier = ImportPreset(ImportSettings({}), SINE.name) if like is None else ImportPreset.of_run(like)
    preset = earlier.updated(given)
    try:
        tests = read_tests(files, preset.settings)
        replaced = {*(given.get("columns") or {}), *(given.get("scales") or {})}
        differences = preset.compare(tests, replaced)
    except FileProblem as error:
        if like is None:
            raise
        raise FileProblem(error.file, [*error.problems, f"(options of {earlier.run} used)"]) from error
    kept = ImportPreset.of_tests(tests, preset.settings, preset.waveform, preset.mid_stroke_m)
    return tests, replace(kept, run=earlier.run), differences


def write_run(tests: Sequence[ImportedTest], out: Path, described: Described) -> Path:
    """Write tests as a run: all or nothing.

    Args:
        tests: as `rig.recording.external_tests.read_tests` gives them.
        out: folder in which the run's directory is made.
        described: of all tests.

    Raises:
        FileProblem: the folder cannot be written, or the details are wrong.
    """
    kept = {} if described.details is None else details_files(described.details)
    folder = out / f"{utc_now():%Y%m%dT%H%M%SZ}-{NOT_IN_A_NAME.sub('-', described.specimen)}-{secrets.token_hex(2)}"
    try:
        CampaignFolder(folder).points.mkdir(parents=True)
        for name, content in kept.items():
            inner_folder(folder, str(Path(name).parent))
            write_durably(folder / name, content)
        _write_run(folder, tests, described)
    except BaseException as error:  # also if memory is exhausted, or on Ctrl-C
        shutil.rmtree(folder, ignore_errors=True)  # made here, a moment ago, by this very function
        if not isinstance(error, OSError):
            raise
        raise FileProblem(str(folder), [f"could not be written: {error}; nothing was imported"]) from error
    return folder


def details_files(path: Path) -> dict[str, bytes]:
    """Name in the run's folder -> content of a checked file of details and of the logo that it names.

    Raises:
        FileProblem: an entry is wrong, or the logo cannot be read.
    """
    # load pydantic, which other imports do without
    from rig.matrix.named_files import kept
    from rig.matrix.report_table import load_details

    load_details(path)
    text, files = kept(read_text(path, LARGEST_NAMED_FILE_BYTES), path.absolute().parent)
    logos = {f"{CampaignFolder.records}/{name}": content for name, content in files.items()}
    return {CampaignFolder.details: text.encode(), **logos}


def _write_run(folder: Path, tests: Sequence[ImportedTest], described: Described) -> None:
    """Write one file a test and the run's description.

    Raises:
        OSError: the disk refuses one of them.
    """
    entries = []
    parts = every_part(tests, described.waveform)
    for name, part in zip(_names(parts), parts, strict=True):
        test = part.test
        write_file(CampaignFolder(folder).points / f"{name}.h5", _point_file(name, part, described))
        entry = {"id": name, "source": test.source.name, "part": test.part, "sha256": test.sha256,
                 "read_as": test.read_as}  # fmt: skip
        entries.append(entry | ({"motion": part.number, "start_s": part.start_s} if part.number else {}))
    description: dict[str, Any] = {
        "id": folder.name, "imported": True, "specimen": described.specimen,
        "created": utc_now().isoformat(timespec="seconds"), "software": SOFTWARE,
        "columns": {key: choice.text for key, choice in tests[0].choices.items()}, "points": entries,
    }
    if described.tested:
        description[TESTED] = described.tested
    options = described.options
    if options is not None:
        description[KEY] = options.to_json()
    if options is not None and options.run:
        description["like"] = {"run": options.run, "differences": list(described.differences)}
    write_text_durably(CampaignFolder(folder).description, json.dumps(description, indent=1) + "\n")


def points_of(tests: Sequence[ImportedTest], described: Described) -> list[RecordedPoint]:
    """Tests as points in memory, the same as those of a run that `write_run` makes of them.

    Args:
        tests: as `rig.recording.external_tests.read_tests` gives them.
        described: of all tests.
    """
    parts = every_part(tests, described.waveform)
    return [_point_of(_point_file(name, part, described)) for name, part in zip(_names(parts), parts, strict=True)]


def _point_of(file: PointFile) -> RecordedPoint:
    """The point that its file would be opened as, without a file."""
    quality, test = PointQuality.read(file.quality), file.test
    verdict, skew, middle_m = quality.verdict, quality.skew, test["mid_stroke_m"]
    return RecordedPoint(
        **point_fields(test), mid_stroke_m=middle_m if isinstance(middle_m, float) else None,
        verdict=verdict.verdict, reasons=verdict.reasons, lost_samples=quality.lost_samples or 0,
        skew_s=skew.value_s or 0.0, skew_std_s=skew.std_s or 0.0, sample_rate_Hz=file.sample_rate_hz, imported=True,
        test=test, quality=quality, provenance=file.provenance,
        arrays={"time": np.asarray(file.time_s), **{one.name: np.asarray(one.values) for one in file.channels}},
    )


def _names(parts: Sequence[TestPart]) -> list[str]:
    stems = []
    for part in parts:
        test, number = part.test, f"-{part.number}" if part.number else ""
        stem = NOT_IN_A_NAME.sub("-", "_".join((test.source.stem, *([test.part] if test.part else []))))
        stems.append((stem.lstrip(".") or "test")[:LONGEST_NAME] + number)
    return told_apart(stems)


def told_apart(names: Iterable[str]) -> list[str]:
    """The names, those that were there before with a number: files in different folders may have the same name."""
    made: dict[str, None] = {}
    for stem in names:
        name, count = stem, 2
        while name in made:
            name, count = f"{stem}-{count}", count + 1
        made[name] = None
    return list(made)


def _point_file(name: str, part: TestPart, described: Described) -> PointFile:
    test = part.test
    times = test.times
    period_s = float(np.median(np.diff(test.time_s)))
    velocity, method = velocity_of(test.time_s, test.displacement_m)
    assessment = assess(TestSamples(
        test.time_s, test.displacement_m, test.force_N, velocity, test.current_A, test.nominal_current_A,
        test.current_measured,
    ), described.waveform)  # fmt: skip
    motion = assessment.motion
    measured = motion is not None or described.waveform == RANDOM
    amplitude_m, frequency_Hz = _size(test, motion) if measured else (0.0, 0.0)
    channels = [
        AlignedChannel("displacement", test.displacement_m, "m", "Damper extension", _source(test, "displacement")),
        AlignedChannel("force", test.force_N, "N", "Force", _source(test, "force")),
        AlignedChannel("current", test.current_A, "A", _current_name(test), "current" if test.current_measured else ""),
        AlignedChannel(
            "velocity", velocity, "m/s", "Velocity from measured displacement", attributes={"method": method},
        ),
    ]
    if test.commanded_A is not None:
        channels.append(AlignedChannel(
            "commanded_current", test.commanded_A, "A", "Commanded coil current",
            _source(test, "voltage" if "voltage" in test.choices else "commanded_current"),
        ))
    low_degC = high_degC = None
    if test.temperature_degC is not None and np.any(np.isfinite(test.temperature_degC)):
        low_degC, high_degC = float(np.nanmin(test.temperature_degC)), float(np.nanmax(test.temperature_degC))
        channels.append(AlignedChannel(
            "coil_temperature", test.temperature_degC, "degC", "Temperature of the coil or body",
            _source(test, "temperature"),
        ))  # fmt: skip
    quality = PointQuality(
        verdict=assessment.verdict, lost_samples=assessment.lost, coil_low_degC=low_degC, coil_high_degC=high_degC,
        skew=SkewQuality(value_s=0.0, std_s=0.0, method="common time base, as imported; not checked"),
        motion=MotionQuality(cycles=0) if motion is None else MotionQuality(
            cycles=motion.cycles, amplitude_m=motion.amplitude_m, frequency_Hz=motion.frequency_Hz,
            mean_m=motion.mean_m, start_s=motion.start_s, end_s=motion.end_s,
        ),
        record=part.use(motion),
        time=None if times is None else time_quality(times),
    )
    return PointFile(
        time_s=test.time_s, sample_rate_hz=1.0 / period_s, channels=channels, flags=assessment.flags,
        test={
            "id": name, "waveform": described.waveform,
            "amplitude_m": amplitude_m, "frequency_Hz": frequency_Hz,
            "current_A": test.nominal_current_A, "cycles": 0 if motion is None else motion.cycles,
            "mid_stroke_m": described.mid_extension_m, "imported": True,
        },
        quality=quality.attributes,
        provenance={
            "software": SOFTWARE, "source_file": test.source.name, "source_sha256": test.sha256,
            "imported_utc": utc_now().isoformat(timespec="seconds"),
            "current": _current_source(test), "read_as": test.read_as,
            **({TESTED: described.tested} if described.tested else {}),
        },
        title=f"Imported test {name}",
    )


def _source(test: ImportedTest, quantity: str) -> str:
    """The column of a quantity; of a table in memory the quantity itself."""
    return test.choices[quantity].column if quantity in test.choices else quantity


def _current_name(test: ImportedTest) -> str:
    return "Coil current" if test.current_measured else f"Coil current {_current_source(test)}"


def _current_source(test: ImportedTest) -> str:
    if test.current_measured:
        return "measured"
    if "voltage" in test.choices:
        return f"not measured; see commanded_current (driver voltage {test.choices['voltage'].column})"
    return "as specified; not measured" if test.commanded_A is None else "not measured; see commanded_current"


def _size(test: ImportedTest, motion: MeasuredMotion | None) -> tuple[float, float]:
    """Amplitude (m) and frequency (Hz), of motion without cycles half its span and how often it crosses its mean."""
    if motion is not None:
        return motion.amplitude_m, motion.frequency_Hz
    span_m = float(np.nanmax(test.displacement_m) - np.nanmin(test.displacement_m))
    return 0.5 * span_m, mean_rate_Hz(test.time_s, test.displacement_m)
