"""What is fitted: measurements, the problem as a function of a vector, and how each kind of model is solved for.

Knows damper models and measurements. What may not live here: recorded points and files (`points`), intervals and
verdicts (`uncertainty`). Importing the room loads nothing.
"""
