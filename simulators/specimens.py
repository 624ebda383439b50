"""Specimens file: properties of the simulated damper by its serial number, so that different dampers can be tested.

format = 1
[[specimen]]
serial = "MR-1.3"                    # regular expression for the whole serial number
scale = { Fyb = 0.8, Ca_plus = 0.9 }  # factors on parameters of the damper model
option = ["damper.gas_force_N=120"]   # as --option
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from protocols.patterns import Pattern
from rig.errors import FileProblem
from simulators.options import RigOptions, with_option
from simulators.plant.plant import specimen_model

if TYPE_CHECKING:
    from rig.files.specimens import SpecimensFile


def as_specimen(options: RigOptions, path: Path) -> RigOptions:
    """The rig with the damper that the file describes for its specimen's serial number; unchanged if it has none.

    Raises:
        FileProblem: the file cannot be used, or a parameter or an option is unknown.
    """
    file = _read(path)
    for number, entry in enumerate(file.specimen, start=1):
        if not Pattern(entry.serial).fullmatch(options.specimen.serial_number):
            continue
        for assignment in entry.option:
            options = with_option(options, assignment)
        _, values = specimen_model(options.damper)
        unknown = [name for name in entry.scale if name not in values]
        if unknown:
            known = ", ".join(values)
            raise FileProblem(
                str(path), [f"specimen[{number}].scale: unknown parameter {', '.join(unknown)}; known: {known}"]
            )
        scaled = {name: values[name] * factor for name, factor in entry.scale.items()}
        damper = dataclasses.replace(options.damper, values={**options.damper.values, **scaled})
        options = dataclasses.replace(options, damper=damper)
    return options


def _read(path: Path) -> SpecimensFile:
    """The file.

    Raises:
        FileProblem: with every wrong entry.
    """
    # loads pydantic: only when needed
    from rig.files.loader import load_section
    from rig.files.specimens import SpecimensFile

    return load_section(path, SpecimensFile)[0]
