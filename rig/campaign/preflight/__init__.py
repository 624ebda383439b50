"""What rig and damper must show before a campaign moves them, and again at its end: samples in, a cause or none out.

At rest (`rest_check`), in a slow move (`proof_move`), against the first session (`baseline`), zeros at both ends
(`zero_return`). Nothing here asks the station or waits.
"""
