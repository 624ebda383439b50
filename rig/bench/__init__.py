"""The bench file: which devices there are, how to reach them, their calibration, and the limits of the machine.

`settings` and `sensor_settings` declare its entries as frozen values, which the station uses as they are; `model` is
the whole file. Reading TOML with line numbers and clear messages (`toml_source`, `places`, `problems`, `unread`,
`section`, `quantity`) lives here too, because every file of the user's is read the same way. No device is opened here.
"""
