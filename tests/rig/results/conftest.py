from __future__ import annotations

import json
import os
import pwd
import shutil
import socket
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.layout import AlignedChannel, PointFile
from rig.results import filling, run_index

RATE_HZ, CYCLES = 250.0, 4
Make = Callable[..., Path]


def make_run(
    folder: Path, name: str, *, specimen: str = "MR-1", started: str = "2026-11-27T10:00:00+00:00",
    damping_N_s_m: float = 1000.0, current_A: float = 0.5, points: int = 1, verdict: str = "valid",
    station: str = "bench 1", percent: float | None = None, **description: object,
) -> Path:
    """A run of sines of 20 mm and 1 Hz on a damper F = c v - 50 N, whose characteristics are known on paper."""
    run = folder / name
    (run / "points").mkdir(parents=True)
    (run / "campaign.json").write_text(json.dumps({
        "id": name, "specimen": specimen, "started_utc": started, "bench": station, "matrix_file": "sine.toml",
        "software": "mr-damper-rig 1.0.0", "points": [f"p{k:03d}" for k in range(1, points + 1)], "simulated": None,
        **description,
    }))  # fmt: skip
    time_s = np.arange(round((CYCLES + 0.4) * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * np.clip(time_s - 0.2, 0.0, CYCLES)
    u_m = 0.02 * np.sin(phase)
    v_m_s = 0.02 * 2 * np.pi * np.cos(phase) * ((phase > 0) & (phase < 2 * np.pi * CYCLES))
    stated = {} if percent is None else {f"{of}_uncertainty_percent": percent for of in ("force", "displacement")}
    calibration = {"serial_number": "LC-1", "certificate": "C-7", "due": "2027-01-01", "sensitivity": 1.0}
    for k in range(1, points + 1):
        write_file(run / "points" / f"p{k:03d}.h5", PointFile(
            time_s, RATE_HZ,
            [AlignedChannel("displacement", u_m, "m", "Damper extension"),
             AlignedChannel("force", damping_N_s_m * v_m_s - 50.0, "N", "Force", "load_cell", calibration),
             AlignedChannel("current", np.full(len(u_m), current_A), "A", "Current")],
            test={"id": f"p{k:03d}", "waveform": "sine", "amplitude_m": 0.02, "frequency_Hz": 1.0, "kind": "loop",
                  "current_A": current_A, "mid_stroke_m": 0.0, "repeat": k, **stated},
            quality={"verdict": verdict, "reasons": ("estop: stopped",) if verdict == "invalid" else ()},
            provenance={"bench": station, "specimen": specimen, "started_utc": started, "campaign": name},
        ))  # fmt: skip
    return run


@pytest.fixture
def runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of runs in which files of this very moment count as settled."""
    for module in (run_index, filling):
        monkeypatch.setattr(module, "SETTLED_NS", -60_000_000_000)
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


@pytest.fixture
def made(runs: Path) -> Make:
    """Makes a run in the folder of runs."""
    return lambda name, **options: make_run(runs, name, **options)


class PostgreSQL:
    """A real server with its data in a temporary folder; without fsync, for nothing here outlives the tests."""

    PASSWORD = "a secret/with@signs"
    USER = "rig"

    def __init__(self, programs: Path, folder: Path) -> None:
        self._programs, self._folder = programs, folder
        self._owner = pwd.getpwnam("postgres").pw_name if os.getuid() == 0 else ""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        if self._owner:
            shutil.chown(folder, self._owner)
        secret = folder / "secret"
        secret.write_text(self.PASSWORD)
        secret.chmod(0o644)
        self._call("initdb", "-D", str(self.data), "-U", self.USER, "--no-sync", "--no-locale", "-E", "UTF8",
                   "--auth-local=trust", "--auth-host=scram-sha-256", f"--pwfile={secret}")  # fmt: skip
        self.start()

    @property
    def data(self) -> Path:
        return self._folder / "data"

    def address(self, database: str, password: str = "") -> str:
        return f"postgresql://{self.USER}{password and ':' + password}@127.0.0.1:{self.port}/{database}"

    def start(self) -> None:
        options = f"-p {self.port} -c listen_addresses=127.0.0.1 -k {self._folder} -c fsync=off -c max_connections=60"
        self._call("pg_ctl", "-D", str(self.data), "-w", "-s", "-o", options, "-l", str(self._folder / "log"), "start")

    def stop(self, mode: str = "fast") -> None:
        self._call("pg_ctl", "-D", str(self.data), "-w", "-s", "-m", mode, "stop")

    def sql(self, command: str, database: str = "postgres") -> str:
        options = ("-h", str(self._folder), "-p", str(self.port), "-U", self.USER, "-d", database, "-A", "-t", "-c")
        return self._call("psql", "-q", *options, command)

    def database(self, name: str) -> None:
        self.sql(f"CREATE DATABASE {name}")

    def _call(self, program: str, *arguments: str) -> str:
        found = self._programs / program
        command = [str(found if found.exists() else shutil.which(program)), *arguments]
        identity = {"user": self._owner, "group": self._owner, "extra_groups": []} if self._owner else {}
        done = subprocess.run(command, cwd=self._folder, text=True, timeout=60, stdin=subprocess.DEVNULL,
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False, **identity)  # fmt: skip
        assert done.returncode == 0, done.stdout
        return done.stdout.strip()


def programs() -> Path | None:
    """Folder of the server's programs; None where PostgreSQL is not installed."""
    places = [Path(found).resolve().parent for found in (shutil.which("initdb"),) if found is not None]
    places += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return next((place for place in places if (place / "initdb").exists()), None)


@pytest.fixture(scope="session")
def postgresql() -> Iterator[PostgreSQL]:
    """A running PostgreSQL server; the test is skipped where it is not installed."""
    pytest.importorskip("psycopg", reason="psycopg is not installed: pip install 'mr-damper-rig[results]'")
    installed = programs()
    if installed is None:
        if os.environ.get("CI"):
            pytest.fail("PostgreSQL is not installed: apt-get install postgresql")
        pytest.skip("PostgreSQL is not installed")
    folder = Path(tempfile.mkdtemp(prefix="pg-", dir="/tmp"))  # short: the path of a socket has at most 107 characters
    try:
        server = PostgreSQL(installed, folder)
        yield server
        server.stop("immediate")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def server(postgresql: PostgreSQL, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> str:
    """Address of an empty database, without password; the password is in the environment."""
    name = f"t{abs(hash(request.node.nodeid)) % 10**9}"
    postgresql.database(name)
    monkeypatch.setenv("PGPASSWORD", PostgreSQL.PASSWORD)
    return postgresql.address(name)
