"""The controller: plans a matrix, proves it safe, runs it, records it, identifies models from it.

For scripts and notebooks, `rig.identify`, `rig.load`, `rig.load_fit` and what `dir(rig)` lists; a name is loaded when
it is first used. Its types are in `__init__.pyi`.

Rooms, lowest first: dampers, bench, matrix, recording, station, campaign, identification, study, report, cli.
Imports run downwards only; the simulated rig is never imported, it is started as a process.
"""

from importlib import import_module as _import_module

__version__ = "1.0.0"

_HOMES = {
    "Fit": ("rig.identification.uncertainty.fit", "Fit"),
    "FitOptions": ("rig.identification.options", "FitOptions"),
    "RecordedPoint": ("rig.recording.recorded_point", "RecordedPoint"),
    "RigError": ("rig.errors", "RigError"),
    "Run": ("rig.recording.run", "Run"),
    "characterise": ("rig.characteristics", "characterise"),
    "compare": ("rig.comparison", "compare"),
    "identify": ("rig.identification.runs", "identify"),
    "load": ("rig.recording.loading", "load"),
    "load_fit": ("rig.identification.uncertainty.fit", "load_fit"),
    "write_report": ("rig.report", "write_report"),
}
"""Name -> module and attribute; as texts, because the rooms below import this package."""


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it offers {', '.join(_HOMES)}")
    module, attribute = _HOMES[name]
    value = getattr(_import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(["__version__", *_HOMES])
