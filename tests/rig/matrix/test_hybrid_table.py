"""`[hybrid]` of a matrix file: what it says, what is wrong with it, and what a rig cannot do."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import pytest

from rig.bench.model import Bench
from rig.campaign.resume import same_matrix
from rig.errors import FileProblem, Refused
from rig.matrix.assumed_damper import of_set
from rig.matrix.model import Matrix, load_matrix
from rig.matrix.plan import plan

ROOT = Path(__file__).resolve().parents[3]
EXAMPLE = (ROOT / "examples" / "hybrid-quarter.toml").read_text(encoding="utf-8")


def load(folder: Path, text: str) -> Matrix:
    path = folder / "hybrid.toml"
    path.write_text(text, encoding="utf-8")
    return load_matrix(path)


def bench(folder: Path, register_map: str = "demo-streamed", poll: str = "10 ms") -> Bench:
    text = (ROOT / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
    text = re.sub(r'(?m)^(register_map|poll) = .*\n', "", text)
    text = text.replace("[actuator]\n", f'[actuator]\nregister_map = "{register_map}"\npoll = "{poll}"\n')
    (folder / "bench.toml").write_text(text, encoding="utf-8")
    return Bench.load(folder / "bench.toml")


def reasons(folder: Path, text: str, **of_bench: str) -> dict[str, set[str]]:
    """Slugs of what speaks against each point."""
    planned = plan(load(folder, text), bench(folder, **of_bench))
    return {item.point.id: {cause.slug for cause in item.causes} for item in planned.points}


def test_each_compensator_is_one_point_of_the_whole_length(tmp_path: Path) -> None:
    with_model, without = load(tmp_path, EXAMPLE).points()
    assert (with_model.id, without.id) == ("hybrid-model", "hybrid-none")
    assert with_model.kind == "hybrid"
    # Eight cycles of 3 Hz measure the delay, half a second of rest, 20 s of road, a second to return.
    assert with_model.motion_s == pytest.approx(8.0 / 3.0 + 0.5 + 20.0 + 1.0, abs=1e-6)
    assert with_model.forecast is not None
    assert 0.3 < with_model.peak_speed_m_s < 0.5
    assert with_model.amplitude_m < 0.06
    assert re.fullmatch(r"hybrid test up to [34]\d(\.\d)? mm for 24.2 s, 0 A", with_model.described)


def test_the_example_fits_a_rig_that_follows_set_points(tmp_path: Path) -> None:
    assert reasons(tmp_path, EXAMPLE) == {"hybrid-model": set(), "hybrid-none": set()}


def with_laws(*laws: str, **entries: str) -> str:
    """The example with laws of the current; other entries of [hybrid] as they are given."""
    more = "".join(f'{name} = "{value}"\n' for name, value in entries.items())
    return EXAMPLE.replace("[hybrid]\n", f"[hybrid]\nlaw = {json.dumps(laws)}\n{more}")


def test_each_law_is_a_test_of_its_own_that_begins_with_the_constant_current(tmp_path: Path) -> None:
    text = with_laws("passive", "skyhook", most_current="1.5 A").replace('current = "0 A"', 'current = "0.5 A"')
    points = load(tmp_path, text).points()
    assert [point.id for point in points] == [
        "hybrid-model", "hybrid-none", "hybrid-model-skyhook", "hybrid-none-skyhook",
    ]  # fmt: skip
    assert [(point.first_current_A, point.current_A) for point in points[1:3]] == [(0.5, 0.5), (0.5, 1.5)]


def test_the_plan_judges_a_law_by_its_most_current(tmp_path: Path) -> None:
    """Coil: 1.5 A squared times 5 ohm for the test's 24.2 s, whatever the law will ask for in it."""
    warm = with_laws("skyhook", most_current="1.5 A").replace(
        'prior = "demo" ', 'coil_resistance = "5 ohm"\nprior = "demo" '
    )
    cold = warm.replace('coil_resistance = "5 ohm"\n', "")
    heat = [plan(load(tmp_path, text), bench(tmp_path)).points[0].energy_J for text in (warm, cold)]
    assert heat[0] is not None
    assert heat[1] is not None
    assert heat[0] - heat[1] == pytest.approx(1.5**2 * 5.0 * (8.0 / 3.0 + 21.5), rel=1e-6)
    constant = plan(load(tmp_path, EXAMPLE.replace('current = "0 A"', 'current = "1.5 A"')), bench(tmp_path)).points[0]
    law = plan(load(tmp_path, with_laws("skyhook", most_current="1.5 A")), bench(tmp_path)).points[0]
    assert law.predicted_force_N is not None
    assert constant.predicted_force_N is not None
    assert law.predicted_force_N >= constant.predicted_force_N
    too_much = reasons(tmp_path, with_laws("skyhook", most_current="9 A"))["hybrid-model-skyhook"]
    assert "current" in too_much


