"""The study file as values: what is compared, over which recordings, how often."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from protocols.descriptions import Problem
from rig.dampers import PARAMETER_SETS
from rig.dampers.catalogue import MODELS
from rig.errors import FileProblem
from rig.files.loader import load_section
from rig.files.places import problem_at
from rig.files.quantity import Quantity
from rig.files.section import Section

Method = Literal[
    "c_foa", "c_foa printed", "foa", "ga", "ga feasible", "de", "de 5", "pso", "i_abc", "ga_standard", "ga_kwok",
    "ga_novel", "hybrid",
]  # fmt: skip
CurrentMethod = Literal["ga_standard", "ga_kwok", "zhu_three_step", "ga_novel"]
REVISION = 2
"""Of the searches: to be raised with every change of the software after which one returns other values."""
LED = ("c_foa", "hybrid")
"""Algorithms that begin where `[comparison] start` says; the others draw their first population."""
Population = Annotated[int, Field(ge=4, le=100_000)]
Budget = Annotated[int, Field(ge=10, le=100_000_000)]
Newton = Annotated[float, Quantity("force", "0 N", "10 kN")]
Ampere = Annotated[float, Quantity("current", "0 A", "20 A")]

SETTINGS: dict[str, tuple[str, dict[str, object]]] = {
    "c_foa printed": ("c_foa", {"variant": "printed"}),
    "ga feasible": ("ga", {"mutation": "feasible direction"}),
    "de 5": ("de", {"strategy": 5}),
}
"""Methods of the file that are another method with settings."""


CURRENT_BOXES: dict[str, dict[str, tuple[float, float]]] = {
    "bouc_wen": {
        "c0": (0.0, 5e3), "k0": (0.0, 2e4), "x0": (-0.05, 0.05), "alpha": (0.0, 2e5), "gamma": (0.0, 2e5),
        "beta": (0.0, 2e5), "n": (1.0, 3.0),
    },
    "normalized_bouc_wen": {
        "kx": (0.0, 2e4), "kv": (0.0, 5e3), "kw": (0.0, 5e3), "f0": (-500.0, 500.0), "rho": (10.0, 1e4),
        "sigma": (0.5, 5.0), "n": (1.0, 5.0),
    },
}  # fmt: skip
"""Search boxes of paper 2's genetic algorithms, which mutate uniformly in them; wide for a damper of a few kN."""


class Data(Section):
    """Where the recordings come from: `simulate`, or `runs` with an optional filter."""

    simulate: Literal["table1", "bouc_wen"] | None = None
    truth: str = "demo"
    noise_N: Newton = Field(default=5.0, alias="noise")
    runs: tuple[str, ...] = ()
    select: str | None = Field(default=None, examples=["waveform=sine"])
    keep_every: int = Field(
        default=1, ge=1, le=1000, description=("use only every n-th sample in the objective")
    )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if (self.simulate is None) == (not self.runs):
            yield (), 'data: expected either simulate = "table1" or runs = ["logs/..."]'


class Comparison(Section):
    """The product that is run: Tables 2, 4, 5 and 10-14 of paper 1."""

    models: tuple[str, ...] = Field(default=("asymmetric",), min_length=1)
    methods: tuple[Method, ...] = Field(min_length=1)
    populations: tuple[Population, ...] = Field(default=(50,), min_length=1)
    budgets: tuple[Budget, ...] = Field(default=(16_000,), min_length=1)
    repeats: int = Field(default=30, ge=2, le=10_000)
    start: Literal["ones", "none"] = "ones"
    bounds: Literal["none", "wide", "model"] = "none"
    weight: Literal["v", "1"] = "v"
    hysteresis: Literal["kwok", "printed"] = "kwok"


class Symmetry(Section):
    """Asymmetric against symmetric: Table 3."""

    method: Method = "c_foa"
    population: Population = 50
    budget: Budget = 16_000


class Sensitivity(Section):
    """c-FOA against population, generations and resolution, one at a time (Tables 7-9); first values are the base."""

    populations: tuple[Population, ...] = (50, 100, 150)
    generations: tuple[Annotated[int, Field(ge=1, le=1_000_000)], ...] = (150, 200, 250)
    resolutions: tuple[Annotated[int, Field(ge=2, le=1_000_000)], ...] = (100, 10, 1000)


class Parallel(Section):
    """Serial against parallel computing: Table 6."""

    models: tuple[str, ...] = Field(default=("asymmetric",), min_length=1)
    method: Method = "c_foa"
    population: Population = 50
    evaluations: Budget = 1000
    processes: tuple[Annotated[int, Field(ge=1, le=1024)], ...] = (1, 2, 4)


