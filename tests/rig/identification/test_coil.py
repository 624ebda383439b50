"""The coil's lag from the force alone, where the current was commanded and not measured."""

from pathlib import Path

import numpy as np
import pytest

from rig.dampers import model, parameter_set
from rig.identification import Fit, identify_run
from rig.recording.importing import import_tests

DEMO = dict(parameter_set("demo").values)
COLUMNS = {"time": "t_s", "displacement": "x_mm", "force": "F_N", "commanded_current": "i_A"}


def write(file: Path, frequency_Hz: float, low_A: float, hold_s: float, seed: int) -> None:
    """A sine of 50 mm during which the command steps by 0.5 A every `hold_s`; the coil follows at 25 1/s."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, 10.0 / frequency_Hz + 1.0, 0.004)
    phase = 2.0 * np.pi * frequency_Hz * np.clip(t - 0.5, 0.0, 10.0 / frequency_Hz)
    u = 0.05 * np.sin(phase)
    v = np.gradient(u, 0.004)
    commanded = low_A + 0.5 * ((t // hold_s) % 2.0)
    current = np.empty_like(t)
    current[0] = commanded[0]
    for k in range(1, t.size):
        current[k] = commanded[k - 1] + (current[k - 1] - commanded[k - 1]) * np.exp(-25.0 * 0.004)
    force = model("asymmetric").force(DEMO, u, v, np.gradient(v, 0.004), current, 0.004) + rng.normal(0.0, 5.0, t.size)
    rows = np.column_stack((t, 1e3 * u + rng.normal(0.0, 0.005, t.size), force, commanded))
    np.savetxt(file, rows, delimiter=",", header="t_s,x_mm,F_N,i_A", comments="", fmt="%.5f")


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    folder = tmp_path_factory.mktemp("steps")
    for seed, (frequency_Hz, low_A) in enumerate(((1.0, 0.5), (2.0, 0.0), (2.0, 1.0))):
        write(folder / f"t{seed}.csv", frequency_Hz, low_A, 0.73, seed)
    run = import_tests(sorted(folder.glob("*.csv")), columns=COLUMNS, out=folder / "runs")
    return identify_run([run], profile=["eta"])


def test_eta_and_all_others_are_found_from_the_command(fit: Fit) -> None:
    assert set(fit.identifiable) == set(DEMO)
    for name, each in fit.parameters.items():
        assert each.simultaneous_low < DEMO[name] < each.simultaneous_high, name  # type: ignore[operator] - identifiable
    assert fit.parameters["eta"].value == pytest.approx(25.0, rel=0.05)
    assert fit.error.rmse_N == pytest.approx(5.0, rel=0.05)
    assert any("eta is identified from the commanded current" in text for text in fit.warnings)


def test_the_profile_of_eta_goes_through_the_coil(fit: Fit) -> None:
    found, linear = fit.profiles["eta"], fit.parameters["eta"]
    assert (found.low, found.high) == pytest.approx((linear.low, linear.high), rel=0.02)


def test_a_command_that_never_changes_shows_no_lag(tmp_path: Path) -> None:
    for seed, frequency_Hz in enumerate((1.0, 2.0)):
        write(tmp_path / f"t{seed}.csv", frequency_Hz, 0.5, 1e9, seed)
    run = import_tests(sorted(tmp_path.glob("*.csv")), columns=COLUMNS, out=tmp_path / "runs")
    steady = identify_run([run])
    assert not steady.parameters["eta"].identifiable
    assert any("0.5 A" in text for text in steady.warnings)
