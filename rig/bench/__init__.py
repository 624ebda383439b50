"""The bench file: which devices there are, how to reach them, their calibration, and the limits of the machine.

`settings` and `sensor_settings` declare its entries as frozen values, which the station uses as they are; `model` is
the whole file. No device is opened here.
"""
