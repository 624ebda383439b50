"""The simulated rig: the plant, and the devices that serve it on real wires.

What lives here: physics (`plant`, no sockets), device logic (no transports), and the transports that join them. What
may not: anything of `rig` but damper models, recording layout, clock, errors and faults. Only `world` (everything in
one process and in virtual time) and `testing` (the pytest plug-in) know both sides.
"""
