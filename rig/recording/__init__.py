"""What a test leaves behind: a journal while it runs, one HDF5 file a point afterwards, and how to read both again.

`journal` records, `alignment` puts every sample on one time base, `quality` judges, `conversion` makes the files,
`hdf5` writes and checks them; `run` and `recorded_point` read them back, `importing` makes the same files of foreign
tests.
Nothing here talks to a device or decides what runs next; damper models and fits belong to higher rooms.
"""
