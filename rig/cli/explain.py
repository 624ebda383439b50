"""`rig explain`: meaning of a code, reaction, and what to check."""

from __future__ import annotations

import textwrap
from dataclasses import asdict

import click

from protocols.near_miss import near_names
from rig.cli.options import Command, json_option
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE
from rig.explanations.explanation import explained, texts

WIDTH = 100


@click.command(name="explain", cls=Command, examples=("rig explain watchdog-absent", "rig explain | grep sensor"))
@click.argument("slug", metavar="[CODE]", required=False)
@json_option
def command(slug: str | None, as_json: bool) -> int:
    """Explain CODE, the code of a fault, refusal, finding or reason. Without CODE, list all codes."""
    return _show(slug, as_json=as_json)


def _show(slug: str | None, *, as_json: bool) -> int:
    """Print one explanation, or the list.

    Raises:
        UsageError: nothing has this name; names that are like it are in the message.
    """
    known = texts()
    if slug is None:
        if as_json:
            write_json({"slugs": [{"slug": name, "means": text["means"]} for name, text in known.items()]})
        else:
            for name, text in known.items():
                say(f"{name:<30}{text['means']}")
        return EXIT_DONE
    if slug not in known:
        near = near_names(slug, known, 3)
        hint = f"; did you mean {', '.join(near)}?" if near else "; `rig explain` lists all codes"
        raise click.UsageError(f"unknown code {slug!r}{hint}")
    answer = explained(slug)
    if as_json:
        write_json(asdict(answer))
        return EXIT_DONE
    say(slug + (f"   ({answer.reaction})" if answer.reaction else ""))
    for heading, lines in (
        ("means", (answer.means,)), ("reaction", (answer.done,)), ("check", answer.look_at),
        ("to resume", (answer.resume,)), ("exit code", ("" if answer.exit_code is None else str(answer.exit_code),)),
    ):
        for index, line in enumerate(filter(None, lines)):
            first = f"  {'' if index else heading:<11}"
            say(textwrap.fill(line, WIDTH, initial_indent=first, subsequent_indent=" " * len(first)))
    return EXIT_DONE
