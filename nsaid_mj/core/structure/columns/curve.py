"""Command curves of actuators: the share of its gain that a command gives."""

from ...numerics.kernels import f8, index, routine, vector
from ..parts import Column


@routine(f8(vector, index, f8))
def follow_curve(c, at, u):
    """The curve at a command u.

    At c[at], k > 0 is the number of coefficients of u, u|u|, u³, u³|u| … that follow; −k is the
    number of points of a table, whose commands and then values follow.
    """
    count = int(c[at])
    if count >= 0:
        total = 0.0
        size = abs(u)
        for i in range(at + count, at, -1):
            total = total * size + c[i]
        return total * u
    first = at + 1
    last = at - count
    if u <= c[first]:
        return c[first - count]
    for i in range(first + 1, last + 1):
        if u <= c[i]:
            share = (u - c[i - 1]) / (c[i] - c[i - 1])
            return c[i - 1 - count] + share * (c[i - count] - c[i - 1 - count])
    return c[last - count]


LINEAR = Column.polynomial(1.0)
SQUARED = Column.polynomial(0.0, 1.0)
"""The curves u, and u|u| of a rotor whose command is its speed."""
