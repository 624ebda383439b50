"""Statistics of the test process over many campaigns: control charts, gauge studies, capability, the golden damper.

The statistics are functions of arrays; only `series` knows the rows of the results database.
"""
