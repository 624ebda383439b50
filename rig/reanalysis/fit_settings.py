"""How the model of a run is fitted again: as the original fit states, else as the matrix file requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rig.campaign_folder import CampaignFolder
from rig.errors import FileProblem
from rig.files.loader import validated
from rig.files.toml_source import read_toml
from rig.fits.fit_record import FitRecord
from rig.identification import Fit, Method, identify
from rig.identification.points.inputs import FITTED
from rig.matrix.sections import Identify
from rig.optimisers import METHODS as SEARCHES
from rig.recording.run import Run

SEPARATOR = "|"


@dataclass(frozen=True)
class FitSettings:
    """Settings of one fit.

    Attributes:
        options: keywords of `identify`.
        fitted_ids: ids of the points that the original fit used; empty if unknown.
        held_out: ids of those that it was validated with.
        suspect: whether it used suspect points, too.
        remarks: settings that cannot be repeated.
    """

    options: dict[str, Any]
    fitted_ids: frozenset[str] = frozenset()
    held_out: tuple[str, ...] = ()
    suspect: bool = False
    remarks: tuple[str, ...] = ()

    @classmethod
    def of(cls, original: FitRecord | None, run: Run, model: str) -> FitSettings | None:
        """The settings for a run; None if nothing is to be fitted.

        Args:
            original: the run's fit; None without one.
            run: the original run.
            model: the model that a user requests instead; empty: none.
        """
        if original is None:
            options = _requested(CampaignFolder(run.path))
            if options is None or not any(point.kind in FITTED for point in run.points):
                return cls({"model": model}) if model else None
            return cls({**options, "model": model} if model else options)
        used = frozenset(test.id for test in original.error.per_test)
        held_out = () if original.holdout is None else tuple(test.id for test in original.holdout.per_test)
        suspect = any(point.verdict == "suspect" and point.id in used for point in run.points)
        if model:
            return cls({"model": model}, used, held_out, suspect)
        options = {"model": original.model, "hysteresis": original.hysteresis_form}
        if original.current is not None:
            options["current"] = original.current.dependence
        if original.series is not None:
            options["series_spring"] = True
        if original.temperature is not None:
            options["temperature_law"] = original.temperature.law
        remarks = []
        if original.method in SEARCHES:
            remarks.append(f"the original was fitted by the search {original.method}, whose budget and seed are not "
                "recorded; the present defaults were used")
        usual = "v" if original.method in SEARCHES else "1"
        weight = None if original.weight == usual else original.weight
        options["method"] = Method(original.method, weight=weight, loss=original.loss)
        if original.corrections.others:
            remarks.append("corrections that are not repeated: " + ", ".join(original.corrections.others))
        return cls(options, used, held_out, suspect, tuple(remarks))

    def fitted(self, run: Run) -> tuple[Fit, tuple[str, ...]]:
        """Fit the run.

        Returns:
            The fit, and remarks on settings that could not be repeated.

        Raises:
            IdentificationFailed: nothing can be identified.
        """
        remarks, options = list(self.remarks), dict(self.options)
        present = {point.id for point in run.points}
        held_out = [one for one in self.held_out if one in present]
        if held_out:
            options["holdout"] = f"id={SEPARATOR.join(held_out)}"
        if len(held_out) < len(self.held_out):
            remarks.append("the original fit was validated with tests that are not points of this run; they were not "
                "used")
        if self.fitted_ids - present:
            remarks.append("the original fit also used tests of other runs; only the points of this run were fitted")
        return identify(run, suspect=self.suspect, **options), tuple(remarks)


def _requested(folder: CampaignFolder) -> dict[str, Any] | None:
    """`[identify]` of the run's matrix file as keywords; None if it requests no fit, or there is no such file."""
    if not folder.matrix.is_file():
        return None
    try:
        table = read_toml(folder.matrix).data.get("identify", {})
    except FileProblem:
        return {"model": "auto"}
    settings, _ = validated(table if isinstance(table, dict) else {}, Identify)
    if settings is None:  # of an earlier or a newer version
        return {"model": "auto"}
    return settings.model_dump(exclude={"enabled"}) if settings.enabled else None
