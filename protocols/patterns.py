"""Regular expressions of users, matched in time linear in the text: no corrupted line can block a thread.

The engine is RE2, which never backtracks; look-around and back references, which would need that, are refused. Patterns
of this program's own modules use `re`.
"""

from __future__ import annotations

from typing import Any

import re2

LONGEST_PATTERN = 1000
"""Characters; the longest pattern among the presets and the examples has 90."""
_OPTIONS: Any = re2.Options()
_OPTIONS.log_errors = False  # RE2 would write to standard error beside our own message


class PatternError(ValueError):
    """The text is not a regular expression that can be matched in linear time; the message says why."""


class Match:
    """Where a pattern matched: `match["name"]` is the text of a group, None where the group took no part."""

    __slots__ = ("_found", "_names")

    def __init__(self, found: Any, names: dict[str, int]) -> None:  # noqa: ANN401 - RE2's match, not annotated
        self._found = found
        self._names = names

    def __getitem__(self, name: str) -> str | None:
        part: bytes | None = self._found[self._names[name]]
        return None if part is None else part.decode("utf-8", "replace")

    def span(self, name: str) -> tuple[int, int]:
        """First byte of a group in the text's UTF-8 and the one after its last; -1, -1 where the group took no part."""
        first, end = self._found.span(self._names[name])
        return int(first), int(end)


class Pattern:
    """A compiled regular expression; letters, digits and blanks are the ASCII ones.

    Args (construction):
        text: the pattern, in RE2's syntax: that of Python's `re` without look-around and back references.

    Attributes:
        text: the pattern.
        groups: names of its groups.

    Raises:
        PatternError: not such a pattern, too long, or with a NUL, which no line of text has.
    """

    __slots__ = ("_names", "_regex", "groups", "text")

    def __init__(self, text: str) -> None:
        if len(text) > LONGEST_PATTERN:
            raise PatternError(f"{len(text)} characters, allowed {LONGEST_PATTERN}")
        if "\0" in text:
            raise PatternError("contains a NUL character")
        try:
            self._regex: Any = re2.compile(text.encode("utf-8"), _OPTIONS)
        except UnicodeEncodeError as error:
            raise PatternError("contains a character that is not valid Unicode") from error
        except re2.error as error:
            raise PatternError(_reason(error)) from error
        self.text = text
        self._names = {name.decode(): number for name, number in self._regex.groupindex.items()}
        self.groups = frozenset(self._names)

    def __reduce__(self) -> tuple[type[Pattern], tuple[str]]:
        return Pattern, (self.text,)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and other.text == self.text

    def __hash__(self) -> int:
        return hash(self.text)

    def fullmatch(self, text: str) -> Match | None:
        """The pattern over the whole text."""
        match = self._regex.fullmatch(text.encode("utf-8", "replace"))
        return None if match is None else Match(match, self._names)

    def search(self, text: str) -> Match | None:
        """The first place in the text where the pattern matches."""
        match = self._regex.search(text.encode("utf-8", "replace"))
        return None if match is None else Match(match, self._names)


def _reason(error: Exception) -> str:
    """RE2's reason in words."""
    given = error.args[0] if error.args else error
    text = given.decode("utf-8", "replace") if isinstance(given, bytes) else str(given)
    unsupported = "perl operator" in text or "escape sequence" in text
    return f"{text} (look-around and back references are not supported)" if unsupported else text
