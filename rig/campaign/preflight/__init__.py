"""Requirements on rig and damper before a campaign moves them, and again at its end: samples in, a cause or none out.

At rest (`rest_check`), in a slow move and against the first session (`proof_move`), zeros at both ends
(`zero_return`). The observer's data are evaluated here as soon as they are measured. Nothing here talks to the station.
"""
