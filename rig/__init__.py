"""The controller: plans a matrix, proves it safe, runs it, records it, identifies models from it.

Rooms, lowest first: dampers, bench, matrix, recording, station, campaign, identification, study, report, cli.
Imports run downwards only; the simulated rig is never imported, it is started as a process.
"""

__version__ = "1.0.0"
