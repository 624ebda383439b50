"""Optional parts of the installation: the extras of pyproject.toml that a user's command may need."""

from __future__ import annotations


def how_to_install(extra: str) -> str:
    """The shell command that adds an extra, for the end of a message.

    Args:
        extra: name in `[project.optional-dependencies]` of pyproject.toml.
    """
    return f"pip install 'mr-damper-rig[{extra}]'"


EXTRA_OF = {
    "pyarrow": "files", "asammdf": "files", "matio": "files", "nptdms": "files",
    "python_calamine": "files", "reportlab": "pdf", "PIL": "pdf", "distributed": "cluster", "sklearn": "reference",
    "psycopg": "results",
}
"""Package as it is imported to the smallest extra that installs it."""


def missing_package(error: ModuleNotFoundError) -> str:
    """The message for a package that is not installed; empty if it is part of the basic installation."""
    package = (error.name or "").partition(".")[0]
    extra = EXTRA_OF.get(package)
    return f"the required package {package} is not installed. Fix: {how_to_install(extra)}" if extra else ""
