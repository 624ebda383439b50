"""What a test leaves behind: journal while it runs, one HDF5 file a point afterwards, and how to read both again.

Here live the layout, the recorder, clock alignment, the verdict, recovery and import of foreign tests.
Nothing here talks to a device or decides what runs next; damper models and fits belong to higher rooms.
"""
