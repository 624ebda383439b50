"""The test matrix: from a user's file to ordered `TestPoint`s, and the plan that judges them before anything moves.

`waveform` and `point` are the values everyone shares, `sections` and `model` the file, `plan` and `feasibility` the
verdicts, `order_by_heat` the order that keeps the damper in its temperature window. No I/O but reading the file;
nothing here knows a device.
"""
