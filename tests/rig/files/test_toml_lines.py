"""Lines of a TOML text's entries, counted by hand, and texts that no parser should be given."""

from __future__ import annotations

import tomllib

import pytest

from rig.files.toml_lines import MOST_ENTRIES, scan_lines, structure_problem

TEXT = '''# a comment = none
name = "x = y # no comment"

[a.b]
one = [
    1, # two = 2
    2,
]
"quoted.key" = 'C:\\path'
deep.er = { x = "}", y = [1, 2] }
text = """
[not.a.table]
escaped \\""" quote"""
[[points]]
id = 1
[[points]]
id = 2
[points.more]
z = 3
last = 4 # the end'''


def test_every_table_and_key_has_its_line() -> None:
    tomllib.loads(TEXT)
    assert scan_lines(TEXT) == {
        ("name",): 2, ("a",): 4, ("a", "b"): 4, ("a", "b", "one"): 5, ("a", "b", "quoted.key"): 9,
        ("a", "b", "deep"): 10, ("a", "b", "deep", "er"): 10, ("a", "b", "text"): 11,
        ("points",): 14, ("points", 0): 14, ("points", 0, "id"): 15, ("points", 1): 16, ("points", 1, "id"): 17,
        ("points", 1, "more"): 18, ("points", 1, "more", "z"): 19, ("points", 1, "more", "last"): 20,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = 1\n" + ".".join("k" * 13) + " = 1", "line 2: a key has more than 12 parts"),
        ("a = " + "[" * 13 + "]" * 13, "line 1: lists and tables are nested more than 12 levels deep"),
        ("a = [" + "1," * (MOST_ENTRIES + 1) + "]", "the file has too many entries; allowed: at most 30000"),
    ],
)
def test_a_text_that_would_take_a_parser_long_is_reported_before_it_is_parsed(text: str, says: str) -> None:
    problem = structure_problem(text)
    assert problem is not None
    assert problem.startswith(says)


@pytest.mark.parametrize(
    "text", [TEXT, "", "a = 'dots.and.[[[[[[[[[[[[[[' # [[[[[[[[[[[[[[[\nb = 1", 'a = """""quoted"""""', "a = 1 # end"]
)
def test_what_stands_in_texts_and_comments_does_not_count(text: str) -> None:
    assert structure_problem(text) is None


def test_an_end_within_a_value_or_a_comment_is_an_end() -> None:
    assert scan_lines("a = 1 # last") == {("a",): 1}
    assert scan_lines("a = [1,\n2") == {("a",): 1}
