"""Data written while a campaign runs: the running point's journal, and the campaign's own.

The recorder copies samples from the station's ring; locks define which process uses which file. Nothing is evaluated or
converted here.
"""
