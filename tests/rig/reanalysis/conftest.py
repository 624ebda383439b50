"""Shared by the tests of reanalysis: a campaign of a rig whose sensors lag, as an earlier version recorded it."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.ring import Channel
from rig.identification import identify_run
from rig.recording.conversion.conversion import build
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import PointFile, SensorContext
from rig.report import write_report

RECORDING = Path(__file__).parents[1] / "recording" / "synthetic_rig.py"
specification = importlib.util.spec_from_file_location("synthetic_rig_of_recording", RECORDING)
assert specification is not None
assert specification.loader is not None
synthetic_rig = importlib.util.module_from_spec(specification)
sys.modules["synthetic_rig_of_recording"] = synthetic_rig
specification.loader.exec_module(synthetic_rig)
LAG_S = 2e-3
NAME = "20250102T030405Z-MR-001-ab12cd"


def point_file(number: int) -> PointFile:
    """A point whose force lags by 2 ms behind what the bench file declares; alone it knows this, or it does not."""
    rig = synthetic_rig.SyntheticRig(
        frequency_Hz=2.0, cycles=8, amplitude_m=(0.03, 0.003, 0.0028)[number - 1], seed=number, noise_N=5.0,
        current_A=0.5,
    )
    records = synthetic_rig.with_controller_record(rig, LAG_S)
    polls = [channel in (Channel.POSITION, Channel.CONTROLLER_FORCE) for channel in records["channel"]]
    seen, keep = 0, []
    for is_poll in polls:  # every third status: one point knows the lag to a few tenths of a millisecond
        seen += is_poll
        keep.append(not is_poll or seen % 6 < 2)
    sensors = {
        name: SensorContext(sensor, 250.0, 0.0, unit)
        for name, sensor, unit in (("force", "load_cell", 10_000.0), ("displacement", "lvdt", 0.1))
    }
    context = rig.context(controller_delay_s=0.0, sensors=sensors, provenance={"bench_hash": "one bench"})
    context = replace(context, point=replace(context.point, id=f"p{number:03}"))
    content = JournalContent("", records[keep], (), end={"stopped_by": None, "lost_records": 0})
    file, _ = build(content, context)
    return replace(file, provenance={**file.provenance, "software": "mr-damper-rig 0.9.0"})


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three points that were not yet corrected to one sensor delay, with fit and report; not to be changed."""
    folder = tmp_path_factory.mktemp("logs") / NAME
    (folder / "points").mkdir(parents=True)
    for number in range(1, 4):
        write_file(folder / "points" / f"p{number:03}.h5", point_file(number))
    description = {"id": NAME, "specimen": "MR-001", "started_utc": "2025-01-02T03:04:05+00:00",
                   "points": ["p001", "p002", "p003"], "hashes": {}}
    (folder / "campaign.json").write_text(json.dumps(description))
    (folder / "matrix.toml").write_text("format = 1\n")
    identify_run([folder], model="bingham")
    write_report(folder)
    shutil.rmtree(folder / "cache")
    return folder


@pytest.fixture
def campaign(recorded: Path, tmp_path: Path) -> Path:
    """A copy of its first two points, which a test may change."""
    copy = Path(shutil.copytree(recorded, tmp_path / "logs" / NAME))
    (copy / "points" / "p003.h5").unlink()
    return copy
