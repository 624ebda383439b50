"""Who may open the page: judged for every request, HTTP or WebSocket, before anything of it is read.

A request must name this server (`Host`), come from its own pages where a browser says from where (`Origin`), and carry
one of two tokens: the operator's, or one to hand to viewers. Those of a run's page are drawn anew by every server, so
that of a finished run opens nothing; those of a bench's page are permanent (`rig.page.permanent_address`). Pure:
headers in, a verdict out.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from urllib.parse import parse_qs, urlsplit

TOKEN_BYTES = 24
LOOPBACK_NAMES = ("127.0.0.1", "localhost", "[::1]")


class Role(StrEnum):
    """What a token allows: both see everything and may stop; an operator may take the lease."""

    OPERATOR = "operator"
    VIEWER = "viewer"


@dataclass(frozen=True)
class Denied:
    """Why a request is not answered: HTTP status and slug."""

    status: int
    slug: str


@dataclass(frozen=True)
class Access:
    """The rules of one server.

    Attributes:
        host: name or address that the page is opened by, as in its URL.
        port: the server's.
        secure: TLS.
        tokens: by role; drawn at random.
    """

    host: str
    port: int
    secure: bool = False
    tokens: Mapping[Role, str] = field(default_factory=lambda: new_tokens(), repr=False)

    @property
    def scheme(self) -> str:
        """Of its URLs."""
        return "https" if self.secure else "http"

    def url(self, role: Role, path: str = "/") -> str:
        """The address to open as an operator or viewer; `path` without a query."""
        return f"{self.scheme}://{self.host}:{self.port}{path}?token={self.tokens[role]}"

    @property
    def authorities(self) -> frozenset[str]:
        """What `Host` may say: the name of the URL; on loopback its other names too."""
        names = {self.host, *LOOPBACK_NAMES} if is_loopback(self.host) else {self.host}
        standard = 443 if self.secure else 80
        bare = names if self.port == standard else set()
        return frozenset(name.lower() for name in (*(f"{name}:{self.port}" for name in names), *bare))

    def check(self, path: str, hosts: list[str], origins: list[str]) -> Role | Denied:
        """Whether a request is answered.

        Args:
            path: as requested, with its query.
            hosts: every `Host` header.
            origins: every `Origin` header; a browser sends one with each WebSocket, other programs none.
        """
        if len(hosts) != 1 or hosts[0].lower() not in self.authorities:
            return Denied(403, "foreign-host")
        own = {f"{self.scheme}://{authority}" for authority in self.authorities}
        if len(origins) > 1 or any(origin.lower() not in own for origin in origins):
            return Denied(403, "foreign-origin")
        try:
            given = parse_qs(urlsplit(path).query).get("token", [""])
        except ValueError:  # an address such as //[
            return Denied(400, "bad-address")
        matched = [role for role, token in self.tokens.items() if _same(given[0], token)]
        if len(given) != 1 or not matched:
            return Denied(401, "wrong-token")
        return matched[0]


def new_tokens() -> dict[Role, str]:
    """Tokens that no stranger can guess."""
    return {role: secrets.token_urlsafe(TOKEN_BYTES) for role in Role}


def _same(given: str, token: str) -> bool:
    return hmac.compare_digest(given.encode("utf-8", "replace"), token.encode())


def is_loopback(host: str) -> bool:
    """Whether a name or address (an IPv6 one in brackets) reaches this machine alone."""
    if host.lower() == "localhost":
        return True
    try:
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False
