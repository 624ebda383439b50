"""What is done with a fitted model: its force, the current for a wanted force, its equation, its loops.

Knows parameters, not how they were found: a `Fit` hands itself over as a `law.Law` and a `tested_range.TestedRange`.
Every result is a pandas table and says in itself where it lies beyond what the tests covered. Nothing is fitted or
judged here.
"""
