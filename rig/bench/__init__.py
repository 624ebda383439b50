"""The bench file: which devices there are, how to reach them, their calibration, and the limits of the machine.

`Bench` and its sections live in `model`; reading TOML with line numbers and clear messages (`toml_source`,
`problems`, `quantity`) lives here too, because the matrix file is read the same way. No device is opened here.
"""
