"""Pure detectors: samples, statuses and counters in, findings out. No clock, no I/O, no thread, no decision to stop.

Every finding carries the slug of a row of `rig.faults`; what follows from it is the supervisor's.
"""
