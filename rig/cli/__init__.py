"""The `rig` command: arguments in, a room's function called, text or one JSON object out.

Nothing is computed here and no device is touched. Each command is a module of its own, loaded when it is called, so
that `rig --help` loads nothing but click.
"""
