"""Files that other programs wrote, read without trust: which columns they have, in what unit, on which time.

`formats` opens any of them, `csv_dialect` guesses how a CSV file is written, `columns` finds the wanted ones and their
units. What the numbers mean for a damper test is for `rig.recording.importing`.
"""
