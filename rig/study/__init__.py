"""The comparison study: models x methods x populations x budgets x repeats over the same recordings.

Here live the study file, the list of searches it stands for, their resumable execution, and the tables and figures of
both papers. What may not live here: an algorithm, a damper model, anything that talks to a rig.
"""
