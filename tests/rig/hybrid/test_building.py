"""The benchmark's building and transfer system against the authors' files and other ways to compute them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rig.hybrid import building
from rig.hybrid.delay_margin import critical_delay_s
from rig.hybrid.discretisation import along_a_line, held, low_pass
from rig.hybrid.transfer_system import POSITION, SPREAD, TransferSystem, perturbed, sensitivity


def test_the_damping_of_each_case_is_that_of_the_authors_files() -> None:
    # `Building cases/Case_N.mat`, entries (1,1) and (2,3)
    published = {
        1: (14084.275745, -6348.672096), 2: (11817.422620, -5327.047374), 3: (9635.014363, -4343.084702),
        4: (8450.565447, -3809.203258),
    }  # fmt: skip
    for case, (first, second) in published.items():
        damping = building.reference(building.CASES[case]).damping
        assert damping[0, 0] == pytest.approx(first, rel=5e-5)
        assert damping[1, 2] == pytest.approx(second, rel=5e-5)


def test_what_is_computed_and_what_is_tested_make_the_whole_building() -> None:
    whole = building.reference(building.CASES[2])
    specimen = building.Specimen(stiffness_N_m=1.25e6)
    rest = building.computed_part(whole, specimen)
    for complete, left, part in zip(whole, rest, (29.13, 117.065, 1.25e6), strict=True):
        difference = complete - left
        # 2 x 0.0097 x sqrt(29.13 x 1.25e6) = 117.065
        assert difference[0, 0] == pytest.approx(part, rel=5e-5)
        assert np.count_nonzero(difference) == 1


def test_the_specimens_damping_is_that_of_the_papers_second_table() -> None:
    assert building.Specimen().damping_N_s_m == pytest.approx(114.6, rel=0.01)


def test_a_step_of_a_building_is_what_a_solver_of_differential_equations_gives() -> None:
    whole = building.reference(building.CASES[3])
    state, inputs = whole.state_space(building.ground_and_force(whole))
    step_s = 1 / 250
    start, first, last = np.linspace(-1e-3, 1e-2, 6), np.array([1.0, 500.0]), np.array([-2.0, 900.0])

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        return state @ x + inputs @ (first + (last - first) * t / step_s)

    expected = solve_ivp(rates, (0.0, step_s), start, method="DOP853", rtol=1e-11, atol=1e-15).y[:, -1]
    transition, earlier, later = along_a_line(state, inputs, step_s)
    np.testing.assert_allclose(transition @ start + earlier @ first + later @ last, expected, rtol=1e-7)
    whole_step = held(state, inputs, step_s)[1]
    np.testing.assert_allclose(whole_step, earlier + later, rtol=1e-9, atol=1e-18)


def test_the_transfer_system_is_the_authors_chain_of_transfer_functions() -> None:
    # gain * feedback(Gs * feedback(Ga * Gest, a2 s), 1) as in F1_input_file.m, evaluated by hand at each frequency
    plant = TransferSystem(a3=4.0, beta1=420.0, beta2=1.02e5, stiffness_N_m=1.15e6)
    omega = 2 * np.pi * np.array([0.1, 3.6, 16.0, 38.0])
    s = 1j * omega
    damping = 2 * 0.0097 * 29.13 * np.sqrt(1.15e6 / 29.13)
    actuator = 1 / (s + 4.0) / (29.13 * s**2 + damping * s + 1.15e6)
    inner = actuator / (1 + actuator * 4.2297e6 * s)
    loop = 2.1283e13 / (s**2 + 420.0 * s + 1.02e5) * inner
    expected = 1.0261 * loop / (1 + loop)
    state, inputs = plant.state_space()
    response = np.array([np.linalg.solve(p * np.eye(5) - state, inputs)[POSITION, 0] for p in s])
    np.testing.assert_allclose(response, expected, rtol=1e-9)
    inverse = np.polynomial.polynomial.polyval(s, plant.inverse())
    np.testing.assert_allclose(inverse * expected, 1.0, rtol=1e-9)


def test_the_sensitivity_predicts_the_inverse_of_another_plant() -> None:
    shift = np.array([1.0, -1.0, 0.5, 2.0])
    spread = (SPREAD.a3, SPREAD.beta1, SPREAD.beta2, SPREAD.stiffness_N_m)
    other = TransferSystem(*(np.array([3.3, 425.0, 9.9976e4, 1.19e6]) + shift * spread)).inverse()
    nominal = TransferSystem().inverse()
    np.testing.assert_allclose((nominal + sensitivity() @ shift)[:4], other[:4], rtol=0.02)
    assert np.all(np.abs(other[:3] - nominal[:3]) > 0.002 * nominal[:3])


def test_perturbed_plants_have_the_published_spread_and_are_the_same_for_a_seed() -> None:
    plants = perturbed(4000, 7)
    assert np.std([plant.a3 for plant in plants]) == pytest.approx(1.3, rel=0.05)
    assert np.std([plant.stiffness_N_m for plant in plants]) == pytest.approx(5e4, rel=0.05)
    assert np.mean([plant.beta2 for plant in plants]) == pytest.approx(9.9976e4, rel=0.005)
    assert perturbed(3, 7) == plants[:3]


def test_the_low_passs_states_are_its_output_and_derivatives() -> None:
    state, inputs = low_pass(6, 25.0)
    omega = 2 * np.pi * np.array([1.0, 25.0, 50.0])
    response = np.array([np.linalg.solve(1j * w * np.eye(6) - state, inputs)[:, 0] for w in omega])
    # Butterworth of order 6: 1 / sqrt(1 + (f / fc)^12)
    np.testing.assert_allclose(np.abs(response[:, 0]), [1.0, np.sqrt(0.5), 1 / np.sqrt(4097.0)], rtol=1e-6)
    np.testing.assert_allclose(response[:, 3], (1j * omega) ** 3 * response[:, 0], rtol=1e-9)


def test_the_critical_delay_of_a_mass_on_a_late_spring_is_that_of_the_closed_form() -> None:
    # m s^2 + c s + k exp(-s tau) = 0 at s = i w: m w^2 = k cos(w tau), c w = k sin(w tau)
    mass, damping, spring = 100.0, 200.0, 4.0e4
    square = (-(damping**2) + np.sqrt(damping**4 + 4 * mass**2 * spring**2)) / (2 * mass**2)
    omega = np.sqrt(square)
    expected = np.arcsin(damping * omega / spring) / omega
    one = building.Structure(np.eye(3) * mass, np.eye(3) * damping, np.zeros((3, 3)))
    late = critical_delay_s(one, building.Specimen(stiffness_N_m=spring, mass_kg=0.0, damping_ratio=0.0))
    assert late == pytest.approx(expected, rel=1e-6)
    assert late == pytest.approx(damping / spring, rel=0.02)  # Horiuchi: the delay acts as a damper of -k tau


def test_the_transfer_system_alone_is_later_than_any_case_bears() -> None:
    delays = []
    for case in building.CASES.values():
        specimen = building.Specimen()
        delays.append(critical_delay_s(building.computed_part(building.reference(case), specimen), specimen))
    # the sample controller, stable in all cases, leaves 4.6 ms (Table 3)
    assert min(delays) > 0.0046
    assert max(delays) < TransferSystem().inverse()[1]
    assert delays == sorted(delays, reverse=True)
