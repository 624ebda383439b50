"""`rig page`: the operator's page of a run or of a bench; and the part of `rig run` that serves pages."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.campaign_folder import LOGS, CampaignFolder
from rig.cli.options import Command, RunPath, json_option
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE, FileProblem, RigError
from rig.page.settings import PageSettings
from rig.page.started import PageProcess

if TYPE_CHECKING:
    from rig.campaign.live_link import LiveLink
    from rig.campaign.results import CampaignResult
    from rig.comparison.specimen import SpecimenResult

EVALUATING = "evaluating"
"""State of a specimen between the end of the motion and its verdict."""
GONE = "sigterm"
"""What stopped a campaign whose terminal was closed, or whose program was told to end."""


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options that say where a page is served."""
    options = (
        click.option(
            "--page-address", metavar="HOST[:PORT]",
            help="Address of the page. The default is 127.0.0.1 with any free port. Access from other machines "
                 "requires TLS.",
        ),
        click.option("--page-cert", type=click.Path(path_type=Path), metavar="FILE", help="TLS certificate (PEM)."),
        click.option("--page-key", type=click.Path(path_type=Path), metavar="FILE", help=(
            "Private key of the certificate (PEM)."
        )),
    )
    for option in reversed(options):
        command = option(command)
    return command


def page_settings(
    address: str | None, cert: Path | None, key: Path | None, *,
    enabled: bool = True, hold: bool = False, stay: bool = False,
) -> PageSettings | None:
    """The settings of a page, looked at as a whole; None where none is wanted.

    Raises:
        UsageError: there are settings without a page.
        PageProblem: they cannot be used.
    """
    if not enabled:
        if any(option is not None for option in (address, cert, key)):
            raise click.UsageError("--page-address, --page-cert and --page-key require --page")
        if hold:
            raise click.UsageError("--hold requires --page")
        if stay:
            raise click.UsageError("--stay requires --page")
        return None
    settings = PageSettings(
        address="127.0.0.1" if address is None else address, cert="" if cert is None else str(cert.resolve()),
        key="" if key is None else str(key.resolve()),
    )
    settings.context()
    return settings


class RunLink:
    """What a running campaign shows, and the page that shows it.

    Attributes:
        link: the live folder; None where shared memory refused it: then no page can be opened.
    """

    def __init__(self, link: LiveLink | None, page: PageProcess | None = None) -> None:
        self.link = link
        self._page = page

    @property
    def url(self) -> str | None:
        """Of the page that was started with it."""
        return None if self._page is None else self._page.url

    def stay(self, result: CampaignResult) -> None:
        """Keep the page, with what is left of the campaign, until an operator closes it there, or Ctrl-C here.

        The rig is at rest and let go of, and the campaign's own link taken away: it may be resumed meanwhile, and the
        page follows. After SIGTERM or a closed terminal the program does not wait.
        """
        if self._page is None or self.link is None or result.stopped_by == GONE:
            return
        with contextlib.suppress(KeyboardInterrupt):
            self.link.close()
            with contextlib.suppress(OSError):
                say("The page remains open; to close it, click 'Close the page' or press Ctrl-C here.", err=True)
            self._page.wait()

    def refused(self, error: RigError) -> None:
        """Show that it did not begin, or broke off, and why."""
        if self.link is not None:
            self.link.display.refused(error.slug, str(error))

    def ended(self, result: CampaignResult) -> None:
        """Show how the campaign ended."""
        # loads numpy and pyserial: not needed for the help
        from rig.cli.words import ending
        from rig.matrix.acceptance_table import has_acceptance

        if self.link is not None:
            self.link.display.ended(result, [text for _, text in ending(result)])
            if has_acceptance(result.campaign):
                self.link.display.specimen({"verdict": EVALUATING, "reason": ""})

    def evaluated(self, specimen: SpecimenResult | None) -> None:
        """Show the verdict on the specimen, if there is one."""
        if self.link is not None and specimen is not None:
            self.link.display.specimen({"verdict": str(specimen.verdict), "reason": specimen.reason})


@contextmanager
def live_link(
    settings: PageSettings | None, *, held: bool = False, operated: bool = False
) -> Iterator[RunLink]:
    """A live folder for as long as the block runs, and a page where one is wanted; its address is printed.

    Args:
        settings: of the page; None: none is started, but `rig page RUN` finds the campaign.
        held: the campaign waits for Start.
        operated: the page of a bench has started it, so that questions to the operator are shown there.

    Raises:
        PageProblem: the page cannot be served; nothing was begun.
        OSError: it has no live folder.
        RigError: the block's own; the page shows it first.
    """
    from dataclasses import replace

    # loads numpy and pyserial: not needed for the help
    from rig.campaign.live_link import LiveLink

    try:
        link = LiveLink(held=held)
    except OSError:
        if settings is not None or operated:
            raise
        yield RunLink(None)
        return
    with contextlib.ExitStack() as ends:
        ends.callback(link.close)
        page, link.paged = None, operated
        if settings is not None:
            page = PageProcess.start(replace(settings, live=str(link.folder)))
            ends.callback(page.close)
            say(f"page: {page.url}", err=True)
            link.paged = True
        shown = RunLink(link, page)
        try:
            yield shown
        except RigError as error:
            shown.refused(error)
            raise


