"""Velocity and acceleration from measured displacement, without phase.

Default is a harmonic fit over whole cycles: a Fourier series whose fundamental frequency is fitted too, evaluated and
differentiated exactly at any times. It averages the sensor's noise over the whole test: with N samples of noise s each
coefficient is known to s sqrt(2/N), so 5 um over 2,000 samples leave 0.16 um. Where the motion does not repeat, the
residual of the fit says so and a local polynomial (Savitzky and Golay 1964) takes its place. The recorded file's own
velocity is a local parabola through measured displacement.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.signals.arrays import FloatArray
from rig.signals.fourier import quantisation_step, significant_orders
from rig.signals.phase_sums import normal_sums, series_at

MAXIMUM_HARMONICS = 400
REPEATS = 0.003  # share of the amplitude
TAIL_ORDERS = 4  # fewer harmonics in a half octave are single ones, not a series that goes on
TAIL_SHARE = 0.3  # nor do they make a series when they are fewer than this share of its orders
ROUNDS = 5  # strong harmonics hide weak ones: each round looks at what the last one left
CERTAIN_ORDERS = 7  # a motion's own lowest orders are motion also where they are small
FIRST_GUESS = 16384  # samples sufficient for the first estimate of the frequency
MOST_STEPS = 4  # of the frequency
SMALL_STEP = 1e-6  # by which the last one moves the phase (rad) of the highest order over the record
HALF_WIDTH = 4
WIDTH = 2 * HALF_WIDTH + 1
MARGIN = 4 * HALF_WIDTH
"""Samples beyond a part on each side, with which its velocity is that of the whole."""
GAP_STEPS = 1.5
UNIFORM = 0.02
"""Steps that differ by less from a window's mean are one step: an error below 0.5 % of the velocity."""
WINDOWS_AT_A_TIME = 65_536
METHOD = f"local parabola through {WIDTH} samples"
Method = Literal["harmonic", "savitzky_golay"]


class NotDifferentiable(RigError):
    """The displacement has too few samples, or too long gaps, to be differentiated."""


@dataclass(frozen=True)
class HarmonicFit:
    """A Fourier series: u(t) = mean + sum c_k cos(k w t') + s_k sin(k w t') over some orders k, t' = t - origin.

    Attributes:
        origin_s: origin of the phase (s).
        omega_rad_s: fundamental angular frequency (rad/s).
        mean_m: mean of the series (m).
        orders: the harmonics k that stand out of the noise, shape (K,); the first is 1.
        cosine_m: c_k (m), shape (K,).
        sine_m: s_k (m), shape (K,).
        residual_m: standard deviation of measured minus fitted displacement (m).
        white: whether neighbouring residuals are unrelated, as sensor noise is.
        samples: how many samples were fitted.
        rounding_m: largest error of the displacement by rounded times (m).
    """

    origin_s: float
    omega_rad_s: float
    mean_m: float
    orders: NDArray[np.int64]
    cosine_m: FloatArray
    sine_m: FloatArray
    residual_m: float
    white: bool
    samples: int = 0
    rounding_m: float = 0.0

    @property
    def frequency_Hz(self) -> float:
        """Fundamental frequency (Hz)."""
        return self.omega_rad_s / (2.0 * np.pi)

    @property
    def repeats(self) -> bool:
        """Whether the motion repeats: the series leaves noise, rounding, or less than 0.3 % of the amplitude."""
        return self.white or self.residual_m < max(REPEATS * self.amplitude_m, self.rounding_m)

    @property
    def amplitude_m(self) -> float:
        """Amplitude of the fundamental (m)."""
        return float(np.hypot(self.cosine_m[0], self.sine_m[0]))

    @property
    def rms_speed_m_s(self) -> float:
        """Root mean square speed of the fundamental (m/s)."""
        return self.omega_rad_s * self.amplitude_m / float(np.sqrt(2.0))

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement (m), velocity (m/s), acceleration (m/s^2) at any times (s), each of shape (n,)."""
        u, v, a = self._sum(time_s, np.ones(self.orders.size, dtype=bool))
        return u + self.mean_m, v, a

    def unseen_at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """What harmonics lost in the noise or beyond the samples' reach may add: velocity (m/s), acceleration (m/s^2).

        The corner of a triangle, rounded by a servo of second order, has harmonics that fall as k^-4. Those above the
        last one K found then add up to what the half octave below K adds to the velocity, sum k^-3, and to 2.4 times
        that to the acceleration, sum k^-2. None where there is no such series, as in a sine with its few harmonics.
        """
        half_octave = 1.0 - 1.0 / np.sqrt(2.0)
        for last in self.orders[::-1].tolist():
            band = (self.orders > (1.0 - half_octave) * last) & (self.orders <= last)
            if np.count_nonzero(band) >= max(TAIL_ORDERS, TAIL_SHARE * half_octave * last):
                _, v, a = self._sum(time_s, band)
                return v, a / (np.sqrt(2.0) - 1.0)
        return None

    def _sum(self, time_s: FloatArray, chosen: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The chosen harmonics' displacement, velocity and acceleration."""
        orders, amplitude_m = self.orders[chosen], self.cosine_m[chosen] - 1j * self.sine_m[chosen]
        spectra = np.zeros((3, int(orders[-1]) + 1), np.complex128)
        for times in range(3):
            spectra[times, orders] = amplitude_m * (1j * orders * self.omega_rad_s) ** times
        u, v, a = series_at(_turns(time_s - self.origin_s, self.omega_rad_s), spectra)
        return u, v, a


