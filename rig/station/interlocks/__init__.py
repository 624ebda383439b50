"""Pure detectors: samples, statuses and counters in, findings out. No clock, no I/O, no thread, no decision to stop.

Every finding carries the code of a row of `rig.faults`; the supervisor decides the reaction.
"""
