"""Quality of a recorded point: evidence in its samples, limits, reasons, and the verdict.

`PointQuality` is the quality section of a file, field by field. Instruments are compared with each other, by one point
and by all points of a campaign combined. Nothing here writes a file or talks to a device.
"""