def test_a_law_needs_a_current_source_on_can(tmp_path: Path) -> None:
    rig = bench(tmp_path)
    rig = rig.model_copy(update={"ecu": dataclasses.replace(rig.ecu, by_hand=True)})
    planned = plan(load(tmp_path, with_laws("groundhook", most_current="0.5 A")), rig).points[0]
    assert [cause.slug for cause in planned.causes] == ["hybrid"]
    assert "CAN" in planned.reasons[0]
    assert reasons(tmp_path, with_laws("groundhook", most_current="0.5 A"))["hybrid-model-groundhook"] == set()


def test_every_wrong_entry_is_named_with_its_line(tmp_path: Path) -> None:
    text = EXAMPLE.replace('mass = "600 kg"', 'mass = "-6 kg"').replace('unsprung_mass = "90 kg"\n', "")
    text = text.replace('last_frequency = "5 Hz"', 'last_frequency = "0.5 Hz"')
    text = text.replace('compensation = ["model", "none"]', 'compensation = ["modelx"]')
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, text)
    message = "\n".join(caught.value.problems)
    for entry in ("hybrid.car.body.mass", "unsprung_mass", "compensation"):
        assert entry in message
    lines = text.splitlines()
    assert f"line {lines.index(next(line for line in lines if 'modelx' in line)) + 1}" in message


