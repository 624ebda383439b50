"""Standard output and error that take every character: what a terminal's encoding lacks is written in ASCII."""

from __future__ import annotations

import codecs
import io
import sys
import unicodedata

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


def say(text: object, *, err: bool = False) -> None:
    """Write one line, in the stream's own encoding (`click.echo` writes UTF-8 to an ASCII terminal)."""
    stream = sys.stderr if err else sys.stdout
    stream.write(f"{text}\n")
    stream.flush()
