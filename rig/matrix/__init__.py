"""The test matrix: from a user's file to ordered `TestPoint`s, and the plan that judges them before anything moves.

`point` is the value that everyone shares, `sections`, `signal_tables`, `hybrid_table` and `model` the file, `plan` and
`feasibility` the verdicts, `order_by_heat` the order that keeps the damper in its temperature window. No I/O but
reading the file and those that it names; nothing here knows a device.
"""