@click.command(
    name="page", cls=Command,
    examples=(
        "rig page --bench my-lab/bench.toml --matrices my-lab",
        "rig page --bench my-lab/bench.toml --simulate --speed 5    (rehearsal)",
        "rig page logs/20260102T030405Z-MR-001-ab12cd",
    ),
)
@click.argument("run", type=RunPath(), required=False)
@click.option("--bench", type=click.Path(path_type=Path), metavar="FILE",
              help="Operate this bench from the page: choose, plan, start and resume runs.")
@click.option("--matrices", type=click.Path(path_type=Path), metavar="FOLDER",
              help="With --bench: folder of the matrix files. The default is the folder of the bench file.")
@click.option("--simulate", is_flag=True, help="With --bench: start runs on a simulated rig with the devices of the "
                                               "bench file.")
@click.option("--speed", type=click.FloatRange(0.01, 1000.0),
              help="With --simulate: simulated seconds per real second. The default is 1.")
@click.option("--new-tokens", is_flag=True, help="With --bench: replace the stored tokens; earlier addresses become "
                                                 "invalid.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), metavar="FOLDER",
              help="With --bench: folder of the runs. The default is logs.")
@page_options
@json_option
def command(
    run: Path | None, bench: Path | None, matrices: Path | None, simulate: bool, speed: float | None, new_tokens: bool,
    out: Path | None, page_address: str | None, page_cert: Path | None, page_key: Path | None, as_json: bool,
) -> int:
    """Serve the operator's page for RUN (running or finished), or for a bench.

    The page for RUN is served until 'Close the page' is clicked or Ctrl-C is pressed. The page for a bench is served
    until Ctrl-C is pressed; its address and tokens remain the same when it is started again.

    The command prints the address as `page: URL`. Runs do not depend on the page: they continue when the page is
    closed or killed.
    """
    import asyncio
    from dataclasses import replace

    # loads numpy: not needed for the help
    from rig.page.process import serve_page

    settings = page_settings(page_address, page_cert, page_key)
    if settings is None:
        return EXIT_DONE
    _check_usage(run, bench, {
        "--matrices": matrices is not None, "--speed": speed is not None, "--out": out is not None,
        "--simulate": simulate, "--new-tokens": new_tokens,
    })  # fmt: skip
    if bench is None:
        of_run = replace(settings, run="" if run is None else str(_campaign(run)))
        asyncio.run(serve_page(of_run, partial(_announce, as_json=as_json)))
        return EXIT_DONE
    folders = (bench.parent if matrices is None else matrices), LOGS if out is None else out
    _serve_bench(settings, bench, folders, 1.0 if speed is None else speed, simulate=simulate, new_tokens=new_tokens,
                 as_json=as_json)
    return EXIT_DONE


def _check_usage(run: Path | None, bench: Path | None, given: Mapping[str, bool]) -> None:
    """Refuse contradictions before anything is read.

    Args:
        run: the run.
        bench: the bench file.
        given: the options of the page of a bench, and whether each is given.

    Raises:
        UsageError: with what to write instead.
    """
    if bench is None and any(given.values()):
        raise click.UsageError(f"{next(name for name, is_given in given.items() if is_given)} requires --bench FILE")
    if run is None and bench is None:
        raise click.UsageError("specify RUN (see `rig runs`) or --bench FILE")
    if run is not None and bench is not None:
        raise click.UsageError("specify either RUN or --bench, not both; the page of a bench lists all its runs")
    if given["--speed"] and not given["--simulate"]:
        raise click.UsageError("--speed: only allowed with a simulated rig. Fix: add --simulate")


def _serve_bench(
    settings: PageSettings, bench_path: Path, folders: tuple[Path, Path], speed: float, *, simulate: bool,
    new_tokens: bool, as_json: bool,
) -> None:
    """Serve the page of a bench until Ctrl-C.

    Raises:
        FileProblem: the bench file cannot be used, or there is no folder of matrix files.
        PageProblem: the page cannot be served.
    """
    import asyncio

    # loads numpy and pyserial: not needed for the help
    from rig.bench.model import Bench
    from rig.campaign.machine_resources import devices_of
    from rig.campaign.simulated_rig import wearing
    from rig.page import bench_control
    from rig.page.permanent_address import PermanentAddress
    from rig.page.process import serve_bench

    known, (matrices, out) = Bench.load(bench_path), folders
    if simulate:
        wearing(bench_path)  # a bench whose devices no simulated rig can have is refused now
    if not matrices.is_dir():
        raise FileProblem(str(matrices), ["no such folder. Fix: specify the folder of the matrix files (--matrices)"])
    address = PermanentAddress.opened(bench_path, renewed=new_tokens)
    try:
        if address.warning:
            say(f"warning: {address.warning}", err=True)
        bench = bench_control.Bench(
            path=bench_path.resolve(), name=known.name, devices=frozenset(devices_of(known)),
            matrices=matrices.resolve(), out=out.resolve(), state=address.folder, simulate=simulate, speed=speed,
        )
        asyncio.run(serve_bench(settings, bench, address, partial(_announce, as_json=as_json)))
    finally:
        address.close()


def _announce(url: str, *, as_json: bool) -> None:
    say(f"page: {url}", err=True)
    if as_json:
        write_json({"page": url})


def _campaign(run: Path) -> Path:
    """The directory, where it holds a campaign.

    Raises:
        FileProblem: it does not.
    """
    from rig.page.ended_run import is_imported  # loads numpy, which the options of a page do not need

    folder = CampaignFolder(run)
    if not folder.journal.is_file() and not is_imported(folder):
        raise FileProblem(str(run), ["contains no campaign. Fix: specify the folder that `rig run` printed (see "
            "`rig runs`)"])
    return run.resolve()
