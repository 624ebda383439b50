"""Options of an earlier import, used again for files of the same layout (`rig import --like RUN`).

They are kept in `campaign.json`, with the layout of the files at that time. What belongs to a test and not to the
layout of its file is not used again: a fixed coil current and the specimen.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.recording.external_tests import ImportedTest, ImportSettings, named_files
from rig.recording.file_formats.file_layout import FileLayout
from rig.recording.file_formats.table_file import Dialect
from rig.text_file import read_json

KEY = "import"
"""Of `campaign.json`."""
EXCLUSIVE = (("time", "rate_Hz"), ("current", "current_from_name"), ("commanded_current", "voltage"))
"""Options of which a new one replaces the other one of the earlier import."""
MOST_LAYOUTS = 16


@dataclass(frozen=True)
class ImportPreset:
    """The options of an import and the layouts of its files.

    Attributes:
        settings: what was read of every file.
        waveform: of all tests.
        mid_stroke_m: of all tests; None: unknown.
        layouts: of the files, each different one once.
        run: name of the run.
    """

    settings: ImportSettings
    waveform: str
    mid_stroke_m: float | None = None
    layouts: tuple[FileLayout, ...] = ()
    run: str = field(default="", compare=False)

    @classmethod
    def of_run(cls, folder: Path) -> ImportPreset:
        """The options with which a run was imported.

        Raises:
            FileProblem: it is no run, was not imported, or by a version that did not keep the options.
        """
        file = CampaignFolder(folder).description
        held = read_json(file)
        if not held.get("imported"):
            raise FileProblem(str(file), ["this run was recorded, not imported. Fix: specify an imported run"])
        if KEY not in held:
            raise FileProblem(str(file), ["this run was imported by a version that did not store its options. Fix: "
                "import its files again with all options, then use that run"])
        # loads pydantic, which other imports do without
        from pydantic import TypeAdapter, ValidationError

        try:
            preset = TypeAdapter(cls).validate_python(held[KEY])
        except ValidationError as error:
            problems = [f"{'.'.join(map(str, (KEY, *one['loc'])))}: {one['msg']}" for one in error.errors()[:5]]
            raise FileProblem(str(file), problems) from error
        return replace(preset, run=folder.name)

    @classmethod
    def of_tests(
        cls, tests: Sequence[ImportedTest], settings: ImportSettings, waveform: str, mid_stroke_m: float | None
    ) -> ImportPreset:
        """The options of an import that is being made."""
        layouts: list[FileLayout] = []
        for test in tests:
            alike = (known for known in layouts if test.layout and not any(known.differences(test.layout, ())))
            if test.layout is not None and len(layouts) < MOST_LAYOUTS and next(alike, None) is None:
                layouts.append(test.layout)
        return cls(settings, waveform, mid_stroke_m, tuple(layouts))

    def to_json(self) -> dict[str, Any]:
        """For `campaign.json`."""
        scales = {quantity: str(scale) for quantity, scale in self.settings.scales.items()}
        held = asdict(replace(self, settings=replace(
            self.settings, columns=dict(self.settings.columns), scales=scales
        )))  # fmt: skip
        del held["run"]
        return held

    def updated(self, given: Mapping[str, Any]) -> ImportPreset:
        """These options with new ones in their place.

        Args:
            given: fields of `ImportSettings`, of `Dialect` and of this class that the user states; columns and scales
                replace those of the same quantity.

        Raises:
            FileProblem: the coil current is stated in none of them; that of the earlier import is not used again.
        """
        settings, columns = self.settings, dict(given.get("columns") or {})
        kept = {
            quantity: text for quantity, text in settings.columns.items()
            if not any(quantity in pair and any(
                other in columns or given.get(other) is not None for other in pair if other != quantity
            ) for pair in EXCLUSIVE)
        }  # fmt: skip
        scales = {quantity: scale for quantity, scale in settings.scales.items()
                  if quantity in kept and quantity not in columns}  # fmt: skip
        stated = {one.name: given[one.name] for one in fields(ImportSettings) if one.name in given}
        dialect = {one.name: given[one.name] for one in fields(Dialect) if one.name in given}
        dropped = {option: None for quantity, option in EXCLUSIVE[:2] if quantity in columns}
        if given.get("current_A") is not None:
            dropped["current_from_name"] = None
        merged = replace(settings, **{
            "current_A": None, "described": {}, **dropped, **stated, "columns": {**kept, **columns},
            "scales": {**scales, **(given.get("scales") or {})}, "dialect": replace(settings.dialect, **dialect),
        })  # fmt: skip
        known = {"current", "commanded_current", "voltage"} & merged.columns.keys()
        if settings.current_A is not None and not (known or merged.current_from_name or merged.current_A is not None):
            raise FileProblem("--like", [
                f"{self.run} was imported with the coil current {settings.current_A:g} A, which may not apply to "
                "these files. Fix: specify the current, for example --current '0.5 A'"
            ])
        own = {name: given[name] for name in ("waveform", "mid_stroke_m") if name in given}
        return replace(self, settings=merged, **own)

    def compare(self, tests: Sequence[ImportedTest], replaced: Collection[str]) -> list[str]:
        """How the files of tests differ from those of the earlier import, one line for each difference.

        Args:
            tests: read with these options.
            replaced: quantities whose column or scale the user states anew.

        Raises:
            FileProblem: a difference for which these options would give wrong numbers.
        """
        problems: dict[str, list[Path]] = {}
        notes: dict[str, list[Path]] = {}
        for test in tests:
            now = test.layout
            if now is None or not self.layouts:
                continue
            wrong, other = min(
                ((list(one.contradictions(now, replaced)), list(one.differences(now, replaced)))
                 for one in self.layouts), key=lambda pair: (len(pair[0]), len(pair[1])),
            )  # fmt: skip
            for texts, where in ((wrong, problems), (other, notes)):
                for text in texts:
                    where.setdefault(text, []).append(test.source)
        if problems:
            raise FileProblem("import", [f"{named_files(list(dict.fromkeys(where)))}: differs from {self.run}: {text}"
                                         for text, where in problems.items()])  # fmt: skip
        return [f"{named_files(list(dict.fromkeys(where)))}: {text}" for text, where in notes.items()]
