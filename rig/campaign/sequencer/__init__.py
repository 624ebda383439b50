"""The sequence of a campaign as a pure state machine: state and event in, state and actions out.

`step` is the entry point; `stopping` and `point_preparation` are parts of it; `action`, `event` and `state` define its
values. Tests explore it by state and event. No clock, file, device or thread belongs here.
"""
