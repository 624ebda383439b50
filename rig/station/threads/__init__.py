"""The threads that own a device each, and the set of them: they read, judge by `interlocks`, and fill the ring.

Only these talk to drivers. They report findings to the supervisor and carry out what it orders; they decide nothing.
"""
