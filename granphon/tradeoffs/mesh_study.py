"""How fine a mesh the density of states needs, measured against counting modes between the roots of determinants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.base.progress import Step
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.media.mean_field import EffectiveMedium
from granphon.media.state import ContactState
from granphon.tradeoffs.study import EPSILON, Deadline, Point, Reference, Study, leave_out

Array = NDArray[np.float64]
#: methods of a density of states
_METHODS = ("tetrahedron", "smearing")
#: number of frequencies at which a density of states is computed
_POINTS_OF_DOS = 501
#: points of the density of states in each interval of frequency whose modes are compared
_POINTS_OF_INTERVAL = 5
#: greatest frequency that is compared, in units of the top frequency of the branches
_BEYOND_TOP = 1.02


@dataclass(frozen=True)
class MeshStudy(Study):
    """Mesh and method of the density of states; the error is the fraction of modes in a wrong interval of frequency.

    ``load``: the loads of the trade-off, ascending; only the greatest is used. ``meshes``: points along a side of the meshes
    that are tried. ``reference_lines``: number of lines of the reference; a count on half as many gives its error.
    """

    name = "density of states"

    packing: Packing
    load: Load
    finite_overlap: bool
    meshes: tuple[int, ...] = (8, 16, 32, 64, 128, 256)
    reference_lines: int = 256

    @property
    def observed(self) -> tuple[str, ...]:
        """Names of the quantities whose errors are measured."""
        return ("dos",)

    @property
    def loads(self) -> tuple[float, ...]:
        """The greatest load, where finite overlap does most; in the paper's limit the form is the same at each load."""
        return self.load.values[-1:]

    @cached_property
    def state(self) -> ContactState:
        """State of the effective medium at the greatest load."""
        return EffectiveMedium(self.packing).at(self.load[-1], finite_overlap=self.finite_overlap)

    @property
    def lattice(self) -> ContactLattice:
        """The lattice of contacts of that state."""
        return self.state.contact_lattice()

    @cached_property
    def edges(self) -> Array:
        """Edges of the intervals of frequency, (k/M)^1/2."""
        at = np.linspace(0.0, _BEYOND_TOP * self.lattice.top_frequency, _POINTS_OF_DOS)
        inner = 0.5 * (at[1:] + at[:-1])[_POINTS_OF_INTERVAL - 1 :: _POINTS_OF_INTERVAL]
        return np.concatenate([at[:1], inner, at[-1:]])

    def make_points(self) -> list[Point]:
        """Return the points: for each method, the cheapest setting of its knob first; in the plane only."""
        if self.packing.structure.periods != 2:
            why = "the modes of a density of states are counted by another method in the plane only"
            return [leave_out(method, why) for method in _METHODS]

        def prepare(run: int) -> Any:
            from granphon.phonons.phonons import Phonons

            phonons = Phonons(self.state)
            _ = phonons.phonopy
            return phonons

        def make_point(method: str, mesh: int) -> Point:
            def solve(phonons: Any) -> Array:
                return self.count_below(phonons.dos((mesh, mesh), method))

            return Point(method, f"{mesh} x {mesh}", prepare, solve)

        return [make_point(method, mesh) for method in _METHODS for mesh in self.meshes]

    def count_below(self, dos: Any) -> Array:
        """Return the number of modes per ball below each edge, from a density of states."""
        at = dos.frequencies / self.state.scales.frequency
        ends = np.concatenate([at[:1], 0.5 * (at[1:] + at[:-1]), at[-1:]])
        total = np.concatenate([[0.0], np.cumsum(dos.total * self.state.scales.frequency * np.diff(ends))])
        return np.asarray(np.interp(self.edges, ends, total))

    def find_reference(self, deadline: Deadline, better: Callable[[Reference], bool], step: Step) -> Reference:
        """Count modes between the roots of determinants, on two numbers of lines."""
        from granphon.tradeoffs.references import count_modes

        rough, fine = (
            count_modes(self.lattice, self.edges, lines, deadline.check)
            for lines in (self.reference_lines // 2, self.reference_lines)
        )
        error = compare_counts(rough, fine)
        made = f"counting between the roots of determinants; with twice the lines it differs by {error:.0e}"
        return Reference(fine, np.array([[max(error, EPSILON)]]), made)

    def compute_errors(self, outcomes: Sequence[Any], reference: Reference) -> Array:
        """Return the relative errors of a point, (n_loads, n_observed), from the outcomes of its runs."""
        return np.array([[compare_counts(outcomes[0], reference.values)]])

    def find_floor(self, point: Point, outcomes: Sequence[Any]) -> float:
        """Return the least relative error that the point can have."""
        return EPSILON * self.lattice.n_branches


def compare_counts(below: Array, reference: Array) -> float:
    """Return the fraction of modes that ``below`` puts into another interval than ``reference``.

    Both are numbers of modes below each edge, (n,).
    """
    return float(0.5 * np.sum(np.abs(np.diff(below) - np.diff(reference))) / reference[-1])
