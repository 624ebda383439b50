"""The page itself: one document with its style and scripts inside, so that nothing is fetched from anywhere."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files

SCRIPTS = ("charts.js", "panels.js", "banner.js", "link.js", "page.js")


@cache
def document() -> bytes:
    """The whole page, UTF-8."""
    page = _static("page.html")
    page = page.replace("/*STYLE*/", _static("page.css"))
    return page.replace("/*SCRIPT*/", _script()).encode()


@cache
def headers() -> dict[str, str]:
    """What goes with it: only what is in the page itself may run, and it may speak to this server alone."""
    policy = (
        f"default-src 'none'; script-src '{_digest(_script())}'; "
        f"style-src '{_digest(_static('page.css'))}'; "
        "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {
        "Content-Type": "text/html; charset=utf-8",
        "Content-Security-Policy": policy,
        "Cache-Control": "no-store",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "DENY",
        "Cross-Origin-Opener-Policy": "same-origin",
    }


def _script() -> str:
    return "\n".join(map(_static, SCRIPTS))


def _static(name: str) -> str:
    return files("rig.page").joinpath("static", name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
