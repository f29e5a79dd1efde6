"""Identified values for the tests: physical ones that differ from those of the file."""

import numpy as np

from nsaid_mj.robots.identified import Identified, inertial_parameters, with_inertias


def identified(robot, seed=0):
    rng, n = np.random.default_rng(seed), len(robot.joints)
    scaled = inertial_parameters(robot.model) * rng.uniform(0.5, 2, (n, 1))
    return Identified(
        with_inertias(robot.model, scaled, rng.uniform(0.01, 0.2, n)),
        damping=rng.uniform(0.1, 3, n),
        friction=rng.uniform(0.1, 2, n),
        friction_speed=np.full(n, 0.02),
        gain=rng.uniform(5, 50, n),
        anchor="mass of link_2 -- 1.2 kg, weighed",
        notes=("A delay of 12 ms was found.",),
    )


def same_inertias(one, two):
    a, b = inertial_parameters(one), inertial_parameters(two)
    return np.abs(a - b).max() < 1e-9 * np.abs(a).max()
