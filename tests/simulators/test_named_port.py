"""Ports behind a name that stays."""

import os
from pathlib import Path

from simulators.named_port import NamedPort


def test_after_renumbering_the_name_leads_to_another_port_and_the_old_one_has_ended(tmp_path: Path) -> None:
    port = NamedPort(tmp_path, "LC-1")
    before = os.path.realpath(port.url)
    reader = os.open(port.url, os.O_RDONLY | os.O_NOCTTY)
    port.write(b"first", 5)
    assert os.read(reader, 100) == b"first"
    port.renumber()
    assert os.path.realpath(port.url) != before
    try:
        assert os.read(reader, 100) == b""
    except OSError as error:
        assert error.errno == 5  # noqa: PT017 - either is what a pulled cable gives
    os.close(reader)
    second = os.open(port.url, os.O_RDONLY | os.O_NOCTTY)
    port.write(b"second", 6)
    assert os.read(second, 100) == b"second"
    os.close(second)
    assert (port.sent_bytes, port.dropped_frames) == (11, 0)
    port.close()
    assert list(tmp_path.iterdir()) == []
