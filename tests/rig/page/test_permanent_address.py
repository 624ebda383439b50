"""The permanent address of a bench's page: its tokens, who can read them, one server at a time."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.page.access import Access, Denied, Role
from rig.page.permanent_address import ADDRESS, PermanentAddress
from rig.page.process import permanent_socket
from rig.page.settings import PageProblem, PageSettings

BENCH = Path("lab") / "bench.toml"


def served(place: Path, *, renewed: bool = False) -> PermanentAddress:
    """The address after one server was started and ended."""
    address = PermanentAddress.opened(BENCH, place=place, renewed=renewed)
    address.keep(address.port, f"http://127.0.0.1:{address.port}/")
    address.close()
    return address


def file_of(address: PermanentAddress) -> Path:
    return address.folder / ADDRESS


def test_tokens_and_port_last_and_belong_to_this_user_alone(tmp_path: Path) -> None:
    first = served(tmp_path)
    again = served(tmp_path)
    assert (again.tokens, again.port, again.known, again.warning) == (first.tokens, first.port, True, "")
    assert file_of(first).stat().st_mode & 0o777 == 0o600
    assert first.folder.stat().st_mode & 0o777 == 0o700
    assert first.tokens[Role.OPERATOR] not in repr(first)
    other = PermanentAddress.opened(Path("other") / "bench.toml", place=tmp_path)
    assert set(other.tokens.values()).isdisjoint(first.tokens.values())
    other.close()


def test_renewed_tokens_make_the_old_address_one_of_a_stranger(tmp_path: Path) -> None:
    old, new = served(tmp_path), served(tmp_path, renewed=True)
    access = Access("127.0.0.1", 1, tokens=new.tokens)
    host = ["127.0.0.1:1"]
    assert access.check(f"/?token={old.tokens[Role.OPERATOR]}", host, []) == Denied(401, "wrong-token")
    assert access.check(f"/?token={new.tokens[Role.OPERATOR]}", host, []) is Role.OPERATOR


def test_a_second_server_is_refused_and_names_the_address(tmp_path: Path) -> None:
    served(tmp_path)
    first = PermanentAddress.opened(BENCH, place=tmp_path)
    with pytest.raises(PageProblem, match=rf"already being served at http://127.0.0.1:{first.port}/"):
        PermanentAddress.opened(BENCH, place=tmp_path)
    first.close()


def readable(file: Path) -> None:
    file.chmod(0o640)


def linked(file: Path) -> None:
    elsewhere = file.with_name("elsewhere")
    file.rename(elsewhere)
    file.symlink_to(elsewhere)


def piped(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def shortened(file: Path) -> None:
    content = json.loads(file.read_text())
    file.write_text(json.dumps({**content, "tokens": {"operator": "a", "viewer": "a"}}))


@pytest.mark.parametrize("spoil", [readable, linked, piped, shortened, lambda file: file.write_bytes(b"\xff[")])
def test_a_file_that_may_have_been_read_or_written_by_others_gives_new_tokens(
    spoil: Callable[[Path], None], tmp_path: Path
) -> None:
    first = served(tmp_path)
    spoil(file_of(first))
    again = served(tmp_path)
    assert set(again.tokens.values()).isdisjoint(first.tokens.values())
    assert not file_of(again).is_symlink()
    assert file_of(again).stat().st_mode & 0o777 == 0o600


def test_a_known_port_that_another_program_has_is_not_exchanged_in_silence(tmp_path: Path) -> None:
    address = PermanentAddress.opened(BENCH, place=tmp_path)
    other = permanent_socket(PageSettings(), address)
    other.listen()
    next_one = permanent_socket(PageSettings(), address)
    assert next_one.getsockname()[1] != other.getsockname()[1]
    address.known, address.port = True, other.getsockname()[1]
    with pytest.raises(PageProblem, match=r"choose another port for this start with --page-address 127\.0\.0\.1:PORT"):
        permanent_socket(PageSettings(), address)
    for sock in (other, next_one):
        sock.close()
    address.close()
