"""The pages themselves: documents with their style and scripts inside, so that nothing is fetched from anywhere.

`static/vendor` holds uPlot, which draws the charts, unchanged as released, with its licence.
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib.resources import files
from urllib.parse import quote

RUN, BENCH = "page", "bench"
"""The view of a run, and that of a bench."""
LIBRARY, LIBRARY_STYLE, LIBRARY_LICENCE = "vendor/uPlot.iife.min.js", "vendor/uPlot.min.css", "vendor/uPlot.LICENSE"
HEAD = "head.html"
STYLES = {RUN: (LIBRARY_STYLE, "page.css"), BENCH: ("page.css", "bench.css", "line.css")}
SCRIPTS = {
    RUN: ("dom.js", "series.js", "charts.js", "panels.js", "banner.js", "link.js", "page.js"),
    BENCH: ("dom.js", "link.js", "line.js", "bench.js"),
}


@cache
def document(view: str = RUN) -> bytes:
    """A whole page, UTF-8."""
    page = _static(f"{view}.html").replace("/*HEAD*/\n", _static(HEAD)).replace("/*LICENCE*/", _static(LIBRARY_LICENCE))
    page = page.replace("/*STYLE*/", _joined(STYLES[view])).replace("/*LIBRARY*/", _static(LIBRARY))
    return page.replace("/*SCRIPT*/", _joined(SCRIPTS[view])).encode()


@cache
def headers(view: str = RUN) -> dict[str, str]:
    """What goes with it: only what is in the page itself may run, and it may speak to this server alone."""
    policy = (
        f"default-src 'none'; script-src '{_digest(_static(LIBRARY))}' '{_digest(_joined(SCRIPTS[view]))}'; "
        f"style-src '{_digest(_joined(STYLES[view]))}'; "
        "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )
    return {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy, **GUARDS}


def report_headers() -> dict[str, str]:
    """What goes with a report, which may come from anywhere: a page of nowhere (`sandbox`), whose scripts do not run.

    It can neither read its address nor ask anything of this server.
    """
    policy = (
        "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    )
    return {"Content-Type": "text/html; charset=utf-8", "Content-Security-Policy": policy, **GUARDS}


def pdf_headers(name: str) -> dict[str, str]:
    """What goes with the PDF of a report: the browser stores it as a file and shows none of it here.

    Args:
        name: of the run.
    """
    return {
        "Content-Type": "application/pdf", "Content-Disposition": f"attachment; filename*=UTF-8''{quote(name)}.pdf",
        "Content-Security-Policy": "sandbox; default-src 'none'", **GUARDS,
    }


GUARDS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def _joined(names: tuple[str, ...]) -> str:
    return "\n".join(map(_static, names))


def _static(name: str) -> str:
    return files("rig.page").joinpath("static", name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
