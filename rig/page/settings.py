"""Where the page is served: this machine alone unless a name and a certificate are given."""

from __future__ import annotations

import ssl
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rig.errors import RigError
from rig.page.access import is_loopback

MOST_PORT = 65535
WILDCARDS = frozenset({"0.0.0.0", "[::]", "::", "*", ""})


class PageProblem(RigError):
    """The page cannot be served as asked for; every reason is in the message."""

    slug = "page-address"


@dataclass(frozen=True)
class PageSettings:
    """One page.

    Attributes:
        address: `HOST` or `HOST:PORT` as it is opened in a browser; port 0 or none: any that is free.
        cert, key: PEM files of its TLS certificate; empty: none.
        run: the run's directory; empty: as the live folder says.
        live: the live folder; empty: as the run's directory says.
        tied: ends with its standard input, as the child of a campaign.
    """

    address: str = "127.0.0.1"
    cert: str = ""
    key: str = ""
    run: str = ""
    live: str = ""
    tied: bool = False

    @property
    def host(self) -> str:
        """Without the port; an IPv6 address in brackets."""
        return self._parts[0]

    @property
    def port(self) -> int:
        """0: any that is free."""
        return int(self._parts[1] or "0")

    @property
    def _parts(self) -> tuple[str, str]:
        address = self.address
        if address.startswith("["):
            inside, _, after = address.partition("]")
            return f"{inside}]", after.removeprefix(":")
        host, _, port = address.partition(":")
        return host, port

    def context(self) -> ssl.SSLContext | None:
        """TLS with the given certificate; None without one.

        Raises:
            PageProblem: files, address or port cannot be used; all that is wrong is named.
        """
        problems, context = self._problems(), None
        if self.cert and self.key:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.minimum_version = ssl.TLSVersion.TLSv1_2
            try:
                context.load_cert_chain(self.cert, self.key)
            except (OSError, ValueError) as error:
                problems.append(f"certificate {self.cert} with key {self.key}: {error}")
        if problems:
            raise PageProblem("\n".join(problems))
        return context

    def _problems(self) -> list[str]:
        host, port = self._parts
        problems = []
        if host in WILDCARDS or "/" in self.address or (self.address.count(":") > 1 and not host.startswith("[")):
            problems.append(
                f"page address {self.address!r}: got a wildcard or no name, expected the name or address that browsers "
                "use, such as rig-pc.lab.example:8443 or [fd00::2]:8443"
            )
        elif not is_loopback(host) and not (self.cert and self.key):
            problems.append(
                f"page address {self.address!r}: other machines can reach this address, but TLS is not configured. "
                "Fix: specify a certificate and its key, or omit the address to serve the page on this machine only"
            )
        if port and (not port.isascii() or not port.isdigit() or int(port) > MOST_PORT):
            problems.append(f"page address {self.address!r}: got an invalid port, expected 0 to {MOST_PORT}")
        if bool(self.cert) != bool(self.key):
            problems.append("expected both a certificate and a key, got only one of them")
        problems += [f"{path}: file not found" for path in (self.cert, self.key) if path and not Path(path).is_file()]
        return problems

    def to_json(self) -> dict[str, Any]:
        """For the page's own process."""
        return asdict(self)