@pytest.mark.parametrize(
    ("before", "after", "entry"),
    [
        ('prior = "demo" ', "# prior ", "specimen.prior"),
        ('duration = "20 s"', 'duration = "130 s"', "hybrid.road.sweep.duration"),
        ('last_frequency = "5 Hz"', 'last_frequency = "0.5 Hz"', "hybrid.road.sweep.last_frequency"),
        ('["model", "none"]', '["model", "model"]', "hybrid.compensation"),
        ('largest_delay = "25 ms"', 'largest_delay = "25"', "hybrid.largest_delay"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_at_its_entry(before: str, after: str, entry: str, tmp_path: Path) -> None:
    assert before in EXAMPLE
    with pytest.raises(FileProblem, match=entry.replace(".", r"\.")):
        load(tmp_path, EXAMPLE.replace(before, after))


def test_a_delay_beyond_the_margin_is_refused_with_the_numbers(tmp_path: Path) -> None:
    """Critical: 32 ms. Without compensation 27 ms would act, and 1.25 times that is beyond it; led, half of it."""
    text = EXAMPLE.replace('"25 ms"', '"27 ms"')
    assert reasons(tmp_path, text) == {"hybrid-model": set(), "hybrid-none": {"hybrid-unstable"}}
    planned = plan(load(tmp_path, EXAMPLE.replace('"25 ms"', '"60 ms"')), bench(tmp_path))
    assert not planned.feasible
    for item in planned.points:
        assert [cause.slug for cause in item.causes] == ["hybrid-unstable"]
        assert "32." in item.reasons[0]
        assert "60 ms" in item.reasons[0]


@pytest.mark.parametrize(
    ("law", "current", "end", "fastest"),
    [("passive", "0 A", "", "12 ms"), ("passive", "0.3 A", "", "6 ms"), ("skyhook", "0 A", "-skyhook", "3 ms")],
)
def test_extrapolation_over_a_delay_that_makes_it_unstable_is_refused(
    tmp_path: Path, law: str, current: str, end: str, fastest: str
) -> None:
    """Critical: 15.5 ms without current, 8.5 ms at 0.3 A, 4.5 ms at the 1 A of the law; 1.25 times the delay is."""
    text = EXAMPLE.replace('["model", "none"]', '["model", "polynomial"]')
    text = text.replace('current = "0 A"', f'current = "{current}"')
    text = text.replace("[hybrid]\n", f'[hybrid]\nlaw = ["{law}"]\n')
    found = reasons(tmp_path, text)
    assert (found[f"hybrid-model{end}"], found[f"hybrid-polynomial{end}"]) == (set(), {"hybrid-unstable"})
    assert reasons(tmp_path, text.replace('"25 ms"', f'"{fastest}"'))[f"hybrid-polynomial{end}"] == set()


def test_a_rig_that_cannot_follow_fast_enough_or_far_enough_is_refused(tmp_path: Path) -> None:
    text = EXAMPLE.replace('first_height = "20 mm"', 'first_height = "60 mm"')
    assert {"position", "stroke"} <= reasons(tmp_path, text)["hybrid-model"]
    assert reasons(tmp_path, EXAMPLE, register_map="demo")["hybrid-model"] == {"hybrid"}
    assert reasons(tmp_path, EXAMPLE, poll="20 ms")["hybrid-model"] == {"sampling"}


SWEEP = EXAMPLE[EXAMPLE.index("[hybrid.road.sweep]") : EXAMPLE.index("[campaign]")]


REAR = '[hybrid.car.rear]\nunsprung_mass = "-1 kg"\n'


@pytest.mark.parametrize(
    ("text", "place", "way_out"),
    [
        (EXAMPLE.replace("[hybrid.road]\n", f"{REAR}[hybrid.road]\n"), "hybrid.car.rear", "remove this table"),
        (EXAMPLE.replace(SWEEP, '[hybrid.road.drive]\nfile = "a.csv"\n'), "hybrid.road.drive", "[hybrid.road.sweep]"),
        (EXAMPLE.replace(SWEEP, "[hybrid.road.profile]\n"), "hybrid.road.profile", "[hybrid.road.bump]"),
        (EXAMPLE.replace(SWEEP, ""), "hybrid.road", "got none"),
        (EXAMPLE.replace(SWEEP, f'{SWEEP}[hybrid.road.bump]\nheight = "1 mm"\nlength = "2 m"\n'),
         "hybrid.road.bump", "got 2 (sweep, bump)"),
        (EXAMPLE.replace('[hybrid.road]\nspeed = "20 m/s"\n', "").replace(SWEEP, ""), "hybrid.road",
         "write a table [hybrid.road] with speed"),
    ],
)  # fmt: skip
def test_what_a_hybrid_test_has_not_is_named_where_it_stands_with_the_way_out(
    text: str, place: str, way_out: str, tmp_path: Path
) -> None:
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, text)
    (output,) = caught.value.problems
    line, where, message = output.split(": ", 2)
    assert (where, way_out in message) == (place, True), output
    heading = text.splitlines()[int(line.removeprefix("line ")) - 1]
    assert heading in {f"[{place}]", "[hybrid]"}


def test_a_wrong_value_beside_a_needless_table_is_reported_with_it(tmp_path: Path) -> None:
    text = EXAMPLE.replace("[hybrid.road]\n", f"{REAR}[hybrid.road]\n").replace('"600 kg"', '"-6 kg"')
    with pytest.raises(FileProblem) as caught:
        load(tmp_path, text)
    assert [message.split(": ")[1].split(" = ")[0] for message in caught.value.problems] == [
        "hybrid.car.body.mass", "hybrid.car.rear"
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("bump", "slug", "message"),
    [
        ('length = "2 m"\nsides = "right"', "hybrid", "by only 0 mm"),
        ('length = "2 m"\nstart = "9000 m"', "hybrid", "by only 0 mm"),
        ('length = "20 cm"', "sampling", "with steps of 10 ms"),
    ],
)
def test_a_road_that_never_comes_or_is_over_between_two_steps_is_refused(
    bump: str, slug: str, message: str, tmp_path: Path
) -> None:
    """20 cm at 20 m/s are 10 ms, one step: the samples stand at the bump's ends, where its height is 0."""
    text = EXAMPLE.replace(SWEEP, f'[hybrid.road.bump]\nheight = "20 mm"\n{bump}\n')
    planned = plan(load(tmp_path, text), bench(tmp_path)).points[0]
    assert [(cause.slug, message in cause.text) for cause in planned.causes if cause.slug == slug] == [(slug, True)]


def test_what_is_requested_of_the_station_keeps_to_the_machine(tmp_path: Path) -> None:
    matrix, rig = load(tmp_path, EXAMPLE), bench(tmp_path)
    point = matrix.points()[0]
    assert matrix.hybrid is not None
    order = matrix.hybrid.order(point, of_set("demo"), rig, (-0.05, 0.08))
    assert order.bounds.extension_m == pytest.approx(0.05), "no further than to the nearer end"
    assert (order.bounds.speed_m_s, order.bounds.acceleration_m_s2) == (
        rig.limits.speed_m_s, rig.limits.acceleration_m_s2
    )  # fmt: skip
    assert order.part.inertia_kg == pytest.approx(3.83 + rig.fixture.moving_mass_kg), "the rod's, of the set demo"
    assert order.duration_s == pytest.approx(point.motion_s)


def test_a_matrix_without_hybrid_tests_keeps_its_digest(tmp_path: Path) -> None:
    """SHA-256 of specimen and points as the program wrote it before there were hybrid tests."""
    matrix = load_matrix(ROOT / "examples" / "table1.toml")
    assert '"hybrid"' not in matrix.model_dump_json(exclude={"identify", "hybrid"})
    assert matrix.hybrid is None
    changed = load(tmp_path, EXAMPLE.replace('mass = "600 kg"', 'mass = "601 kg"'))
    assert changed.digest != load(tmp_path, EXAMPLE).digest


BEFORE_LAWS = "5971d1389e28b68499237819774ea372a77f2a7733bd7efc18f53223c9d6e219"
"""Digest of the example by the program as it was before hybrid tests had laws (22 November 2026)."""


def described_by(folder: Path, digest: str) -> Path:
    (folder / "matrix.toml").write_text(EXAMPLE, encoding="utf-8")
    (folder / "campaign.json").write_text(json.dumps({"hash": "", "hashes": {"matrix": digest}}), encoding="utf-8")
    return folder


def test_a_campaign_begun_before_there_were_laws_goes_on_where_the_law_is_the_default(tmp_path: Path) -> None:
    matrix = load(tmp_path, EXAMPLE)
    assert matrix.digest != BEFORE_LAWS
    same_matrix(described_by(tmp_path, BEFORE_LAWS), matrix)
    same_matrix(described_by(tmp_path, matrix.digest), matrix)


@pytest.mark.parametrize("change", [
    ("[hybrid]\n", '[hybrid]\nlaw = ["skyhook"]\n'), ("[hybrid]\n", '[hybrid]\nmost_current = "2 A"\n'),
    ('mass = "600 kg"', 'mass = "601 kg"'),
])
def test_it_is_refused_where_anything_else_is_requested(tmp_path: Path, change: tuple[str, str]) -> None:
    assert change[0] in EXAMPLE
    with pytest.raises(Refused) as refused:
        same_matrix(described_by(tmp_path, BEFORE_LAWS), load(tmp_path, EXAMPLE.replace(*change)))
    assert refused.value.slug == "matrix-changed"


def test_hybrid_tests_alone_are_not_identified(tmp_path: Path) -> None:
    assert not load(tmp_path, EXAMPLE).wants_fit
    sweep = '[matrix]\namplitude = ["10 mm"]\nfrequency = ["1 Hz"]\ncurrent = ["0 A"]\n'
    both = load(tmp_path, EXAMPLE + sweep)
    assert both.wants_fit
    assert [point.kind for point in both.points()] == ["loop", "hybrid", "hybrid"]
    assert dataclasses.asdict(both.points()[0])["forecast"] is None
