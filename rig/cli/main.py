"""The entry of the `rig` command: finds the command, runs it, turns errors into messages and exit codes."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import sys
import warnings
from collections.abc import Sequence
from importlib.machinery import PathFinder
from pathlib import Path
from typing import TextIO

import click

from rig import __version__
from rig.bench.server_address import without_passwords
from rig.cli.help_examples import write_examples
from rig.cli.output import say, say_error, take_every_character, write_json
from rig.compile_notice import NOTICE
from rig.errors import (
    EXIT_DEFECT,
    EXIT_DONE,
    EXIT_STOPPED,
    EXIT_UNKNOWN_STATE,
    EXIT_USAGE,
    DataWarning,
    FileProblem,
    RigError,
)
from rig.extras import missing_package

OPERATOR_STOP = "sigint"

# Heading -> command -> its module (with the click command as `command`) and its line in the help, so that the help
# loads no module.
GROUPS: dict[str, dict[str, tuple[str, str]]] = {
    "Set up": {
        "demo": ("rig.cli.demo", "Run a complete example on the simulated rig, in under a minute."),
        "init": ("rig.cli.init", "Write a commented bench file and matrix file to start from."),
        "check": ("rig.cli.check", "Check every device of a bench; --listen shows what a device sends."),
        "plan": ("rig.cli.plan", "Check every point of a matrix against the limits of a bench."),
    },
    "Run": {
        "run": ("rig.cli.run", "Run and record a test matrix or a hybrid test; identify the damper."),
        "line": ("rig.cli.line", "Test one specimen after another, each started by its serial number."),
        "page": ("rig.cli.page", "Serve the operator's page for a run or a bench."),
    },
    "Results": {
        "runs": ("rig.cli.runs", "List recorded runs."),
        "results": ("rig.cli.results", "Show, export or deliver the results of all runs."),
        "report": ("rig.cli.report", "Write the report for a run (HTML, PDF)."),
        "compare": ("rig.cli.compare", "Compare runs; check them against acceptance bands."),
        "export": ("rig.cli.export", "Export a run or a fit for use in another program."),
        "import": ("rig.cli.importing", "Convert test files (CSV, Excel, MATLAB, ...) to a run."),
        "recover": ("rig.cli.recover", "Finish the points of an interrupted campaign."),
        "quality": ("rig.cli.quality", "Check the process: control charts, golden damper, gauge R&R, capability."),
        "reanalyse": ("rig.cli.reanalyse", "Analyse old runs again with this version; show what has changed."),
    },
    "Models": {
        "identify": ("rig.cli.identify", "Fit damper models to recorded runs."),
        "ride": ("rig.cli.ride", "Compare the ride of a car with different fitted dampers, including the uncertainty."),
        "study": ("rig.cli.study", "Compare identification algorithms on recordings."),
        "models": ("rig.cli.models", "List the damper models: equations, parameters, energy."),
        "benchmark": ("rig.cli.hybrid_benchmark", "Run a published benchmark for real-time hybrid simulation."),
    },
    "Tools": {
        "simulate": ("rig.cli.simulate", "Start only the simulated rig."),
        "scenarios": ("rig.cli.scenarios", "Run a matrix in simulated scenarios with random faults."),
        "explain": ("rig.cli.explain", "Explain the code of a fault, refusal or finding."),
        "schema": ("rig.cli.schema", "Print JSON schemas for the files you write, for use in editors."),
        "plugins": ("rig.cli.plugins", "List plug-ins: drivers, models, methods, report sections, export formats."),
    },
}
COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}

# Names of earlier versions, kept until 2.0.
RENAMED = {"sniff": ("check", "--listen"), "hybrid": ("run", "--hybrid"), "worlds": ("scenarios",)}

EXAMPLES = (
    "rig demo",
    "rig plan examples/table1.toml --bench examples/demo-bench.toml",
    "rig run examples/table1.toml --simulate --speed 50",
)

EXIT_CODES = (
    ("0", "done"),
    ("1", "defect in this software; the message names a file to attach to a bug report"),
    ("2", "incorrect usage or invalid file"),
    ("3", "refused before motion"),
    ("4", "stopped by a fault or the operator; the rig is safe"),
    ("5", "finished, but some points are not valid"),
    ("6", "identification failed"),
    ("7", "rig state unknown: inspect the rig before continuing"),
    ("8", "acceptance bands not met"),
)

MOVING = frozenset({"run", "line", "demo", "hybrid"})
"""Commands after which a rig may have moved."""
LINUX_ONLY = frozenset({"demo", "check", "run", "line", "page", "simulate", "scenarios", "recover", *RENAMED})
"""Commands that start the station or the simulated rig, or lock a campaign."""
PACKAGES = ("drivers", "protocols", "simulators")
"""What lies beside `rig`: names that other projects use, too."""


class LazyGroup(click.Group):
    """A group that imports a command when it is called, and knows the others by their line of help only."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the help."""
        del ctx
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command's module."""
        del ctx
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(COMMANDS[cmd_name][0]).command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command and its arguments; an earlier name is replaced by the present one, with a note."""
        present = _present_spelling(args)
        if present is not args and not ctx.resilient_parsing:
            name = "check --listen" if args[0] == "sniff" else present[0]
            say(f"rig: `rig {args[0]}` is now `rig {name}`; the old name will be removed in 2.0", err=True)
        return super().resolve_command(ctx, present)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The commands under their headings, from the table alone."""
        del ctx
        width = max(map(len, COMMANDS))
        for heading, group in GROUPS.items():
            with formatter.section(heading):
                formatter.write_dl([(f"{name:<{width}}", line) for name, (_, line) in group.items()])

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Examples and exit codes."""
        del ctx
        write_examples(formatter, EXAMPLES)
        with formatter.section("Exit codes"):
            formatter.write_dl(list(EXIT_CODES))


def _present_spelling(words: list[str]) -> list[str]:
    """Command and arguments as this version spells them; the same list where nothing changed."""
    if not words or words[0] not in RENAMED:
        return words
    own = words[: words.index("--")] if "--" in words else words
    if words[0] == "hybrid" and "--benchmark" in own:
        return ["benchmark", *_of_benchmark(own[1:])]
    return [*RENAMED[words[0]], *words[1:]]


def _of_benchmark(words: list[str]) -> list[str]:
    """Options of `rig hybrid --benchmark` that `rig benchmark` has too: --out had no effect there."""
    kept: list[str] = []
    following = iter(words)
    for word in following:
        if word == "--out":
            next(following, None)
        elif word != "--benchmark" and not word.startswith("--out="):
            kept.append(word)
    return kept


def _show_version(ctx: click.Context, param: click.Parameter, shown: bool) -> None:
    """Print version and commit and end.

    Raises:
        Exit: always, where it is asked for.
    """
    del param
    if not shown or ctx.resilient_parsing:
        return
    from rig.version import described  # starts git in a checkout: only here

    say(f"rig {described()}")
    raise click.exceptions.Exit(EXIT_DONE)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version", is_flag=True, expose_value=False, is_eager=True, callback=_show_version,
    help="Show the version and commit, and exit.",
)
def cli() -> None:
    """Controller for an MR-damper test rig: plan, run, record, identify."""


def main(arguments: Sequence[str]) -> int:
    """Run one command; return its exit code.

    Errors that a user can correct are one message on standard error; with `--json` also one object on standard output.
    """
    return answered(cli, arguments, "rig")


def answered(command: click.Command, arguments: Sequence[str], name: str, loaded: object = None) -> int:
    """Run a command under a name as `main` does; return its exit code.

    Args:
        command: the command.
        arguments: its arguments.
        name: shown in its messages.
        loaded: what was loaded in advance; the object of the command's context.
    """
    take_every_character()
    NOTICE.report = _write_to_stderr
    with warnings.catch_warnings():
        warnings.simplefilter("always", DataWarning)
        warnings.showwarning = _show_warning
        return _answered(command, arguments, name, loaded)


def _write_to_stderr(text: str) -> None:
    """Write a line to standard error; a closed terminal does not stop the command."""
    with contextlib.suppress(OSError):
        say(text, err=True)


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """A warning about data in its own words; any other as Python shows it."""
    own = issubclass(category, DataWarning)
    text = f"warning: {message}" if own else warnings.formatwarning(message, category, filename, lineno, line).rstrip()
    del file
    _write_to_stderr(text)


def _answered(command: click.Command, arguments: Sequence[str], name: str, loaded: object) -> int:
    as_json = "--json" in (arguments[: arguments.index("--")] if "--" in arguments else arguments)
    try:
        ended = command.main(args=list(arguments), prog_name=name, standalone_mode=False, obj=loaded)
        return int(ended or EXIT_DONE)
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        answer: dict[str, object] = {"error": error.format_message(), "slug": RigError.slug}
        return _ended(shown.getvalue().rstrip(), answer, EXIT_USAGE, as_json=as_json)
    except FileProblem as error:
        answer = {"error": str(error), "slug": error.slug}
        answer |= {"file": error.file, "problems": error.problems}
        return _ended(str(error), answer, error.exit_code, as_json=as_json)
    except RigError as error:
        return _ended(f"rig: {error}", {"error": str(error), "slug": error.slug}, error.exit_code, as_json=as_json)
    except BrokenPipeError:
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115 - the reader of the output has closed it; nothing more is printed
        return EXIT_DONE
    except OSError as error:
        text = f"{error.filename or 'input or output'}: {error.strerror or error}"
        return _ended(f"rig: {text}", {"error": text, "slug": FileProblem.slug}, EXIT_USAGE, as_json=as_json)
    except (click.Abort, KeyboardInterrupt) as stop:
        message = str(stop.__cause__) if isinstance(stop.__cause__, KeyboardInterrupt) else ""  # click passes it on so
        text = f"stopped by operator: {message}" if message else "stopped by operator"
        return _ended(f"rig: {text}", {"error": text, "slug": OPERATOR_STOP}, EXIT_STOPPED, as_json=as_json)
    except ModuleNotFoundError as error:
        text = "" if _moves(arguments) else missing_package(error)
        if not text:
            return _of_defect(error, arguments, as_json=as_json)
        return _ended(f"rig: {text}", {"error": text, "slug": RigError.slug}, EXIT_USAGE, as_json=as_json)
    except MemoryError as error:
        if _moves(arguments):
            return _of_defect(error, arguments, as_json=as_json)
        details = f" ({error})" if str(error) else ""
        text = f"not enough memory for this command{details}. Fix: {MORE_MEMORY}"
        return _ended(f"rig: {text}", {"error": text, "slug": RigError.slug}, EXIT_USAGE, as_json=as_json)
    except Exception as error:  # noqa: BLE001 - a traceback helps its reader only; it goes into a file for them
        return _of_defect(error, arguments, as_json=as_json)


MORE_MEMORY = "use fewer or shorter tests at a time, close other programs, or use a computer with more memory"


def _moves(arguments: Sequence[str]) -> bool:
    return not MOVING.isdisjoint(arguments[:1])


def _of_defect(error: Exception, arguments: Sequence[str], *, as_json: bool) -> int:
    text = _defect(error)
    moves = _moves(arguments)
    text += "; the rig's state is unknown: inspect the rig before continuing" if moves else ""
    answer: dict[str, object] = {"error": text, "slug": "defect"}
    return _ended(f"rig: {text}", answer, EXIT_UNKNOWN_STATE if moves else EXIT_DEFECT, as_json=as_json)


def _defect(error: Exception) -> str:
    """What is said of an error that no code expected; its traceback goes into a file in the temporary folder."""
    # Loaded here, because it takes a third of the time of `rig --help`.
    import tempfile
    import traceback

    last = traceback.extract_tb(error.__traceback__)[-1]
    text = f"unexpected {type(error).__name__} in {Path(last.filename).name}, line {last.lineno}: {error}. "
    try:
        with tempfile.NamedTemporaryFile("w", prefix="mr-damper-rig-", suffix=".txt", delete=False) as file:
            text_of = f"rig {__version__}, {' '.join(sys.argv)}\n{''.join(traceback.format_exception(error))}"
            file.write(without_passwords(text_of))
    except OSError:
        return f"{text}This is a defect in this program; please report it with the command and its files"
    return f"{text}This is a defect in this program; please report it with {file.name}"


def _ended(text: str, answer: dict[str, object], code: int, *, as_json: bool) -> int:
    """End a command early: say why, in words and as one object; returns the exit code.

    A terminal that was closed takes nothing from it.
    """
    with contextlib.suppress(OSError):
        say_error(text)
    if as_json:
        with contextlib.suppress(OSError):
            write_json({**answer, "exit_code": code})
    return code


def conflicting_packages(search: list[str] | None = None) -> str | None:
    """Name what is wrong with the four packages; None when all are ours.

    Args:
        search: where Python looks (default `sys.path`).

    Returns:
        One message with what to do, or None.
    """
    home = Path(__file__).resolve().parents[2]
    for name in PACKAGES:
        spec = PathFinder.find_spec(name, search)
        if spec is None or spec.origin is None:
            return f"the package {name} is missing from {home / 'rig'}. Fix: reinstall mr-damper-rig"
        if Path(spec.origin).resolve().parents[1] != home:
            return (
                f"the package {name} at {Path(spec.origin).parent} belongs to another project with that name and hides "
                f"the package in {home}. Fix: install mr-damper-rig into a separate environment (python3 dev.py "
                "install)"
            )
    return None


def needs_linux(arguments: Sequence[str], system: str = os.name) -> str | None:
    """The message for a command that does not run on this operating system; None if it runs.

    Args:
        arguments: of the command line, the command first.
        system: `os.name`; `nt` is Windows.
    """
    if system != "nt" or not LINUX_ONLY.intersection(arguments[:1]) or {"-h", "--help"}.intersection(arguments):
        return None
    here = ", ".join(name for name in COMMANDS if name not in LINUX_ONLY)
    return (
        f"`rig {arguments[0]}` needs Linux. Fix: use WSL2 (see \"Use the software on Windows\" in the how-to guides). "
        f"These commands also run on Windows: {here}"
    )


def run() -> None:
    """Console entry: `rig ...`."""
    open_standard_streams()
    # Our matrices are small: a second thread of the library waits for them busily, beside a rig that has to be watched.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if problem := conflicting_packages() or needs_linux(sys.argv[1:]):
        take_every_character()
        say(f"rig: {problem}", err=True)
        sys.exit(EXIT_USAGE)
    code = main(sys.argv[1:])
    _let_go_of_the_terminal()
    sys.exit(code)


def open_standard_streams() -> None:
    """Put /dev/null in place of standard streams that the caller has closed.

    Else the next file opened would get the descriptor of one, and what is meant for the terminal would go into it.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free descriptor is the one that was closed: those below it are open.
            os.open(os.devnull, os.O_RDONLY if mode == "r" else os.O_WRONLY)
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode, encoding="utf-8", closefd=False))  # noqa: SIM115 - for the process


def _let_go_of_the_terminal() -> None:
    """What cannot be written at the very end (the terminal was closed) takes nothing from the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    run()
