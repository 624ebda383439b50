"""What every slug means, what was done and what to look at: texts for the engineer at the rig, as data.

One TOML file a topic; `explanation.py` reads them. May not know who shows them, nor decide anything.
"""
