"""The file of a public benchmark as values: open recordings by source and checksum, their split, who competes."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from protocols.descriptions import Problem
from rig.dampers.catalogue import MODELS
from rig.errors import FileProblem, IdentificationFailed
from rig.files.loader import TABLES, load_section
from rig.files.places import problem_at
from rig.files.section import Section
from rig.files.toml_source import read_toml
from rig.identification.cross_validation import LEFT_OUT as PAIRS
from rig.identification.models.solving import known_methods
from rig.identification.points.whole_record import last_share

SEPARABLE = "separable"
REVISION = 1
"""Of split and scorer: to be raised with every change after which an entry's result is another one."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Published(Section):
    """A published result of others on the same recordings, shown next to ours."""

    who: str
    nrmse_percent: float | None = Field(
        default=None, gt=0.0, lt=100.0, description=("NRMSE of validation tests, % of peak")
    )
    variance_percent: float | None = Field(
        default=None, gt=0.0, le=100.0, description=("explained variance of the force in validation tests, %")
    )
    note: str = ""


class Recordings(Section):
    """Open recordings of one damper: where they come from, their bytes, how they are read and split."""

    name: Name
    title: str
    source: str
    licence: str
    prepare: str = Field(default="", description="how to prepare these files from the download")
    folder: str = Field(description="folder that contains the files, relative to the folder of this file")
    variable: str = Field(default="", description="environment variable that overrides the folder")
    files: dict[str, Sha256] = Field(min_length=1)
    columns: dict[str, str]
    current_from_name: str | None = None
    waveform: Literal["sine", "triangle", "random"] = "sine"
    split: str = Field(description='"leave-one-pair-out", or "last 30 %" for motion without cycles')
    published: tuple[Published, ...] = ()

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        try:
            share = last_share(self.split)
        except IdentificationFailed as error:
            yield (), str(error)
            return
        if self.split != PAIRS and share is None:
            yield (), f'split: got "{self.split}", expected "{PAIRS}" or "last 30 %"'
        elif (share is None) == (self.waveform == "random"):
            yield (), f'split: "{PAIRS}" requires motion with cycles, "last 30 %" requires waveform = "random"'


class Benchmark(Section):
    """Who competes: every model by separable least squares, some of them by the other methods too."""

    models: Literal["all"] | tuple[str, ...] = "all"
    methods: Literal["all"] | tuple[str, ...] = "all"
    searched: tuple[str, ...] = Field(
        default=("asymmetric",), description="models fitted with methods other than separable"
    )
    budget: int = Field(default=4000, ge=10, le=100_000_000)
    population: int = Field(default=50, ge=4, le=100_000)
    seed: int = Field(default=1, ge=0)


class BenchmarkFile(Section):
    """A whole benchmark file."""

    format: Literal[1]
    name: str = Field(default="benchmark", pattern=r"^[A-Za-z0-9][A-Za-z0-9 _-]{0,63}$")
    benchmark: Benchmark
    recordings: tuple[Recordings, ...] = Field(min_length=1)

    @property
    def fingerprint(self) -> str:
        """Hash of everything that decides an entry's result."""
        decisive = [
            (one.name, sorted(one.files.items()), sorted(one.columns.items()), one.waveform, one.split)
            for one in self.recordings
        ]
        settings = self.benchmark.model_dump(include={"budget", "population", "seed"})
        return hashlib.sha256(repr((REVISION, decisive, settings)).encode()).hexdigest()[:16]


def load_benchmark(path: Path) -> BenchmarkFile:
    """Read and validate a benchmark file.

    Raises:
        FileProblem: with every wrong entry of the file at once.
    """
    benchmark, source = load_section(path, BenchmarkFile, "benchmark")
    named = {
        "models": (benchmark.benchmark.models, tuple(MODELS)),
        "searched": (benchmark.benchmark.searched, tuple(MODELS)),
        "methods": (benchmark.benchmark.methods, known_methods()),
    }
    problems = [
        problem_at(source, ("benchmark", key), f"got {name!r}, expected one of {', '.join(known)}")
        for key, (names, known) in named.items()
        if names != "all"
        for name in names
        if name not in known
    ]
    names = [one.name for one in benchmark.recordings]
    problems += [f"recordings: name: got {name!r} twice" for name in sorted(set(names)) if names.count(name) > 1]
    if problems:
        raise FileProblem(str(path), problems)
    return benchmark


def is_benchmark(path: Path) -> bool:
    """Whether a file that is to be studied is a benchmark's; what is wrong with it is told when it is loaded."""
    return bool(read_toml(path).data.keys() & TABLES["benchmark"])
