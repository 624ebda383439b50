"""Evaluation of a bench's devices, one by one, before a campaign relies on them: `rig check`.

Ports, wire formats and points do not belong here; the station owns the devices, and moves them only for the test.
"""
