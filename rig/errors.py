"""What can go wrong, by exit code: each error says expected, got, where, and what to do."""

from __future__ import annotations

EXIT_DONE = 0
EXIT_USAGE = 2
EXIT_REFUSED = 3
EXIT_STOPPED = 4
EXIT_NOT_ALL_VALID = 5
EXIT_IDENTIFICATION = 6
EXIT_UNKNOWN_STATE = 7


class RigError(Exception):
    """Base of every error a user is shown; `exit_code` is the command's exit code."""

    exit_code = EXIT_USAGE


class FileProblem(RigError):
    """A user's file cannot be used: missing, unreadable, or with wrong entries.

    `problems` holds one line for each wrong entry: place, value, allowed range, what would fit. `slug` is the fault
    matrix's name for it, empty where it has none.
    """

    def __init__(self, file: str, problems: list[str], slug: str = "") -> None:
        self.file = file
        self.slug = slug
        self.problems = problems
        super().__init__("\n".join(f"{file}: {problem}" for problem in problems))


class FileProblems(FileProblem):
    """More than one of a user's files cannot be used; `each` holds the problems of every file."""

    def __init__(self, each: list[FileProblem]) -> None:
        self.each = each
        problems = [text for one in each for text in str(one).split("\n")]
        super().__init__(", ".join(one.file for one in each), problems, each[0].slug)
        self.args = ("\n".join(str(one) for one in each),)


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


class IdentificationFailed(RigError):
    """No model could be fitted; the message names what the data lack."""

    exit_code = EXIT_IDENTIFICATION


class UnknownRigState(RigError):
    """Links are lost and the rig's state cannot be proved: go and look."""

    exit_code = EXIT_UNKNOWN_STATE
