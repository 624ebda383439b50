"""The running campaign: the loop that turns what the rig reports into events and carries out the sequencer's actions.

`runner` is the door. Here live its observer of the ring, its requests to the station, the recording of points and what
it watches while they run. What comes next is not decided here: that is the sequencer's.
"""
