"""A whole campaign against a data-acquisition device that shares no code with the product (`peers/daq_box.py`)."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rig.recording.journal.campaign_log import read_log

ROOT = Path(__file__).parents[2]
SIMULATOR = (
    "--speed", "1", "--ports", "socket", "--drop-unread", "--force-format", "signed-decimal", "--displacement-format",
    "signed-decimal", "--supply", "generic-scpi", "--option", "limits.current_A=2", "--rate", "125",
)  # fmt: skip
DEVICES = """
[ecu]
url = "modbus-tcp://127.0.0.1:{port}"
supply = "{root}/examples/labjack-output.toml"
poll = "50 ms"
timeout = "200 ms"
stale_after = "600 ms"
[load_cell]
url = "modbus-tcp://127.0.0.1:{port}"
format = "labjack-t"
rate = "50 Hz"
stale_after = "600 ms"
range = "10 kN"
calibration = {{ sensitivity = 2000.0, serial_number = "LC-1" }}
[lvdt]
url = "modbus-tcp://127.0.0.1:{port}"
format = {{ base = "labjack-t", address = 2 }}
rate = "50 Hz"
stale_after = "600 ms"
range = "100 mm"
calibration = {{ sensitivity = 0.01, serial_number = "LVDT-1" }}
"""


@pytest.mark.nightly
@pytest.mark.wire
def test_force_travel_and_current_come_from_one_foreign_device(tmp_path: Path) -> None:
    simulated = subprocess.Popen([sys.executable, "-m", "simulators", *SIMULATOR], stdout=subprocess.PIPE, text=True)
    assert simulated.stdout is not None
    processes = [simulated]
    try:
        text = Path(simulated.stdout.readline().strip()).read_text(encoding="utf-8")
        ports = [re.search(rf"\[{table}\]\nurl = \".*:(\d+)\"", text) for table in ("load_cell", "lvdt", "ecu")]
        box = subprocess.Popen(
            [sys.executable, str(ROOT / "tests/peers/daq_box.py"), *(port[1] for port in ports if port)],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        processes.append(box)
        assert box.stdout is not None
        own = DEVICES.format(port=box.stdout.readline().strip(), root=ROOT)
        kept = re.sub(r"\[(?:ecu|load_cell|lvdt)(?:\.calibration)?\][^\[]*|shared = .*\n", "", text)
        (tmp_path / "bench.toml").write_text(kept + own, encoding="utf-8")
        matrix = (ROOT / "examples/quick.toml").read_text(encoding="utf-8")
        slow = re.sub(r"frequency = .*", 'frequency = ["0.5 Hz"]', matrix)
        (tmp_path / "slow.toml").write_text(slow, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, "-m", "rig.cli.main", "run", str(tmp_path / "slow.toml"), "--bench",
             str(tmp_path / "bench.toml"), "--no-identify", "--json", "--out", str(tmp_path)],
            capture_output=True, text=True, check=False, timeout=300.0,
        )  # fmt: skip
    finally:
        for process in reversed(processes):
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=20.0)  # closes its pipe, too
    answer = json.loads(done.stdout)
    assert done.returncode in {0, 5}, done.stderr  # 5: a sample was late on a busy machine
    assert answer["rig_state"] == "safe"
    assert [point["current_A"] for point in answer["points"]] == [0.5, 1.5]
    # A reading that a busy host requests too late is lost, on both channels; the station reports how late it was.
    journal = read_log(Path(answer["campaign"]))
    late_s = max((line["total_s"] for line in journal if line.get("what") == "late"), default=0.0)
    lost = sum(point["lost_samples"] for point in answer["points"])
    assert lost < 0.05 * 50.0 * 28.0 + 2.0 * 50.0 * late_s
