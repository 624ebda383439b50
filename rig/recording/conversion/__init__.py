"""Journals become files: in a process of its own, proved against what they were made of, and again after a crash.

Nothing here decides what is valid (`rig.recording.quality`) or how a file is laid out (`rig.recording.hdf5`).
"""
