"""Diagnosis: what explains the misfit of a fit, and data that no damper gives.

A `statement` is a slug with its words and the function that finds it: `plausibility` has those about sizes and signs,
`trials` those that are fitted together with the damper. `stretches` are the samples that are looked at; `distortions`
are what may have happened to them, fitted by `descent`; `groups` looks for two dampers; `ranking` puts the causes in
order. Changes no fit. How to add one: docs/how-to/add-a-diagnosis-statement.md.
"""
