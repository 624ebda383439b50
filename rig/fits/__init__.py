"""A fit as a value, its file, and what every reader of it needs: parameters, values of the model, covariance.

`fit_record` is the value with its parts (`entries`, `relation`, `temperature_term`), `fit_file` the only module that
knows the keys of `fit.json`, `plain` turns values into JSON types and back. `rig.identification.Fit` adds the use of a
fit. Nothing is fitted or recorded here.
"""
