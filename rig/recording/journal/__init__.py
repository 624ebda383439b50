"""Everything that is written while a campaign runs: the running point's journal, and the campaign's own.

The recorder takes samples from the station's ring; locks say who works on what. Nothing is judged or converted here.
"""
