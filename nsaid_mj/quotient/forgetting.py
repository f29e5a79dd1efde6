"""Directional forgetting: information is discounted only where new data renew it.

Exponential forgetting by a share g leaves (1 − g) G of the information G. In unexcited directions
it discards all information, and noise takes its place. With D ⪯ G the information of the new data,
every direction here loses min(g G, D): in directions without new data the information is kept, with
enough new data it is forgotten at the stated rate, and otherwise it loses no more than it gains
(Kulhavý, Automatica 23, 1987; Cao and Schwartz, Automatica 36, 2000).
"""

import numpy as np

from ..parameters import Array
from .matrices import common_root

_ABOVE = 2.0  # power of new data over their expected noise, from which they inform
_FLOOR = 1e-8  # share of a column's power below which a direction is forgotten more slowly


def forgetting(whole: Array, new: Array, noise: Array, lost: float) -> tuple[Array, float]:
    """Maps T (n, p, p) by which T G Tᵀ is kept of the information, and the mean share kept.

    `whole` (n, p, p) is G ⪰ D for every row of the momentum balance, `new` (n, p, p) D, `noise` (n,
    p, p) its part expected from noise, `lost` the share g.
    """
    maps, shares = np.repeat(np.eye(whole.shape[1])[None], len(whole), axis=0), [np.ones(1)]
    for i, (all_of, added, expected) in enumerate(zip(whole, new, noise, strict=True)):
        seen = np.diag(all_of) > 0
        part = np.ix_(seen, seen)
        floored = all_of[part] + _FLOOR * np.diag(np.diag(all_of[part]))
        root, renewed = common_root(floored, added[part] - _ABOVE * expected[part])
        share = np.maximum(1 - lost, 1 - np.clip(renewed, 0.0, 1.0))
        maps[i][part] -= np.linalg.solve(root.T, (root * (1 - np.sqrt(share))).T).T
        shares.append(share)
    return maps, float(np.mean(np.concatenate(shares[1:] if len(shares) > 1 else shares)))
