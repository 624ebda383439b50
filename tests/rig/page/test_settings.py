"""Where the page may be served."""

from __future__ import annotations

from pathlib import Path

import pytest

from rig.page.settings import PageProblem, PageSettings


def test_it_is_served_on_this_machine_alone_by_default() -> None:
    assert (PageSettings().host, PageSettings().port, PageSettings().context()) == ("127.0.0.1", 0, None)
    assert (PageSettings("[::1]:8080").host, PageSettings("[::1]:8080").port) == ("[::1]", 8080)


@pytest.mark.parametrize("address", ["192.168.0.10:8443", "rig-pc.lab", "[fd00::2]:8443"])
def test_another_address_needs_a_certificate(address: str) -> None:
    with pytest.raises(PageProblem, match="certificate"):
        PageSettings(address).context()


@pytest.mark.parametrize("address", ["0.0.0.0:8080", "::", "[::]:80", "*", "", "http://rig-pc.lab", "fd00::2"])
def test_an_address_that_no_browser_opens_is_refused(address: str) -> None:
    with pytest.raises(PageProblem, match="the name or address"):
        PageSettings(address).context()


def test_everything_wrong_is_reported_at_once(tmp_path: Path) -> None:
    with pytest.raises(PageProblem) as problem:
        PageSettings("rig-pc.lab:99999", cert=str(tmp_path / "no.pem")).context()
    assert len(str(problem.value).splitlines()) == 4


def test_a_file_that_is_no_certificate_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.pem").write_text("no certificate")
    with pytest.raises(PageProblem, match=r"a\.pem"):
        PageSettings("rig-pc.lab:0", cert=str(tmp_path / "a.pem"), key=str(tmp_path / "a.pem")).context()
