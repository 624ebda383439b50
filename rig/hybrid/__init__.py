"""Hybrid tests: a structure that is computed, with a specimen that is moved, step by step.

Here live the test itself (`hybrid_motion`: pure numbers without numpy, since it runs in the station), its forecast and
assessment, and the benchmark problem of Silva et al. 2020 in process. Numbers in, numbers out; no device, station or
campaign is known here.
"""
