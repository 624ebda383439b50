"""Draws sentences that users read, for a blind rating of the language.

    python benchmarks/sentences.py --seed 17 --each 40 --report logs/RUN/report.html > sentences.json

One list of sentences per source, each without its origin: docs (README, tutorial, how-to), messages (every string of
the program with a message's shape), help (of all commands and options), report (a report's page), page (the operator's
page). Rate each sentence alone: idiomatic, odd or unclear. Placeholders of a message are shown as [...].
"""

from __future__ import annotations

import argparse
import ast
import html
import json
import random
import re
from collections.abc import Iterator
from pathlib import Path

import click

from rig.cli.main import cli as rig

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("rig", "drivers", "protocols", "simulators")
FEWEST_WORDS = 4
FOR_MACHINES = re.compile(r"(?:SELECT|INSERT|DELETE|UPDATE|CREATE|PRAGMA)\b|.*'none'", re.DOTALL)
"""SQL and the header of a page's security policy, which are not language."""
WORD = re.compile(r"[(\"']?[A-Za-z][A-Za-z'-]*[)\"'.,:;?!]*")


def worth_rating(text: str) -> bool:
    """Whether a text is language rather than a name, a pattern or a number."""
    parts = re.sub(r"`[^`]*`", "", text).split()
    words = sum(WORD.fullmatch(part) is not None for part in parts)
    return words >= FEWEST_WORDS and words > len(parts) / 2 and not FOR_MACHINES.match(text)


def split(text: str) -> Iterator[str]:
    """Sentences of a paragraph."""
    for sentence in re.split(r"(?<=[.!?:])\s+(?=[A-Z`\"'(])", " ".join(text.split())):
        if worth_rating(sentence):
            yield sentence.strip()


def docs() -> Iterator[str]:
    """Sentences of README, tutorial and how-to, without boxes, tables and headings."""
    for file in [ROOT / "README.md", ROOT / "docs/tutorial.md", *sorted((ROOT / "docs/how-to").glob("*.md"))]:
        text = re.sub(r"```.*?```", "\n\n", file.read_text(encoding="utf-8"), flags=re.DOTALL)
        for paragraph in re.split(r"\n\s*\n|\n(?=[-*] |\d+\. )", text):
            if not paragraph.lstrip().startswith(("#", "|", "<", "![")):
                plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", paragraph)
                yield from split(re.sub(r"^\s*(?:[-*>]|\d+\.)\s+", "", plain, flags=re.MULTILINE).replace("**", ""))


def strings(tree: ast.AST) -> Iterator[str]:
    """Texts of a module that are neither docstrings nor parts of others; placeholders as [...]."""
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
        if isinstance(node, ast.JoinedStr):
            skipped.update(id(value) for value in node.values)
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.JoinedStr):
            yield "".join(
                str(value.value) if isinstance(value, ast.Constant) else "[...]" for value in node.values
            )


def messages() -> Iterator[str]:
    """Texts of the program's modules, and the explanations."""
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            for text in strings(ast.parse(file.read_text(encoding="utf-8"))):
                yield from split(text)
    for file in sorted((ROOT / "rig/explanations").glob("*.toml")):
        for text in re.findall(r'"([^"\n]+)"', file.read_text(encoding="utf-8")):
            yield from split(text)


def help_texts() -> Iterator[str]:
    """Help of all commands and options."""
    def of(command: click.Command, context: click.Context) -> Iterator[str]:
        yield from split(command.help or "")
        for parameter in command.params:
            if isinstance(parameter, click.Option) and not parameter.hidden:
                yield from split(parameter.help or "")
        if isinstance(command, click.Group):
            for name in command.list_commands(context):
                if (inner := command.get_command(context, name)) is not None and not inner.hidden:
                    yield from of(inner, click.Context(inner, info_name=name, parent=context))

    yield from of(rig, click.Context(rig, info_name="rig"))


def report(page: Path) -> Iterator[str]:
    """Text of a report's page, element by element."""
    body = re.sub(r"<(script|style|svg)\b.*?</\1>", "\n\n", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for piece in re.split(r"</?(?:p|h\d|li|td|th|tr|div|caption|figcaption|summary|section|dt|dd)\b[^>]*>", body):
        for part in re.split(r"<(?:span|b|strong|small)\b[^>]*class=[^>]*>", piece):  # shown apart, by its style
            yield from split(html.unescape(re.sub(r"<[^>]+>", " ", part)))


def operators_page() -> Iterator[str]:
    """Texts of the operator's page."""
    folder = ROOT / "rig/page/static"
    yield from report(folder / "page.html")
    for attribute in re.findall(r'(?:title|aria-label|placeholder)="([^"]+)"', (folder / "page.html").read_text()):
        yield from split(attribute)
    for file in sorted(folder.glob("*.js")):
        text = re.sub(r"^\s*(?://|\*|/\*).*$", "", file.read_text(encoding="utf-8"), flags=re.MULTILINE)
        for quoted in re.findall(r'"((?:[^"\\\n])*)"|`([^`]*)`', text):
            shown = re.sub(r"\$\{[^}]*\}", "[...]", "".join(quoted))
            if not re.search(r"[{}<>=;]|=>", shown):
                yield from split(shown)
    for file in sorted((ROOT / "rig/page").glob("*.py")):
        for text in strings(ast.parse(file.read_text(encoding="utf-8"))):
            yield from split(text)


def main() -> None:
    """Draw and print."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seed", type=int, required=True)
    arguments.add_argument("--each", type=int, default=40)
    arguments.add_argument("--report", type=Path, required=True, help="report.html of a run")
    given = arguments.parse_args()
    sources = {
        "docs": docs(), "messages": messages(), "help": help_texts(), "report": report(given.report),
        "page": operators_page(),
    }
    drawn = {}
    for name, sentences in sources.items():
        known = sorted(set(sentences))
        drawn[name] = random.Random(f"{given.seed} {name}").sample(known, min(given.each, len(known)))
    print(json.dumps(drawn, indent=1, ensure_ascii=False))


if __name__ == "__main__":
    main()
