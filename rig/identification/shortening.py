"""Shorter measurements for searches: one cycle says nearly what many say."""

from __future__ import annotations

from dataclasses import replace

from rig.identification.measurement import Measurement


def first_cycle(each: Measurement) -> Measurement:
    """The first whole cycle of a measurement; the measurement itself when it has no more."""
    stop = each.samples_per_cycle
    if not 1 < stop < each.u_m.size:
        return each
    return replace(
        each,
        u_m=each.u_m[:stop],
        v_m_s=each.v_m_s[:stop],
        a_m_s2=each.a_m_s2[:stop],
        force_N=each.force_N[:stop],
        current_A=each.current_A[:stop],
        usable=None if each.usable is None else each.usable[:stop],
        commanded_A=None if each.commanded_A is None else each.commanded_A[:stop],
    )


def spaced(each: Measurement, most: int) -> Measurement:
    """Every so-many-th sample of a measurement, so that a cycle has at most about `most`."""
    every = max(1, each.samples_per_cycle // most)
    if every == 1:
        return each
    part = each.rows(slice(0, each.u_m.size, every))
    return replace(part, dt_s=each.dt_s * every, samples_per_cycle=each.samples_per_cycle // every)