@dataclass(frozen=True)
class Motion:
    """Displacement and its derivatives at the wanted times, shape (n,) each.

    Attributes:
        time_s: the times (s).
        u_m: displacement (m), in the sensor's coordinate.
        v_m_s: velocity (m/s).
        a_m_s2: acceleration (m/s^2).
        method: "harmonic" or "savitzky_golay".
        harmonics: the fit behind it; None for the local polynomial.
    """

    time_s: FloatArray
    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    method: Method
    harmonics: HarmonicFit | None


def harmonic(
    time_s: FloatArray, displacement_m: FloatArray, frequency_Hz: float, resolution_s: float = 0.0
) -> HarmonicFit:
    """Fit a Fourier series to displacement over whole cycles.

    Args:
        time_s: sample times (s), shape (n,); need not be uniform.
        displacement_m: displacement (m), shape (n,); not-a-number samples are skipped.
        frequency_Hz: first guess of the fundamental, within a fraction of 1/duration.
        resolution_s: step to which the times are rounded (s); times the speed it is one of the displacement.

    Raises:
        NotDifferentiable: fewer samples than the series has coefficients, or a gap longer than half a cycle.
    """
    usable = np.isfinite(displacement_m)
    t, u = np.asarray(time_s)[usable], np.asarray(displacement_m)[usable]
    _refuse_gaps(t, frequency_Hz)
    origin = float(t[0] + t[-1]) / 2.0
    spacing = float(np.median(np.diff(t)))
    count = int(max(1, min(MAXIMUM_HARMONICS, 0.4 / (spacing * frequency_Hz), (t.size - 4) // 4)))
    omega = 2.0 * np.pi * frequency_Hz
    first, step = np.array([1], dtype=np.int64), quantisation_step(u)
    thin = slice(None, None, max(1, t.size // FIRST_GUESS))
    for _ in range(2):
        omega += _solved(t[thin] - origin, u[thin], omega, first)[1]
    omega, coefficients, residual = _fitted(t - origin, u, omega, first)
    # Rounded times are errors of the displacement as large as the speed times their step. If the rounding repeats with
    # the samples, all of it lies in one or two orders (2 and 3 ms in turns: near half the sampling rate).
    rounding = resolution_s * omega * float(np.hypot(*coefficients[1:]))
    orders, tried = first, first
    for _ in range(ROUNDS):
        added = np.setdiff1d(significant_orders(t - origin, residual, omega, count, step), tried)
        if added.size == 0:
            break
        orders, tried = np.union1d(orders, added), np.union1d(tried, added)
        if rounding > 0.0:
            coefficients = _solved(t - origin, u, omega, orders)[0]
            orders = orders[(orders <= CERTAIN_ORDERS) | (np.hypot(coefficients[1::2], coefficients[2::2]) > rounding)]
        omega, coefficients, residual = _fitted(t - origin, u, omega, orders)
    deviation = float(np.sqrt(np.sum(residual**2) / max(1, t.size - coefficients.size - 1)))
    series = (orders, coefficients[1::2], coefficients[2::2])
    white = is_white(residual)
    return HarmonicFit(origin, omega, float(coefficients[0]), *series, deviation, white, t.size, 0.5 * rounding)


def with_orders(fit: HarmonicFit, time_s: FloatArray, values: FloatArray, orders: NDArray[np.int64]) -> HarmonicFit:
    """A fit's fundamental with all of the given orders, whether they stand out of the noise or not.

    Args:
        fit: whose fundamental and origin are kept.
        time_s: sample times (s), shape (n,).
        values: samples, shape (n,), none missing.
        orders: the orders (K,), ascending.

    Raises:
        numpy.linalg.LinAlgError: the samples do not determine so many.
    """
    since_s = time_s - fit.origin_s
    coefficients = _solved(since_s, values, fit.omega_rad_s, orders)[0]
    residual = values - _series(since_s, fit.omega_rad_s, orders, coefficients)
    deviation = float(np.sqrt(np.sum(residual**2) / max(1, time_s.size - coefficients.size - 1)))
    return HarmonicFit(
        fit.origin_s, fit.omega_rad_s, float(coefficients[0]), orders, coefficients[1::2], coefficients[2::2],
        deviation, is_white(residual), time_s.size,
    )


def savitzky_golay(time_s: FloatArray, displacement_m: FloatArray, window_s: float, degree: int = 4) -> Motion:
    """Local polynomial through each sample's neighbours (Savitzky and Golay 1964), centred, so without phase.

    Args:
        time_s: sample times (s), uniform to within 10 %, shape (n,).
        displacement_m: displacement (m), shape (n,), no gaps.
        window_s: length of the window (s).
        degree: degree of the polynomial.

    Raises:
        NotDifferentiable: the window holds too few samples, or the recording is shorter than the window.
    """
    spacing = float(np.median(np.diff(time_s)))
    half = max(round(window_s / spacing / 2.0), (degree + 2) // 2)
    if 2 * half + 1 > time_s.size:
        raise NotDifferentiable(f"{time_s.size} samples; differentiation requires a window of {2 * half + 1} samples")
    offsets = np.arange(-half, half + 1)
    inverse = np.linalg.pinv(np.vander(offsets / half, degree + 1, increasing=True))
    u, v, a = (_correlate(displacement_m, inverse[k]) for k in range(3))
    for edge, where in ((slice(0, 2 * half + 1), range(half)), (slice(-2 * half - 1, None), range(-half, 0))):
        polynomial = inverse @ displacement_m[edge]
        for k in where:
            x = (k - half) / half if k >= 0 else (k + half + 1) / half
            powers = x ** np.arange(degree + 1)
            u[k] = polynomial @ powers
            v[k] = polynomial[1:] @ (np.arange(1, degree + 1) * powers[:-1])
            a[k] = polynomial[2:] @ (np.arange(2, degree + 1) * np.arange(1, degree) * powers[:-2]) / 2.0
    scale = half * spacing
    return Motion(time_s, u, v / scale, 2.0 * a / scale**2, "savitzky_golay", None)


def is_white(residual: FloatArray) -> bool:
    """Whether the first ten autocorrelations are those of white noise (Box and Pierce 1970), 1 in 10,000 missed."""
    n = residual.size
    centred = residual - np.mean(residual)
    power = float(centred @ centred)
    if n < 40 or power == 0.0:
        return True
    correlated = 0.0
    for k in range(1, 11):
        correlated += (float(centred[k:] @ centred[:-k]) / power) ** 2
        if n * correlated >= 35.6:
            return False
    return True


def _correlate(x: FloatArray, kernel: FloatArray) -> FloatArray:
    half = kernel.size // 2
    out = np.empty(x.size)
    out[half : x.size - half] = np.correlate(x, kernel, mode="valid")
    return out


def _refuse_gaps(t: FloatArray, frequency_Hz: float) -> None:
    if t.size < 16:
        raise NotDifferentiable(f"{t.size} displacement samples; at least 16 are required for a harmonic fit")
    longest = float(np.max(np.diff(t)))
    if longest > 0.5 / frequency_Hz:
        raise NotDifferentiable(
            f"a gap of {longest:.3f} s in the displacement is longer than half a cycle ({0.5 / frequency_Hz:.3f} s)"
        )


def harmonic_columns(t: FloatArray, omega: float, orders: NDArray[np.int64]) -> FloatArray:
    """Columns 1, cos(k w t), sin(k w t) of the harmonics `orders`, shape (n, 2 K + 1)."""
    waves = _waves(t, omega, orders)
    design = np.ones((t.size, 2 * orders.size + 1))
    design[:, 1::2] = waves.real
    design[:, 2::2] = waves.imag
    return design


def _waves(t: FloatArray, omega: float, orders: NDArray[np.int64]) -> NDArray[np.complex128]:
    """exp(i k w t) of the harmonics `orders`, rising, shape (n, K): each from the one before by a product."""
    waves = np.empty((t.size, orders.size), np.complex128, order="F")
    first = np.exp(1j * omega * t)
    powers = {1: first}
    for column, step in enumerate(np.diff(orders, prepend=0).tolist()):
        if step not in powers:
            powers[step] = powers[step - 1] * first if step - 1 in powers else np.exp(1j * step * omega * t)
        waves[:, column] = powers[step] if column == 0 else waves[:, column - 1] * powers[step]
    return waves


def _fitted(
    t: FloatArray, u: FloatArray, omega: float, orders: NDArray[np.int64]
) -> tuple[float, FloatArray, FloatArray]:
    """Fit frequency (rad/s) and coefficients (m) by Gauss-Newton least squares; also return the residual (m)."""
    for _ in range(MOST_STEPS):
        coefficients, step, change = _solved(t, u, omega, orders)
        omega += step
        if abs(step) * float(t[-1] - t[0]) * float(orders[-1]) < SMALL_STEP:
            coefficients += change
            break
    else:
        coefficients = _solved(t, u, omega, orders)[0]
    return omega, coefficients, u - _series(t, omega, orders, coefficients)


def _solved(
    t: FloatArray, u: FloatArray, omega: float, orders: NDArray[np.int64]
) -> tuple[FloatArray, float, FloatArray]:
    """Coefficients (m), the next Gauss-Newton step of omega (rad/s), and its effect on the coefficients (m).

    The normal equations of the columns 1, cos(k w t), sin(k w t) contain only sums over harmonics. Those of the slope
    along omega are the same sums, weighted with each sample's phase and its square.
    """
    (normal, with_turns, with_squares), (right, right_with_turns) = normal_sums(_turns(t, omega), u, orders)
    coefficients = np.asarray(np.linalg.solve(normal, right), np.float64)
    slope = np.zeros(coefficients.size)  # columns times this and the phase: the change along omega, times omega / 2 pi
    slope[1::2], slope[2::2] = orders * coefficients[2::2], -orders * coefficients[1::2]
    cross = with_turns @ slope
    imitated = np.asarray(np.linalg.solve(normal, cross), np.float64)
    independent = float(slope @ with_squares @ slope) - float(cross @ imitated)
    if not independent > 0.0:
        return coefficients, 0.0, np.zeros_like(coefficients)
    step = float(slope @ (right_with_turns - with_turns @ coefficients)) / independent
    return coefficients, step * omega / (2.0 * np.pi), -step * imitated


def _turns(t: FloatArray, omega: float) -> FloatArray:
    """Phase (cycles) of times since the origin (s)."""
    return t * (omega / (2.0 * np.pi))


def _series(t: FloatArray, omega: float, orders: NDArray[np.int64], coefficients: FloatArray) -> FloatArray:
    """Series with coefficients of 1, cos(k w t), sin(k w t), at times since the origin (s), shape (n,)."""
    spectrum = np.zeros((1, int(orders[-1]) + 1), np.complex128)
    spectrum[0, 0], spectrum[0, orders] = coefficients[0], coefficients[1::2] - 1j * coefficients[2::2]
    (values,) = series_at(_turns(t, omega), spectrum)
    return np.asarray(values)


def velocity_of(time_s: FloatArray, displacement_m: FloatArray) -> tuple[FloatArray, str]:
    """Velocity (n,) in m/s and the method's name.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.

    Returns:
        NaN where the displacement is, and only there (a single sample has no velocity). The slope at the middle of a
        least-squares parabola over uniform samples is `sum(k x_k) / (dt sum(k^2))`; where a window's times are not
        uniform, the parabola is fitted at those times. At the ends, and beside a gap, it
        is the slope of the parabola through the nearest samples on that side.
    """
    velocity = np.full(len(time_s), np.nan)
    known = np.flatnonzero(np.isfinite(displacement_m))
    if len(known) < 2:
        return velocity, METHOD
    steps = np.diff(time_s[known])
    typical_s = float(np.median(steps))
    bounds = [0, *(np.flatnonzero(steps > GAP_STEPS * typical_s) + 1).tolist(), len(known)]
    for first, last in itertools.pairwise(bounds):
        rows = known[first:last]
        if len(rows) > 2:
            velocity[rows] = _stretch(time_s[rows], displacement_m[rows])
            continue
        beside = known[max(0, first - 1) : last + 1]
        velocity[rows] = np.polyfit(time_s[beside] - time_s[rows[0]], displacement_m[beside], 1)[0]
    return velocity, METHOD


def _stretch(time_s: FloatArray, displacement_m: FloatArray) -> FloatArray:
    """Velocity (m,) of at least three samples without a gap."""
    count = len(time_s)
    width = min(WIDTH, count)
    velocity = np.empty(count)
    if count >= WIDTH:
        offsets = np.arange(-HALF_WIDTH, HALF_WIDTH + 1, dtype=np.float64)
        spans_s = time_s[WIDTH - 1 :] - time_s[: count - WIDTH + 1]
        sums = np.correlate(displacement_m, offsets, "valid")
        inner = sums / float(np.sum(offsets**2)) / (spans_s / (WIDTH - 1))
        uneven = _uneven(time_s, spans_s)
        for at in range(0, len(uneven), WINDOWS_AT_A_TIME):
            windows = uneven[at : at + WINDOWS_AT_A_TIME]
            inner[windows] = _slopes(time_s, displacement_m, windows)
        velocity[HALF_WIDTH : count - HALF_WIDTH] = inner
    ends = ((slice(0, width), slice(0, HALF_WIDTH)), (slice(count - width, count), slice(-HALF_WIDTH, None)))
    for rows, rows_out in ends if count >= WIDTH else ((slice(0, count), slice(0, count)),):
        centre_s = float(np.mean(time_s[rows]))
        curve, slope, _ = np.polyfit(time_s[rows] - centre_s, displacement_m[rows], 2)
        velocity[rows_out] = slope + 2.0 * curve * (time_s[rows_out] - centre_s)
    return velocity


def _uneven(time_s: FloatArray, spans_s: FloatArray) -> NDArray[np.intp]:
    """First samples of the windows in which a step is not what it is on average."""
    steps_s = np.diff(time_s)
    windows = np.lib.stride_tricks.sliding_window_view(steps_s, WIDTH - 1)
    mean_s = spans_s / (WIDTH - 1)
    return np.flatnonzero(np.maximum(windows.max(axis=1) - mean_s, mean_s - windows.min(axis=1)) > UNIFORM * mean_s)


def _slopes(time_s: FloatArray, displacement_m: FloatArray, first: NDArray[np.intp]) -> FloatArray:
    """Slope, at the middle sample, of the parabola through each window that begins at `first` (k,)."""
    rows = first[:, None] + np.arange(WIDTH)
    t = time_s[rows] - time_s[first + HALF_WIDTH, None]
    scale_s = np.max(np.abs(t), axis=1)
    t /= scale_s[:, None]
    design = np.stack((np.ones_like(t), t, t * t), axis=2)
    x = displacement_m[rows] - displacement_m[first + HALF_WIDTH, None]
    normal, right = design.transpose(0, 2, 1) @ design, design.transpose(0, 2, 1) @ x[:, :, None]
    return np.asarray(np.linalg.solve(normal, right)[:, 1, 0] / scale_s, np.float64)
