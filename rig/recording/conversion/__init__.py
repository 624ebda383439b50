"""Conversion of journals to files: in a separate process, verified against the journal, and repeated after a crash.

Nothing here decides what is valid (`rig.recording.quality`) or how a file is laid out (`rig.recording.hdf5`).
"""
