"""Lines of a TOML file, and files that are none."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rig.errors import FileProblem
from rig.files.toml_lines import scan_lines
from rig.files.toml_source import SIZE_LIMIT_BYTES, read_toml

TEXT = '''# a comment = 1
top = 1
"quoted.key" = 2
[table]   # comment
first = ["a",
  "b # no comment",   # one
]
text = """
not_a_key = 3
"""
second = { inner = 1, other = "]" }
[table.sub]
dotted.key = 'it''s'
[[array]]
x = 1
[[array]]
x = "\\""
[array.child]
y = 1
'''.replace("'it''s'", "'its'")


def test_every_table_and_key_is_found_at_its_line() -> None:
    lines = scan_lines(TEXT)
    assert lines == {
        ("top",): 2,
        ("quoted.key",): 3,
        ("table",): 4,
        ("table", "first"): 5,
        ("table", "text"): 8,
        ("table", "second"): 11,
        ("table", "sub"): 12,
        ("table", "sub", "dotted"): 13,
        ("table", "sub", "dotted", "key"): 13,
        ("array",): 14,
        ("array", 0): 14,
        ("array", 0, "x"): 15,
        ("array", 1): 16,
        ("array", 1, "x"): 17,
        ("array", 1, "child"): 18,
        ("array", 1, "child", "y"): 19,
    }


def test_what_has_no_line_of_its_own_takes_the_nearest_enclosing_one(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text(TEXT)
    source = read_toml(path)
    assert source.line(("table", "second", "inner")) == 11
    assert source.line(("table", "first", 1)) == 5
    assert source.line(("table", "missing")) == 4
    assert source.line(("missing",)) is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"a = ", "not valid TOML"),
        (b"a = 1\na = 2", "not valid TOML"),
        (b"\xff\xfe", "UTF-16 text. Fix: save it as UTF-8"),
        (b"a = " + b"[" * 100_000, "line 1: lists and tables are nested more than 12 levels deep"),
        (b'[t]\na = ["1 m"\nb = 2\nc = 3', "line 2: not valid TOML: .*closing ] of this list is missing"),
        (b'a = ["1 m",\n# ]\n"2 m"\n[[next]]\nb = [1]', "line 1: not valid TOML: .*closing ] of this list is missing"),
        (b"a = [\n[1, 2]\n", "line 1: not valid TOML: .*closing ] of this list is missing"),
        (b'a = ["1 m" "2 m"]', "line 1: not valid TOML: .*a comma or the closing ]"),
        (b"a = [", "line 1: not valid TOML"),
        (b"a = {b = 1\nc = 2", "line 1: not valid TOML: .*closing } of the table"),
        (b"a = " + b"1" * 5000, "not valid TOML"),
        (b"#" * (SIZE_LIMIT_BYTES + 1), "larger than 256 KiB"),
    ],
)
def test_what_is_no_file_for_the_rig_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(content)
    with pytest.raises(FileProblem, match=message):
        read_toml(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileProblem, match="there is no such file"):
        read_toml(tmp_path / "none.toml")
    with pytest.raises(FileProblem, match="is a folder, not a file"):
        read_toml(tmp_path)


@given(text=st.text(max_size=300))
def test_no_file_crashes_the_reader(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzzed.toml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        read_toml(path)
    except FileProblem:
        return
