"""The running campaign: the loop that turns reports of the rig into events and executes the sequencer's actions.

`runner` is the entry point. The room contains the observer of the ring, the requests to the station, the recording of
points and their monitoring. The sequencer decides what comes next.
"""
