"""Diagnosis: what explains the misfit of a fit, and data that no damper gives.

`plausibility` looks at sizes and signs; `stretches` are the samples that are looked at; `distortions` are what may have
happened to them, each fitted together with the damper by `descent`; `groups` looks for two dampers; `ranking` puts the
causes in order. Changes no fit.
"""
