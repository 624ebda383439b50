"""Fitting damper models to recorded runs: problems, methods, uncertainty, selection, and the fit as a value.

Reads runs through `rig.recording`; writes nothing but `fit.json`. The published optimisers live in `algorithms`.
"""
