"""Words: every sentence with which identification tells people what it did not find, or doubts.

A `Remark` carries its slug and numbers; code decides by those. Its text is made here and nowhere else, so that it can
be changed without changing what is done. Errors of wrong use (an unknown name, an option that does not fit) stand where
they are raised, statements of the diagnosis with the functions that find them (`diagnosis.statement`).
"""

from __future__ import annotations

from collections.abc import Mapping


class Remark(str):
    """A sentence for people: plain text that knows what it says.

    Attributes:
        slug: key of `SENTENCES`, or of a statement of the diagnosis.
        numbers: what the sentence was made from, by name.
    """

    __slots__ = ("numbers", "slug")
    slug: str
    numbers: Mapping[str, object]

    def __reduce__(self) -> tuple[object, ...]:
        return known_remark, (str(self), self.slug, dict(self.numbers))


def say(slug: str, **numbers: object) -> Remark:
    """The sentence of a slug, from its numbers.

    Raises:
        KeyError: no such slug, or one of its numbers is missing.
    """
    return filled(slug, SENTENCES[slug], numbers)


def filled(slug: str, template: str, numbers: Mapping[str, object]) -> Remark:
    """A sentence that is declared elsewhere, as those of the diagnosis, from its numbers.

    Raises:
        KeyError: one of its numbers is missing.
    """
    return known_remark(template.format(**numbers), slug, numbers)


def known_remark(text: str, slug: str, numbers: Mapping[str, object]) -> Remark:
    """A remark that was formatted before, unchanged."""
    remark = Remark(text)
    remark.slug, remark.numbers = slug, numbers
    return remark


PARAMETERS = {
    "no-knee": (
        "{name} not identifiable: for this direction of motion a single straight line fits equally well, so {knee} "
        "is outside the tested speeds or does not exist. Fix: test at higher and lower speeds"
    ),
    "no-current-step": "eta not identifiable: the current was constant in every test. Fix: add a current step",
    "redundant": (
        "{name} not identifiable separately: {by} only scales {scaled}; the values apply for {by} = {value:g} "
        "(normalized_bouc_wen has no such redundancy)"
    ),
    "few-currents": "{name} not identifiable: got tests at {levels} different currents, expected {needed}",
    "lower-power": (
        "{name} is identified only together with {left_out}, which the tested currents do not determine: the value "
        "applies for {left_out} = 0. Fix: add tests at other currents"
    ),
    "no-current": "{name} not identifiable: every test ran at 0 A. Fix: add tests at another current",
    "one-current": (
        "{name} not separable from {base}: every test ran at {mean_A:.2f} A. Fix: add tests at another current"
    ),
    "sum-at-one-current": (
        "only the sum {base} + {name} I is identified because every test ran at I = {mean_A:.2f} A; the value and its "
        "interval apply to this sum"
    ),
    "one-frequency": (
        "m is not separable from {stiffness}: all tests ran at one frequency, where inertia and stiffness are "
        "proportional. Fix: add a test at another frequency"
    ),
    "harmonics-only": (
        "m is not separable from {stiffness}: all tests ran at one frequency, where inertia and stiffness are "
        "proportional. Fix: add a test at another frequency (only harmonics separate them here; m stays in the fit "
        "so that {stiffness} is correct)"
    ),
    "difference-at-one-frequency": (
        "only the difference {stiffness} - m (2 pi f)^2 is identified because all tests ran at one frequency; the "
        "value and its interval apply to this difference. Fix: add a test at another frequency"
    ),
    "one-speed": (
        "{name} not identifiable: all tests ran at one speed, so the viscous and yield forces are not separable. Fix: "
        "add a test at another speed or a sine test"
    ),
    "residual": (
        "{name} is part of the residual: its value is set by a ridge regression and has no interval; the intervals of "
        "the other parameters are for this residual"
    ),
    "held": "{reason}; its value is set to 0",
    "no-effect": "{name} not identifiable: the parameter has no effect on the force in these tests",
    "inseparable": "{name} not separable from {partners} in these tests",
    "degenerate-yield": (
        "{name} not identifiable: the hysteresis is degenerate because {offset} exceeds the speed term everywhere; the "
        "tanh follows sgn(u), the yield force dissipates no energy, and only its height is identified"
    ),
    "straight-tanh": (
        "{name} not identifiable: the tanh is linear in these tests (its argument is at most {largest:.2g}), so the "
        "yield and viscous forces are not separable. Fix: add faster tests"
    ),
    "bent-or-steep": (
        "{name} not identifiable: at these speeds, a steep tanh and a rounded tanh with different yield and viscous "
        "forces fit equally well. Fix: add tests at other speeds or a sine test"
    ),
    "saturated-tanh": (
        "{name} not identifiable: the tanh is saturated at nearly all samples on both sides of mid-stroke, so the "
        "yield force is effectively a sign function, and the parameter hardly affects the force"
    ),
    "would-be-negative": (
        "{name} is not identifiable: the unconstrained estimate is negative, so the parameter is set to its lower "
        "bound, 0; the upper end of its interval is a 95 % bound"
    ),
    "at-limit": (
        "{name} is not identifiable: the search ended at its limit, {limit:.6g}; a value beyond the limit would fit "
        "equally well or better"
    ),
    "too-wide": (
        "{name} is not identifiable: the interval {value:.3g} +- {half:.3g} (95 %) is wider than the value, although "
        "the parameter's term is {percent:.0f} % of the force; other parameters compensate for this term"
    ),
}
"""Why a parameter is not identified."""

