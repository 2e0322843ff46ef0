"""The edges of chains, membranes and crystals in space, one case each, see :mod:`extreme_cases`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Any

import mpmath
import numpy as np
from mpmath import mpf

import granphon as gp
from tests.extreme_cases import (
    STEEL,
    THIN,
    Case,
    D,
    against_sparse,
    balance,
    coefficient,
    grid,
    off,
)

#: P d^(p - 1)/f
FACTORS = {
    "chain": 1,
    "square": 1,
    "sc": 1,
    "bcc": mpmath.sqrt(3),
    "fcc": 2 * mpmath.sqrt(2),
    "hcp": 2 * mpmath.sqrt(2),
}
SIZES = (1e-300, 1e-150, 1e-60, 1e-30, 1e-12, 1e-6, 1e-3, 0.3)


def balls(lattice: str, **more: Any) -> Any:
    """Packings of all sizes and materials on a lattice."""
    for d, young, sigma in grid((1e-9, D, 1e3), (1.0, 211.65e9, 1e13), (-0.999999, 0.276, 0.5)):
        yield gp.Packing(gp.Material(young, sigma, 7840.0), d, lattice=lattice, **more)


def pressures() -> Iterator[float]:
    for name, factor in FACTORS.items():
        for packing in balls(name):
            medium = gp.AveragedLattice(packing)
            c = coefficient(packing)
            d = mpf(packing.diameter)
            power = packing.structure.periods - 1
            for part in (1e-40, 1e-10, 1e-2):
                f = mpf(part * packing.material.young_modulus * packing.diameter**2)
                state = medium.at_pressure(float(factor * f / d**power))
                yield off(state.force, mpf(state.pressure) * d**power / factor)
                yield off(state.overlap, (mpf(state.force) / c) ** (mpf(2) / 3))


def sound() -> Iterator[float]:
    """Along [100] and [110] of fcc, by the constants of Duffy and Mindlin; of sc along [100]; of a
    chain.
    """
    for friction in (True, False):
        for packing in balls("fcc", friction=friction):
            unit = packing.material.young_modulus * packing.diameter**2
            sigma = mpf(packing.material.poisson_ratio)
            eta = 2 * (1 - sigma) / (2 - sigma) if friction else mpf(0)
            for part in (1e-40, 1e-10, 1e-2):
                state = gp.AveragedLattice(packing).at_force(part * unit)
                d = mpf(packing.diameter)
                k = mpf(state.normal_stiffness)
                root = mpmath.sqrt(2)
                mass = mpmath.pi / 6 * mpf(packing.material.density) * mpf(packing.diameter) ** 3
                c11 = root * (1 + eta) * k / d
                c12 = (1 - eta) * k / (root * d)
                c44 = c11 / 2
                density = mass * root / d**3
                moduli = gp.moduli(state)
                found = gp.sound_velocities(state, [(1, 0, 0), (1, 1, 0)])
                pairs = [
                    (moduli.tensor[0, 0], c11),
                    (moduli.tensor[3, 3], c44),
                    (moduli.bulk, (c11 + 2 * c12) / 3),
                    (found.longitudinal[0], mpmath.sqrt(c11 / density)),
                    (found.transverse[0, 0], mpmath.sqrt(c44 / density)),
                    (found.longitudinal[1], mpmath.sqrt((c11 + c12 + 2 * c44) / 2 / density)),
                    (found.transverse[1, 0], mpmath.sqrt(min((c11 - c12) / 2, c44) / density)),
                    (found.transverse[1, 1], mpmath.sqrt(max((c11 - c12) / 2, c44) / density)),
                ]
                yield from (off(one, exact) for one, exact in pairs)
    for packing in balls("chain"):
        state = gp.AveragedLattice(packing).at_force(
            1e-10 * packing.material.young_modulus * packing.diameter**2
        )
        d = mpf(packing.diameter)
        k = mpf(state.normal_stiffness)
        mass = mpmath.pi / 6 * mpf(packing.material.density) * d**3
        yield off(gp.moduli(state).bulk, k * d)
        yield off(gp.sound_velocities(state).longitudinal, d * mpmath.sqrt(k / mass))


def branches_of_fcc() -> Iterator[float]:
    """Along [100]: omega^2 = 8 (1 + eta) sin^2 h, h = |q|d/(2 sqrt 2), and twist about [100], which
    decouple by symmetry.
    """
    for eta, size in itertools.product((0.0, 1e-300, 1e-16, 1e-3, 0.84, 4.0 / 3.0), SIZES):
        found = gp.ContactLattice.of("fcc", eta).frequencies([[size, 0.0, 0.0]])[0]
        with mpmath.workdps(400):
            h = mpf(size) / (2 * mpmath.sqrt(2))
            exact = mpmath.sqrt(8 * (1 + mpf(eta))) * mpmath.sin(h)
            yield min(off(one, exact) for one in found)


def bending_waves() -> Iterator[float]:
    """The transverse-rotational pair of a chain with bending: the determinant of 2 x 2 matrices at
    many digits.
    """
    for size, eta, bending in grid(SIZES[2:], (1e-3, 0.84, 4.0 / 3.0), (1e-12, 1e-3, 1.0)):
        lattice = gp.ContactLattice.of(
            "chain",
            eta,
            bending=bending,
            motions=gp.Packing(
                STEEL, D, lattice="chain", motions="in_plane", bending=bending
            ).ball_motions,
        )
        found = np.sort(lattice.frequencies([[size]])[0])
        with mpmath.workdps(400):
            h = mpf(size) / 2
            n = mpf(eta)
            b = mpf(bending)
            # slip 2 i sin(h) u - cos(h) phi, roll 2 i sin(h) phi, and phi = w sqrt(10)
            trace = (
                n * (4 * mpmath.sin(h) ** 2 + 10 * mpmath.cos(h) ** 2) + 40 * b * mpmath.sin(h) ** 2
            )
            product = 4 * n * mpmath.sin(h) ** 2 * 40 * b * mpmath.sin(h) ** 2
            high = (trace + mpmath.sqrt(trace**2 - 4 * product)) / 2
            exact = sorted([mpmath.sqrt(product / high), mpmath.sqrt(high), 2 * mpmath.sin(h)])
            yield from (off(a, c) for a, c in zip(found, exact, strict=True))


def membranes() -> Iterator[float]:
    """The product of the frequencies of a triangular layer out of its plane, sqrt(10 sqrt 3 ... )
    eta^(3/2) sin sin sin.
    """
    for eta, size, angle in grid((1e-3, 0.84, 4.0 / 3.0), SIZES[3:], (0.0, 0.1, 0.4)):
        packing = gp.Packing(STEEL, D, motions="out_of_plane")
        q = size * np.array([math.cos(angle), math.sin(angle)])
        found = gp.ContactLattice.of("triangular", eta, motions=packing.ball_motions).frequencies(
            [q]
        )[0]
        with mpmath.workdps(400):
            x, y = (mpf(float(one)) for one in q)
            half = [x / 2, (x + mpmath.sqrt(3) * y) / 4, (-x + mpmath.sqrt(3) * y) / 4]
            exact = (
                10
                * mpmath.sqrt(3)
                * mpf(eta) ** mpf(1.5)
                * abs(mpmath.fprod(mpmath.sin(one) for one in half))
            )
            yield off(1.0, exact / mpmath.fprod(mpf(float(one)) for one in found))


def free_branches() -> Iterator[float]:
    """Branches that cost nothing are zeros to the last bit, at every wave vector."""
    cases = (
        ("chain", "all", 3),
        ("square", "out_of_plane", 1),
        ("honeycomb", "out_of_plane", 3),
        ("kagome", "all", 3),
    )
    for (name, motions, count), eta in grid(cases, (1e-300, 0.84, 4.0 / 3.0)):
        packing = gp.Packing(STEEL, D, lattice=name, motions=motions)
        lattice = gp.ContactLattice.of(name, eta, motions=packing.ball_motions)
        for size in SIZES:
            q = size * np.array([0.6, 0.8])[: packing.structure.periods]
            yield float(np.max(lattice.frequencies([q])[0][:count]))


def hexagonal_sound() -> Iterator[float]:
    """hcp along c, where its layers are those of fcc along [111]; its bulk modulus, which is that
    of fcc.
    """
    for friction in (True, False):
        for packing in balls("hcp", friction=friction):
            sigma = mpf(packing.material.poisson_ratio)
            eta = 2 * (1 - sigma) / (2 - sigma) if friction else mpf(0)
            for part in (1e-40, 1e-10, 1e-2):
                state = gp.AveragedLattice(packing).at_force(
                    part * packing.material.young_modulus * packing.diameter**2
                )
                d = mpf(packing.diameter)
                k = mpf(state.normal_stiffness)
                root = mpmath.sqrt(2)
                mass = mpmath.pi / 6 * mpf(packing.material.density) * mpf(packing.diameter) ** 3
                c33 = root * (4 + 2 * eta) / 3 * k / d
                c44 = root * (1 + 2 * eta) / 3 * k / d
                density = mass * root / d**3
                found = gp.sound_velocities(state, (0, 0, 1))
                yield off(gp.moduli(state).bulk, 2 * root / 3 * k / d)
                yield off(found.longitudinal, mpmath.sqrt(c33 / density))
                yield from (off(one, mpmath.sqrt(c44 / density)) for one in found.transverse)


def finite_overlaps() -> Iterator[float]:
    """Along [100] of fcc without friction, and along a chain, with prestress p = f/(k a) = (2/3)
    delta/(d - delta).

    Cauchy and Born's sums: v_L^2 = (1 - p) a^2 k/M and v_T^2 = (1 - 3 p) a^2 k/2M in fcc, which
    buckles where p is above 1/7, that is delta above 3/17 d; v_L^2 = a^2 k/M on a chain.
    """
    for name, part in itertools.product(("fcc", "chain"), (1e-40, 1e-8, 0.17)):
        for packing in balls(name, friction=False):
            state = gp.AveragedLattice(packing).at_overlap(
                part * packing.diameter, finite_overlap=True
            )
            d = mpf(packing.diameter)
            delta = mpf(state.overlap)
            k = mpf(state.normal_stiffness)
            mass = mpmath.pi / 6 * mpf(packing.material.density) * d**3
            push = 2 * delta / (3 * (d - delta))
            unit = (d - delta) * mpmath.sqrt(k / mass)
            found = gp.sound_velocities(state, (1, 0, 0)[: packing.structure.periods])
            if name == "chain":
                yield off(found.longitudinal, unit)
                continue
            yield off(found.longitudinal, unit * mpmath.sqrt(1 - push))
            yield from (
                off(one, unit * mpmath.sqrt((1 - 3 * push) / 2)) for one in found.transverse
            )


def torsions() -> Iterator[float]:
    """k_t/(k d^2) = (1 - nu)/3 delta/d of a Hertz contact that does not slip."""
    for name in ("fcc", "chain"):
        for packing in balls(
            name, torsion="mindlin", **({"motions": "all"} if name == "chain" else {})
        ):
            for part in (1e-40, 1e-10, 1e-2):
                state = gp.AveragedLattice(packing).at_force(
                    part * packing.material.young_modulus * packing.diameter**2
                )
                ratio = (
                    (1 - mpf(packing.material.poisson_ratio))
                    / 3
                    * mpf(state.overlap)
                    / mpf(packing.diameter)
                )
                yield off(state.torsion, ratio)


def group_velocities() -> Iterator[float]:
    """Of sound near Gamma: on a chain, and along [110] of fcc by the constants of Duffy and
    Mindlin.
    """
    along = np.array([1.0, 1.0, 0.0]) / math.sqrt(2.0)
    for eta, size in itertools.product(
        (0.0, 1e-3, 0.84, 4.0 / 3.0), (0.0, 1e-300, 1e-150, 1e-30, 1e-12, 1e-9)
    ):
        row = gp.ContactLattice.of(
            "chain", eta, motions=gp.Packing(STEEL, D, lattice="chain").ball_motions
        )
        yield off(row.modes([[size]], [1.0]).group_velocities[0, 0, 0], mpf(1))
        modes = gp.ContactLattice.of("fcc", eta).modes([size * along], along)
        n = mpf(eta)
        found = np.sort((modes.group_velocities[0] @ along)[modes.rotational_fraction[0] < 0.5])
        exact = sorted([(1 + 3 * n) / 4, (1 + n) / 2, (5 + 3 * n) / 4])
        yield from (off(a, mpmath.sqrt(b)) for a, b in zip(found, exact, strict=True))


def pulses() -> Iterator[float]:
    """On a chain omega = 2 sin(q/2), along [100] of fcc omega = (8 (1 + eta))^(1/2) sin(q/8^(1/2)):
    q, and d omega/dq.
    """
    for name, friction in itertools.product(("chain", "fcc"), (True, False)):
        packing = gp.Packing(STEEL, D, lattice=name, friction=friction)
        state = gp.AveragedLattice(packing).at_force(18.0)
        unit = math.sqrt(state.normal_stiffness / packing.mass)
        root = mpf(2) if name == "chain" else mpmath.sqrt(8)
        top = root * (1 if name == "chain" else mpmath.sqrt(1 + mpf(packing.mindlin_ratio)))
        for part in (1e-150, 1e-60, 1e-12, 1e-6, 1e-3, 0.3, 0.9):
            frequency = part * float(top) * unit / (2.0 * math.pi)
            found = gp.pulse_velocities(
                state, frequency, (1, 0, 0)[: packing.structure.periods], branches="longitudinal"
            )
            phase = mpmath.asin(2 * mpmath.pi * mpf(frequency) / mpf(unit) / top)
            yield off(found.wavenumber[0], root * phase / mpf(D))
            yield off(found.group[0], top / root * mpmath.cos(phase) * mpf(D) * mpf(unit))


def corners() -> Iterator[float]:
    """omega^2: fcc at X has 4 (1 + 3 eta), 8 (1 + eta), 10 eta and 20 eta, a chain at its end 4, in
    k/M.
    """
    for name, point in (("fcc", (0.5, 0.0, 0.5)), ("chain", (0.5, 0.0, 0.0))):
        for packing, part in itertools.product(balls(name), (1e-40, 1e-4)):
            state = gp.AveragedLattice(packing).at_force(
                part * packing.material.young_modulus * packing.diameter**2
            )
            unit = mpmath.sqrt(mpf(state.normal_stiffness) / mpf(packing.mass))
            n = mpf(packing.mindlin_ratio)
            squares = (
                [4]
                if name == "chain"
                else sorted([10 * n, 10 * n, 20 * n, 4 + 12 * n, 4 + 12 * n, 8 + 8 * n])
            )
            exact = [mpmath.sqrt(one) * unit / (2 * mpmath.pi) for one in squares]
            found = gp.Phonons(state).frequencies([point])[0]
            yield from (off(a, b) for a, b in zip(found, exact, strict=True))


def counted_states() -> Iterator[float]:
    """Three, six or one mode a ball, whatever the mesh."""
    meshes = {
        "chain": [(1,), (2,), (3,), (10007,)], "fcc": [(1, 1, 1), (2, 2, 2), (1, 1, 17), (7, 6, 5)],
        "hcp": [(1, 1, 1), (3, 3, 1), (5, 4, 3)],
    }  # fmt: skip
    for name, friction in (("chain", True), ("fcc", True), ("fcc", False), ("hcp", True)):
        state = gp.AveragedLattice(gp.Packing(STEEL, D, lattice=name, friction=friction)).at_force(
            18.0
        )
        for mesh, points in itertools.product(meshes[name], (12, 501)):
            dos = gp.Phonons(state).dos(mesh, points=points)
            known = np.all(np.isfinite(dos.total)) and np.all(dos.total >= -1e-12 * dos.total.max())
            count = np.trapezoid(dos.total, dos.frequencies)
            yield (
                off(float(count), 1 if name == "chain" else 6 if friction else 3)
                if known
                else math.inf
            )


# -- the simulation --------------------------------------------------------------------------------

CELLS = {
    "chain": ((1,), (2,), (3,), (101,), (10007,)),
    "fcc": ((1, 1, 1), (2, 1, 1), (1, 1, 50), (50, 1, 1), (3, 4, 5), (7, 7, 7)),
    "hcp": ((1, 1, 1), (1, 2, 1), (1, 1, 50), (3, 4, 3)),
}


def cells() -> Any:
    return ((lattice, cell) for lattice, several in CELLS.items() for cell in several)


def equal_samples() -> Iterator[float]:
    for (lattice, cell), friction in grid(cells(), (True, False)):
        packing = gp.Packing(STEEL, D, lattice=lattice, friction=friction)
        media = gp.DirectSimulation(packing, cell, geometry="lattice"), gp.AveragedLattice(packing)
        state, exact = (one.at_force(18.0) for one in media)
        yield max(
            off(state.overlap, exact.overlap), off(state.normal_stiffness, exact.normal_stiffness)
        )
        tensor = exact.elastic_tensor
        yield float(np.max(np.abs(state.elastic_tensor - tensor)) / np.max(tensor))


def disordered_samples() -> Iterator[float]:
    for (lattice, cell), width in itertools.product(cells(), (1e-16, 1e-3, 0.3)):
        packing = gp.Packing(STEEL, D, gp.Uniform(width * D), lattice=lattice, friction=False)
        unit = float(packing.law.force(packing.width))
        for part in (1e22, 1e3, 1.0, 1e-2, 1e-4):
            # displacements on a line add up, and their rounding is that of a random walk
            if part ** (2.0 / 3.0) * width < 0.5 and (part > 1e-3 or math.prod(cell) < 50):
                state = gp.DirectSimulation(packing, cell, seed=3, geometry="lattice").at_force(
                    part * unit
                )
                yield balance(state.sample, part * unit)


def chains() -> Iterator[float]:
    """All contacts of a chain carry the same force: spread or not, the law is Hertz's, and the
    modulus k a's.
    """
    for (cell,), width in grid(CELLS["chain"], (1e-16, 1e-3, 0.3)):
        packing = gp.Packing(STEEL, D, gp.Uniform(width * D), lattice="chain")
        unit = float(packing.law.force(packing.width))
        c = coefficient(packing)
        for part in (1e22, 1e3, 1.0, 1e-2):
            if part ** (2.0 / 3.0) * width < 0.5:
                state = gp.DirectSimulation(packing, (cell,), seed=3).at_force(part * unit)
                overlap = (mpf(part * unit) / c) ** (mpf(2) / 3)
                k = 3 * mpf(part * unit) / (2 * overlap)
                yield max(off(state.overlap, overlap), off(state.normal_stiffness, k))
                yield off(gp.moduli(state).bulk, k * mpf(D))


def sampled_bulk_moduli() -> Iterator[float]:
    """Without friction an even strain changes all overlaps evenly, so that K follows from the
    stiffness.
    """
    in_space = [one for one in cells() if one[0] != "chain"]
    loads = ((0.1,), (1.0,), (1e6,)) if THIN.get() else ((0.1, 1.0, 1e6),)
    for (lattice, cell), parts in grid(in_space, loads):
        packing = gp.Packing(STEEL, D, gp.Uniform(1e-8 * D), lattice=lattice, friction=False)
        unit = float(packing.law.force(packing.width))
        state = gp.DirectSimulation(packing, cell, seed=3, geometry="lattice").at_force(
            unit * np.array(parts)
        )
        factor = packing.structure.pressure_factor / 3.0 / D
        bulk = np.sum(state.elastic_tensor[:, :3, :3], axis=(1, 2)) / 9.0
        yield from np.abs(bulk / (factor * state.normal_stiffness) - 1.0).tolist()


def samples_near_the_threshold() -> Iterator[float]:
    """Contact forces and elastic tensor of loose samples in space, against sparse matrices."""
    for lattice, cell in (("fcc", (8, 8, 8)), ("hcp", (5, 6, 4)), ("fcc", (1, 3, 40))):
        packing = gp.Packing(STEEL, D, gp.Uniform(2e-6), lattice=lattice)
        unit = float(packing.law.force(packing.width))
        state = gp.DirectSimulation(packing, cell, seed=1, geometry="lattice").at_force(
            unit * np.array([1.0, 1e-2, 2e-3])
        )
        yield from map(against_sparse, state.sample.tolist())


CRYSTALS = [
    Case(
        "force, pressure and overlap of chains, planes and crystals",
        "the same balls on the chain, square, sc, bcc, fcc and hcp lattice, f from 1e-40 to"
        " 0.01 E d²",
        8e-15,
        pressures,
    ),
    Case(
        "sound velocities and moduli of fcc and of a chain",
        "the same balls, with friction and without, f from 1e-40 to 0.01 E d², along [100]"
        " and [110]",
        8e-15,
        sound,
    ),
    Case(
        "longitudinal branch of fcc along [100]",
        "|q|d from 1e-300 to 0.3, η from 0 to 4/3",
        4e-15,
        branches_of_fcc,
    ),
    Case(
        "bending waves of a chain, and its rotational and longitudinal branch",
        "|q|d from 1e-60 to 0.3, η from 1e-3 to 4/3, bending from 1e-12 to 1",
        4e-14,
        bending_waves,
    ),
    Case(
        "flexural waves of a layer: product of the three frequencies",
        "|q|d from 1e-30 to 0.3 in three directions, η from 1e-3 to 4/3",
        1e-13,
        membranes,
    ),
    Case(
        "branches that cost nothing, in (k/M)^1/2",
        "chain, square, honeycomb, kagome; |q|d from 1e-300 to 0.3, η from 1e-300 to 4/3",
        0.0,
        free_branches,
    ),
    Case(
        "sound velocities of hcp along c, and its bulk modulus",
        "the same balls, with friction and without, f from 1e-40 to 0.01 E d²",
        8e-15,
        hexagonal_sound,
        slow=True,
    ),
    Case(
        "sound velocities with finite overlap, fcc along [100] and a chain",
        "the same balls, without friction, overlap from 1e-40 to 0.17 d",
        2e-14,
        finite_overlaps,
    ),
    Case(
        "torsion of a Hertz contact that does not slip",
        "the same balls, f from 1e-40 to 0.01 E d²",
        4e-15,
        torsions,
    ),
    Case(
        "group velocities near Γ of a chain, and of fcc along [110]",
        "|q|d of 0 and from 1e-300 to 1e-9, η of 0 and from 1e-3 to 4/3",
        4e-15,
        group_velocities,
    ),
    Case(
        "wavenumber and group velocity of pulses on a chain, and along [100] of fcc",
        "frequencies from 1e-150 to 0.9 of the top of the branch, with friction and without",
        1e-11,
        pulses,
    ),
    Case(
        "frequencies in Hz of fcc at X, and of a chain at its end",
        "the same balls, f of 1e-40 and 1e-4 E d²",
        1e-13,
        corners,
    ),
    Case(
        "number of modes under the density of states of a chain, fcc and hcp",
        "meshes from one wave vector (all branches at an edge) to 10007, and 7 × 6 × 5 in"
        " space, 12 and 501 points",
        1e-12,
        counted_states,
        slow=True,
    ),
    Case(
        "simulation of equal balls on a chain, in fcc and hcp",
        "cells from 1 to 10007 on a line, from 1 × 1 × 1 to 1 × 1 × 50 and 7 × 7 × 7 in"
        " space; with friction and without",
        1e-12,
        equal_samples,
    ),
    Case(
        "simulation on a chain, in fcc and hcp: balance of every ball, and the load",
        "the same cells, W from 1e-16 to 0.3 d, f* from 0.01 to 1e22; below 50 balls from 1e-4",
        1e-9,
        disordered_samples,
        slow=True,
    ),
    Case(
        "simulation of a chain: overlap, stiffness and modulus of a force, by Hertz's law",
        "1 to 10007 balls, W from 1e-16 to 0.3 d, f* from 0.01 to 1e22",
        1e-12,
        chains,
    ),
    Case(
        "simulation in fcc and hcp: bulk modulus without friction",
        "the same cells, f* from 0.1 to 1e6",
        1e-12,
        sampled_bulk_moduli,
    ),
    Case(
        "simulation in fcc and hcp: contact forces and elastic tensor, against sparse matrices",
        "8 × 8 × 8, 5 × 6 × 4 and 1 × 3 × 40 cells, f* from 0.002 to 1",
        1e-9,
        samples_near_the_threshold,
        slow=True,
    ),
]
