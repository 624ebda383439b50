"""Rows that are refused before the matrix moves: files, folders, a second campaign, another damper."""

from __future__ import annotations

import json
import shutil
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from in_process import rig
from matrices import LONG_SECOND_POINT, TWO_POINTS
from scenario_campaign import Setting
from watched_campaign import answer_of, resumed

if TYPE_CHECKING:
    from conftest import InMotion

EXAMPLES = Path(__file__).parents[2] / "examples"


def refused(*arguments: str | Path) -> tuple[int, dict[str, Any]]:
    """`rig run ... --json` in this process, for a campaign that starts no other: exit code and answer."""
    done = rig("run", "--json", *arguments)
    return done.returncode, json.loads(done.stdout)


@pytest.mark.parametrize("place", ["/sys/runs", "file/runs"])
def test_a_folder_that_cannot_be_written_is_refused_before_a_rig_is_touched(tmp_path: Path, place: str) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(TWO_POINTS, encoding="utf-8")
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    code, answer = refused(matrix, "--simulate", "--out", tmp_path / place)
    assert (code, answer["slug"]) == (3, "dir-readonly")
    assert place in answer["error"]
    assert (tmp_path / "file").read_text(encoding="utf-8") == "in the way"


@pytest.mark.nightly
@pytest.mark.wire
def test_a_second_campaign_on_a_rig_is_refused_and_the_first_goes_on(in_motion: InMotion, tmp_path: Path) -> None:
    matrix, elsewhere = tmp_path / "second.toml", tmp_path / "elsewhere"
    matrix.write_text(TWO_POINTS, encoding="utf-8")
    elsewhere.mkdir()
    campaign = in_motion(seconds=0.2, matrix=LONG_SECOND_POINT, speed=2.0)
    shutil.copy(campaign.folder / "bench.toml", tmp_path / "bench.toml")
    second = (str(matrix), "--bench", str(tmp_path / "bench.toml"), "--out", str(tmp_path / "second"))
    code, answer = answer_of(*second)
    assert (code, answer["slug"]) == (3, "two-instances")
    code, answer = resumed(campaign.folder)
    assert (code, answer["slug"]) == (3, "two-instances")
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.output
    assert set(ending.verdicts().values()) == {"valid"}
    assert len(ending.truth.all("START")) == 2


@pytest.mark.nightly
def test_a_changed_matrix_or_bench_is_not_resumed_and_a_double_id_not_loaded(
    moving: InMotion, tmp_path: Path
) -> None:
    campaign = moving()
    ending = campaign.end_by(signal.SIGINT)
    matrix = ending.folder / "matrix.toml"
    text = matrix.read_text(encoding="utf-8")
    matrix.write_text(text.replace('"20 mm"', '"25 mm"'), encoding="utf-8")
    code, answer = campaign.resumed()
    assert (code, answer["slug"]) == (3, "matrix-changed")
    matrix.write_text(text + "# a remark changes nothing\n", encoding="utf-8")
    bench = ending.folder / "bench.toml"
    changed = bench.read_text(encoding="utf-8").replace('force = "5000 N"', 'force = "6000 N"')
    (tmp_path / "bench.toml").write_text(changed, encoding="utf-8")
    assert changed != bench.read_text(encoding="utf-8")
    code, answer = campaign.resumed(bench_path=tmp_path / "bench.toml")
    assert (code, answer["slug"]) == (3, "bench-changed")
    campaign.assert_completed()
    double = tmp_path / "double.toml"
    point = '[[point]]\nid = "p001"\namplitude = "20 mm"\nfrequency = "2 Hz"\ncurrent = "0 A"\n'
    double.write_text(text + point, encoding="utf-8")
    code, answer = answer_of(str(double), "--simulate", "--out", str(tmp_path / "double"))
    assert code == 2
    assert "p001" in answer["error"]
    assert not (tmp_path / "double").exists()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('"20 mm"', '"90 mm"'), "stroke"),
        (('frequency = ["2 Hz"]', 'frequency = ["8 Hz"]'), "speed"),
        (('"1.5 A"', '"9 A"'), "current"),
    ],
    ids=["stroke", "speed", "current"],
)
def test_a_matrix_beyond_the_rig_is_refused_whole_and_names_point_and_reason(
    tmp_path: Path, change: tuple[str, str], named: str
) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(TWO_POINTS.replace(*change), encoding="utf-8")
    bench = EXAMPLES / "demo-bench.toml"
    code, answer = refused(matrix, "--bench", bench, "--out", tmp_path / "out")
    assert (code, answer["slug"]) == (3, "matrix-infeasible")
    assert "p002" in answer["error"]
    assert named in answer["error"]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("good", "absurd"),
    [
        ('force = "5 kN"', 'force = "5 mm"'),
        ('force = "5 kN"', 'force = "5"'),
        ('force = "5 kN"', 'force = "5000 kN"'),
        ('force = "5 kN"', 'force = "12 kN"'),
        ('speed = "0.8 m/s"', 'speed = "nan m/s"'),
        ('current = "3 A"', 'current = "-3 A"'),
        ('watchdog = "500 ms"', 'watchdog = "500 s"'),
    ],
    ids=["unit", "no-unit", "absurd", "beyond-sensor", "nan", "negative", "watchdog"],
)
def test_an_absurd_bench_is_refused_with_key_and_value_before_anything_is_connected(
    tmp_path: Path, good: str, absurd: str
) -> None:
    matrix, bench = tmp_path / "matrix.toml", tmp_path / "bench.toml"
    matrix.write_text(TWO_POINTS, encoding="utf-8")
    text = (EXAMPLES / "demo-bench.toml").read_text(encoding="utf-8")
    assert good in text
    bench.write_text(text.replace(good, absurd), encoding="utf-8")
    code, answer = refused(matrix, "--bench", bench, "--out", tmp_path / "out")
    assert (code, answer["slug"]) == (2, "config-absurd"), "a file that cannot be used"
    key = absurd.split(" = ")[0]
    assert any(key in problem for problem in answer["problems"]), answer["problems"]
    assert not (tmp_path / "out").exists()


@pytest.mark.nightly
def test_another_damper_than_the_first_sessions_is_not_resumed(moving: InMotion) -> None:
    campaign = moving()
    campaign.end_by(signal.SIGINT)
    code, answer = campaign.resumed(Setting(simulator=("--option", "damper.values.F0=-150.0")))
    assert (code, answer["stopped_by"]) == (3, "wrong-damper")
    assert answer["valid"] == 1, "what was finished is kept"
    campaign.assert_completed()
