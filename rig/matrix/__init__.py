"""The test matrix: from a user's file to ordered `TestPoint`s, and the plan that judges them before anything moves.

`point` holds the value everyone shares (no dependencies), `model` the file, `plan` the verdicts. No I/O but reading
the file; nothing here knows a device.
"""
