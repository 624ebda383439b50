"""The objects that the options name, and the test files of this folder that apply to them."""

from __future__ import annotations

import pytest

from rig.conformance.peer import ACTUATOR, CURRENT_SOURCE, SENSOR, kind_of, known_drivers

FILES = {ACTUATOR: "test_actuator.py", CURRENT_SOURCE: "test_current_source.py", SENSOR: "test_sensor.py"}


def chosen_files(config: pytest.Config) -> set[str]:
    """The files to collect.

    Raises:
        UsageError: nothing was named, or it is not known.
    """
    driver, model, method = (config.getoption(name, None) for name in ("rig_driver", "rig_model", "rig_method"))
    files = set()
    if driver is not None:
        kind = kind_of(driver)
        if kind is None:
            raise pytest.UsageError(f"--driver {driver}: unknown driver; known drivers: {', '.join(known_drivers())}")
        files.add(FILES[kind])
    if model is not None:
        # loads all algorithms and numpy: only when needed
        from rig.dampers import MODELS

        if model not in MODELS:
            raise pytest.UsageError(f"--model {model}: unknown model; known models: {', '.join(MODELS)}")
        files.add("test_model.py")
    if method is not None:
        # loads all algorithms and numpy: only when needed
        from rig.optimisers import METHODS

        if method not in METHODS:
            raise pytest.UsageError(f"--method {method}: unknown method; known methods: {', '.join(METHODS)}")
        files.add("test_method.py")
    if not files:
        raise pytest.UsageError("rig.conformance: specify what to test: --driver NAME, --model NAME or --method "
            "NAME")
    return files
