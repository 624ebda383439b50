"""Output of a command: one JSON object, or text in the encoding of the terminal."""

from __future__ import annotations

import codecs
import io
import json
import math
import shutil
import sys
import time
import unicodedata
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rig.errors import RigError
from rig.extras import how_to_install

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from rich.console import Console

    from rig.document.blocks import Block, Document

PLAIN_WIDTH = 132
BAR_AFTER_S = 2.0
"""Progress of shorter work is not shown."""


def write_json(value: object) -> None:
    """Print one JSON object on standard output; inf and nan, which JSON lacks, become null."""
    say(json.dumps(_plain(value), indent=2, allow_nan=False))


def console(*, as_json: bool = False) -> Console:
    """Where text for people goes: standard output, or standard error when that is kept for JSON."""
    from rig.cli.safe_console import SafeConsole  # loads rich: not needed for the help

    shown = SafeConsole(stderr=as_json, highlight=False)
    if not shown.is_terminal:
        return SafeConsole(stderr=as_json, highlight=False, width=PLAIN_WIDTH)
    if shown.is_dumb_terminal:  # rich takes these for 80 columns wide, whatever they are
        columns, lines = shutil.get_terminal_size()
        return SafeConsole(stderr=as_json, highlight=False, width=columns, height=lines)
    return shown


@contextmanager
def status_line(console: Console, text: str) -> Iterator[None]:
    """Say what is done meanwhile; a closed terminal does not prevent it."""
    with ExitStack() as shown:
        with suppress(OSError):
            shown.enter_context(console.status(text))
        yield
        with suppress(OSError):
            shown.close()


class JobBar(Protocol):
    """Shows the number of finished jobs; yielded by `job_bar`."""

    def __call__(self, done: int, total: int, left_s: float | None = None, doing: str = "") -> None:
        """Show the finished and total jobs, the time left (s) if known, and the current work if it has changed."""


@contextmanager
def job_bar(what: str) -> Iterator[JobBar]:
    """Progress bar on standard error with the number of finished jobs and the time left."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    from rig.jobs.time_left import duration  # not needed for the help

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=console(as_json=True)) as bar:
        task = bar.add_task(what, total=None, left="")

        def show_progress(done: int, total: int, left_s: float | None = None, doing: str = "") -> None:
            left = "" if left_s is None or done == total else f"{duration(left_s)} left"
            bar.update(task, description=doing or what, completed=done, total=total, left=left)

        yield show_progress


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """Progress bar for work that is short as a rule, shown after `BAR_AFTER_S`."""
    started_s = time.monotonic()
    with ExitStack() as shown:
        bar: JobBar | None = None

        def report_progress(done: int, total: int) -> None:
            nonlocal bar
            if bar is None and time.monotonic() - started_s > BAR_AFTER_S:
                bar = shown.enter_context(job_bar(what))
            if bar is not None:
                bar(done, total, (time.monotonic() - started_s) * (total - done) / done)

        yield report_progress


@contextmanager
def kept_after_stop(kept: Callable[[], str]) -> Iterator[None]:
    """After Ctrl-C or a failure of the workers, add to the message which results are kept.

    Args:
        kept: called then; the sentence to add.

    Raises:
        KeyboardInterrupt: Passed on, with this sentence.
        WorkersFailed: Likewise.
    """
    from rig.jobs.workers import WorkersFailed  # not needed for the help

    try:
        yield
    except (KeyboardInterrupt, WorkersFailed) as stop:
        raise type(stop)("\n".join(filter(None, (str(stop), kept())))) from stop


def _plain(value: object) -> object:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, Path) else value


HANDLER = "rig.ascii"
PLAIN = {
    "°": "deg ", "µ": "u", "μ": "u", "²": "^2", "³": "^3", "±": "+-", "×": "x", "·": "*", "–": "-", "—": "-", "−": "-",
    "…": "...", "≤": "<=", "≥": ">=", "→": "->", "Ω": "ohm", "π": "pi", "√": "sqrt", "✓": "+", "✗": "x", "•": "*",
    "┃": "|", "│": "|", "━": "-", "─": "-", "╸": "-", "╺": "-", "“": '"', "”": '"', "’": "'",
}  # fmt: skip


def replaced(error: UnicodeError) -> tuple[str, int]:
    """Error handler of a codec: look-alikes in ASCII, "?" where there is none.

    Raises:
        UnicodeError: it is not an error of encoding.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(map(_in_ascii, error.object[error.start : error.end])), error.end


def _in_ascii(letter: str) -> str:
    """One character in ASCII: as in `PLAIN`, or without its accents, or "?"."""
    if letter in PLAIN:
        return PLAIN[letter]
    return unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode() or "?"


def take_every_character() -> None:
    """Let standard output and error replace what they cannot encode, instead of ending the command."""
    codecs.register_error(HANDLER, replaced)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=HANDLER)


def shown_path(path: Path) -> str:
    """A path as every command prints it: relative to the current folder inside it, else absolute; JSON is absolute."""
    whole = path.resolve()
    try:
        return str(whole.relative_to(Path.cwd().resolve())) or "."
    except (ValueError, OSError):  # elsewhere; or the current folder is gone
        return str(whole)


def say(text: object, *, err: bool = False) -> None:
    """Write one line, in the stream's own encoding (`click.echo` writes UTF-8 to an ASCII terminal)."""
    stream = sys.stderr if err else sys.stdout
    stream.write(f"{text}\n")
    stream.flush()


def say_error(text: str) -> None:
    """Write a message on standard error; on a terminal it is wrapped between words."""
    if sys.stderr.isatty():
        from rig.document.terminal import wrapped  # not needed for the help

        columns = shutil.get_terminal_size().columns
        parts = ((line for line, _ in wrapped(part, columns)) if part else ("",) for part in text.split("\n"))
        text = "\n".join(line for part in parts for line in part)
    say(text, err=True)


def write_pdf(document: Document, page: Path) -> Path:
    """Write a document as a PDF next to its page; the PDF's path.

    Raises:
        RigError: the library is not installed.
        OSError: the file cannot be written.
    """
    try:
        # numpy and the writer of files: not needed for the help
        from rig.document.pdf import pdf
        from rig.recording.atomic_write import write_durably
    except ImportError as error:
        raise RigError(
            f"{page} was written, but the PDF was not: {error.name or 'reportlab'} is not installed. Fix: "
            f"{how_to_install('pdf')}, or print the page from a browser (the page has a print style)"
        ) from error
    path = page.with_suffix(".pdf")
    write_durably(path, pdf(document))
    return path


def show(blocks: Iterable[Block], on: Console) -> None:
    """Print blocks of a document as wide as the console."""
    from rig.document.terminal import lines  # not needed for the help

    for line, style in lines(blocks, on.width):
        on.print(line, style=style, markup=False, highlight=False, soft_wrap=True)
