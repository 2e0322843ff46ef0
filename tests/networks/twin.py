"""An independent twin of the waves in a periodic network: forces of each contact, one by one, in
SI.

It shares nothing with the package but the names of a network's fields.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import granphon as gp


def cross_matrix(v: NDArray[Any]) -> NDArray[Any]:
    """Matrix of w -> v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def dynamical_matrix(network: gp.ContactNetwork, q: NDArray[Any]) -> NDArray[Any]:
    """D(q), (rad/s)^2, of all six motions (u, R_g phi) of each ball that moves, phases at the
    centres; q (3,) in 1/m.
    """
    moving = [ball for ball in range(network.n_balls) if np.isfinite(network.masses[ball])]
    stiffness = np.zeros((6 * network.n_balls,) * 2, complex)
    for c in range(network.n_contacts):
        i = int(network.i[c])
        j = int(network.j[c])
        n = network.normal[c]
        along = np.outer(n, n)
        across = np.eye(3) - np.outer(n, n)
        lever = -cross_matrix(n)
        apart = network.positions[j] + network.shift[c] @ network.cell - network.positions[i]
        # motions of j relative to i: the displacement at the contact, and the rotation
        ends = {i: np.zeros((6, 6), complex), j: np.zeros((6, 6), complex)}
        if not (np.isfinite(network.masses[i]) and np.isfinite(network.masses[j])):
            apart = np.zeros(3)
        for ball, sign, phase in ((i, -1.0, 1.0), (j, 1.0, np.exp(1j * q @ apart))):
            arm = network.arm_i[c] if sign < 0 else network.arm_j[c]
            block = np.zeros((6, 6), complex)
            block[:3, :3] = sign * np.eye(3)
            block[:3, 3:] = -arm * lever  # -(arm phi) x n, the surface of either ball
            block[3:, 3:] = sign * np.eye(3)
            ends[ball] = ends[ball] + phase * block
        load = network.normal_force[c] / network.distance[c] if network.prestress else 0.0
        springs = np.zeros((6, 6))
        springs[:3, :3] = network.normal_stiffness[c] * along + network.shear_stiffness[c] * across
        springs[3:, 3:] = (
            network.torsion_stiffness[c] * along + network.bending_stiffness[c] * across
        )
        balls = sorted(ends)
        whole = np.concatenate([ends[ball] for ball in balls], axis=1)
        energy = whole.conj().T @ springs @ whole
        moved = whole[:3].copy()
        for at in range(len(balls)):
            moved[:, 6 * at + 3 : 6 * at + 6] = 0.0
        if network.prestress and network.slip_levers != "arms":
            # slip has the radii as levers, and its force makes torques with the arms; by YADE it
            # counts displacements more than once
            more = np.zeros((3, 6 * len(balls)), complex)
            if network.slip_levers == "yade":
                surfaces = network.radii[i] + network.radii[j]
                more += (surfaces / (network.arm_i[c] + network.arm_j[c]) - 1.0) * moved
            for ball, arm, phase in (
                (i, network.arm_i[c], 1.0),
                (j, network.arm_j[c], np.exp(1j * q @ apart)),
            ):
                if np.isfinite(network.radii[ball]):
                    at = 6 * balls.index(ball) + 3
                    more[:, at : at + 3] -= phase * (network.radii[ball] - arm) * lever
            pulled = network.shear_stiffness[c] * whole[:3].conj().T @ across @ more
            energy += 0.5 * (pulled + pulled.conj().T)
        energy -= load * moved.conj().T @ across @ moved
        if network.prestress and network.tangential_force is not None:
            # the force stays across the normal as that turns, and its levers grow by half of the
            # elongation; the part of it that has no potential is left out
            force = network.tangential_force[c]
            levers = {i: [], j: []}
            turn = across @ moved[:3] / network.distance[c]
            elongation = n @ moved[:3]
            levers[i].append((network.arm_i[c], -1.0, 1.0))
            levers[j].append((network.arm_j[c], 1.0, np.exp(-1j * q @ apart)))
            follows = np.zeros_like(energy)
            for at, ball in enumerate(balls):
                for arm, sign, phase in levers[ball]:
                    push = sign * np.outer(n, force @ turn)
                    twist = -arm * cross_matrix(force) @ turn + 0.5 * np.outer(
                        np.cross(n, force), elongation
                    )
                    follows[6 * at : 6 * at + 6] += phase * np.concatenate([push, twist])
            if network.tangential_law == "yade":
                # it turns about the normal by the mean rotation of the balls
                mean = np.zeros(6 * len(balls), complex)
                for at, ball in enumerate(balls):
                    for _, _, phase in levers[ball]:
                        mean[6 * at + 3 : 6 * at + 6] += 0.5 * np.conj(phase) * n
                follows -= np.outer(whole[:3].conj().T @ np.cross(n, force), mean)
            energy += 0.5 * (follows + follows.conj().T)
        place = np.concatenate([6 * ball + np.arange(6) for ball in balls])
        stiffness[np.ix_(place, place)] += energy
    keep = np.concatenate([6 * ball + np.arange(6) for ball in moving])
    weight = (
        np.concatenate([np.repeat([network.masses[b], network.inertias[b]], 3) for b in moving])
        ** -0.5
    )
    return weight[:, None] * stiffness[np.ix_(keep, keep)] * weight
