"""The address of a results server: checked, and shown without its password. Loads no validator."""

from __future__ import annotations

import re
from urllib.parse import parse_qsl, quote, unquote, urlsplit

ADDRESS_VARIABLE = "RIG_RESULTS"
"""Environment variable with the address of the server, in place of `url`; it may contain the password."""
SCHEMES = frozenset({"postgresql", "postgres", "postgresql+psycopg"})
EXPECTED = "expected postgresql://USER@HOST/DATABASE or postgresql://USER@HOST:PORT/DATABASE"
PASSWORD_OF_URL = re.compile(r"(\w+://[^\s/:@]*:)[^\s/@]+@|([?&]password=)[^\s&]+", re.IGNORECASE)


def without_passwords(text: str) -> str:
    """A text in which each password of an address is replaced by `***`."""
    return PASSWORD_OF_URL.sub(lambda part: f"{part[1]}***@" if part[1] else f"{part[2]}***", text)


def checked_address(url: str) -> str:
    """The address of a results server, unchanged.

    Raises:
        ValueError: it is not the address of a PostgreSQL database; the message does not contain the password.
    """
    shown = without_passwords(url)
    try:
        parts = urlsplit(url.strip())
        port = parts.port
    except ValueError as error:
        raise ValueError(f"{shown!r}: {EXPECTED}") from error
    if parts.scheme not in SCHEMES or not parts.path.strip("/") or port == 0:
        raise ValueError(f"{shown!r}: {EXPECTED}")
    return url


def address_without_password(url: str) -> str:
    """An address as it is kept in files: refused with a password.

    Raises:
        ValueError: as `checked_address`, or the address contains a password.
    """
    parts = urlsplit(checked_address(url).strip())
    if parts.password is not None or "password" in dict(parse_qsl(parts.query)):
        raise ValueError(
            f"{without_passwords(url)!r}: a password must not be stored in this file, which is copied to every run. "
            "Fix: remove the password; set PGPASSWORD or use ~/.pgpass"
        )
    return url


def server_name(url: str) -> str:
    """The server and database of an address, for messages and files: without password and options."""
    parts = urlsplit(checked_address(url).strip())
    host = parts.hostname or dict(parse_qsl(parts.query)).get("host", "")
    host = quote(host, safe="") if "/" in host else f"[{host}]" if ":" in host else host
    user = "" if parts.username is None else f"{quote(unquote(parts.username), safe='')}@"
    port = "" if parts.port is None else f":{parts.port}"
    return f"postgresql://{user}{host}{port}/{parts.path.strip('/')}"
