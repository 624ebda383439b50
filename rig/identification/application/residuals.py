"""Measured minus modelled force, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import IdentificationFailed
from rig.identification.application.law import Law
from rig.identification.models.measurement import Measurement

if TYPE_CHECKING:
    import pandas as pd

NO_TESTS = (
    "the fit contains neither tests nor references to recordings. Fix: specify the tests, for example "
    "tests=rig.load('FOLDER')"
)


def residual_table(law: Law, tests: Sequence[Measurement]) -> pd.DataFrame:
    """One row a sample of the tests; see `rig.identification.Fit.residuals_of`.

    Raises:
        IdentificationFailed: there is no test.
    """
    import pandas as pd

    if not tests:
        raise IdentificationFailed(f"no residuals: {NO_TESTS}")
    parts = []
    for test in tests:
        force_N, model_N = np.where(test.scored, test.force_N, np.nan), law.force_of(test)
        parts.append(pd.DataFrame({
            "test": test.id, "displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "current_A": test.current_A,
            "force_N": force_N, "model_N": model_N, "residual_N": force_N - model_N,
        }))
    return pd.concat(parts, ignore_index=True)
