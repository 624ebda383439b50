"""What this lab adds to the rig: one module for each thing."""
