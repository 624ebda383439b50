"""What a page's operator has seen is what is run: the plan's files, and the specimen that was entered."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from rig.campaign import campaign
from rig.campaign.file_copies import keep_matrix, with_serial_number
from rig.campaign.results import CampaignOptions
from rig.campaign.setup import plan_digest, same_plan
from rig.cli.page_answers import answered
from rig.errors import EXIT_REFUSED, FileProblem, Refused
from rig.matrix.model import load_files, load_matrix
from rig.text_file import FirstRead
from simulators.scenarios.scenario import Silent

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "examples"
TEXTS = (
    '[specimen]  # serial_number = "A"\nserial_number = "A"  # kept\nstroke = "1 mm"\n',
    "specimen = {stroke = '1 mm', 'serial_number' = 'A'}\n[identify]\nholdout = 'serial_number = \"A\"'\n",
    'specimen.serial_number= "A"\nspecimen.stroke = "1 mm"\n',
    '[actuator]\nserial_number = "A"\n[specimen]\nserial_number = "A"\n',
)


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    for name in ("quick.toml", "demo-bench.toml"):
        (tmp_path / name).write_bytes((EXAMPLES / name).read_bytes())
    return tmp_path


@pytest.mark.parametrize("text", TEXTS)
def test_another_serial_number_changes_that_entry_alone(text: str) -> None:
    changed = with_serial_number(text, "B-2")
    expected = tomllib.loads(text)
    expected["specimen"]["serial_number"] = "B-2"
    assert tomllib.loads(changed) == expected
    assert len(changed) in {len(text) + 2, len(text)}
    assert with_serial_number(text, "") == with_serial_number(text, "A") == text


def test_a_serial_number_that_cannot_be_replaced_is_named() -> None:
    with pytest.raises(FileProblem, match='serial_number = "A"'):
        with_serial_number('[specimen]\nserial_number = """A"""\n', "B")


def test_the_kept_copy_is_the_matrix_of_the_specimen_that_was_entered(lab: Path) -> None:
    matrix = load_matrix(lab / "quick.toml")
    entered = matrix.of_specimen("MR-7")
    keep_matrix(lab / "quick.toml", lab / "kept.toml", "MR-7")
    kept = load_matrix(lab / "kept.toml")
    assert (kept.specimen.serial_number, kept.digest) == ("MR-7", entered.digest)
    assert entered.digest != matrix.digest
    assert matrix.of_specimen("") is matrix
    assert [point.id for point in entered.points()] == [point.id for point in matrix.points()]
    for hostile in ("--out=/", "a/b", "", " ", "A\n", "x" * 33):
        if hostile:
            with pytest.raises(FileProblem, match="expected a letter or digit"):
                matrix.of_specimen(hostile)


@pytest.mark.parametrize("name", ["quick.toml", "demo-bench.toml"])
def test_a_file_that_was_changed_after_its_plan_is_refused(lab: Path, name: str) -> None:
    paths = lab / "quick.toml", lab / "demo-bench.toml"
    planned = plan_digest(*paths, *load_files(*paths))
    same_plan(planned, plan_digest(*paths, *load_files(*paths)))
    (lab / name).write_text((lab / name).read_text() + "# another line\n")
    with pytest.raises(Refused) as caught:
        same_plan(planned, plan_digest(*paths, *load_files(*paths)))
    assert (caught.value.slug, caught.value.exit_code) == ("plan-changed", EXIT_REFUSED)


def test_a_file_that_changes_while_the_run_starts_is_run_and_kept_as_planned_or_refused(lab: Path) -> None:
    paths = lab / "quick.toml", lab / "demo-bench.toml"
    planned = plan_digest(*paths, *load_files(*paths))
    options = CampaignOptions(paths[0], lab / "out", bench_path=paths[1], planned=planned, serial_number="MR-7")
    matrix, bench = campaign._as_planned(options)
    assert (matrix.specimen.serial_number, bench is None) == ("MR-7", False)
    with options.files:
        load_files(*paths)
        paths[0].write_text(paths[0].read_text().replace("1.5 A", "1.4 A"))
        assert campaign._as_planned(options)[0].digest == matrix.digest
        keep_matrix(paths[0], lab / "kept.toml", "MR-7")
    assert load_matrix(lab / "kept.toml").digest == matrix.digest
    with pytest.raises(Refused) as caught:
        campaign.run_campaign(replace(options, files=FirstRead()), Silent())
    assert (caught.value.slug, (lab / "out").exists()) == ("plan-changed", False)


def test_a_page_is_answered_with_the_plan_of_the_command_or_its_refusal(lab: Path) -> None:
    request = {"do": "plan", "matrix": str(lab / "quick.toml"), "bench": str(lab / "demo-bench.toml")}
    plan = answered(request)
    paths = lab / "quick.toml", lab / "demo-bench.toml"
    assert plan["planned"] == plan_digest(*paths, *load_files(*paths))
    assert (plan["feasible"], plan["serial_number"]) == (True, "MR-001")
    tables = [block for block in plan["blocks"] if block["kind"] == "table"]
    assert [row["cells"][0] for row in tables[0]["rows"]] == ["p001", "p002"]
    (lab / "quick.toml").write_text((lab / "quick.toml").read_text().replace("30 mm", "200 mm"))
    far = answered(request)
    assert (far["feasible"], any("stroke" in block.get("text", "") for block in far["blocks"])) == (False, True)
    (lab / "quick.toml").write_text("x = [")
    assert answered(request)["refused"] == "file"
    assert answered({"do": "questions", "run": str(lab)})["refused"] == "file"
    assert "no such file" in answered({**request, "matrix": str(lab / "none.toml")})["text"].lower()
