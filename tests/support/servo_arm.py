"""A planar arm of position servos, by Lagrange's equations in absolute angles, in plain numpy.

Link k turns by φ_k = q_1 + … + q_k in a vertical plane; T = ½ Σ m_k |ċ_k|² + ½ Σ I_k φ̇_k². With
a_ki = l_i for i < k, r_k for i = k and 0 beyond, Lagrange's equations in φ are, row i,

    Σ_j H_ij (cos(φ_i − φ_j) φ̈_j + sin(φ_i − φ_j) φ̇_j²) + I_i φ̈_i + g cos φ_i Σ_k m_k a_ki = Q_i,

with H_ij = Σ_k m_k a_ki a_kj. A servo exerts kp clip(u − q) between neighbours; the motor's
inertia, damping and dry friction act on q̇. After Spong, Hutchinson and Vidyasagar, Robot Modeling
and Control (2006), chapter 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsaid_mj.core.parameters import Array
from nsaid_mj.core.structure.parts import Body, Column, Inertia, Rotor
from nsaid_mj.core.structure.structure import Structure

GRAVITY = 9.81


@dataclass(frozen=True)
class ServoArm:
    """Numbers of an arm of k links, each an array (k,).

    Attributes:
        mass: of the links [kg].
        length: of the links [m].
        centre: distance of the centres of mass from the joints, along the links [m].
        inertia: about the centres of mass [kg·m²].
        armature: rotor inertias [kg·m²].
        damping: [N·m·s/rad].
        friction: dry friction [N·m].
        kp: of the servos [N·m/rad].
        limit: largest error of position that the servos respond to [rad].
        speed: at which dry friction saturates [rad/s].
    """

    mass: Array
    length: Array
    centre: Array
    inertia: Array
    armature: Array
    damping: Array
    friction: Array
    kp: Array
    limit: float = 0.9
    speed: float = 0.05

    def acceleration(self, q: Array, v: Array, u: Array) -> Array:
        """(k,) q̈ by Lagrange's equations."""
        k = len(self.mass)
        sums = np.tril(np.ones((k, k)))  # φ = sums q
        a = np.tril(np.tile(self.length, (k, 1)), -1) + np.diag(self.centre)
        H = a.T @ (self.mass[:, None] * a)
        phi, rate = sums @ q, sums @ v
        apart = phi[:, None] - phi[None, :]
        M = sums.T @ (H * np.cos(apart) + np.diag(self.inertia)) @ sums + np.diag(self.armature)
        turning = sums.T @ (H * np.sin(apart) @ rate**2)
        weight = sums.T @ (GRAVITY * np.cos(phi) * (self.mass @ a))
        torque = self.kp * np.clip(u - q, -self.limit, self.limit) - self.damping * v
        torque -= self.friction * np.tanh(v / self.speed)
        return np.asarray(np.linalg.solve(M, torque - turning - weight), dtype=np.float64)

    def structure(self) -> Structure:
        """The arm as a structure: θ = [links (10 k), rotors, damping, friction, kp]."""
        k = len(self.mass)
        axis = (0.0, -1.0, 0.0)  # x along the link, z up at q = 0: turning lifts
        bodies = [
            Body("hinge", i - 1, axis, np.eye(3), (self.length[i - 1] if i else 0.0, 0, 0))
            for i in range(k)
        ]
        columns = [Column("viscous", 11 * k + i, dof=i) for i in range(k)]
        columns += [Column("coulomb", 12 * k + i, dof=i, speed=self.speed) for i in range(k)]
        columns += [Column("servo", 13 * k + i, dof=i, input=i, limit=self.limit) for i in range(k)]
        return Structure(
            bodies,
            [Inertia(i, 10 * i) for i in range(k)],
            columns,
            14 * k,
            k,
            [Rotor(i, 10 * k + i) for i in range(k)],
            (0.0, 0.0, -GRAVITY),
        )

    @property
    def theta(self) -> Array:
        """(14 k,) its parameters."""
        links = []
        for m, r, own in zip(self.mass, self.centre, self.inertia, strict=True):
            links += [m, m * r, 0, 0, 0.3 * own, 0, own + m * r * r, 0, 0, own + m * r * r]
        return np.concatenate([links, self.armature, self.damping, self.friction, self.kp])
