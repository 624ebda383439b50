"""Hybrid tests: a computed structure with a physical specimen, step by step.

The room contains the test itself (`hybrid_motion`: pure numbers without numpy, because it runs in the station), its
forecast and assessment, and the benchmark problem of Silva et al. 2020 in process. Numbers in, numbers out; devices,
station and campaign are unknown here.
"""
