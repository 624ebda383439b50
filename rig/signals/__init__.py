"""Signals as values: numpy arrays in, numbers out.

Array types, interpolation, derivatives, spectra, waveforms, cycles, loop shape, clock models, delays
(`delay_estimation`) and the grouping of tests by current and motion (`test_set`) live here. No file, no campaign, no
device and no damper is known here; what a finding means for a recorded point is decided in `rig.recording.quality`.
"""
