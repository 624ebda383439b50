"""From recorded points to measurements: kept cycles, motion, coil lag from current steps, and tests that contradict.

Reads `rig.recording`. What may not live here: a damper model's fit, a verdict on it.
"""
