"""Gramians of rows Y with Y θ = 0 for every true θ: means over blocks in time, or plain sums.

Directional forgetting: information is forgotten only where new data renew it. Ordinary exponential
forgetting by a share g leaves (1 − g) G of the information G; in unexcited directions it discards
everything in the end, and noise takes its place. Here every direction loses min(g G, D), with
D ⪯ G the information of the new data. So a direction without new data keeps its information, one
with enough new data forgets at the stated rate, and others lose no more than they gain (Kulhavý,
Automatica 23, 1987; Cao and Schwartz, Automatica 36, 2000).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numerics.kernels import cube, f8, kernel, matrix, vector, void
from ..parameters import Array
from .matrices import common_root

_ABOVE = 2.0  # power of new data over their expected noise, from which they inform
_FLOOR = 1e-8  # share of a column's power below which a direction is forgotten more slowly
_TOGETHER = 0.25  # share of the horizon whose blocks are treated together in forgetting


class Sums(NamedTuple):
    """Gramians that add over parts of a log."""

    sums: Array  # (n, p, p) Σ Y_iᵀ Y_i over the usable rows of velocity i
    counts: Array  # (n,) number of these rows

    @staticmethod
    def of(rows: Array, usable: NDArray[np.bool_]) -> Sums:
        """The Gramians of rows (N, n, p), of which a mask (N, n) marks the usable ones."""
        used = (rows[mask, i] for i, mask in enumerate(usable.T))
        return Sums(np.array([Y.T @ Y for Y in used]), usable.sum(axis=0).astype(float))

    @property
    def means(self) -> Array:
        """(n, p, p) mean Gramians; 0 where there are no rows."""
        return self.sums / np.maximum(self.counts, 1.0)[:, None, None]

    def __sub__(self, other: Sums) -> Sums:
        return Sums(self.sums - other.sums, self.counts - other.counts)

    def __add__(self, other: Sums) -> Sums:  # pyright: ignore[reportIncompatibleMethodOverride]
        return Sums(self.sums + other.sums, self.counts + other.counts)


class Means(NamedTuple):
    """Means over blocks, with directional forgetting if there is a horizon."""

    fade: float  # factor by which information decreases per block where blocks renew it
    blocks: float  # effective number of blocks
    gramian: Array  # (n, p, p) mean over the blocks of every row's Yᵀ Y
    lagged: Array  # (n, p, p) mean of Yᵀ Y′, symmetrised, with Y′ the preceding block
    last: Array  # (n, p) the kept part of the last completed block; 0 after a restart
    noise: Array  # (n, p, p) mean of N_i, the expected effect of the sensors' noise on `gramian`
    recent: Array  # (n, p, p) sum of Yᵀ Y since the last forgetting
    since: int = 0  # number of blocks in it

    def of_innovations(self, rho: Array, own: Array, lagged: Array, last: Array) -> Array:
        """(n,) mean squares of the innovation Y − ρ Y′, from sufficient statistics.

        own (n,) is the mean of Y², lagged (n,) that of Y Y′, last (n,) the square of the last
        block, and rho (n,) the correlation of neighbouring blocks. The mean of Y′² is that of Y²
        without the last block.
        """
        return (1 + rho**2) * own - 2 * rho * lagged - rho**2 / max(self.blocks, 1.0) * last

    def innovations(self, rho: Array) -> Array:
        """(n, p, p) mean of (Y − ρ Y′)ᵀ (Y − ρ Y′), with ρ (n,) the correlation of neighbours."""
        found = np.empty_like(self.gramian)
        _innovate(rho, 1 / max(self.blocks, 1.0), self.last, self.gramian, self.lagged, found)
        return found

    @staticmethod
    def empty(n: int, p: int, fade: float) -> Means:
        """The means before any block."""
        flat = np.zeros((n, p))
        cube = np.zeros((n, p, p))
        return Means(fade, 0.0, cube, cube, flat, cube, cube)

    def with_blocks(self, rows: Array, before: Array, noise: Array) -> Means:
        """The means after k further blocks, rows (k, n, p), each with noise N_i (n, p, p).

        before (k, n, p) are the blocks that precede them.
        """
        if not len(rows):
            return self
        blocks = self.blocks + len(rows)
        gramian = np.empty_like(self.gramian)
        lagged = np.empty_like(self.lagged)
        _add_products(self.blocks, rows, rows, self.gramian, gramian)
        _add_products(self.blocks, rows, before, self.lagged, lagged)
        if noise is not self.noise:
            noise = self.noise + len(rows) / blocks * (noise - self.noise)
        means = Means(self.fade, blocks, gramian, lagged, rows[-1], noise, self.recent, self.since)
        return means if self.fade == 1 else means.renewed_by(rows)

    def renewed_by(self, rows: Array) -> Means:
        """The means, which contain the last blocks (k, n, p), after forgetting what they renew.

        The blocks of a share of the horizon count together: those of an interval have less rank
        than a motion.
        """
        recent = self.recent + np.matmul(rows.transpose(1, 2, 0), rows.transpose(1, 0, 2))
        since = self.since + len(rows)
        if since < -_TOGETHER / np.log(self.fade):
            return self._replace(recent=recent, since=since)
        lost = 1 - self.fade**since
        expected = since * self.noise
        maps, share = forgetting(self.blocks * self.gramian, recent, expected, lost)
        back = maps.transpose(0, 2, 1)

        def part(mean: Array) -> Array:
            found = maps @ mean @ back / share
            return 0.5 * (found + found.transpose(0, 2, 1))

        return self._replace(
            blocks=share * self.blocks,
            gramian=part(self.gramian),
            lagged=part(self.lagged),
            last=(maps @ self.last[:, :, None])[:, :, 0],
            noise=part(self.noise),
            recent=0 * recent,
            since=0,
        )


def forgetting(whole: Array, new: Array, noise: Array, lost: float) -> tuple[Array, float]:
    """Maps T (n, p, p) by which T G Tᵀ is kept of the information, and the mean share kept.

    `whole` (n, p, p) is G ⪰ D for every row of the momentum balance, `new` (n, p, p) D, `noise` (n,
    p, p) its part expected from noise, `lost` the share g.
    """
    maps = np.repeat(np.eye(whole.shape[1])[None], len(whole), axis=0)
    shares = [np.ones(1)]
    for i, (all_of, added, expected) in enumerate(zip(whole, new, noise, strict=True)):
        seen = np.diag(all_of) > 0
        part = np.ix_(seen, seen)
        floored = all_of[part] + _FLOOR * np.diag(np.diag(all_of[part]))
        root, renewed = common_root(floored, added[part] - _ABOVE * expected[part])
        share = np.maximum(1 - lost, 1 - np.clip(renewed, 0.0, 1.0))
        maps[i][part] -= np.linalg.solve(root.T, (root * (1 - np.sqrt(share))).T).T
        shares.append(share)
    return maps, float(np.mean(np.concatenate(shares[1:] if len(shares) > 1 else shares)))


@kernel(void(f8, cube, cube, cube, cube))
def _add_products(old, rows, others, kept, found):
    """Writes the mean of `old` products, kept (n, p, p), and of Yᵀ Y′, symmetrised, into found.

    rows (k, n, p) are Y, others (k, n, p) Y′.
    """
    number, n, p = rows.shape
    share = old / (old + number)
    half = 0.5 / (old + number)
    for i in range(n):
        for a in range(p):
            for b in range(p):
                found[i, a, b] = share * kept[i, a, b]
        for k in range(number):
            for a in range(p):
                own = rows[k, i, a]
                other = others[k, i, a]
                for b in range(p):
                    found[i, a, b] += half * (own * others[k, i, b] + other * rows[k, i, b])


@kernel(void(vector, f8, matrix, cube, cube, cube))
def _innovate(rho, share, last, own, lagged, found):
    """Writes (n, p, p) mean squares of Y − ρ Y′; `share` is that of one block."""
    n, p = last.shape
    for i in range(n):
        one = 1.0 + rho[i] * rho[i]
        two = 2.0 * rho[i]
        three = rho[i] * rho[i] * share
        for a in range(p):
            past = three * last[i, a]
            for b in range(p):
                found[i, a, b] = one * own[i, a, b] - two * lagged[i, a, b] - past * last[i, b]
