"""Examples at the end of a help text; a separate module, so `rig --help` does not load the commands' options."""

from __future__ import annotations

import re

import click

WORD = re.compile(r"(?:--?[\w-]+ (?!-))?(?:[^\s']|'[^']*')+")
"""A word of a command; an option and its value count as one word."""
ON = " \\"


def write_examples(formatter: click.HelpFormatter, examples: tuple[str, ...]) -> None:
    """Print examples in a help text; long ones are continued after a backslash, as in a shell."""
    with formatter.section("Example" if len(examples) == 1 else "Examples"):
        for example in examples:
            room = formatter.width - formatter.current_indent
            for line in continued(example, room):
                formatter.write(f"{'':>{formatter.current_indent}}{line}\n")


def continued(command: str, width: int) -> list[str]:
    """Split a command into lines of at most `width` characters, if possible, with a backslash at each line end."""
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
