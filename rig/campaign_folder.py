"""A campaign's folder: the only module that knows the names of its files (`docs/files.md`, "A campaign's directory").

Names inside `points/` are those of `rig.recording.point_files`, names in the live folder those of
`rig.station.live_folder`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import overload

from rig.errors import FileProblem


class _Inside:
    """A file or folder of the campaign's folder: its path in an instance, its name in the class."""

    def __init__(self, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, folder: None, kind: type[CampaignFolder]) -> str: ...

    @overload
    def __get__(self, folder: CampaignFolder, kind: type[CampaignFolder]) -> Path: ...

    def __get__(self, folder: CampaignFolder | None, kind: type[CampaignFolder]) -> str | Path:
        return self._name if folder is None else folder.path / self._name


@dataclass(frozen=True)
class CampaignFolder:
    """The folder at `path`: `CampaignFolder(path).fit` is the path of its fit, `CampaignFolder.fit` the file's name."""

    path: Path

    description = _Inside("campaign.json")
    bench = _Inside("bench.toml")
    matrix = _Inside("matrix.toml")
    records = _Inside("records")
    """Folder of the files that the matrix names."""
    journal = _Inside("journal.jsonl")
    reserve = _Inside("journal.reserve")
    """Room for the journal's last lines on a full disk."""
    baseline = _Inside("baseline.json")
    points = _Inside("points")
    """Folder of the points' files."""

    fit = _Inside("fit.json")
    characteristics = _Inside("characteristics.json")
    report = _Inside("report.html")
    hybrid = _Inside("hybrid.json")
    reference = _Inside("reference")
    """Folder of the hybrid tests' courses."""

    live_link = _Inside("live.json")
    operator = _Inside("operator.json")
    """What was entered on the operator's page."""
    station_config = _Inside("station.json")
    station_log = _Inside("station.log")
    finaliser_log = _Inside("finaliser.log")
    simulator_log = _Inside("simulator.log")
    truth = _Inside("truth.h5")

    @classmethod
    def found(cls, path: Path) -> CampaignFolder:
        """The folder at a path, or the only campaign that lies directly in it.

        Raises:
            FileProblem: several campaigns lie in the folder; the message names them.
        """
        here = cls(path)
        if not path.is_dir() or here.points.is_dir():
            return here
        inside = [folder for folder in map(cls, sorted(path.iterdir())) if folder.points.is_dir()]
        if len(inside) > 1:
            names = ", ".join(folder.path.name for folder in inside[:3]) + (" ..." if len(inside) > 3 else "")
            text = f"{len(inside)} campaigns found in this folder ({names}). Fix: specify one of them"
            raise FileProblem(str(path), [text])
        return inside[0] if inside else here

    @property
    def written_points(self) -> Path:
        """`points`, into which files are to be written.

        Raises:
            FileProblem: there is none, or it is a symbolic link: what is written there would lie elsewhere.
        """
        if self.points.is_symlink():
            raise FileProblem(str(self.points), ["is a symbolic link; files are written only into a real folder"])
        if not self.points.is_dir():
            raise FileProblem(str(self.path), ["this is not a campaign folder: it does not contain a points/ folder"])
        return self.points

    def session_bench(self, session: int) -> Path:
        """The bench file of a further session; the first one is session 1."""
        return self.bench.with_stem(f"{self.bench.stem}-session{session}")

    def session_truth(self, session: int) -> Path:
        """The truth file of an earlier session."""
        return self.truth.with_stem(f"{self.truth.stem}-session{session}")

    def earlier_fit(self, written: str) -> Path:
        """Where a fit is kept once another one takes its place; `written` says when it was."""
        return self.fit.with_stem(f"{self.fit.stem}-{written}")
