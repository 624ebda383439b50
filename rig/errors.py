"""Errors by exit code: each has a code that identifies it, and a message: expected, got, where, what to do."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

EXIT_DONE = 0
EXIT_DEFECT = 1
"""An error that no code expected: of this program, not of its user."""
EXIT_USAGE = 2
EXIT_REFUSED = 3
EXIT_STOPPED = 4
EXIT_NOT_ALL_VALID = 5
EXIT_IDENTIFICATION = 6
EXIT_UNKNOWN_STATE = 7
EXIT_NOT_ACCEPTED = 8


CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Characters that control a terminal or turn the direction of text; tabs and line ends are none of them."""


def clean_text(text: str) -> str:
    """The one place that the words of errors, causes and notes pass; nothing behind it is decided by them.

    Control characters, which names in a user's files may contain, are shown as escapes: a terminal would obey them.
    """
    return CONTROL.sub(lambda sign: repr(sign[0])[1:-1], text) if CONTROL.search(text) else text


def some(texts: Sequence[str], separator: str = ", ", most: int = 3) -> str:
    """The first texts of a list, and how many more there are."""
    return separator.join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


class RigError(Exception):
    """Base of every error a user is shown; `exit_code` is the command's exit code, `slug` the error's name."""

    exit_code = EXIT_USAGE
    slug = "usage"

    def __init__(self, message: str) -> None:
        super().__init__(clean_text(message))

    def __reduce__(self) -> tuple[Callable[..., RigError], tuple[object, ...]]:
        """Support pickling from worker processes: the constructors of error classes take more than the message."""
        return _received, (type(self), self.args, self.__dict__)


def _received(kind: type[RigError], arguments: tuple[object, ...], state: dict[str, object]) -> RigError:
    error = kind.__new__(kind, *arguments)
    error.__dict__.update(state)
    return error


class FileProblem(RigError):
    """A user's file cannot be used: missing, unreadable, or with wrong entries.

    `problems` holds one line for each wrong entry: place, value, allowed range, what would fit. `slug` is the fault
    matrix's name for it where it has one.
    """

    slug = "file"

    def __init__(self, file: str, problems: list[str], slug: str = "") -> None:
        self.file = file
        self.slug = slug or FileProblem.slug
        self.problems = [clean_text(problem) for problem in problems]
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


class FileProblems(FileProblem):
    """More than one of a user's files cannot be used; `files` holds the problems of every one."""

    def __init__(self, files: list[FileProblem]) -> None:
        self.files = files
        problems = [f"{error.file}: {problem}" for error in files for problem in error.problems]
        super().__init__(", ".join(error.file for error in files), problems, files[0].slug)
        self.args = ("\n".join(str(error) for error in files),)


class Refused(RigError):
    """The rig refuses to start; nothing has moved."""

    exit_code = EXIT_REFUSED

    def __init__(self, slug: str, message: str) -> None:
        self.slug = slug
        super().__init__(message)


class Stopped(RigError):
    """The campaign was stopped by a fault or by the operator; the rig is safe."""

    exit_code = EXIT_STOPPED

    def __init__(self, slug: str, message: str) -> None:
        self.slug = slug
        super().__init__(message)


class NoSuchEntry(RigError, KeyError, IndexError):
    """A value in memory has no entry of that name or place; the message lists those that it has."""

    def __str__(self) -> str:
        """The message as it is; a `KeyError` would put quotes around it."""
        return str(self.args[0]) if self.args else ""


class IdentificationFailed(RigError):
    """No model could be fitted; the message names what the data lack."""

    exit_code = EXIT_IDENTIFICATION
    slug = "identification"


class UnknownRigState(RigError):
    """Links are lost and the rig's state cannot be confirmed: inspect the rig before continuing."""

    exit_code = EXIT_UNKNOWN_STATE
    slug = "state-unknown"


class DataWarning(UserWarning):
    """Data that a call goes on without; commands show it on standard error."""


NUMERICAL_ERRORS = (ValueError, ArithmeticError, LookupError)
"""What numerical code raises where data break one of its invariants; `numpy.linalg.LinAlgError` is a `ValueError`."""


@contextmanager
def evaluating(what: str) -> Iterator[None]:
    """Boundary around numerical code that works on measured data: no data may end a command with a traceback.

    Args:
        what: what is evaluated, such as a test's id.

    Raises:
        IdentificationFailed: in place of any of `NUMERICAL_ERRORS`. A `RigError` passes as it is.
    """
    try:
        yield
    except NUMERICAL_ERRORS as error:
        raise IdentificationFailed(
            f"{what} cannot be evaluated: {type(error).__name__}: {error}. The data of this point violate "
            "an assumption made by the software. Fix: check its displacement, force and time, or exclude the point"
        ) from error
