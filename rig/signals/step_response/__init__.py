"""Response time of a quantity to a step, from repeated records: dead time, lags, and the times to 63, 90 and 95 %.

Each record is the quantity around one step, on a time axis with the step at 0. Before the step and long after it the
quantity may drift linearly (a spring at constant velocity). Two estimates are made of the same records: a fit of one or
two lags with dead time (`lag_fit`), and the crossings of the levels without a model (`crossings`). No file and no
channel is known here.
"""
