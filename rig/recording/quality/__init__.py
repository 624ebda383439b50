"""How good a recorded point is: what its samples show, limits, reasons, and the verdict.

`PointQuality` is what a file says of it, field by field. Instruments are judged against each other, by one point and by
all points of a campaign together. Nothing here writes a file or talks to a device.
"""
