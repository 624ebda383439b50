"""What became of a recorded point, as the finaliser and `rig recover` tell it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rig.recording.quality.point_quality import PointQuality


@dataclass(frozen=True)
class FinishedPoint:
    """What became of a point: its file, or why there is none (`error`; the journal is then kept).

    `quality` holds the numbers among the attributes of `/entry/quality`, by name. `error_slug` is `disk-full`,
    `disk-error`, `unreadable` (what is in the journal), `conversion-crashed` or `conversion-timeout`.
    """

    id: str
    file: str = ""
    verdict: str = "invalid"
    reasons: tuple[str, ...] = ()
    lost_samples: int = 0
    skew_s: float | None = None
    skew_std_s: float = 0.0
    error: str = ""
    quality: Mapping[str, float] = field(default_factory=dict)
    error_slug: str = ""

    @classmethod
    def of(cls, point_id: str, file: Path, quality: PointQuality) -> FinishedPoint:
        """What became of a point whose file is complete."""
        return cls(
            point_id, str(file.resolve()), quality.verdict.verdict, quality.verdict.reasons, quality.lost_samples or 0,
            quality.skew.value_s, quality.skew.std_s or 0.0, quality=quality.numbers,
        )

    @classmethod
    def from_json(cls, answer: Mapping[str, Any]) -> FinishedPoint:
        """From `dataclasses.asdict` by way of JSON."""
        return cls(**{**answer, "reasons": tuple(answer["reasons"])})
