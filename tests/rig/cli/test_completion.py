"""What the shell offers on Tab: click's own completion, over commands that are loaded only when they are called."""

from __future__ import annotations

import pytest
from click.shell_completion import BashComplete

from rig.cli.main import cli


@pytest.mark.parametrize(
    ("words", "begun", "offered"),
    [
        ([], "co", {"compare"}),
        (["schema"], "b", {"bench", "bands"}),
        (["compare"], "--b", {"--bands"}),
    ],
)
def test_names_options_and_choices_are_offered(words: list[str], begun: str, offered: set[str]) -> None:
    complete = BashComplete(cli, {}, "rig", "_RIG_COMPLETE")
    values = {str(item.value) for item in complete.get_completions(words, begun)}
    assert offered <= values
    assert all(value.startswith(begun) for value in values)
