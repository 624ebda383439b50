"""Published parameter sets, with their source."""

from __future__ import annotations

from rig.dampers.parameter import ParameterSet

CFOA = "automotive MR damper, c-FOA paper"
SPENCER = "Spencer, Dyke, Sain, Carlson 1997, converted from N and cm; the input is the driver's voltage (V)"
CFOA_KEYS = (
    "m",
    "F0",
    "beta",
    "delta",
    "Fya",
    "Fyb",
    "Ca_plus",
    "Ca_minus",
    "Cb_plus",
    "Cb_minus",
    "Ka",
    "Kb",
    "eta",
)
CFOA_FITS = (
    (
        "cfoa-table4",
        "Table 4 (c-FOA)",
        (3.83, -270.0, 144.0, 1.41, 5.56, 238.0, 2278.0, 98.0, 46.0, 178.0, 3.70, 1.07, 25.0),
    ),
    (
        "cfoa-table5-fit1",
        "Table 5, fit 1 (c-FOA)",
        (3.83, -275.0, 144.0, 1.41, 5.56, 238.0, 2278.0, 98.0, 46.0, 178.0, 3.70, 1.07, 25.0),
    ),
    (
        "cfoa-table5-fit2",
        "Table 5, fit 2 (GA)",
        (21.48, -203.0, 929.0, 20.0, 88.0, 221.0, 13.0, 0.80, 834.0, 87.0, 4.64, 0.43, 25.0),
    ),
    (
        "cfoa-table5-fit3",
        "Table 5, fit 3 (PSO)",
        (18.79, -201.0, 5926.0, 0.53, 30.42, 235.0, 537.0, 816.0, 347.0, 119.0, 5.33, 0.17, 25.0),
    ),
)


def _cfoa_sets() -> list[ParameterSet]:
    sets = []
    for name, table, numbers in CFOA_FITS:
        values = dict(zip(CFOA_KEYS, numbers, strict=True))
        sets.append(ParameterSet(name, "asymmetric", values, (
            f"{CFOA}, {table}; the paper's lambda is interpreted as delta (dimensionless)"
        )))
        printed = {("lambda" if key == "delta" else key): value for key, value in values.items()}
        source = (
            f"{CFOA}, {table}, as printed: because lambda is larger than every speed, the yield force depends "
            "only on sgn(u)"
        )
        sets.append(ParameterSet(f"{name}-printed", "asymmetric", printed, source, hysteresis="printed"))
    return sets


PUBLISHED = (
    ParameterSet(
        "spencer-modified",
        "modified_bouc_wen",
        {
            "alpha_a": 14000.0,
            "alpha_b": 69500.0,
            "c0a": 2100.0,
            "c0b": 350.0,
            "c1a": 28300.0,
            "c1b": 295.0,
            "k0": 4690.0,
            "k1": 500.0,
            "x0": 0.143,
            "gamma": 3.63e6,
            "beta": 3.63e6,
            "A": 301.0,
            "n": 2.0,
            "eta": 190.0,
        },
        f"{SPENCER}; generalised model, 14 values",
    ),
    ParameterSet(
        "spencer-bouc-wen",
        "bouc_wen",
        {
            "c0": 5000.0,
            "c0_b": 0.0,
            "k0": 2500.0,
            "x0": 0.038,
            "alpha": 88000.0,
            "alpha_b": 0.0,
            "gamma": 1e6,
            "beta": 1e6,
            "A": 120.0,
            "n": 2.0,
        },
        f"{SPENCER}; simple Bouc-Wen model at one voltage",
    ),
    ParameterSet(
        "spencer-bingham",
        "bingham",
        {"fc": 670.0, "fc_b": 0.0, "c0": 5000.0, "c0_b": 0.0, "f0": -95.0},
        f"{SPENCER}; Bingham model at one voltage",
    ),
)

PARAMETER_SETS = (*_cfoa_sets(), *PUBLISHED)
