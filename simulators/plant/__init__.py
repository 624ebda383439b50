"""The physics of the simulated rig: servo-hydraulics, controller's set-point generator, damper, coil, heat.

What lives here: compiled equations of motion and the `Plant` that owns their state. What may not: sockets, wall time,
registers, frames.
"""