QUANTITIES = {
    "sum-at-one-current": "{base} + {name} I at I = {mean_A:.2f} A",
    "difference-at-one-frequency": "{stiffness} - m (2 pi f)^2",
}
"""Slug of a reason -> the quantity that the tests determine in place of the parameter."""

WARNINGS = {
    "few-cycles": "number of full cycles: {cycles}; no cycle was discarded, so transients at the ends may remain",
    "no-repeat": (
        "the motion does not repeat from cycle to cycle: the velocity is derived from a local polynomial, whose "
        "errors are not included in the intervals"
    ),
    "one-cycle-no-series": (
        "only one cycle remains after the first and last are discarded, and no Fourier series describes its motion: "
        "the velocity is derived from a local polynomial, whose errors are not included in the intervals"
    ),
    "mean-cycles": (
        "{samples} samples in {cycles} cycles fitted as {groups} mean cycles of {phases} samples, each the mean of "
        "{each:.0f} recorded samples"
    ),
    "whole-record": (
        "the motion has no cycles, so the whole record is used ({used}); errors in its velocity are not included in "
        "the intervals"
    ),
    "command-steps": "no current was measured: eta is identified from the commanded current",
    "command-steady": "no current was measured: the commanded current ({current_A:g} A) is used",
    "saturated-force": (
        "the force remains at its {end} value ({extreme_N:.1f} N) {times} times: the force channel is probably "
        "saturated; these samples are excluded, so the fit does not cover the largest forces"
    ),
    "left-out": "{test} not used: {reason}",
    "no-diagnosis": "the causes of the misfit were not investigated: {reason}",
    "time-errors": (
        "each sample time is uncertain by {std_ms:.3g} ms (rounded or jittering time stamps); the stated "
        "uncertainties of the force noise and the delay include this error"
    ),
    "constant-channel": (
        "{test} not used: its {channel[0]} is {channel[1]:g} {channel[2]} in all samples (channel not connected, or "
        "wrong column). Fix: measure again, or select another column"
    ),
    "contradiction": (
        "tests with the same motion and current have different forces ({pairs}), possibly because of two specimens, "
        "two temperatures, or a change to the rig between the tests; a fit describes one damper in one condition"
    ),
    "current-contradicts": (
        "the measured current differs from the requested current: {tests}; these tests are grouped by measured "
        "current. Fix: check the current source and the requested values"
    ),
    "currents-merged": (
        "the tests at the currents {levels} are each grouped as one level, although the outermost tests of a group "
        "differ by more than the resolution of the measured current ({resolution_mA:.2g} mA): adjacent tests cannot be "
        "separated. Fix: record the requested currents, or measure the current with less noise"
    ),
    "runs-apart": (
        "separate fits to the {count} runs leave an error of {apart_N:.3g} N, but a joint fit leaves {together_N:.3g} "
        "N: the runs probably contain different dampers, or one damper in different conditions. Fix: identify the runs "
        "separately"
    ),
    "degenerate-hysteresis": (
        "degenerate hysteresis: {offset} = {value:.3g} exceeds beta v at every tested speed, so the yield force "
        "follows the position, sgn(u), instead of the motion and dissipates no energy. Fix: check the mid-stroke "
        "position, or fit another model"
    ),
    "not-passive": (
        "the fitted model is not passive: at {percent:.0f} % of the tested speeds and currents, the model's force "
        "(without gas force) drives the rod instead of damping its motion ({worst}); a simulation with this model can "
        "gain energy"
    ),
    "energy-unknown": (
        "the energy per cycle is unknown because force samples are missing in part of every cycle: {tests}"
    ),
    "energy-differs": (
        "the model's energy per cycle differs from the measured energy by more than {percent:g} %: {tests}"
    ),
    "misses-held-out": (
        "the model fits its tests, but the errors of the validation tests exceed their measurement noise: the model "
        "does not generalise"
    ),
    "model-error": (
        "Model error exceeds the repeatability (scatter) of the tests: the values are the best fit of the closest "
        "model; the intervals do not include model error"
    ),
    "no-two-cycles": (
        "no test has two whole cycles in addition to its first and last, which are not fitted, so it is unknown "
        "whether the model fits within measurement noise. Fix: run more cycles"
    ),
    "ranked-unseen-by-none": (
        "every test used to compare the models is outside the fitted range ({quantities}), so its error is an "
        "extrapolation error; the models are ranked by the information criterion. Fix: add tests within this range"
    ),
    "ranked-beyond": (
        "every validation test is outside the fitted range ({quantities}): the models are ranked by extrapolation error"
    ),
    "residual-too-few": (
        "no residual of {model}: got tests of {groups} different motions (or currents), expected at least {needed} to "
        "leave out in turn, so the physical model is used. Fix: measure more motions"
    ),
    "residual-no-gain": (
        "no residual of {model}: on tests left out, the best residual has an error of {grey:.3g} % of force amplitude, "
        "compared with {physical:.3g} % for the physical model, which is used"
    ),
    "residual-not-passive": (
        "no residual of {model}: with it, a closed cycle within the tested range gains energy, so the physical model "
        "is used"
    ),
    "residual-reduced": (
        "the residual of {model} is reduced to {percent:.0f} % of its fitted size because a closed cycle within the "
        "tested range would gain energy"
    ),
    "described-first": (
        "{model} is ranked first because it fits all tests within measurement noise; {other} predicts held-out tests "
        "better ({other_error:.3g} % of force amplitude, compared with {error:.3g} % for {model}), but its error on "
        "the fitted tests is {times:.3g} times as large. Fix: measure more motions"
    ),
    "ranked-by-those-beyond": (
        "{model} is ranked first by the validation tests outside the fitted range ({tests}: {quantities}), but {other} "
        "is first by those inside the range: {other_error:.3g} % of force amplitude, compared with "
        "{error:.3g} % for {model}"
    ),
    "relative-weights": (
        "the residual of the best model is {ratio:.1f} times the measurement noise, which indicates model error; all "
        "tests are therefore weighted equally (error in % of the force amplitude); with weight 1, all samples would be "
        "weighted equally"
    ),
    "weight-v": "weight v (equation 12) suppresses the reversals; compare the result with that for weight 1",
    "sharp-reversals": (
        "every test reverses more sharply than its displacement samples resolve, so the velocity at the reversals is "
        "uncertain by up to {worst_mm_s:.1f} mm/s; the intervals include this uncertainty. Fix: add sine tests to "
        "narrow the intervals"
    ),
    "unfinished": (
        "{method} stopped before the least-squares solution: {names} differ from that solution by more than "
        "{errors:g} standard errors, so the intervals, which apply to that solution, are not valid. Fix: increase "
        "the budget, or use separable"
    ),
    "drifting-tests": (
        "the force changes steadily from the first to the last cycle of {tests}, by up to {percent:.2g} % of the peak "
        "force (in {worst}); the intervals include this drift. Check the temperature of the damper, the gas pressure "
        "and the load cell. Fix: use a temperature correction, or fewer cycles"
    ),
    "systematic-residuals": (
        "{count} of {tests} residuals are systematic{worst}; the intervals are widened by a factor of {widening:.1f}"
    ),
    "relations-beyond": (
        "validation tests outside the range of the fitted currents, where the relations are not valid: {tests}"
    ),
    "given-up": (
        "{model}: stopped after {evaluations} evaluations on one cycle of {tests}: the error of this model, "
        "{reached_N:.3g} N, is {times:.1f} times that of the best model so far, {rival_N:.3g} N"
    ),
}
"""What the reader of a fit should know before using its numbers."""

UNTRIED = "fit with --model all; "

SENTENCES = {**PARAMETERS, **WARNINGS}
