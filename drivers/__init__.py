"""Drivers: one device each, over its real transport.

What lives here: the actuator controller, the current ECU, load cell and LVDT, the serial port and CAN bus under them,
what is known of other vendors' devices (`devices`, `register_maps`), and the ring in which the station leaves what they
read. Each driver owns its port, time-outs and bounded retries, and
gives every reading its age. What may not: numpy, test sequences, limits of the rig, anything that knows of another
device.
"""
