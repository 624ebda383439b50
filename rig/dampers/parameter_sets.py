"""Parameter sets by name: published ones with their source, and plausible ones that drive the simulated rig."""

from __future__ import annotations

from rig.dampers.parameter import ParameterSet

CFOA = "automotive MR damper, c-FOA paper"
SPENCER = "Spencer, Dyke, Sain, Carlson 1997, converted from N and cm; its input is the driver's voltage (V)"
SIMULATED = "plausible values for the simulated rig; not a published fit"
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
        sets.append(ParameterSet(name, "asymmetric", values, f"{CFOA}, {table}; its lambda read as delta (no unit)"))
        printed = {("lambda" if key == "delta" else key): value for key, value in values.items()}
        source = f"{CFOA}, {table}, as printed: with lambda above every speed the yield force only follows sgn(u)"
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

DEMONSTRATION = (
    ParameterSet(
        "demo",
        "asymmetric",
        {
            "m": 3.83,
            "F0": -270.0,
            "beta": 50.0,
            "delta": 1.0,
            "Fya": 5.56,
            "Fyb": 238.0,
            "Ca_plus": 900.0,
            "Ca_minus": 500.0,
            "Cb_plus": 46.0,
            "Cb_minus": 178.0,
            "Ka": 300.0,
            "Kb": 50.0,
            "eta": 25.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-symmetric",
        "symmetric",
        {
            "m": 3.83,
            "F0": -270.0,
            "beta": 50.0,
            "delta": 1.0,
            "Fya": 5.56,
            "Fyb": 238.0,
            "Ca": 700.0,
            "Cb": 110.0,
            "Ka": 300.0,
            "Kb": 50.0,
            "eta": 25.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-kwok",
        "kwok",
        {
            "c": 700.0,
            "c_b": 110.0,
            "k": 300.0,
            "k_b": 50.0,
            "alpha": 60.0,
            "alpha_b": 238.0,
            "beta": 50.0,
            "delta": 1.0,
            "f0": -270.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-bingham",
        "bingham",
        {"fc": 60.0, "fc_b": 238.0, "c0": 700.0, "c0_b": 110.0, "f0": -270.0},
        SIMULATED,
    ),
    ParameterSet(
        "demo-viscoelastic-plastic",
        "viscoelastic_plastic",
        {
            "k1": 1.5e5,
            "c1": 1500.0,
            "k2": 3e5,
            "c0": 700.0,
            "fc": 60.0,
            "fc_b": 238.0,
            "c0_b": 110.0,
            "f0": -270.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-bouc-wen",
        "bouc_wen",
        {
            "c0": 700.0,
            "c0_b": 110.0,
            "k0": 300.0,
            "x0": 0.5,
            "alpha": 1.2e5,
            "alpha_b": 4e5,
            "gamma": 1.5e6,
            "beta": 1e6,
            "A": 1.0,
            "n": 2.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-normalized-bouc-wen",
        "normalized_bouc_wen",
        {
            "kx": 300.0,
            "kv": 700.0,
            "kv_b": 110.0,
            "kw": 80.0,
            "kw_b": 250.0,
            "f0": -150.0,
            "rho": 1500.0,
            "sigma": 0.6,
            "n": 2.0,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-thinning-bouc-wen",
        "thinning_bouc_wen",
        {
            "kx": 300.0,
            "kv": 400.0,
            "kv_b": 40.0,
            "kw": 30.0,
            "kw_b": 250.0,
            "f0": -270.0,
            "rho": 900.0,
            "sigma": 0.8,
            "n": 1.6,
            "kw_c": 20.0,
            "kw_d": -12.0,
            "kt": 60.0,
            "kt_b": 60.0,
            "kt_c": 10.0,
            "kt_d": -5.0,
            "vt": 0.08,
        },
        SIMULATED,
    ),
    ParameterSet(
        "demo-modified-bouc-wen",
        "modified_bouc_wen",
        {
            "alpha_a": 14000.0,
            "alpha_b": 50000.0,
            "c0a": 800.0,
            "c0b": 110.0,
            "c1a": 14000.0,
            "c1b": 2000.0,
            "k0": 1000.0,
            "k1": 500.0,
            "x0": 0.15,
            "gamma": 3.63e6,
            "beta": 3.63e6,
            "A": 100.0,
            "n": 2.0,
            "eta": 25.0,
        },
        SIMULATED,
    ),
)

PARAMETER_SETS: dict[str, ParameterSet] = {each.name: each for each in (*DEMONSTRATION, *_cfoa_sets(), *PUBLISHED)}
