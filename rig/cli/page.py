"""`rig page`: the operator's page of a run; and the part of `rig run` that serves pages."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rig.campaign_folder import CampaignFolder
from rig.cli.options import Command, json_option, run_argument
from rig.cli.output import say, write_json
from rig.errors import EXIT_DONE, FileProblem, RigError
from rig.page.settings import PageSettings
from rig.page.started import PageProcess

if TYPE_CHECKING:
    from rig.campaign.live_link import LiveLink
    from rig.campaign.results import CampaignResult

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

        if self.link is not None:
            self.link.display.ended(result, [text for _, text in ending(result)])


@contextmanager
def live_link(settings: PageSettings | None, *, held: bool = False) -> Iterator[RunLink]:
    """A live folder for as long as the block runs, and a page where one is wanted; its address is printed.

    Args:
        settings: of the page; None: none is started, but `rig page RUN` finds the campaign.
        held: the campaign waits for Start.

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
        if settings is not None:
            raise
        yield RunLink(None)
        return
    with contextlib.ExitStack() as ends:
        ends.callback(link.close)
        page = None
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
    examples=("rig page logs/20260102T030405Z-MR-001-ab12cd", "rig page logs/RUN --page-address 127.0.0.1:8080"),
)
@run_argument
@page_options
@json_option
def command(
    run: Path, page_address: str | None, page_cert: Path | None, page_key: Path | None, as_json: bool
) -> int:
    """Serve the operator's page for RUN (running or finished) until 'Close the page' is clicked or Ctrl-C is pressed.

    The command prints the address as `page: URL`. Serving the page does not affect the campaign.
    """
    import asyncio
    from dataclasses import replace

    # loads numpy: not needed for the help
    from rig.page.process import serve_page

    settings = page_settings(page_address, page_cert, page_key)
    if settings is not None:
        of_run = replace(settings, run=str(_campaign(run)))
        asyncio.run(serve_page(of_run, partial(_announce, as_json=as_json)))
    return EXIT_DONE


def _announce(url: str, *, as_json: bool) -> None:
    say(f"page: {url}", err=True)
    if as_json:
        write_json({"page": url})


def _campaign(run: Path) -> Path:
    """The directory, where it holds a campaign.

    Raises:
        FileProblem: it does not.
    """
    if not CampaignFolder(run).journal.is_file():
        raise FileProblem(str(run), ["contains no campaign. Fix: specify the folder that `rig run` printed (see "
            "`rig runs`)"])
    return run.resolve()
