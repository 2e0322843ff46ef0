"""Benchmarks of simulations in space: ratios, each measured side by side in one run, each with the
bound it is to keep.

Balls on the fcc lattice are spread uniformly and rest under a given overlap; one
thread throughout.
"""

from __future__ import annotations

import json
import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg
from side_by_side import Part, Row, alternate, over, run_alone, spend

import granphon as gp
from granphon.array.equilibrium import REST_TOLERANCE, Equilibrium
from granphon.array.options import ReducedLoad
from granphon.array.rest import bring_to_rest
from granphon.array.stencils import Stencils
from granphon.balls.lattices import FCC
from tests.sparse_array import find_step_length

Array = NDArray[np.float64]
#: a*, times faster than Newton's method with scipy's conjugate gradients; where few iterations are
#: needed the gain is less
AGAINST = ((1.0, 10.0), (0.7, 5.0))
#: numbers of cells along each axis, whose iterations are compared
SIDES = (16, 32, 64, 100)


def balls(side: int, seed: int = 0) -> Array:
    x = gp.Uniform(1.0).sample((side,) * 3, seed)
    return x - np.mean(x)


def rest(side: int, spacing: float, stencils: Stencils | None = None) -> Equilibrium:
    """The equilibrium at a*."""
    return bring_to_rest(
        balls(side),
        ReducedLoad(overlap=spacing - 0.5),
        stencils or Stencils((side,) * 3, lattice=FCC),
    )


class Plain:
    """Newton's method with scipy's conjugate gradients, at their own accuracy (1e-5), and the
    diagonal as preconditioner.

    The measure of rest, the stiffness added to contacts and the rule for the length of a step are
    those of the simulation. With ``inexact`` the accuracy of each step's linear equations is that
    of the simulation, too.
    """

    def __init__(self, side: int, inexact: bool = False) -> None:
        self.inexact = inexact
        table = FCC.contacts
        site = np.arange(side**3).reshape((side,) * 3)
        i = np.tile(site.ravel(), len(table))
        j = np.concatenate(
            [
                np.roll(site, [-a for a in shift], (0, 1, 2)).ravel()
                for shift in table.shift.tolist()
            ]
        )
        normal = np.repeat(table.normal, side**3, axis=0)
        row = np.repeat(np.arange(i.size), 6)
        column = np.concatenate(
            [3 * j[:, None] + range(3), 3 * i[:, None] + range(3)], axis=1
        ).ravel()
        entries = np.concatenate([normal, -normal], axis=1).ravel()
        self.c = csr_array((entries, (row, column)), shape=(i.size, 3 * side**3))
        self.transposed = csr_array(self.c.T)
        self.squared = csr_array(self.transposed.power(2))
        x = balls(side).ravel()
        self.means = 0.5 * (x[i] + x[j])

    def forces(self, overlap: float) -> Array:
        """Contact forces at rest, in units of c W^(3/2)."""
        h = overlap + self.means
        while True:
            closed = np.maximum(h, 0.0)
            force = closed * np.sqrt(closed)
            pull = self.transposed @ force
            scale = min(float(np.mean(force)), float(np.std(force)))
            distance = math.sqrt(float(np.max(np.sum(pull.reshape(-1, 3) ** 2, axis=1)))) / scale
            if distance <= REST_TOLERANCE:
                return np.asarray(force)
            k = 1.5 * np.sqrt(closed)
            k += 1e-2 * min(1.0, distance) * np.mean(k)
            diagonal = 1.0 / (self.squared @ k)
            product = LinearOperator(
                (pull.size,) * 2, lambda u, k=k: self.transposed @ (k * (self.c @ u))
            )
            inverse = LinearOperator((pull.size,) * 2, lambda u, d=diagonal: d * u)
            reduction = (
                min(0.1, max(math.sqrt(distance), 0.3 * REST_TOLERANCE / distance))
                if self.inexact
                else 1e-5
            )
            step, _ = cg(product, pull, rtol=reduction, M=inverse, maxiter=3000)
            strain = self.c @ step
            h = h - find_step_length(h, strain) * strain


def against(repeats: int) -> list[Row]:
    """32^3 balls: same tolerance, same start; what both make once for the array is left out."""
    rows, plain, stencils = [], Plain(32), Stencils((32, 32, 32), lattice=FCC)
    tuned = Plain(32, inexact=True)
    for spacing, bound in AGAINST:
        ours = rest(32, spacing, stencils)
        theirs = plain.forces(spacing - 0.5)
        apart = np.max(np.abs(ours.forces.ravel() - theirs)) / ours.force
        assert apart < 1e-8, "the two disagree: the ratio would mean nothing"
        seconds = alternate(
            repeats,
            granphon=lambda s=spacing: rest(32, s, stencils),
            plain=lambda s=spacing: plain.forces(s - 0.5),
            tuned=lambda s=spacing: tuned.forces(s - 0.5),
        )
        what = (
            f"fcc, 32^3, a* = {spacing:g}, to 1e-10: times faster than Newton's method with"
            f" scipy's conjugate gradients"
        )
        rows.append(over(what, seconds, "plain", "granphon", bound, least=True))
        what = (
            f"fcc, 32^3, a* = {spacing:g}: the same, with linear equations no more accurate than"
            f" each step needs"
        )
        rows.append(over(what, seconds, "tuned", "granphon"))
    return rows


def growth(repeats: int) -> list[Row]:
    """Iterations do not depend on the machine."""
    counts = {side: rest(side, 1.0).conjugate for side in SIDES}
    note = ", ".join(f"{count} for {side}^3" for side, count in counts.items())
    value = max(counts.values()) / counts[SIDES[0]]
    return [
        Row(
            f"fcc, a* = 1: iterations from {SIDES[0]}^3 to {SIDES[-1]}^3", value, "", 1.5, note=note
        )
    ]


def alone(side: int) -> None:
    """Print what a sample at a* = 1 takes: in a process of its own, as memory is counted from its
    beginning.
    """
    state, spent = spend(lambda: rest(side, 1.0))
    print(json.dumps({**spent, "newton": state.newton, "conjugate": state.conjugate}))


def million(repeats: int) -> list[Row]:
    """One million balls, once."""
    seen = run_alone("bench_arrays.alone(100)")
    took = f"{seen['newton']} steps, {seen['conjugate']} iterations"
    return [
        Row("fcc, 100^3, a* = 1: time of the first sample", seen["s"], "s", 90.0, note=took),
        Row("fcc, 100^3, a* = 1: peak memory of the process", seen["GiB"], "GiB", 1.5),
    ]


#: memory first: it is measured in a process that inherits the peak of this one
PARTS: dict[str, Part] = {"fcc-million": million, "fcc-against": against, "fcc-growth": growth}
