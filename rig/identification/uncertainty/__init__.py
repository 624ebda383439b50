"""What is known of a fit: residuals, intervals, inseparable parameters, scores, and the fit as a value.

Works on measurements and a solution. What may not live here: solving (`models`), recorded points, files but `fit.json`.
"""
