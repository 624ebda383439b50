"""How a study was made, how to make it again, and how to cite it."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import sys
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rig import __version__

SOFTWARE = f"mr-damper-rig {__version__}"
LIBRARIES = ("numpy", "scipy", "numba")
CITE_SOFTWARE = (
    "mr-damper-rig: a hardware-in-the-loop test-rig controller for magneto-rheological dampers, by the mr-damper-rig "
    f"authors, version {__version__}, MIT licence (CITATION.cff)"
)
CITE_PAPERS = (
    "Paper 1, the c-FOA paper: S. Kanarachos, D. Savitski, N. Lagaros, M. E. Fitzpatrick, Automotive "
    "magneto-rheological dampers: modelling and parameter identification using contrast-based fruit fly optimisation, "
    "Soft Computing 22 (24), 2018",
    "Paper 2, the novel-GA paper: novel genetic algorithm for the Bouc-Wen model of magneto-rheological fluid dampers, "
    "Advances in Mechanical Engineering, 2020, doi 10.1177/1687814020950546",
)
METHODS = {
    "c_foa": "as intended by paper 1: the signs of the first swarm are drawn at random, and decisions are made every "
             "kappa generations; `c-FOA as printed` follows its Fig. 6 exactly",
    "foa": "Pan 2012",
    "ga": "MATLAB's ga as described in paper 1, with Gaussian mutation; the variant `feasible directions` uses the "
          "mutation that better matches the paper's description",
    "de": "Price, Storn, Lampinen 2005, rand/1 with dither (Storn's deopt)",
    "pso": "MATLAB's particleswarm, equations (20) to (22) of paper 1",
    "i_abc": "Li, Niu, Xiao 2012, reconstructed, because paper 1 only names the method and gives one constant",
    "ga_standard": "as described in paper 2 for its comparison",
    "ga_kwok": "Kwok et al. 2007, as described in paper 2",
    "ga_novel": "paper 2",
    "hybrid": "c-FOA, then local least squares, as announced in paper 1",
    "zhu_three_step": "Zhu et al., reconstructed from the summary in paper 2",
}  # fmt: skip
"""What each method follows; its equations are in the docstring of its file under `rig/optimisers`."""


def provenance(
    file: Path, folder: Path, seed: int, fingerprint: str, lines: Iterable[Mapping[str, Any]]
) -> dict[str, Any]:
    """When, where, with which versions and how often; JSON values.

    Args:
        file: Study file, as the user named it.
        folder: Of the results, as the user named it.
        seed: Of every draw.
        fingerprint: Of the study and its recordings.
        lines: Results, with `software` and `seconds` where they are known.

    Raises:
        OSError: The file cannot be read.
    """
    made = [line for line in lines if "seconds" in line]
    return {
        "written_utc": datetime.now(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "software": SOFTWARE,
        "searched_with": sorted({str(line.get("software", "not recorded")) for line in made}),
        "python": platform.python_version(),
        "libraries": {name: version for name in LIBRARIES if (version := _version(name))},
        "machine": f"{platform.system()} {platform.machine()}, {_processor()}, {os.cpu_count()} processors",
        "searched_s": round(sum(float(line["seconds"]) for line in made), 1),
        "seed": seed,
        "fingerprint": fingerprint,
        "command": f"rig study {file} --out {folder}",
        "file": file.read_text(encoding="utf-8"),
    }


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _processor() -> str:
    """The processor's name where the system tells it."""
    place = Path("/proc/cpuinfo")
    if sys.platform == "linux" and place.is_file():
        for line in place.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "processor unknown"
