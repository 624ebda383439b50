"""One device each: the driver owns its port, its time-outs and its retries, and every reading has its age.

What lives here: actuator, ECU, load cell, LVDT, the serial port they share, the slcan bus, and the ring that carries
their samples to other processes. What may not: numpy, test matrices, limits, decisions about safety.
"""
