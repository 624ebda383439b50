"""Faults as data: the rows of the fault matrix, the station's reactions, the kinds of stop.

Nothing here detects, injects or acts. A fault is one `FaultRow` in one of the `*_rows` files; `matrix` combines them.
To add one: a row here, a detector in the station that reports its code, an injector in the simulators.
"""
