"""The weightings against ISO 2631-1:1997, table 3, at its nominal frequencies."""

from __future__ import annotations

import numpy as np
import pytest

from rig.vehicle.comfort import WEIGHTINGS, weighted_rms

TABLE_3 = {  # frequency Hz: Wk and Wd, thousandths, as printed
    0.1: (31.2, 62.4), 0.125: (48.6, 97.3), 0.16: (79.0, 158.0), 0.2: (121.0, 243.0), 0.25: (182.0, 365.0),
    0.315: (263.0, 530.0), 0.4: (352.0, 713.0), 0.5: (418.0, 853.0), 0.63: (459.0, 944.0), 0.8: (477.0, 992.0),
    1.0: (482.0, 1011.0), 1.25: (484.0, 1008.0), 1.6: (494.0, 968.0), 2.0: (531.0, 890.0), 2.5: (631.0, 776.0),
    3.15: (804.0, 642.0), 4.0: (967.0, 512.0), 5.0: (1039.0, 409.0), 6.3: (1054.0, 323.0), 8.0: (1036.0, 253.0),
    12.5: (902.0, 161.0), 16.0: (768.0, 125.0), 20.0: (636.0, 100.0), 25.0: (513.0, 80.0),
    31.5: (405.0, 63.2), 40.0: (314.0, 49.4), 50.0: (246.0, 38.8), 63.0: (186.0, 29.5), 80.0: (132.0, 21.1),
}  # fmt: skip


@pytest.mark.parametrize(("name", "column"), [("Wk", 0), ("Wd", 1)])
def test_a_weighting_is_the_standard_s_table_to_one_percent(name: str, column: int) -> None:
    frequencies = np.array(list(TABLE_3))
    printed = np.array([row[column] for row in TABLE_3.values()])
    gain = 1e3 * np.abs(WEIGHTINGS[name].gain(frequencies))
    assert np.max(np.abs(gain / printed - 1.0)) < 0.01, np.round(100.0 * (gain / printed - 1.0), 2)


def test_a_sine_is_weighted_by_the_table_s_factor() -> None:
    t = np.arange(20_000) * 1e-3
    for frequency_Hz, factor in ((1.0, 0.482), (5.0, 1.039), (16.0, 0.768)):
        weighted = weighted_rms(np.sqrt(2.0) * np.sin(2.0 * np.pi * frequency_Hz * t), 1e-3, "Wk")
        assert weighted == pytest.approx(factor, rel=0.01)
