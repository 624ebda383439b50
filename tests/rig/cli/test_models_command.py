"""`rig models`: every model by name, with what a fit and the simulated rig take of it."""

import json

import pytest
from click.testing import CliRunner

from rig.cli.models import command
from rig.dampers import MODELS, parameter_set


def test_every_model_is_listed_with_equation_and_parameters() -> None:
    reported = CliRunner().invoke(command, ["--json"], catch_exceptions=False)
    models = json.loads(reported.output)["models"]
    assert {entry["name"] for entry in models} == set(MODELS)
    for entry in models:
        assert "F = " in entry["equation"]
        assert entry["energy"], entry["name"]
        assert parameter_set(entry["set"]).model == entry["name"]
        assert {parameter["role"] for parameter in entry["parameters"]} <= {"linear", "shape"}


def test_a_model_by_name_shows_its_parameters_with_units() -> None:
    reported = CliRunner().invoke(command, ["lugre"], catch_exceptions=False)
    assert "Canudas" in reported.output
    assert "dissipates" in reported.output
    assert "N s/m" in reported.output
    assert "dahl" not in reported.output


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(Exception, match="did you mean 'lugre'"):
        CliRunner().invoke(command, ["lugr"], catch_exceptions=False)
