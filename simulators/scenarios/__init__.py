"""One seed, one world: application, station, finaliser and devices in one process and in virtual time.

The production code runs unchanged; what it takes from the machine (clock, threads, sockets, pipes, processes, disk,
signals, chance) is taken from a world instead (`machine`), which draws everything from one seed. The one room that may
import both sides of the wires.
"""
