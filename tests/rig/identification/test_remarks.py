"""Words are made in one place, and nothing is decided by them."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import pytest

from rig.dampers import parameter_set
from rig.errors import some
from rig.identification import Measurement, identify, remarks
from rig.identification.diagnosis.statement import Statement
from rig.identification.remarks import Remark, say

Make = Callable[..., list[Measurement]]


def outcome(tests: list[Measurement]) -> dict[str, Any]:
    """What a fit says, without its remarks."""
    fit = identify(tests, model="all")
    return {
        "model": fit.model,
        "values": fit.values,
        "identifiable": fit.identifiable,
        "adequate": fit.adequate,
        "slugs": [getattr(text, "slug", "") for text in fit.warnings],
        "reasons": {name: getattr(estimate.reason, "slug", "") for name, estimate in fit.parameters.items()},
        "ranking": [score.model for score in fit.selection],
    }


def test_with_every_sentence_scrambled_a_fit_is_the_same(make_synthetic: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    tests = make_synthetic(parameter_set("demo").values, (1.0,), (1.0, 2.0), cycles=3)
    plain = outcome(tests)
    assert {plain["reasons"]["eta"], plain["reasons"]["Fyb"]} == {"no-current-step", "held"}
    for slug, sentence in remarks.SENTENCES.items():
        monkeypatch.setitem(remarks.SENTENCES, slug, sentence[::-1].replace("{", "(").replace("}", ")"))
    straight = Statement.say
    monkeypatch.setattr(Statement, "say", lambda self, part="", **numbers: straight(self, part, **numbers)[::-1])
    scrambled = outcome(tests)
    assert scrambled.pop("values") == pytest.approx(plain.pop("values"), rel=1e-9)
    assert scrambled == plain


def test_a_remark_keeps_its_slug_and_numbers_through_a_process() -> None:
    remark = say("few-cycles", cycles=2)
    again = pickle.loads(pickle.dumps(remark))
    assert isinstance(again, Remark)
    assert (again, again.slug, again.numbers) == (remark, "few-cycles", {"cycles": 2})


def test_a_long_list_names_three_and_counts_the_rest() -> None:
    assert some(["a", "b", "c", "d", "e"]) == "a, b, c and 2 more"
    assert some(["a", "b"], "; ") == "a; b"
