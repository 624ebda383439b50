"""The campaign's order of things, pure: state and event in, state and actions out.

`step` is the door; `stopping` and `point_preparation` are parts of it, `action`, `event` and `state` its words. Tests
explore it by state and event. No clock, no file, no device and no thread may live here.
"""
