"""What can go wrong, as data: the rows of the fault matrix, the station's reactions, the kinds of stop.

Nothing here detects, injects or acts. A fault is one `FaultRow` in one of the `*_rows` files; `matrix` puts them
together. To add one: a row here, a detector in the station that reports its slug, an injector in the simulators.
"""
