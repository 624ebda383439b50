"""A wrong entry hides no other problem of its file, and nothing is told that might not be true."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.bench import problems
from rig.bench.model import Bench
from rig.bench.toml_source import read_toml
from rig.errors import FileProblem
from rig.matrix.model import load_matrix

EXAMPLES = Path(__file__).parents[3] / "examples"
MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
max_force = "2 kN"
[matrix]
waveform = ["sweep", "road", "file"]
current = ["0 A"]
order = "random"
[matrix.sweep]
first_frequency = "1 Hz"
last_frequency = "5 Hz"
first_amplitude = "5 mm"
duration = "2 weeks"
[matrix.road]
road = ["iso8608-c", "no-such-road"]
amplitude = "5 kg"
[temperature]
window = ["25 degC", "25.1 degC"]
ambient = "1 A"
[hybrid]
[hybrid.car]
source = "quarter-car"
[hybrid.road]
speed = "20 parsec"
[hybrid.road.random]
class = "C"
duration = "600 s"
"""


def told(path: Path, text: str) -> list[str]:
    path.write_text(text)
    with pytest.raises(FileProblem) as caught:
        load_matrix(path)
    return list(caught.value.problems)


def test_wrong_units_hide_nothing_of_their_tables_nor_of_those_around_them(tmp_path: Path) -> None:
    lines = told(tmp_path / "matrix.toml", MATRIX)
    for said in (
        'line 14: matrix.sweep.duration = "2 weeks": unknown unit',
        'line 17: matrix.road.amplitude = "5 kg": 5 kg is a mass',
        'line 16: matrix.road.road[2] = "no-such-road": there is no such file',
        "file needs a table [matrix.file]",
        'order = "random" needs a seed',
        'line 20: temperature.ambient = "1 A"',
        "window: the first must lie at least",
        'line 25: hybrid.road.speed = "20 parsec"',
        "a hybrid test lasts",
        "specimen.prior: is missing",
    ):
        assert len([line for line in lines if said in line]) == 1, (said, lines)
    assert not [line for line in lines if "give prior or max_force" in line], "no prior is given"


def test_a_misspelt_key_is_not_also_called_missing(tmp_path: Path) -> None:
    text = MATRIX[: MATRIX.index("[matrix.sweep]")].replace('"sweep", "road", "file"', '"sine"')
    text = text.replace('order = "random"', 'amplitude = ["5 mm"]\nfrequency = ["1 Hz"]\norder = "random"')
    lines = told(tmp_path / "matrix.toml", text.replace("frequency =", "frequenzy_Hz ="))
    assert [line.partition(":")[2] for line in lines] == [
        ' matrix.frequenzy_Hz = ["1 Hz"]: unknown key; did you mean frequency_Hz?',
        ' matrix: order = "random" needs a seed, for example seed = 1',
    ]


def places(data: Any, at: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:  # noqa: ANN401 - TOML of any depth
    for key, value in data.items():
        if isinstance(value, dict):
            yield from places(value, (*at, key))
        else:
            yield (*at, key)


def changed(data: Any, at: tuple[str, ...]) -> Any:  # noqa: ANN401 - TOML of any depth
    return {**data, at[0]: changed(data[at[0]], at[1:]) if at[1:] else "7 leagues"}


@pytest.mark.parametrize("name", ["demo-bench.toml", "streamed-bench.toml"])
def test_of_a_good_file_with_one_wrong_entry_that_entry_alone_is_told(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = read_toml(EXAMPLES / name)
    whole = source.data
    monkeypatch.setattr(problems, "read_toml", lambda _: source)
    for place in places(whole):
        object.__setattr__(source, "data", changed(whole, place))
        lines = problems_of(EXAMPLES / name)
        assert [line for line in lines if ".".join(place) not in line] == [], place
        assert len(lines) <= 1, (place, lines)


def problems_of(path: Path) -> list[str]:
    try:
        Bench.load(path)
    except FileProblem as problem:
        return list(problem.problems)
    return []
