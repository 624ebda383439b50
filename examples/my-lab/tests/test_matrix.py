"""The lab's matrix on the simulated rig, as the CI runs it: undisturbed, on bad days, and what is found from it."""

import pytest


def test_the_matrix_fits_the_bench_and_every_point_is_valid(campaign):
    end = campaign()
    assert end.exit_code == 0, end.message
    assert set(end.verdicts.values()) == {"valid"}, end.reasons
    assert end.at_rest
    # What is fitted is what the simulated damper was made of: kw and kv of `demonstration` in my_lab/friction.py.
    parameters = end.fit.parameters
    assert parameters["kw_b"].value == pytest.approx(250.0, rel=0.05)
    assert parameters["kv"].value == pytest.approx(700.0, rel=0.05)


@pytest.mark.parametrize("slug", ["estop", "loadcell-pulled", "coil-open-short"])
def test_a_fault_ends_as_its_row_says(campaign, faults, slug):
    end = campaign(f"{slug}@1")
    assert (end.exit_code, end.slug) == (faults[slug].exit_code, slug), end.message
    assert end.at_rest
    assert set(end.verdicts.values()) != {"valid"}


@pytest.mark.parametrize("seed", [3])
def test_all_checks_pass_in_each_scenario(scenario, seed):
    end = scenario(seed)
    assert end.passed, f"{end.failed}; again: {end.again}"
