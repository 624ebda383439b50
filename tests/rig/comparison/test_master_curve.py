from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.cli.main import main
from rig.comparison import load_bands
from rig.comparison.master_curve import make_bands, tolerance_factor, tolerances_of
from rig.errors import EXIT_DONE, EXIT_NOT_ACCEPTED, EXIT_USAGE, RigError
from rig.recording.run import Run

Make = Callable[..., Path]
PEAK_M_S = 2 * math.pi * 0.02
ENERGY_J = math.pi * 1000.0 * 2 * math.pi * 0.02**2


def test_bands_lie_about_the_mean_of_the_golden_runs(made_run: Make, tmp_path: Path) -> None:
    """c = 990 and 1010 N s/m, F0 = -50 N: on the average 75.66 N in rebound and -175.66 N in compression."""
    runs = [Run.open(made_run("a", 990.0)), Run.open(made_run("b", 1010.0))]
    made = make_bands(runs, tolerances_of(["5 %", "energy = 0.5 J"]))
    file = tmp_path / "made.toml"
    file.write_text(made.text)
    bands = load_bands(file)
    assert (made.count, made.remarks) == (3, ())
    for band, value, half in (
        (bands.rebound_force[0], 1000.0 * PEAK_M_S - 50.0, 0.05 * 75.66),
        (bands.jounce_force[0], -1000.0 * PEAK_M_S - 50.0, 0.05 * 175.66),
        (bands.energy[0], ENERGY_J, 0.5),
    ):
        assert band.low == pytest.approx(value - half, abs=0.3)
        assert band.high == pytest.approx(value + half, abs=0.3)
        assert (band.waveform, band.amplitude_m, band.frequency_Hz, band.current_A) == ("sine", 0.02, 1.0, 0.5)


def test_a_bands_file_is_in_the_units_of_the_runs_display(made_run: Make, tmp_path: Path) -> None:
    folder, tolerances = made_run("a"), tolerances_of(["5 %", "damping=5 %"])
    (folder / "matrix.toml").write_text('[display]\nforce = "lbf"\ndisplacement = "in"\nspeed = "in/s"\n')
    shown, usual = make_bands([Run.open(folder)], tolerances), make_bands([Run.open(made_run("b"))], tolerances)
    bands = []
    for made in (shown, usual):
        (tmp_path / "bands.toml").write_text(made.text)
        bands.append(load_bands(tmp_path / "bands.toml"))
    for key in ("rebound_force", "jounce_force", "energy", "damping"):
        one, other = (getattr(of, key)[0] for of in bands)
        assert (one.low, one.high) == pytest.approx((other.low, other.high), rel=1e-4)
        assert one.amplitude_m == pytest.approx(0.02, rel=1e-11)
    assert shown.text.count(" lbf\"") == 4
    assert " lbf s/in" in shown.text


def test_what_gets_no_band_is_stated(made_run: Make, made_point: Make) -> None:
    first, second = made_run("a"), made_run("b")
    made_point(first, "p002", 1000.0, frequency_Hz=2.0)
    made_point(first, "p003", 1000.0, current_A=1.0, offset_N=-125.0)
    made_point(second, "p003", 1000.0, current_A=1.0, offset_N=-125.0)
    made = make_bands([Run.open(first), Run.open(second)], tolerances_of(["rebound_force=5 %"]))
    assert made.count == 1
    assert [line.partition(":")[0] for line in made.remarks] == [
        "sine, 20 mm, 2 Hz, 0.5 A", "rebound_force at sine, 20 mm, 1 Hz, 1 A",
    ]
    exact = make_bands([Run.open(first)], tolerances_of(["rebound_force=1 mN"]))
    assert exact.count == 3
    stated = make_bands([Run.open(made_run("c", percent=2.0))], tolerances_of(["1 %"]))
    assert "narrower than the expanded uncertainty" in stated.remarks[-1]
    assert "with guarded acceptance: 3, " in stated.remarks[-1]


def test_a_band_that_good_dampers_can_fail_is_stated(made_run: Make) -> None:
    # ISO 16269-6, two-sided, 95 % of the values with 95 % confidence
    for count, exact in ((3, 9.916), (10, 3.379), (30, 2.549)):
        assert tolerance_factor(count) == pytest.approx(exact, rel=0.01)
    runs = [Run.open(made_run(name, damping)) for name, damping in (("a", 990.0), ("b", 1000.0), ("c", 1010.0))]
    # s = 10 N s/m * 0.12566 m/s = 1.257 N, 9.9 s = 12.5 N; 75.66 N in rebound
    for tolerance, stated in (("12 N", True), ("13 N", False)):
        made = make_bands(runs, tolerances_of([f"rebound_force={tolerance}"]))
        assert any("tolerance interval of the 3 golden specimens" in remark for remark in made.remarks) is stated
    assert not make_bands(runs[:2], tolerances_of(["rebound_force=2 N"])).remarks


def test_runs_of_one_specimen_show_nothing_of_other_dampers(made_run: Make) -> None:
    folders = [made_run(name, damping) for name, damping in (("a", 990.0), ("b", 1000.0), ("c", 1010.0))]
    for folder in folders:
        (folder / "campaign.json").write_text(json.dumps({"specimen": "S-1"}))
    remarks = make_bands([*map(Run.open, folders)], tolerances_of(["rebound_force=2 N"])).remarks
    assert "the 3 golden runs show only the repeatability of one specimen (S-1)" in remarks[-1]
    assert not any("such dampers" in remark for remark in remarks)
    # five runs of four specimens (S-1 twice): an interval of four values
    others = [made_run(name, damping) for name, damping in (("d", 995.0), ("e", 1005.0))]
    (folders[2] / "campaign.json").write_text(json.dumps({"specimen": "S-3"}))
    runs = [*map(Run.open, [*folders, *others])]
    assert "tolerance interval of the 4 golden specimens" in make_bands(
        runs, tolerances_of(["rebound_force=2 N"])).remarks[-1]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("5", "has no unit|not a number"), ("0 %", "more than 0"), ("force=5 %", "unknown quantity force"),
        ("energy=5 N", "5 N is a force"), ("-5 %", "more than 0"), ("2000 %", "at most 1000 %"),
    ],
)
def test_a_wrong_tolerance_is_refused(text: str, problem: str) -> None:
    with pytest.raises(RigError, match=problem):
        tolerances_of([text])


def test_the_command_writes_bands_that_the_golden_run_passes_and_another_damper_does_not(
    made_run: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    golden, other, file = str(made_run("a")), str(made_run("b", 1200.0)), tmp_path / "bands-of-a.toml"
    make = ["compare", golden, "--make-bands", str(file)]
    assert main(make) == EXIT_USAGE
    assert "--tolerance '5 %'" in capsys.readouterr().err
    assert main([*make, "--tolerance", "5%", "--json"]) == EXIT_DONE
    assert json.loads(capsys.readouterr().out)["bands"] == 3
    assert main([*make, "--tolerance", "5%"]) == EXIT_USAGE, "an existing file is kept"
    assert main(["compare", golden, "--bands", str(file)]) == EXIT_DONE
    assert main(["compare", other, "--bands", str(file)]) == EXIT_NOT_ACCEPTED
    assert main([*make[:-1], str(tmp_path / "of-fit.toml"), "--tolerance", "5%", "--of-fit"]) == EXIT_USAGE
    assert "rig identify" in capsys.readouterr().err
