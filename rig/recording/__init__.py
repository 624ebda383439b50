"""The records of a test: a journal while it runs, one HDF5 file per point afterwards, and reading both.

`journal` records, `alignment` converts every sample to one time base, `quality` evaluates, `conversion` makes the
files, `hdf5` writes and checks them; `run` and `recorded_point` read them, `importing` makes the same files from tests
of other programs. Nothing here talks to a device or decides what runs next; damper models and fits belong to higher
rooms.
"""
