"""Roads against what their standard or publication says, and road files that are wrong."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import coherence, welch
from scipy.special import k1

from rig.errors import FileProblem
from rig.vehicle.car import Car, load_car
from rig.vehicle.road import RandomRoad
from rig.vehicle.road_file import load_road, road_names

GEOMETRIC_MEAN = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6}  # m^3 at 0.1 cycles/m, ISO 8608 table C.1


def track(roughness_m3: float, coherence: str = "isotropic") -> tuple[float, np.ndarray, np.ndarray]:
    distance_m, left, right = RandomRoad(roughness_m3, 20_000.0, coherence, 1.6, 3).tracks()
    return 1.0 / (distance_m[1] - distance_m[0]), left, right


@pytest.mark.parametrize("road_class", "ABCD")
def test_a_road_s_spectrum_is_its_class_to_one_decibel(road_class: str) -> None:
    rate, left, right = track(GEOMETRIC_MEAN[road_class])
    for side in (left, right):
        n, density = welch(side, rate, nperseg=8192, detrend=False)
        octaves = 0.0221 * 2.0 ** np.arange(8)
        for low, high in pairwise(octaves):
            inside = (n >= low) & (n < high)
            expected = GEOMETRIC_MEAN[road_class] * (n[inside] / 0.1) ** -2.0
            apart_dB = 10.0 * np.log10(np.sum(density[inside]) / np.sum(expected))
            assert abs(apart_dB) < 1.0, (road_class, low, apart_dB)


def test_a_shipped_road_of_a_class_has_that_class_s_height() -> None:
    _, height, _ = load_road("iso8608-c").under(load_car("compact-suv"), 2e-3)
    n, density = welch(height[2000:, 0], 500.0 / 20.0, nperseg=4096)
    inside = (n > 0.05) & (n < 1.0)
    apart_dB = 10.0 * np.log10(np.sum(density[inside]) / np.sum(256e-6 * (n[inside] / 0.1) ** -2.0))
    assert abs(apart_dB) < 1.0


def test_left_and_right_are_as_coherent_as_on_an_isotropic_surface() -> None:
    rate, left, right = track(64e-6)
    n, measured = coherence(left, right, rate, nperseg=4096)
    for required in (0.05, 0.1, 0.2, 0.4):
        x = 2.0 * np.pi * required * 1.6
        near = np.abs(n - required) < 0.02
        assert np.mean(np.sqrt(measured[near])) == pytest.approx(x * k1(x), abs=0.07), required
    for name, expected in (("equal", 1.0), ("independent", 0.0)):
        rate, left, right = track(64e-6, name)
        near = slice(20, 200)
        assert np.mean(coherence(left, right, rate, nperseg=4096)[1][near]) == pytest.approx(expected, abs=0.03)


def test_the_paper_s_sweep_falls_from_4_to_1_mm_and_the_rear_comes_later_by_wheelbase_over_speed() -> None:
    car = load_car("compact-suv")
    t, height, _ = load_road("paper-sweep").under(car, 1e-3)
    assert np.ptp(height[2000:6000, 0]) == pytest.approx(4e-3 * (1.0 - 3.0 / 60.0 * 0.75), rel=0.04)
    assert np.ptp(height[59_000:60_000, 0]) == pytest.approx(1e-3, rel=0.05)
    late = round(2.66 / 25.0 / 1e-3)
    assert late == 106
    assert np.max(np.abs(height[late + 1000 : 50_000, 2] - height[1000 : 50_000 - late, 0])) < 5e-5
    crossings = np.sum(np.diff(np.sign(height[50_000:51_000, 0])) != 0)
    assert crossings == pytest.approx(2 * 15.15, abs=1)
    assert t[-1] == pytest.approx(60.0 + 2.66 / 25.0, abs=2e-3)


def test_obstacles_have_their_height_where_they_are() -> None:
    car = load_car("compact-suv")
    _, bump, _ = load_road("bump").under(car, 1e-3)
    assert np.max(bump[:, 0]) == pytest.approx(0.06, rel=1e-3)
    assert np.argmax(bump[:, 0]) == pytest.approx((10.0 + 0.5) / 5.0 / 1e-3, abs=1)
    _, hole, _ = load_road("pothole").under(car, 1e-3)
    assert np.min(hole[:, 0]) == pytest.approx(-0.05, rel=1e-3)
    assert np.all(hole[:, 1] == 0.0)


def test_posts_move_the_wheels_that_their_columns_name(tmp_path: Path) -> None:
    rows = "".join(f"{i * 0.01},{i * 1e-3},{i * 2e-3}\n" for i in range(201))
    (tmp_path / "posts.csv").write_text("time_s,left,right\n" + rows)
    (tmp_path / "posts.toml").write_text('format = 1\nname = "posts"\n[drive]\nfile = "posts.csv"\n')
    _, height, rate = load_road(tmp_path / "posts.toml").under(load_car("compact-suv"), 1e-2)
    assert height[100].tolist() == pytest.approx([0.1, 0.2, 0.1, 0.2])
    assert rate[100].tolist() == pytest.approx([0.1, 0.2, 0.1, 0.2])


def test_every_shipped_road_loads_and_begins_and_stays_in_finite_numbers() -> None:
    for name in road_names():
        _, height, rate = load_road(name).under(load_car("compact-suv"), 1e-2)
        assert np.max(np.abs(height[0])) < 1e-12
        assert np.all(np.isfinite(rate))


def problems_of(path: Path, kind: str) -> str:
    with pytest.raises(FileProblem) as caught:
        load_car(path) if kind == "car" else load_road(path)
    return str(caught.value)


def test_a_bad_road_file_says_every_problem(tmp_path: Path) -> None:
    path = tmp_path / "road.toml"
    path.write_text(
        'format = 1\nname = "x"\nspeed = "25 kg"\n[sweep]\nlast_frequency = "900 Hz"\nphase_deg = 400\nwobble = 3\n'
    )
    text = problems_of(path, "road")
    for word in ("speed", "last_frequency", "phase_deg", "wobble", "line 3", "line 5", "line 6", "line 7"):
        assert word in text, (word, text)
    path.write_text('format = 1\nname = "x"\n[sweep]\n[random]\nclass = "A"\n')
    assert "got 2" in problems_of(path, "road")
    path.write_text('format = 1\nname = "x"\n[random]\nclass = "A"\n')
    assert "speed" in problems_of(path, "road")
    assert "known: bump" in problems_of(tmp_path / "iso8608-z", "road")


@pytest.mark.parametrize(
    ("csv", "word"),
    [
        ("time_s,left\n0,0\n1,0\n", "line 1"),
        ("distance_m,left\n0,0\n0,0\n", "line 3"),
        ("distance_m,left\n0,0\n1,nan\n", "finite"),
        ("distance_m,left\n0,0\n", "two rows"),
        ("distance_m,left\n0,a\n1,0\n", "non-numeric"),
    ],
)
def test_a_bad_profile_says_what_is_wrong(tmp_path: Path, csv: str, word: str) -> None:
    (tmp_path / "road.csv").write_text(csv)
    (tmp_path / "road.toml").write_text('format = 1\nname = "x"\nspeed = "9 m/s"\n[profile]\nfile = "road.csv"\n')
    assert word in problems_of(tmp_path / "road.toml", "road")


def test_a_bad_car_file_says_every_problem(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(
        'format = 1\nname = "x"\nkind = "full"\nsource = "y"\n[body]\nmass = "-3 kg"\npitch_inertia = "2 m"\n'
        '[front]\nunsprung_mass = 50\nwheel_rate = "32 kN/m"\ntyre_stiffness = "240 kN/m"\nmotion_ratio = 7\n'
    )
    text = problems_of(path, "car")
    for word in ("mass", "pitch_inertia", "unsprung_mass", "motion_ratio", "line 6", "line 7", "line 9", "line 12"):
        assert word in text, (word, text)


def test_a_car_without_what_its_kind_needs_or_with_an_inertia_it_cannot_have_is_refused(tmp_path: Path) -> None:
    shipped = Path(load_car.__globals__["FOLDER"]) / "compact-suv.toml"
    path = tmp_path / "car.toml"
    lines = shipped.read_text().splitlines()
    path.write_text("\n".join(line for line in lines if "roll_inertia" not in line and "track" not in line))
    text = problems_of(path, "car")
    assert text.count("is missing; a full car requires this entry") == 3, text
    path.write_text(shipped.read_text().replace('"900 kg m^2"', '"90000 kg m^2"'))
    assert "got more than" in problems_of(path, "car")
    path.write_text(shipped.read_text().replace('kind = "full"', 'kind = "half"'))
    assert 'set kind = "full"' in problems_of(path, "car")


def test_a_half_car_is_the_left_side() -> None:
    assert isinstance(load_car("compact-suv"), Car)
    half = load_car("compact-suv").model_copy(update={"kind": "half"})
    _, height, _ = load_road("pothole").under(half, 1e-3)
    assert np.min(height, axis=0).tolist() == pytest.approx([-0.05, -0.05], rel=1e-3)
