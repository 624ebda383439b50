"""The bench file: the devices of a rig, their addresses, their calibration, and the limits of the machine.

`settings` and `sensor_settings` declare its entries as frozen values, which the station uses unchanged; `model` is the
whole file. No device is opened here.
"""
