"""From records as received to channels on one time base.

This room knows which channel belongs to which clock; the computation of clocks and delays is in `rig.signals`. Nothing
is evaluated and no file is written here.
"""
