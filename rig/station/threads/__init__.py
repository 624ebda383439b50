"""The threads, one per device, and the set of them: they read, check by `interlocks`, and fill the ring.

Only these talk to drivers. They report findings to the supervisor and execute its commands; they decide nothing.
"""
