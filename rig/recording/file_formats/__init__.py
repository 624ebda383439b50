"""Files of other programs, read without trust: their columns, units and times.

`formats` opens any of them, `csv_dialect` guesses the format of a CSV file, `columns` finds the requested columns and
their units. The meaning for a damper test belongs to `rig.recording.importing`.
"""
