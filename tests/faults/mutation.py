"""Switches each row's detector off and expects the row's test to fail: `python3 dev.py faults --mutate [SLUG...]`.

A detector is switched off in a copy of the four packages, which the test loads instead of the real ones; as many
tests run at a time as there are processors. Most detectors are one slug that the station reports; the others are a
changed line. A mutation that no longer applies, or that its test survives, fails the check.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from edits import ROOT, Edit, NoLongerThere, deaf_station, edited

from rig.faults.matrix import MATRIX, REACTIONS

PACKAGES = ("rig", "drivers", "protocols", "simulators")
TIMEOUT_S = 150.0
FAILED = 1
"""Exit code of pytest when tests ran and some failed."""


BLIND_RECORDER = (
    Edit(
        "rig/campaign/execution/runner.py",
        "if executor.recording.recorder is not None and not executor.recording.recorder.healthy:",
        "if False and executor.recording.recorder is not None and not executor.recording.recorder.healthy:",
    ),
    Edit("rig/campaign/execution/runner.py", "recorder is None or recorder.healthy", "True"),
    Edit(
        "rig/campaign/execution/runner.py",
        "failed.append(ev.ActionFailed(action, self.state.phase, cause_of(error)))",
        "pass",
    ),
)
"""Nobody hears that the recorder can no longer write, nor that a recording could not be begun or ended."""

HALVES = {
    "overcurrent": "test_coil_and_bus.py::test_more_current_than_the_bench_allows_stops_the_rig",
    "can-lost": "test_coil_and_bus.py::test_an_adapter_that_is_gone_is_named_and_the_ecu_goes_to_zero_by_itself",
    "auxiliary-pulled": "test_sensors.py::test_a_pulled_auxiliary_sensor_stops_the_rig_in_its_own_name",
}
"""Slugs of the station that share a row of the matrix with another one, and the tests that prove them."""

DEAF_PREFLIGHT = (
    Edit("rig/campaign/sequencer/step.py", "_arm(state) if event.cause is None else", "_arm(state) if True else"),
)

MUTATIONS: dict[str, tuple[Edit, ...]] = {
    "watchdog-absent": (
        Edit("rig/station/preparation.py", "if tripped is None:\n", "if tripped is None and False:\n"),
        Edit("rig/station/preparation.py", "(tripped.received_ns - begin_ns) / 1e9", "0.0"),
    ),
    "register-layout": (
        Edit("drivers/modbus_actuator.py", "        if wrong:\n", "        if False:\n"),
    ),
    "load-train": (
        Edit(
            "rig/campaign/execution/runner.py",
            "if changed is not None and self.state.phase",
            "if False and self.state.phase",
        ),
    ),
    "not-tared": DEAF_PREFLIGHT,
    "sensors-swapped": DEAF_PREFLIGHT,
    "current-stuck": (
        deaf_station("current-stuck"),
        Edit("rig/station/safe_stop.py", "(stop, (StopAction.CURRENT_STUCK,)) if first", "(stop, ()) if first"),
    ),
    "supply-not-zero": (
        Edit("rig/campaign/preflight/rest_check.py", "not zero_A.beyond(0.0, limits.current_zero_A, SURE)", "True"),
        Edit(
            "rig/station/preparation.py",
            "if current_A is None or abs(current_A) >= ZERO_CURRENT_A:\n            slug =",
            "if False:\n            slug =",
        ),
    ),
    "stop-ignored": (
        deaf_station("stop-ignored"),
        Edit("rig/station/safe_stop.py", "    if _late(stop, inputs):\n", "    if False:\n"),
    ),
    "sigint": (Edit("rig/campaign/operator_link.py", "self.caught.append(number)", "pass"),),
    "sigint-storm": (
        Edit(
            "rig/campaign/operator_link.py",
            "self.caught.append(number)",
            "if number in self.caught_once:\n            raise KeyboardInterrupt\n"
            "        self.caught_once.add(number)\n        self.caught.append(number)",
        ),
        Edit(
            "rig/campaign/operator_link.py",
            "    paused: bool = False\n",
            "    paused: bool = False\n    caught_once: set[int] = field(default_factory=set)\n",
        ),
    ),
    "sigterm": (Edit("rig/campaign/operator_link.py", "for number in (*STOPS, *PAUSES):", "for number in PAUSES:"),),
    "sigkill": (deaf_station("sigkill"),),
    "clock-step": (Edit("rig/clock.py", "if abs(stepped_s) < STEP_S:", "if True or abs(stepped_s) < STEP_S:"),),
    "disk-full": BLIND_RECORDER,
    "fsync-error": BLIND_RECORDER,
    "dir-readonly": (Edit("rig/campaign/setup.py", 'inner_folder(folder, CampaignFolder.points)', "pass"),),
    "two-instances": (
        Edit("rig/campaign/machine_resources.py", "fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)", "pass"),
        Edit("rig/station/preparation.py", 'if error.slug != "second-master":', "if True:"),
    ),
    "config-absurd": (
        Edit("rig/units.py", "if unit.dimension != dimension:", "if False:"),
        Edit("rig/files/quantity.py", "if self.high is not None and result", "if False and result"),
    ),
    "matrix-infeasible": (Edit("rig/campaign/setup.py", "    if refused:\n", "    if False:\n"),),
    "matrix-changed": (
        Edit(
            "rig/campaign/resume.py",
            'if hashes.get("matrix") not in {matrix.digest, *matrix.earlier_digests}:',
            "if False:",
        ),
    ),
    "wrong-damper": (
        Edit(
            "rig/campaign/preflight/proof_move.py",
            "if expected is not None and now.peak_N >",
            "if False and expected is not None and now.peak_N >",
        ),
    ),
}
"""Detectors that are not one slug of the station's fault table."""


