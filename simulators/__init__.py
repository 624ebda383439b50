"""The simulated rig: the plant, and the devices that serve it on real wires.

What lives here: physics (no sockets), device logic (no transports), and the transports that join them. What may not:
anything of `rig` but the damper models and the recording layout.
"""
