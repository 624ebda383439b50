"""The `rig` command: arguments in, a function of a room called, text or one JSON object out.

Nothing is computed here and no device is used. Each command is a separate module, loaded when it is called, so that
`rig --help` loads click only.
"""