class CurrentStudy(Section):
    """Parameters against current and the comparison of genetic algorithms: paper 2."""

    data: Data
    model: Literal["bouc_wen", "normalized_bouc_wen"] = "bouc_wen"
    methods: tuple[CurrentMethod, ...] = ("ga_standard", "ga_kwok", "zhu_three_step", "ga_novel")
    current_A: tuple[Ampere, ...] = Field(default=(0.0, 0.4, 0.8, 1.2), alias="current")
    population: Population = 50
    budget: Budget = 10_000
    repeats: int = Field(default=3, ge=1, le=10_000)
    degree: int = Field(default=2, ge=1, le=10, description="degree of the polynomial in the current")
    bounds: dict[str, tuple[float, float]] = Field(
        default={}, description=("search boxes (SI units) that replace the defaults")
    )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        for name, (low, high) in self.bounds.items():
            if name not in CURRENT_BOXES[self.model]:
                yield (), f"bounds: got {name!r}, expected one of {', '.join(CURRENT_BOXES[self.model])}"
            if not low < high:
                yield (), f"bounds: {name} = [{low:g}, {high:g}]: expected the first value to be less than the second"

    @property
    def boxes(self) -> dict[str, tuple[float, float]]:
        """Search box of each free parameter, SI."""
        return {**CURRENT_BOXES[self.model], **self.bounds}


class RideOfFits(Section):
    """A car with the fits of c-FOA, GA and PSO: Figures 12 and 13 of paper 1."""

    current_A: Ampere = Field(default=0.0, alias="current", description="constant current in the dampers")


class StudyFile(Section):
    """A whole study file."""

    format: Literal[1]
    name: str = Field(default="study", pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]{0,63}$")
    seed: int = Field(default=1, ge=0)
    data: Data
    comparison: Comparison
    symmetry: Symmetry | None = None
    sensitivity: Sensitivity | None = None
    parallel: Parallel | None = None
    ride: RideOfFits | None = None
    current: CurrentStudy | None = Field(default=None, alias="per_current")

    @property
    def fingerprint(self) -> str:
        """Hash of everything that decides what one search would return: results of other fingerprints are not mixed."""
        ranges = [
            (name, parameter.name, parameter.low, parameter.high)
            for name, model in MODELS.items()
            for parameter in model.parameters
        ]
        decisive = {
            "revision": REVISION,
            "ranges": ranges if self.comparison.bounds == "model" else None,
            "boxes": None if self.current is None else self.current.boxes,
            "seed": self.seed,
            "data": self.data.model_dump(),
            "problem": self.comparison.model_dump(include={"start", "bounds", "weight", "hysteresis"}),
            "current": None if self.current is None else self.current.model_dump(include={"data", "model", "bounds"}),
        }
        return hashlib.sha256(repr(decisive).encode()).hexdigest()[:16]


def load_study(path: Path) -> StudyFile:
    """Read and validate a study file.

    Args:
        path: TOML file.

    Returns:
        The study.

    Raises:
        FileProblem: with every wrong entry of the file at once.
    """
    study, source = load_section(path, StudyFile, "study")
    known = _known_models()
    named = {"comparison": study.comparison.models, "parallel": study.parallel.models if study.parallel else ()}
    problems = [
        problem_at(source, (section, "models"), f"model: got {name!r}, expected one of {', '.join(known)}")
        for section, names in named.items()
        for name in names
        if name not in known
    ]
    problems += [
        problem_at(source, place, f"truth: got {data.truth!r}, expected one of {', '.join(PARAMETER_SETS)}")
        for place, data in (
            (("data", "truth"), study.data),
            *([(("per_current", "data", "truth"), study.current.data)] if study.current is not None else []),
        )
        if data.simulate == "table1" and data.truth not in PARAMETER_SETS
    ]
    if not problems and study.comparison.start == "ones" and study.comparison.bounds == "model":
        problems = [
            problem_at(
                source, ("comparison", "bounds"), f"{outside}, so no search can start with all parameters equal to "
                    "1. Fix: set start = "
                                                  '"none", or bounds = "none" or "wide"',
            )
            for outside in _ones_outside(study)
        ]  # fmt: skip
    if problems:
        raise FileProblem(str(path), problems)
    return study


def _ones_outside(study: StudyFile) -> list[str]:
    """Parameters whose own range does not hold 1, of the models that are searched from all ones."""
    def led(method: str) -> bool:
        return SETTINGS.get(method, (method,))[0] in LED

    models = list(study.comparison.models) if any(map(led, study.comparison.methods)) else []
    models += study.parallel.models if study.parallel is not None and led(study.parallel.method) else ()
    return [
        f"{parameter.name} of {name} ranges from {parameter.low:g} to {parameter.high:g}"
        for name in dict.fromkeys(models)
        for parameter in MODELS[name].parameters
        if not parameter.low <= 1.0 <= parameter.high
    ]


def _known_models() -> list[str]:
    return list(MODELS)
