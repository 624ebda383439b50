"""Descriptions of devices: files of data, and what reads them. No ports, no threads.

`NAME_controller.toml` describes an actuator controller, `NAME_ecu.toml` (with its DBC) a current source; NAME is what a
bench file says. What is in such a file is what the generic drivers need to know of a device; another vendor's device is
another file here.
"""
