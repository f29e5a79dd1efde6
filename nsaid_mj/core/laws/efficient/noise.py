"""Estimates the sensors' noise levels from the data.

A smooth signal, sampled at a constant rate, has a negligible fourth difference. That of its
measurements is then the noise's alone, and has C(8, 4) = 70 times the variance of the noise.
"""

from typing import NamedTuple

import numpy as np
from numba import types

from ...numerics.kernels import helper, kernel, matrix, vector, void
from ...parameters import Array

MEMORY = 2000.0
"""Samples over which the noise is averaged."""
_SMALLEST = 1e-6  # least standard deviation of the noise [rad or m, rad/s or m/s]


class Noise(NamedTuple):
    """Running estimate of the sensors' noise."""

    increments: Array  # (3, 2n) the last increments of position and velocity
    variance: Array  # (2n,) variance of the noise [rad² or m², (rad/s)² or (m/s)²]
    count: Array  # (2n,) fourth differences used; those of a constant signal are not
    seen: Array  # (1,) number of increments so far


NOISE = types.NamedTuple((matrix, vector, vector, vector), Noise)


@kernel(void(NOISE, vector), inner=True)
def add_increment(noise, increment):
    """Updates the estimate of the noise by an increment (2n,) of position and velocity."""
    increments, variance, count, seen = noise
    for i in range(increment.shape[0]):
        fourth = increment[i] - 3 * increments[2, i] + 3 * increments[1, i] - increments[0, i]
        if seen[0] >= 3 and fourth != 0.0:
            count[i] += 1
            share = 1.0 / min(count[i], MEMORY)
            variance[i] += share * (fourth * fourth / 70 - variance[i])
        increments[0, i], increments[1, i] = increments[1, i], increments[2, i]
        increments[2, i] = increment[i]
    seen[0] += 1


@helper(void(NOISE, vector))
def write_variance(noise, R):
    """Writes `noise_variance` into R (2n,)."""
    for i in range(R.shape[0]):
        R[i] = max(noise.variance[i], _SMALLEST * _SMALLEST)


def noise_variance(noise: Noise) -> Array:
    """(2n,) R, bounded below by rounding errors."""
    return np.maximum(noise.variance, _SMALLEST * _SMALLEST)
