"""The test matrix: from a user's file to ordered `TestPoint`s, and the plan that checks them before any motion.

`point` is the shared value; `sections`, `signal_tables`, `hybrid_table` and `model` are the file; `plan` and
`feasibility` the checks; `order_by_heat` the order that keeps the damper in its temperature window. The only I/O is
reading the file and the files that it names; devices are unknown here.
"""
