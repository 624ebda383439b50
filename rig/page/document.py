"""The page itself: one document with its style and scripts inside, so that nothing is fetched from anywhere.

`static/vendor` holds uPlot, which draws the charts, unchanged as released, with its licence.
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files

SCRIPTS = ("series.js", "charts.js", "panels.js", "banner.js", "link.js", "page.js")
LIBRARY, LIBRARY_STYLE, LIBRARY_LICENCE = "vendor/uPlot.iife.min.js", "vendor/uPlot.min.css", "vendor/uPlot.LICENSE"


@cache
def document() -> bytes:
    """The whole page, UTF-8."""
    page = _static("page.html").replace("/*LICENCE*/", _static(LIBRARY_LICENCE))
    page = page.replace("/*STYLE*/", _style()).replace("/*LIBRARY*/", _static(LIBRARY))
    return page.replace("/*SCRIPT*/", _script()).encode()


@cache
def headers() -> dict[str, str]:
    """What goes with it: only what is in the page itself may run, and it may speak to this server alone."""
    policy = (
        f"default-src 'none'; script-src '{_digest(_static(LIBRARY))}' '{_digest(_script())}'; "
        f"style-src '{_digest(_style())}'; "
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


def _style() -> str:
    return _static(LIBRARY_STYLE) + _static("page.css")


def _script() -> str:
    return "\n".join(map(_static, SCRIPTS))


def _static(name: str) -> str:
    return files("rig.page").joinpath("static", name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