def mutations_of(slug: str) -> tuple[Edit, ...]:
    """How this row's detector is switched off; empty when nobody has said."""
    if slug in MUTATIONS:
        return MUTATIONS[slug]
    return (deaf_station(slug),) if slug in REACTIONS else ()


def all_mutations() -> dict[str, tuple[Edit, ...]]:
    """By slug, of every row that has a test, of the halves, and what else is named here."""
    tested = [slug for slug, row in MATRIX.items() if row.tested]
    return {slug: mutations_of(slug) for slug in dict.fromkeys((*tested, *HALVES, *MUTATIONS))}


def test_of(slug: str) -> str:
    """File and function of the test that proves a row or the other half of one."""
    return HALVES.get(slug) or MATRIX[slug].test


def mutated_copy(edits: tuple[Edit, ...], folder: Path) -> None:
    """Copy the packages to `folder` and change them.

    Raises:
        NoLongerThere: a line to be changed is not there exactly once.
    """
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package)  # compiled files too: they know their sources by the time
    for file in dict.fromkeys(edit.file for edit in edits):
        (folder / file).write_text(edited(file, edits)[1], encoding="utf-8")


def survives(slug: str) -> str:
    """What is wrong with the row's test, empty when it fails without the detector as it should."""
    edits = mutations_of(slug)
    if not edits:
        return "no mutation is known for its detector"
    with tempfile.TemporaryDirectory(prefix="mutated-") as name:
        folder = Path(name)
        try:
            mutated_copy(edits, folder)
        except NoLongerThere as error:
            return f"the mutation no longer applies: {error}"
        command = [
            # -P: not the folder it is started in, the copy is what the test itself loads too.
            sys.executable, "-P", "-m", "pytest", f"tests/faults/{test_of(slug)}", "-q", "-x", "-p", "no:cacheprovider",
            f"--timeout={TIMEOUT_S:g}",
        ]  # fmt: skip
        try:
            done = subprocess.run(
                command, cwd=ROOT, env=os.environ | {"PYTHONPATH": name}, capture_output=True, text=True,
                timeout=2 * TIMEOUT_S, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "its test did not end"
    if done.returncode == FAILED:
        return ""
    return "its test passes without its detector" if done.returncode == 0 else f"pytest ended with {done.returncode}"


def main() -> int:
    """Check the named rows, or all that have a test."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    tested = [*(slug for slug, row in MATRIX.items() if row.tested), *HALVES]
    parser.add_argument("slugs", nargs="*", metavar="SLUG")
    slugs = parser.parse_args().slugs or tested
    if unknown := set(slugs) - set(tested):
        parser.error(f"no such row: {', '.join(sorted(unknown))}; there are {', '.join(tested)}")
    begin_s, wrong = time.monotonic(), 0
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        checks = {pool.submit(survives, slug): slug for slug in slugs}
        for check in as_completed(checks):
            problem = check.result()
            wrong += bool(problem)
            sys.stdout.write(f"{checks[check]:20} {problem or 'killed'}\n")
            sys.stdout.flush()
    sys.stdout.write(f"{len(slugs) - wrong} of {len(slugs)} mutants killed, {time.monotonic() - begin_s:.0f} s\n")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
