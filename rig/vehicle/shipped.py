"""Cars and roads that come with the program: files in a folder of this room, asked for by name."""

from __future__ import annotations

from pathlib import Path

from rig.errors import FileProblem


def names_in(folder: Path) -> tuple[str, ...]:
    """Names of the files that come with the program in a folder."""
    return tuple(sorted(path.stem for path in folder.glob("*.toml")))


def found(given: str | Path, folder: Path, what: str) -> Path:
    """The file of a name that comes with the program, or the user's own.

    Args:
        given: name or path.
        folder: where those are that come with the program.
        what: what they are, for people.

    Raises:
        FileProblem: neither; the names that are known.
    """
    name, known = str(given), names_in(folder)
    path = folder / f"{name}.toml" if name in known else Path(given)
    if not path.exists():
        raise FileProblem(name, [f"there is no file and no {what} with this name; known: {', '.join(known)}"])
    return path
