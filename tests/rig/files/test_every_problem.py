"""Every wrong entry of a file is reported at once; checks over several entries run when each of them is valid."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.errors import FileProblem
from rig.files.descriptions import table_of
from rig.matrix.model import load_matrix

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
"""


def problems_of(path: Path, text: str) -> list[str]:
    path.write_text(text)
    with pytest.raises(FileProblem) as caught:
        load_matrix(path)
    return list(caught.value.problems)


def test_every_wrong_entry_is_reported_at_once_and_contradictions_once_they_are_right(tmp_path: Path) -> None:
    lines = problems_of(tmp_path / "matrix.toml", MATRIX)
    places = ("14: matrix.sweep.duration", "17: matrix.road.amplitude", "20: temperature.ambient")
    assert [line.partition(" = ")[0] for line in lines] == [f"line {place}" for place in places]
    right = MATRIX.replace("2 weeks", "10 s").replace("5 kg", "5 mm").replace("1 A", "23 degC")
    lines = problems_of(tmp_path / "matrix.toml", right)
    assert [line.partition(": ")[0] for line in lines] == ["line 16", "line 18"]
    assert lines[0].startswith('line 16: matrix.road.road[2] = "no-such-road"')


def test_a_misspelt_key_is_not_also_called_missing(tmp_path: Path) -> None:
    text = MATRIX[: MATRIX.index("[matrix.sweep]")].replace('"sweep", "road", "file"', '"sine"')
    text = text.replace('order = "random"', 'amplitude = ["5 mm"]\nfrequency = ["1 Hz"]\norder = "random"')
    lines = problems_of(tmp_path / "matrix.toml", text.replace("frequency =", "frequenzy_Hz ="))
    assert [line.partition(":")[2] for line in lines] == [
        ' matrix.frequenzy_Hz = ["1 Hz"]: unknown key; did you mean frequency_Hz?',
    ]


ROLES = """measured_current = "Status.Actual"
[protection.Command]
counter = "Alive"
profile = "e2e-9"
"""


def test_roles_that_are_missing_or_wrong_are_reported_at_their_place_with_what_to_write(tmp_path: Path) -> None:
    path = tmp_path / "roles.toml"
    path.write_text(ROLES)
    with pytest.raises(FileProblem) as caught:
        table_of("ecu-roles", path)
    profile, command = caught.value.problems
    assert profile.startswith('line 4: protection.Command.profile = "e2e-9": ')
    assert command.endswith('command = "Message.signal"')


def test_what_should_be_a_table_is_reported_with_the_keys_that_it_needs(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text('format = 1\n[quantities]\nposition = 3\n[commands]\nreset = "now"\n[state]\nhold = 1\n')
    with pytest.raises(FileProblem) as caught:
        table_of("register-map", path)
    position, reset = caught.value.problems
    assert position == "line 3: quantities.position = 3: must be a table with address"
    assert reset.startswith('line 5: commands.reset = "now": ')
    assert "{write = {command = 3}}" in reset
