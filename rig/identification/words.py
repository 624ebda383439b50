"""Words: every sentence with which identification tells people what it did not find, or doubts.

A `Saying` carries its slug and numbers; code decides by those. Its text is made here and nowhere else, so that it can
be changed without changing what is done. Errors of wrong use (an unknown name, an option that does not fit) stand where
they are raised.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence


class Saying(str):
    """A sentence for people: plain text that knows what it says.

    Attributes:
        slug: key of `SENTENCES`.
        numbers: what the sentence was made from, by name.
    """

    __slots__ = ("numbers", "slug")
    slug: str
    numbers: Mapping[str, object]

    def __reduce__(self) -> tuple[object, ...]:
        return _said, (self.slug, dict(self.numbers))


def say(slug: str, **numbers: object) -> Saying:
    """The sentence of a slug, from its numbers.

    Raises:
        KeyError: no such slug, or one of its numbers is missing.
    """
    return _said(slug, numbers)


def _said(slug: str, numbers: Mapping[str, object]) -> Saying:
    saying = Saying(SENTENCES[slug].format(**numbers))
    saying.slug, saying.numbers = slug, numbers
    return saying


def some(texts: Sequence[str], separator: str = ", ") -> str:
    """The first three of a list, and how many more there are."""
    return separator.join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


PARAMETERS = {
    "no-knee": (
        "{name} not identifiable: on its side of standstill one straight line fits as well, so {knee} lies beyond the "
        "tested speeds, or there is none; test faster and slower"
    ),
    "no-current-step": "eta not identifiable: every test held its current constant; add a current step",
    "redundant": (
        "{name} not identifiable on its own: {by} only scales {scaled}; the values given are for {by} = {value:g} "
        "(normalized_bouc_wen has no such freedom)"
    ),
    "few-currents": "{name} not identifiable: it needs tests at {needed} different currents, and there are {levels}",
    "lower-power": (
        "{name} is known only together with {left_out}, which the tests' currents do not tell: the value given is for "
        "0 there; add tests at other currents"
    ),
    "no-current": "{name} not identifiable: every test ran without current; add tests at another current",
    "one-current": "{name} not separable from {base}: every test ran at {mean_A:.2f} A; add tests at another current",
    "sum-at-one-current": (
        "only {base} + {name} I is known, at I = {mean_A:.2f} A, where every test ran; the value given is that sum"
    ),
    "one-frequency": (
        "m is not separately identifiable from {stiffness}: every test ran at one frequency, where inertia and "
        "stiffness are proportional; add another frequency"
    ),
    "harmonics-only": (
        "m is not separately identifiable from {stiffness}: every test ran at one frequency, where inertia and "
        "stiffness are proportional; add another frequency (only harmonics separate them here; m stays in the fit, so "
        "that {stiffness} is right)"
    ),
    "difference-at-one-frequency": (
        "only {stiffness} - m (2 pi f)^2 is known: every test ran at one frequency; the value given is that "
        "difference; add another frequency"
    ),
    "one-speed": (
        "{name} not identifiable: every test ran at one speed, where viscous and yield force are one; add another "
        "speed or a sine"
    ),
    "held": "{reason}; taken as 0 here",
    "no-effect": "{name} not identifiable: it has no effect on the force in these tests",
    "inseparable": "{name} not separable from {partners} in these tests",
    "degenerate-yield": (
        "{name} not identifiable: the hysteresis is degenerate, {offset} outweighs every speed, so that the tanh "
        "follows sgn(u) and the yield force dissipates nothing; only its height is known"
    ),
    "straight-tanh": (
        "{name} not identifiable: the tanh is a straight line here (at most {largest:.2g}), so that yield and viscous "
        "force are one; add faster tests"
    ),
    "bent-or-steep": (
        "{name} not identifiable: at these speeds a steep tanh and a bent one, with other yield and viscous forces, "
        "fit alike; add other speeds or a sine"
    ),
    "saturated-tanh": (
        "{name} not identifiable: the tanh is saturated at nearly all samples, towards or away from mid-stroke, so it "
        "hardly changes the force; the yield force is only a sign function there"
    ),
    "would-be-negative": (
        "{name} is not identifiable: it would be negative, and is held at its limit, 0; with 95 % it is below the "
        "upper end of its interval"
    ),
    "at-limit": (
        "{name} is not identifiable: its search ended at its limit, {limit:.6g}; a value beyond it would fit as well "
        "or better"
    ),
    "too-wide": (
        "{name} is not identifiable: {value:.3g} +- {half:.3g} (95 %) is wider than its value, and stands for "
        "{percent:.0f} % of the force, for which other parameters make up"
    ),
}
"""Why a parameter is not identified."""

WARNINGS = {
    "few-cycles": "only {cycles} full cycle(s); none could be dropped, so the ends may hold transients",
    "no-repeat": (
        "the motion does not repeat from cycle to cycle; a local polynomial gives the velocity, and its errors are in "
        "no interval"
    ),
    "one-cycle-no-series": (
        "no series describes the motion of the single cycle that is left without the first and the last; a local "
        "polynomial gives the velocity, and its errors are in no interval"
    ),
    "whole-record": (
        "the motion has no cycles: the whole record is used, {used}; errors of its velocity are in no interval"
    ),
    "command-steps": "no current was measured; eta is found with the commanded one",
    "command-steady": "no current was measured; the commanded {current_A:g} A is used",
    "saturated-force": (
        "the force stands still at its {end} value, {extreme_N:.1f} N, {times} times; it is probably saturated, and "
        "the fit does without these samples: the greatest forces are not in it"
    ),
    "left-out": "{test} left out: {reason}",
    "no-diagnosis": "no cause of the misfit was looked for: {reason}",
    "time-errors": (
        "the times of the samples are known to {std_ms:.3g} ms each (their stamps are rounded or jitter); the noise of "
        "the force and the delay allow for it"
    ),
    "constant-channel": (
        "{test} left out: its {channel[0]} is {channel[1]:g} {channel[2]} in all samples: a channel that was not "
        "connected, or a wrong column. Fix: measure it again, or name another column"
    ),
    "contradiction": (
        "tests of the same motion and current measured different forces ({pairs}): two specimens, two temperatures, or "
        "a rig that changed between them; one fit describes one damper in one condition"
    ),
    "current-contradicts": (
        "the measured current contradicts the requested one: {tests}; these tests are grouped by what was measured. "
        "Fix: check the current source and the requested values"
    ),
    "currents-merged": (
        "currents {levels} are grouped as one level each, although their outermost tests differ by more than the "
        "resolution of the measured current ({resolution_mA:.2g} mA): neighbouring tests cannot be separated. Fix: "
        "record the requested currents, or measure the current with less noise"
    ),
    "runs-apart": (
        "the {count} runs are described to {apart_N:.3g} N when each is fitted apart, and only to {together_N:.3g} N "
        "by one fit: they are probably not the same damper, or not in the same condition; identify them apart"
    ),
    "degenerate-hysteresis": (
        "degenerate hysteresis: {offset} = {value:.3g} outweighs beta v at every tested speed, so that the yield force "
        "follows the side of mid-stroke, sgn(u), and not the motion, and dissipates nothing; check the mid-stroke, or "
        "fit another model"
    ),
    "not-passive": (
        "the fitted model is not passive: at {percent:.0f} % of the tested speeds and currents its force, gas force "
        "left out, drives the rod instead of damping it ({worst}); a simulation with it can gain energy"
    ),
    "energy-unknown": "energy per cycle is unknown where a stretch of every cycle has no force samples: {tests}",
    "energy-differs": "energy per cycle differs by more than {percent:g} % between model and measurement: {tests}",
    "misses-held-out": (
        "the model describes the tests it was fitted to, but misses the held-out ones by more than their own scatter: "
        "outside of what it was fitted to it does not hold"
    ),
    "model-error": (
        "Model error exceeds the repeatability (scatter) of the tests: the values are a best fit of the closest model, "
        "the intervals do not include model error"
    ),
    "no-two-cycles": (
        "no test has two whole cycles left without its first and last, which are not fitted, so whether the model fits "
        "to the noise is unknown; run more cycles"
    ),
    "ranked-unseen-by-none": (
        "every test that was left out to compare the models lies beyond the others' data ({quantities}): its error is "
        "that of an extrapolation, so the information criterion ranks the models; add tests between these"
    ),
    "ranked-beyond": (
        "every held-out test lies beyond the fitted ones' data ({quantities}): the models are ranked by how they "
        "extrapolate"
    ),
    "described-first": (
        "{model} comes first because it describes every test to its scatter; {other} foretells tests left out better "
        "({other_error:.3g} % of peak against {error:.3g} %), but its error on the fitted ones is {times:.3g} times as "
        "large: measure more motions"
    ),
    "ranked-by-those-beyond": (
        "{model} is first by held-out tests beyond the fitted ones' data ({tests}: {quantities}); on those within it "
        "{other} is: {other_error:.3g} % of peak, {model} {error:.3g} %"
    ),
    "relative-weights": (
        "what even the best model leaves is {ratio:.1f} times the tests' scatter, so misfit: every test counts alike, "
        "by its error in % of its peak, and not by newtons; weight 1 counts all samples alike"
    ),
    "weight-v": "weight v (equation 12) mutes the reversals; compare with weight 1",
    "sharp-reversals": (
        "every test reverses more sharply than its displacement samples resolve (velocity there uncertain by up to "
        "{worst_mm_s:.1f} mm/s); the intervals allow for it; add sines to narrow them"
    ),
    "unfinished": (
        "{method} stopped before the least-squares solution: {names} lie more than {errors:g} standard errors from it, "
        "and the intervals, which are those of the solution, do not hold; give it more budget, or use separable"
    ),
    "systematic-residuals": (
        "{count} of {tests} residuals are systematic{worst}; the intervals are widened for it by {widening:.1f}"
    ),
    "relations-beyond": ("held out beyond the fitted currents, where the relations foretell nothing: {tests}"),
    "given-up": (
        "{model}: given up after {evaluations} evaluations on one cycle of each test: its error, {reached_N:.3g} N, is "
        "{times:.1f} times that of the best model before it, {rival_N:.3g} N"
    ),
}
"""What the reader of a fit should know before using its numbers."""

CAUSES = {
    "units-force": (
        "the greatest force is {value:.3g} {unit}, which no test of a damper has: it is probably in {likely}"
    ),
    "units-time": "a cycle lasts {value:.3g} {unit}, which no test of a damper does: the time is probably in {likely}",
    "units-displacement": (
        "the displacement spans {value:.3g} {unit}, which no test of a damper does: it is probably in {likely}"
    ),
    "units-current": "the greatest current is {value:.3g} {unit}, which no coil takes: it is probably in {likely}",
    "units-of-some": "in {tests} and no other test {what}",
    "odd-test": (
        "{test} does not fit the other tests, whose fit misses {percent_missed:.0f} % of its force; {mends}"
    ),
    "odd-test-mended": "it would with {mends}",
    "odd-test-apart": "no gain of its force, other current or other motion makes up for it",
    "mend-force": "its force multiplied by {factor:.3g}",
    "mend-current": "a current of {likely_A:.2f} A, not {told_A:.2f} A",
    "mend-motion": "its motion multiplied by {factor:.3g}",
    "units-velocity": (
        "the displacement changes {ratio:.3g} times as fast as the velocity says: one of them, or the sampling "
        "interval, is in another unit"
    ),
    "signs-reversed": (
        "the force's middle at low speed is {offset_N:+.3g} N, towards extension, against the gas that pushes the rod "
        "out: probably the signs of both force and displacement are reversed, unless the load cell's zero is off by "
        "that"
    ),
    "force-offset": (
        "the force's middle at low speed is {offset_N:+.3g} N, towards extension: a preload, or a load cell that does "
        "not read 0 without force; the model's offset takes it. A damper with gas and both signs reversed looks like "
        "that too, where it does not resist rebound more than jounce"
    ),
    "skew": (
        "a delay of {skew_ms:+.3g} ms of the force behind the displacement explains {percent_explained:.0f} % of the "
        "misfit"
    ),
    "force-drift": (
        "a drift of the force channel over time, {percent:+.3g} % in gain and {zero_N:+.3g} N in zero from end to end, "
        "explains {percent_explained:.0f} % of the misfit"
    ),
    "force-drift-some": (
        "a force channel that drifts in each test by itself ({tests}; most {percent:+.3g} % in gain from its start to "
        "its end) explains {percent_explained:.0f} % of the misfit"
    ),
    "temperature": (
        "the recorded temperature, {percent:+.3g} % of force and {zero_N:+.3g} N from the coldest to the warmest, "
        "explains {percent_explained:.0f} % of the misfit"
    ),
    "temperature-rates": (
        "the recorded temperature, which weakens viscous forces by {viscous_percent_K:.2g} % and yield forces by "
        "{yield_percent_K:.2g} % per kelvin, explains {percent_explained:.0f} % of the misfit"
    ),
    "outliers": (
        "{count} samples of the force ({percent:.2g} %) lie far from their neighbours and explain "
        "{percent_explained:.0f} % of the misfit"
    ),
    "clipping": (
        "a force channel that ends at {low_N:.4g} and {high_N:.4g} N explains {percent_explained:.0f} % of the misfit"
    ),
    "clipping-one-end": "a force channel that ends at {end_N:.4g} N explains {percent_explained:.0f} % of the misfit",
    "clipping-left-out": "the force stood at the end of its range in {tests}; the fit does without these samples",
    "series-compliance": (
        "a spring of {stiffness_N_m:.3g} N/m in series, such as mounts that give way, explains "
        "{percent_explained:.0f} % of the misfit"
    ),
    "current-law": (
        "another law of the current than the model's, over {currents} A, explains {percent_explained:.0f} % of the "
        "misfit: probably the force saturates"
    ),
    "current-law-two": (
        "the law of the current is drawn through {low_A:.3g} and {top_A:.3g} A alone and leaves {zero_N:.3g} N, "
        "{percent:.0f} % of the yield force at {top_A:.3g} A, at zero current, where nothing was measured: probably "
        "the force saturates"
    ),
    "current-sign": (
        "currents of both signs: the force follows the current's size and not its sign, which explains "
        "{percent_explained:.0f} % of the misfit"
    ),
    "missing-hysteresis": (
        "a force that changes with the path after each reversal, which the model lacks, explains "
        "{percent_explained:.0f} % of the misfit; {percent:.0f} % of it lies within 1 mm after a reversal"
    ),
    "mixed-specimens": (
        "two dampers instead of one explain {percent_explained:.0f} % of the misfit; the other one's tests are {tests}"
    ),
    "speed-shape": (
        "another shape of the force over speed than the model's explains {percent_explained:.0f} % of the misfit"
    ),
    "stroke-shape": (
        "another shape of the force over the stroke than the model's, such as end stops or gas that stiffens, explains "
        "{percent_explained:.0f} % of the misfit"
    ),
    "unexplained": (
        "no cause that was looked for explains {least:.0f} % of the misfit; {near:.0f} % of it lies within 1 mm after "
        "a reversal, {slow:.0f} % below a tenth of the greatest speed, {of_worst:.0f} % in {worst}, one of {count} "
        "tests"
    ),
}
"""What may explain a misfit, or is implausible."""

NEXT = {
    "next-units-force": "multiply the force by {factor:g}, or name its unit on import (--column force=NAME:kN)",
    "next-units-time": "multiply the time by {factor:g}, or name its unit on import (--column time=NAME:ms)",
    "next-units-displacement": (
        "multiply the displacement by {factor:g}, or name its unit on import (--column displacement=NAME:mm)"
    ),
    "next-units-current": "multiply the current by {factor:g}, or name its unit on import (--column current=NAME:mA)",
    "next-odd-test": (
        "check the current, the units and the ranges of both channels of that test and the damper in it, or identify "
        "without it"
    ),
    "next-units-velocity": "give displacement in m, velocity in m/s, acceleration in m/s^2 and the interval in s",
    "next-signs-reversed": (
        "check the signs by a slow extension by hand: displacement rises, force is positive; if both are reversed, "
        "multiply both by -1; if neither is, check the load cell's zero"
    ),
    "next-force-offset": (
        "read the load cell with the rod free, and check the signs by a slow extension by hand: displacement rises, "
        "force is positive"
    ),
    "next-skew": "measure the delay of both channels with one sharp motion, or shift the force by it before the fit",
    "next-force-drift": (
        "check the load cell's zero and gain before and after the tests; warm amplifier and damper up, and repeat the "
        "first test at the end"
    ),
    "next-temperature": "fit with --temperature-law both, or hold the damper in a temperature window",
    "next-outliers": "fit with --loss huber; look for interference or lost bits in the force channel",
    "next-clipping": "use a larger range of the force channel, or less speed and current",
    "next-series-compliance": "fit with --series-spring; measure the displacement at the damper itself",
    "next-current-law": "fit with --current-law saturating, or compare the laws with --current-law all",
    "next-current-law-two": "measure at 0 A and at one current between",
    "next-current-sign": "give all currents without their sign: the magnetic field's direction changes no yield force",
    "next-missing-hysteresis": (
        "{untried}measure slow triangles of several amplitudes, which show the path after a reversal"
    ),
    "next-mixed-specimens": "check which damper was mounted, and identify these tests apart",
    "next-speed-shape": "{untried}measure sines of more amplitudes at the same frequency",
    "next-unexplained": (
        "{untried}repeat {worst}, the first test and one with the currents in another order: what then "
        "differs is no model's to describe"
    ),
    "next-stroke-shape": "measure with less amplitude, and at more positions of the stroke",
}
"""What to measure or mend then; `untried` is `UNTRIED` where not every model was compared, else empty."""

UNTRIED = "fit with --model all; "

SENTENCES = {**PARAMETERS, **WARNINGS, **CAUSES, **NEXT}
