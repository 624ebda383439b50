"""A zero that did not return is a doubt about every point of the session: it enters their verdicts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from rig.campaign.ledger import Ledger
from rig.campaign.options import CampaignFinding, PointResult
from rig.errors import FileProblem
from rig.recording.conversion.delay_correction import finished, write_verdict
from rig.recording.quality.instrument_checks import ZERO_RETURN
from rig.recording.quality.verdict import suspect
from rig.recording.recorded_point import RecordedPoint


def doubt_points(
    ledger: Ledger, findings: Sequence[CampaignFinding], warn: Callable[[str], None],
    earlier: Iterable[PointResult] = (),
) -> None:
    """Make the session's valid points suspect for what the rest after its motion showed, in their files and the books.

    Args:
        ledger: the campaign's points.
        findings: of `ZeroReturn.findings`; without any nothing is touched.
        warn: told of a file that could not be written; its point then stays as it was judged.
        earlier: points of earlier sessions, which were measured between other rests.
    """
    reasons = [suspect(ZERO_RETURN, finding.text, **finding.values) for finding in findings]
    others = {result.file for result in earlier}
    files = [
        result.file for result in ledger.results.values()
        if result.file is not None and result.file not in others and result.file.is_file()
    ]
    for file in files if reasons else ():
        try:
            judged = RecordedPoint.open(file, whole=False).quality.verdict.replaced({ZERO_RETURN}, reasons)
            write_verdict(file, judged, "load cell and LVDT at rest after the session's motion")
            told = finished(RecordedPoint.open(file, whole=False))
        except (FileProblem, OSError) as error:
            warn(f"{file.name} does not say that a zero did not return: {error}")
            continue
        ledger.mended(file, told.verdict, told.reasons, told.quality)
