"""Of several attempts of one point the best verdict counts, then the latest: in the books and on resuming."""

from __future__ import annotations

import itertools
from pathlib import Path

import h5py
import numpy as np
import pytest

from rig.campaign.point_results import PointResults
from rig.campaign.resume import take_stock
from rig.campaign.stop_cause import StopCause
from rig.recording.conversion.recovery import set_aside
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.test_point import TestPoint

POINT = TestPoint("p001", "sine", 0.02, 2.0, 0.5)
ATTEMPTS = [pair for pair in itertools.product(("valid", "suspect", "invalid"), repeat=2) if pair[0] != "valid"]
BEST = {"valid": 3, "suspect": 2, "invalid": 1}


def name_of(attempt: int) -> str:
    return "p001" if attempt == 1 else f"p001-attempt{attempt}"


def expected(verdicts: tuple[str, ...]) -> str:
    best = max(range(len(verdicts)), key=lambda number: (BEST[verdicts[number]], number))
    return f"{name_of(best + 1)}.h5"


def write(folder: Path, attempt: int, verdict: str, apart: int = 0) -> None:
    """An attempt's file, or that of the record out of tolerance with this number."""
    (folder / "points").mkdir(exist_ok=True)
    time_s = np.arange(16) / 250.0
    name, slug = (f"p001-out-of-tolerance{apart}", "out-of-tolerance") if apart else (name_of(attempt), "amplitude")
    write_file(folder / "points" / f"{name}.h5", PointFile(
        time_s, 250.0, [AlignedChannel(name, time_s, unit, name) for name, unit in (
            ("force", "N"), ("displacement", "m"), ("velocity", "m/s"), ("current", "A"))],
        quality={"verdict": verdict, "reasons": () if verdict == "valid" else (f"{slug}: {attempt}",)},
        test={"id": name, "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 2.0, "current_A": 0.5},
        provenance={"point": "p001", "attempt": str(attempt)},
    ))


@pytest.mark.parametrize("verdicts", ATTEMPTS)
def test_the_books_keep_the_best_attempt(verdicts: tuple[str, ...]) -> None:
    results = PointResults((POINT,))
    for attempt, verdict in enumerate(verdicts, start=1):
        results.record_verdict(POINT, Path(f"{name_of(attempt)}.h5"), verdict, (), 0)
    assert str(results.results["p001"].file) == expected(verdicts)


@pytest.mark.parametrize("verdicts", [*ATTEMPTS, ("suspect", "suspect", "invalid"), ("invalid", "suspect", "valid")])
def test_a_resumed_campaign_keeps_the_best_attempt(verdicts: tuple[str, ...], tmp_path: Path) -> None:
    for attempt, verdict in enumerate(verdicts, start=1):
        write(tmp_path, attempt, verdict)
    stock = take_stock(tmp_path, (POINT,))
    if set(verdicts) == {"invalid"}:
        assert [point.id for point in stock.remaining] == ["p001"]
    else:
        assert [result.file.name for result in stock.results if result.file] == [expected(verdicts)]
    assert stock.attempts == {"p001": len(verdicts)}


UNSETTLED = StopCause("current-tracking", "the measured current did not reach 0.25 A in 5 s")
MESSAGE = "current-tracking: the measured current did not reach 0.25 A in 5 s"


@pytest.mark.parametrize("recorded_first", [True, False])
def test_an_attempt_of_which_nothing_was_recorded_hides_no_file(recorded_first: bool) -> None:
    results = PointResults((POINT,))
    if not recorded_first:
        results.given_up(POINT, UNSETTLED)
    results.record_verdict(POINT, Path("p001.h5"), "invalid", ("force-scatter: 7.6 %",), 2)
    if recorded_first:
        assert results.given_up(POINT, UNSETTLED).file is None
    (result,) = results.all_results()
    assert (result.file, result.verdict, result.lost_samples) == (Path("p001.h5"), "invalid", 2)
    assert result.reasons == ("force-scatter: 7.6 %", *((MESSAGE,) if recorded_first else ()))


def test_nothing_is_reported_of_a_point_whose_attempts_left_no_file_but_why() -> None:
    results = PointResults((POINT,))
    results.given_up(POINT, UNSETTLED)
    results.given_up(POINT, UNSETTLED)
    (result,) = results.all_results()
    assert (result.file, result.reasons) == (None, (MESSAGE,))


def test_what_an_earlier_session_recorded_is_reported_until_the_point_has_been_run_again(tmp_path: Path) -> None:
    write(tmp_path, 1, "invalid")
    other = TestPoint("p002", "sine", 0.02, 2.0, 0.5)
    stock = take_stock(tmp_path, (POINT, other))
    assert (stock.results, [point.id for point in stock.remaining]) == ((), ["p001", "p002"])
    books = stock.books((POINT, other))
    earlier = tmp_path / "points" / "p001.h5"
    reported = [(result.file, result.verdict, result.reasons) for result in books.all_results()]
    assert reported == [(earlier, "invalid", ("amplitude: 1",)), (None, "not run", ())]
    assert not books.results, "nothing was judged in this session yet"
    books.renamed(set_aside(tmp_path / "points", "p001", ("p001", "p002")))
    books.given_up(POINT, StopCause("not-written", "the disk is full"))
    (again, _) = books.all_results()
    assert again.file == tmp_path / "points" / "p001-attempt1.h5.old"
    assert again.file.is_file()
    assert again.reasons == ("amplitude: 1", "not-written: the disk is full")
    books.record_verdict(POINT, earlier, "invalid", ("stroke: 2",), 0)
    assert (books.all_results()[0].file, books.all_results()[0].reasons) == (earlier, ("stroke: 2",))


@pytest.mark.parametrize("apart_first", [True, False])
def test_a_record_out_of_tolerance_is_reported_until_the_point_is_recorded_again(apart_first: bool) -> None:
    """The file may be made before the point is given up, or after."""
    results, apart = PointResults((POINT,)), Path("p001-out-of-tolerance1.h5")
    if apart_first:
        results.recorded_apart(POINT, apart, "invalid", ("out-of-tolerance: 4.8 mm",), 1, {})
        (result,) = results.all_results()
        assert (result.file, result.verdict, result.reasons) == (apart, "invalid", ("out-of-tolerance: 4.8 mm",))
        assert not results.results, "the point was not judged"
    results.given_up(POINT, UNSETTLED)
    if not apart_first:
        results.recorded_apart(POINT, apart, "invalid", ("out-of-tolerance: 4.8 mm",), 1, {})
    (result,) = results.all_results()
    assert (result.file, result.lost_samples, result.reasons) == (apart, 1, ("out-of-tolerance: 4.8 mm", MESSAGE))
    results.record_verdict(POINT, Path("p001.h5"), "invalid", ("stroke: 2",), 0)
    assert results.all_results()[0].file == Path("p001.h5")
    results.record_verdict(POINT, Path("p001-attempt2.h5"), "valid", (), 0)
    assert results.all_results()[0].reasons == ()


@pytest.mark.parametrize("recorded_then", [True, False])
def test_the_next_session_tells_of_records_out_of_tolerance_what_their_own_session_reported(
    recorded_then: bool, tmp_path: Path
) -> None:
    books = PointResults((POINT,))
    for number in (1, 2, 10):
        write(tmp_path, 1, "invalid", apart=number)
        file = tmp_path / "points" / f"p001-out-of-tolerance{number}.h5"
        books.recorded_apart(POINT, file, "invalid", ("out-of-tolerance: 1",), 0, {})
    if recorded_then:
        write(tmp_path, 1, "invalid")
        books.record_verdict(POINT, tmp_path / "points" / "p001.h5", "invalid", ("amplitude: 1",), 0)
    (result,) = books.all_results()
    (again,) = take_stock(tmp_path, (POINT,)).books((POINT,)).all_results()
    assert (again.file, again.verdict, again.reasons) == (result.file, result.verdict, result.reasons)


def test_a_resumed_campaign_knows_the_coil_temperatures_of_the_points_before(tmp_path: Path) -> None:
    write(tmp_path, 1, "valid")
    with h5py.File(tmp_path / "points" / "p001.h5", "r+") as file:
        file["entry/quality"].attrs.update({"coil_temperature_low_degC": 24.5, "coil_temperature_high_degC": 31.0})
    (result,) = take_stock(tmp_path, (POINT,)).results
    assert result.to_json()["quality"] == {"coil_temperature_low_degC": 24.5, "coil_temperature_high_degC": 31.0}


def test_a_file_that_was_set_aside_is_reported_where_a_later_session_left_none_and_is_never_kept(
    tmp_path: Path,
) -> None:
    write(tmp_path, 1, "suspect")
    set_aside(tmp_path / "points", "p001", ("p001",))
    (tmp_path / "points" / "p001-attempt2.h5.old").write_bytes(b"damaged")
    stock = take_stock(tmp_path, (POINT,))
    assert (stock.results, stock.problems, stock.attempts) == ((), (), {"p001": 1})
    (reported,) = stock.invalid
    assert (reported.file, reported.verdict) == (tmp_path / "points" / "p001-attempt1.h5.old", "invalid")
    books = stock.books((POINT,))
    books.given_up(POINT, UNSETTLED)
    assert [result.verdict for result in books.all_results()] == ["invalid"]
    write(tmp_path, 2, "invalid")
    (reported,) = take_stock(tmp_path, (POINT,)).invalid
    assert reported.file == tmp_path / "points" / "p001-attempt2.h5"


def test_a_file_whose_values_are_not_what_was_written_is_run_again_and_reported(tmp_path: Path) -> None:
    """Its description opens and says valid; one value of one column was changed behind it."""
    write(tmp_path, 1, "valid")
    assert not take_stock(tmp_path, (POINT,)).remaining
    with h5py.File(tmp_path / "points" / "p001.h5", "r+") as file:
        file["entry/data/force"][3] = 99.0
    stock = take_stock(tmp_path, (POINT,))
    assert ([point.id for point in stock.remaining], stock.results, stock.attempts) == (["p001"], (), {"p001": 1})
    (result,) = stock.problems
    assert result.startswith("points/p001.h5: /entry/data/force: the data are damaged")
    assert result.endswith("the point is repeated")


def test_a_damaged_later_attempt_gives_way_to_one_that_can_be_read(tmp_path: Path) -> None:
    write(tmp_path, 1, "suspect")
    write(tmp_path, 2, "valid")
    with h5py.File(tmp_path / "points" / "p001-attempt2.h5", "r+") as file:
        file["entry/data/time"][0] = -1.0
    (kept,) = take_stock(tmp_path, (POINT,)).results
    assert kept.file == tmp_path / "points" / "p001.h5"
