"""The car around the damper: quarter, half or full car with any damper at its corners, roads, and what a ride is like.

Numbers and files of cars and roads in, responses out. Nothing here knows a rig, a recording or how a damper was fitted:
a damper is a model and its parameters, the same object as the simulated plant and the identifier use.
"""
