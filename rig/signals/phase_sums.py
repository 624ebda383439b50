"""Harmonic sums of samples, and series at arbitrary times, in time proportional to the number of samples.

A sample at phase x (cycles) lies within half a step of the nearest of M equal phases x_g, and with d = x - x_g

    exp(2 pi i j x) = exp(2 pi i j x_g) sum over p of (2 pi i j d)^p / p!

so that `sum w exp(2 pi i j x)` for all orders j is a transform of M folded sums `sum w d^p` for each of a few p (a
non-uniform fast Fourier transform by Taylor's series; Anderson and Dahleh 1996). A series is evaluated with the
transposed steps. The number of powers keeps the error below `ACCURACY` times the sum of |w|.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import ComplexArray, FloatArray

CHUNK = 1 << 16
ACCURACY = 1e-14
FEWEST_PHASES, MOST_PHASES = 4, 64
"""Phases per order; with more samples, more phases and fewer powers are faster."""


def phase_sums(
    turns: FloatArray, columns: tuple[FloatArray | None, ...], highest: int, powers: int = 0
) -> ComplexArray:
    """`sum of column turns^q exp(2 pi i j turns)` of each column, for q up to `powers` and j up to `highest`.

    Args:
        turns: phases of the samples (cycles), shape (n,).
        columns: (n,) each; None for ones.
        highest: highest order j.
        powers: highest power q of the phase that multiplies the column.

    Returns:
        Shape (columns, powers + 1, highest + 1).
    """
    phases, terms = _grid(turns.size, highest)
    folded = np.zeros((len(columns), powers + 1, terms, phases))
    for part in _chunks(turns.size):
        turn = turns[part]
        nearest, offset = _nearest(turn, phases)
        for column, sums in zip(columns, folded, strict=True):
            weight = np.ones(turn.size) if column is None else column[part]
            for power in range(powers + 1):
                weight = weight * turn if power else weight
                product = weight
                for term in range(terms):
                    product = product * offset if term else product
                    sums[power, term] += np.bincount(nearest, product, phases)
    spectra = np.conj(np.fft.rfft(folded, axis=-1)[..., : highest + 1])
    return np.asarray(np.einsum("cptj,tj->cpj", spectra, _taylor(highest, terms)))


def series_at(turns: FloatArray, spectra: ComplexArray) -> FloatArray:
    """`Re sum over j of spectrum[j] exp(2 pi i j turns)` of each spectrum.

    Args:
        turns: phases of the samples (cycles), shape (n,).
        spectra: (s, highest + 1), complex.

    Returns:
        Shape (s, n).
    """
    highest = spectra.shape[-1] - 1
    phases, terms = _grid(turns.size, highest)
    half = np.zeros((len(spectra), terms, phases // 2 + 1), np.complex128)
    half[..., : highest + 1] = 0.5 * spectra[:, None, :] * _taylor(highest, terms)
    half[..., 0] = half[..., 0].real * 2.0
    tables = np.fft.irfft(half, phases, axis=-1) * phases
    values = np.empty((len(spectra), turns.size))
    for part in _chunks(turns.size):
        nearest, offset = _nearest(turns[part], phases)
        for table, value in zip(tables, values[:, part], strict=True):
            value[:] = table[-1][nearest]
            for term in range(terms - 2, -1, -1):
                value *= offset
                value += table[term][nearest]
    return values


def normal_sums(turns: FloatArray, values: FloatArray, orders: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """The normal equations of the columns 1, cos(2 pi k turns), sin(2 pi k turns), weighted by powers of the phase.

    Args:
        turns: phases of the samples (cycles), shape (n,).
        values: samples, shape (n,).
        orders: k, rising, shape (K,).

    Returns:
        Sums of turns^q times the products of two columns for q = 0, 1, 2, shape (3, 2 K + 1, 2 K + 1), and of turns^q
        times column and value for q = 0, 1, shape (2, 2 K + 1); each order's cosine is before its sine.
    """
    highest = int(orders[-1])
    products = [_products(sums, orders) for sums in phase_sums(turns, (None,), 2 * highest, 2)[0]]
    columns = [_columns(sums, orders) for sums in phase_sums(turns, (values,), highest, 1)[0]]
    return np.array(products), np.array(columns)


def _columns(sums: ComplexArray, orders: NDArray[np.int64]) -> FloatArray:
    """Sums of each column, (2 K + 1,), from those of exp(2 pi i j turns) for j up to the highest order."""
    columns = np.empty(2 * orders.size + 1)
    columns[0], columns[1::2], columns[2::2] = sums[0].real, sums[orders].real, sums[orders].imag
    return columns


def _products(sums: ComplexArray, orders: NDArray[np.int64]) -> FloatArray:
    """Sums of products of two columns, (2 K + 1, 2 K + 1), from those of exp(2 pi i j turns) up to twice the order."""
    apart = orders[:, None] - orders
    added, less = sums[orders[:, None] + orders], sums[np.abs(apart)]
    lower_sine = np.sign(apart) * less.imag
    products = np.empty((2 * orders.size + 1, 2 * orders.size + 1))
    products[0] = products[:, 0] = _columns(sums, orders)
    products[1::2, 1::2] = 0.5 * (less.real + added.real)
    products[2::2, 2::2] = 0.5 * (less.real - added.real)
    products[2::2, 1::2] = 0.5 * (added.imag + lower_sine)
    products[1::2, 2::2] = products[2::2, 1::2].T
    return products


def _grid(count: int, highest: int) -> tuple[int, int]:
    """Number of equal phases per cycle for a number of samples, and number of powers of the distance from them."""
    order = max(1, highest)
    wanted = min(max(FEWEST_PHASES * order, count // 2), MOST_PHASES * order)
    phases = 1 << math.ceil(math.log2(max(wanted, 8)))
    reach, error, terms = math.pi * order / phases, 1.0, 0
    while error > ACCURACY:
        terms += 1
        error *= reach / terms
    return phases, terms


def _nearest(turn: FloatArray, phases: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Nearest of the equal phases for each sample (n,), and the distance from it (cycles)."""
    place = turn * phases
    whole = np.rint(place)
    place -= whole
    place /= phases
    return whole.astype(np.int64) & (phases - 1), place


def _taylor(highest: int, terms: int) -> ComplexArray:
    """`(2 pi i j)^p / p!`, shape (terms, highest + 1)."""
    rate = 2j * np.pi * np.arange(highest + 1)
    rows = np.ones((terms, highest + 1), np.complex128)
    for term in range(1, terms):
        rows[term] = rows[term - 1] * rate / term
    return rows


def _chunks(count: int) -> Iterator[slice]:
    for start in range(0, count, CHUNK):
        yield slice(start, min(start + CHUNK, count))
