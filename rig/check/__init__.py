"""What a bench's devices show, one by one, before a campaign relies on them: `rig check`.

May not know ports, wire formats or points; the station owns the devices, and moves them only for the proof.
"""
