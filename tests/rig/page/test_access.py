"""Who may open the page."""

from __future__ import annotations

import pytest

from rig.page.access import Access, Denied, Role, is_loopback

TOKENS = {Role.OPERATOR: "o" * 32, Role.VIEWER: "v" * 32}
ACCESS = Access("127.0.0.1", 8123, tokens=TOKENS)
OPEN = f"/?token={TOKENS[Role.OPERATOR]}"


def test_the_printed_address_opens_the_page_for_an_operator() -> None:
    assert ACCESS.url(Role.OPERATOR) == f"http://127.0.0.1:8123{OPEN}"
    assert ACCESS.check(OPEN, ["127.0.0.1:8123"], []) is Role.OPERATOR
    assert ACCESS.check(f"/ws?token={'v' * 32}", ["localhost:8123"], ["http://localhost:8123"]) is Role.VIEWER


@pytest.mark.parametrize(
    "host", ["evil.example:8123", "evil.example", "127.0.0.1", "127.0.0.1:80", "", "127.0.0.1:8123.evil.example"]
)
def test_a_request_for_another_host_is_denied_whatever_its_token(host: str) -> None:
    assert ACCESS.check(OPEN, [host], []) == Denied(403, "foreign-host")


def test_a_request_with_no_host_or_two_is_denied() -> None:
    assert ACCESS.check(OPEN, [], []) == Denied(403, "foreign-host")
    assert ACCESS.check(OPEN, ["127.0.0.1:8123", "127.0.0.1:8123"], []) == Denied(403, "foreign-host")


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "https://127.0.0.1:8123", "http://127.0.0.1:8124", "file://", ""]
)
def test_a_page_of_somebody_else_is_denied(origin: str) -> None:
    assert ACCESS.check(OPEN, ["127.0.0.1:8123"], [origin]) == Denied(403, "foreign-origin")


@pytest.mark.parametrize(
    "path",
    [
        "/", "/?token=", "/?token=wrong", f"/?token={'o' * 31}", f"/?token={'o' * 32}&token=x", "/?token=%C3%A9",
        f"/ws?Token={'o' * 32}",
    ],
)
def test_a_wrong_token_is_denied(path: str) -> None:
    assert ACCESS.check(path, ["127.0.0.1:8123"], []) == Denied(401, "wrong-token")


def test_an_address_that_cannot_be_read_is_denied() -> None:
    assert ACCESS.check(f"//[{OPEN}", ["127.0.0.1:8123"], []) == Denied(400, "bad-address")


def test_every_server_draws_tokens_of_its_own_so_that_an_ended_runs_opens_nothing() -> None:
    ended, running = Access("127.0.0.1", 8123), Access("127.0.0.1", 8123)
    for role in Role:
        path = f"/?token={ended.tokens[role]}"
        assert running.check(path, ["127.0.0.1:8123"], []) == Denied(401, "wrong-token")
        assert len(running.tokens[role]) >= 32
    assert "token" not in repr(running)


def test_a_named_server_with_tls_answers_to_its_name_alone() -> None:
    named = Access("rig-pc.lab", 443, secure=True, tokens=TOKENS)
    assert named.check(OPEN, ["rig-pc.lab"], ["https://rig-pc.lab"]) is Role.OPERATOR
    assert named.check(OPEN, ["localhost:443"], []) == Denied(403, "foreign-host")
    assert named.check(OPEN, ["rig-pc.lab"], ["http://rig-pc.lab"]) == Denied(403, "foreign-origin")


@pytest.mark.parametrize(
    ("host", "inside"),
    [
        ("127.0.0.1", True), ("localhost", True), ("[::1]", True), ("127.8.0.1", True), ("10.0.0.4", False),
        ("rig-pc.lab", False), ("[fd00::2]", False), ("localhost.evil.example", False),
    ],
)
def test_loopback_is_this_machine_alone(host: str, inside: bool) -> None:
    assert is_loopback(host) is inside
