"""From records as they were received to channels on one time base.

Which channel is tied to which clock is known here; how clocks and delays are computed is in `rig.signals`. Nothing is
judged here and no file is written.
"""
