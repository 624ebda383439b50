"""Hybrid tests: a structure that is computed, with a specimen that is moved, step by step.

Here lives the benchmark problem of Silva et al. 2020 in process: the building, its partition, the transfer system,
compensators for its delay, the criteria. Numbers in, numbers out; no device, station or campaign is known here.
"""
