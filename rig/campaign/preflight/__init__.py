"""What rig and damper must show before a campaign moves them, and again at its end: samples in, a cause or none out.

At rest (`rest_check`), in a slow move and against the first session (`proof_move`), zeros at both ends
(`zero_return`). What the observer waits for is judged here as soon as it is measured. Nothing here asks the station.
"""
