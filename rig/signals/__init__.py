"""Signals as values: numpy arrays in, numbers out.

Array types, interpolation, derivatives, spectra, cycles, loop shape, clock models and delays live here. No file, no
campaign, no device and no damper is known here; what a finding means for a recorded point is decided in
`rig.recording.quality`.
"""
