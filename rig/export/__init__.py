"""Runs and fits in other programs' formats: one exporter a format, all in one catalogue, plug-ins among them.

`code` prints a model's equation in other languages.
Nothing is measured, judged or fitted here.
"""

from rig.export.exporter import EXPORTERS, Exporter, Source, export

__all__ = ["EXPORTERS", "Exporter", "Source", "export"]
