"""What a browser may ask for, by its rights."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from rig.page.access import Role
from rig.page.commands import Client, Commands
from rig.page.lease import Lease
from rig.station.live_folder import make_live_folder

ADA, BOB = Client(Role.OPERATOR, "ada"), Client(Role.OPERATOR, "bob")
GUEST = Client(Role.VIEWER, "guest")


@dataclass
class Desk:
    """A lease and commands whose datagrams are kept."""

    folder: Path
    now_ns: int = 0
    running: bool = True
    reached: bool = True
    sent: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    closed: int = 0

    def __post_init__(self) -> None:
        self.lease = Lease(lambda: self.folder if self.running else None, lambda: self.now_ns)
        self.commands = Commands(self.lease, lambda: self.folder if self.running else None, self._close, self._say)

    def _close(self) -> None:
        self.closed += 1

    def _say(self, path: str | Path, message: dict[str, Any]) -> bool:
        self.sent.append((Path(path).name, message))
        return self.reached

    def ask(self, client: Client, **message: object) -> dict[str, Any]:
        return self.commands.take(json.dumps(message), client)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    folder, _ = make_live_folder(tmp_path)
    made = Desk(folder)
    yield made
    for client in (ADA, BOB):
        made.lease.give_back(client.key)


@pytest.mark.parametrize("client", [ADA, GUEST])
def test_a_stop_of_anybody_goes_to_station_and_application(desk: Desk, client: Client) -> None:
    assert desk.ask(client, do="stop")["ok"] is True
    assert [name for name, _ in desk.sent] == ["station.sock", "application.sock"]
    assert {message["do"] for _, message in desk.sent} == {"stop"}


def test_a_stop_is_taken_from_others_while_somebody_has_control(desk: Desk) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    desk.sent.clear()
    for client, name in ((BOB, " Bob\n"), (BOB, ""), (GUEST, "Ada"), (BOB, "B" * 200), (ADA, "Bob")):
        assert desk.ask(client, do="stop", name=name)["ok"] is True
    who = [message["by"] for _, message in desk.sent[::2]]
    assert (len(desk.sent), max(map(len, who))) == (10, 60 + len(" (without control)"))
    del who[3]
    assert who == ["Bob (without control)", "a browser (without control)", "Ada (viewer)", "Ada"]


@pytest.mark.parametrize("do", ["start", "pause", "lease", "words", "release"])
def test_a_viewer_commands_nothing(desk: Desk, do: str) -> None:
    assert desk.ask(GUEST, do=do, name="Eve", note="x")["refused"] == "viewer"
    assert desk.sent == []


@pytest.mark.parametrize("do", ["start", "pause", "words"])
def test_an_operator_without_the_lease_commands_nothing(desk: Desk, do: str) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    desk.sent.clear()
    assert desk.ask(BOB, do=do, note="x")["refused"] == "no-lease"
    assert desk.sent == []


def test_the_holder_commands_under_the_name_typed(desk: Desk) -> None:
    assert desk.ask(ADA, do="lease", name=" Ada\n<b>L</b> ")["ok"] is True
    assert desk.ask(ADA, do="pause")["ok"] is True
    assert desk.sent[-1] == ("application.sock", {"do": "pause", "by": "Ada <b>L</b>"})


def test_one_lease_at_a_time_and_it_waits_a_while_for_a_holder_who_is_gone(desk: Desk) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    assert desk.ask(BOB, do="lease", name="Bob")["refused"] == "lease-taken"
    desk.lease.left("ada")
    desk.now_ns += 9_000_000_000
    assert desk.ask(BOB, do="lease", name="Bob")["refused"] == "lease-taken"
    desk.now_ns += 2_000_000_000
    assert desk.ask(BOB, do="lease", name="Bob")["ok"] is True
    assert desk.ask(ADA, do="pause")["refused"] == "no-lease"


def test_a_second_page_of_the_same_campaign_gives_out_no_second_lease(desk: Desk) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    other = Desk(desk.folder)
    assert other.ask(BOB, do="lease", name="Bob")["refused"] == "lease-taken"
    desk.ask(ADA, do="release")
    assert other.ask(BOB, do="lease", name="Bob")["ok"] is True
    other.lease.give_back("bob")


@pytest.mark.parametrize(
    "do", ["reset", "arm", "move", "set_current", "hydraulics", "beat", "shutdown", "disarm", "__class__"]
)
def test_there_is_no_word_that_resets_or_moves(desk: Desk, do: str) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    desk.sent.clear()
    assert desk.ask(ADA, do=do, target_m=0.01, current_A=2.0)["refused"] == "unknown-command"
    assert desk.sent == []


@pytest.mark.parametrize("text", ["", "stop", "[]", "null", '{"do": 1}', '{"do": ["stop"]}', b"\xff\xfe", "[" * 4000])
def test_what_is_no_message_is_refused_and_goes_nowhere(desk: Desk, text: str | bytes) -> None:
    assert desk.commands.take(text, ADA)["refused"] == "bad-message"
    assert desk.sent == []


def test_nothing_is_taken_once_the_campaign_has_ended(desk: Desk) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    desk.running = False
    desk.sent.clear()
    assert desk.ask(ADA, do="stop")["refused"] == "not-running"
    assert desk.ask(ADA, do="start")["refused"] == "not-running"
    assert desk.sent == []


def test_a_lease_ends_with_its_campaign_and_is_none_of_the_next_ones(desk: Desk, tmp_path: Path) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    again = tmp_path / "again"
    again.mkdir()
    desk.folder, _ = make_live_folder(again)
    assert desk.ask(ADA, do="start")["refused"] == "no-lease"
    assert desk.ask(BOB, do="lease", name="Bob")["ok"] is True


@pytest.mark.parametrize(("client", "refused"), [(GUEST, "viewer"), (BOB, "no-lease"), (ADA, None)])
def test_a_current_set_by_hand_is_confirmed_by_the_holder_alone(
    desk: Desk, client: Client, refused: str | None
) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    desk.sent.clear()
    assert desk.ask(client, do="set", number=3).get("refused") == refused
    assert desk.sent == ([] if refused else [("application.sock", {"do": "set", "by": "Ada", "number": 3})])
    assert desk.ask(ADA, do="set", number="3")["refused"] == "bad-message"


def test_a_stop_that_nobody_takes_is_not_reported_to_be_taken(desk: Desk) -> None:
    desk.reached = False
    assert desk.ask(ADA, do="stop")["refused"] == "not-reached"


def test_a_slug_is_explained_in_the_words_of_rig_explain(desk: Desk) -> None:
    answer = desk.ask(GUEST, do="explain", slug="estop")
    assert "emergency" in answer["means"].lower() or "e-stop" in answer["means"].lower()
    assert answer["look_at"]
    assert desk.ask(GUEST, do="explain", slug="<script>")["refused"] == "unknown-slug"


def test_the_page_of_a_campaign_that_runs_is_closed_by_nobody(desk: Desk) -> None:
    desk.ask(ADA, do="lease", name="Ada")
    assert desk.ask(ADA, do="close")["refused"] == "still-running"
    desk.running = False
    assert desk.ask(GUEST, do="close")["refused"] == "viewer"
    assert desk.closed == 0
    assert desk.ask(BOB, do="close") == {"do": "close", "ok": True}
    assert desk.closed == 1
    assert desk.sent == [("application.sock", {"do": "words", "by": "Ada", "operator": "Ada"})]


def test_the_lease_of_a_bench_is_had_without_a_campaign_and_outlasts_each(desk: Desk, tmp_path: Path) -> None:
    desk.running = False
    bench = Desk(desk.folder, running=False)
    bench.lease = Lease(lambda: bench.folder if bench.running else None, lambda: bench.now_ns, permanent=True)
    bench.commands = Commands(bench.lease, lambda: bench.folder if bench.running else None, None, bench._say)
    assert bench.ask(ADA, do="lease", name="Ada")["ok"] is True
    assert bench.ask(BOB, do="lease", name="Bob")["refused"] == "lease-taken"
    for do in ("begin", "resume", "make-report", "plan"):
        assert bench.commands.refused_at_bench(do, ADA) is None
        assert bench.commands.refused_at_bench(do, GUEST) == {"do": do, "refused": "viewer"}
    assert bench.commands.refused_at_bench("begin", BOB) == {"do": "begin", "refused": "no-lease"}
    assert bench.commands.refused_at_bench("plan", BOB) is None
    bench.running = desk.running = True
    assert bench.ask(ADA, do="pause")["ok"] is True, "of the campaign that it started"
    assert desk.ask(BOB, do="lease", name="Bob")["refused"] == "lease-taken", "that campaign's own page"
    bench.running = False
    assert bench.lease.held_by("ada")
    assert desk.ask(BOB, do="lease", name="Bob")["ok"] is True
    bench.running = True
    assert bench.ask(ADA, do="pause")["refused"] == "no-lease", "an operator at the campaign's own page commands it"
    assert bench.ask(ADA, do="close")["refused"] == "lasting-page"
    bench.lease.left("ada")
    bench.now_ns += 11_000_000_000
    desk.ask(BOB, do="release")
    assert bench.ask(BOB, do="lease", name="Bob")["ok"] is True
    bench.lease.give_back("bob")
