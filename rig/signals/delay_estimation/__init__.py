"""By how much one signal lags another, and what that says of the delays behind it.

A sensor is laid over the controller's record of the same quantity, sample by sample or all cycles together; the model
of the five delays weighs what was declared against what the signals show. No file and no channel number is known here.
"""
