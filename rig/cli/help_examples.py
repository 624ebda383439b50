"""The examples at the end of a help text; `rig --help` loads this module and no option of any command."""

from __future__ import annotations

import re

import click

WORD = re.compile(r"(?:--?[\w-]+ (?!-))?(?:[^\s']|'[^']*')+")
"""Of a command; an option and its value are one."""
ON = " \\"


def write_examples(formatter: click.HelpFormatter, examples: tuple[str, ...]) -> None:
    """Print examples in a help text as they are typed; a long one goes on behind a backslash, as a shell reads it."""
    with formatter.section("Example" if len(examples) == 1 else "Examples"):
        for example in examples:
            room = formatter.width - formatter.current_indent
            for line in continued(example, room):
                formatter.write(f"{'':>{formatter.current_indent}}{line}\n")


def continued(command: str, width: int) -> list[str]:
    """A command on lines of at most `width` signs where its words allow it, each but the last with a backslash."""
    if len(command) <= width:
        return [command]
    lines = [""]
    for word in WORD.findall(command):
        if len(lines[-1]) + 1 + len(word) + len(ON) > width:
            lines[-1] += ON
            lines.append(f"    {word}")
        else:
            lines[-1] += f" {word}" if lines[-1] else word
    return lines
