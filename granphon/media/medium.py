"""The interface of all media: the state of a packing under a load given as a force, a pressure or an overlap."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.motions import Motions
from granphon.base.errors import InputError
from granphon.base.validation import Rule
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.local_field import LocalField
from granphon.laws.cluster import ClusterLaw
from granphon.media.state import ContactState


@dataclass(frozen=True)
class Option:
    """An option of a medium: its default, and the rule that reads its value."""

    default: Any
    rule: Rule


#: a prestress f/(k a) so small that a lattice which buckles under it does so under any
_LEAST_PUSH = 1e-30
#: type of the states that a medium returns
StateT = TypeVar("StateT", bound=ContactState, covariant=True)


class Medium(ABC, Generic[StateT]):
    """A medium: the state of a packing at a given load, which is given in three ways, each of which calls :meth:`at`.

    ``finite_overlap`` says whether to keep the terms of relative order delta/d; None and False leave them out. The state
    stores the choice, and all functions of a state read it there.
    """

    # the balls under load
    packing: Any
    # the word for the medium in scenes and sweeps, and its name in figures and tables
    name: ClassVar[str]
    words: ClassVar[str]
    # what a scene or a sweep may set of the medium besides the packing, by name
    options: ClassVar[Mapping[str, Option]] = {}
    # what of it takes so long that a survey leaves it out, in words; simulations have words of their own
    slow_part = ""

    @property
    def is_solved_anew(self) -> bool:
        """Whether each packing of a sweep has a law of its own, which takes its time."""
        return False

    @property
    def is_quick(self) -> bool:
        """Whether its states take less than 0.1 s, so that they are found when a scene is only checked."""
        return True

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The medium itself if it simulates arrays, ball by ball; none otherwise."""
        return ()

    @property
    def local_field(self) -> LocalField | None:
        """How the lattice around a ball gives way; None of a medium that does not ask."""
        return None

    @property
    def long_law(self) -> ClusterLaw | None:
        """The law that takes long to solve, in reduced units, once for all media that share it; None if it does not."""
        return None

    def prepare(self) -> None:
        """Find what all states need of the lattice; :class:`~granphon.base.errors.MechanismError` if it has none."""
        return

    def require_sound(self, pushed: bool = False) -> None:
        """Raise if the lattice is known to have no sound, before a state is found.

        :class:`~granphon.base.errors.MechanismError` if it gives way without a force,
        :class:`~granphon.base.errors.InstabilityError` if it is ``pushed`` by prestress and buckles under any. Of the
        stiffnesses of contacts it matters only which of them there are.
        """
        packing = self.packing
        present = tuple(float(bool(one)) for one in (packing.mindlin_ratio, packing.torsion, packing.bending))
        _require_sound(packing.structure, present, packing.ball_motions, pushed)

    def require(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` if an applied load is known not to be borne, solving nothing."""
        return

    def count_start(self, load: Load) -> float:
        """Return how many balls take as long as :meth:`require_start`; zero if a load has nothing to be compared with."""
        return 0.0

    def require_start(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a load below the start of the loading, which is solved."""
        return

    def by_geometry(self, load: Load, finite_overlap: bool | None = None) -> list[tuple[Self, list[int]]]:
        """Return the medium in each geometry that it has at values of an applied load, and their places."""
        return [(self, list(range(load.size)))]

    @abstractmethod
    def at(self, load: Load, *, finite_overlap: bool | None = None) -> StateT:
        """Return the state at a load, with the shape of the values of the load."""

    def at_force(self, force: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """State at the mean contact force f, N."""
        return self.at(Load("force", force), finite_overlap=finite_overlap)

    def at_pressure(self, pressure: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """State at the pressure P: N/m in the plane, Pa in space, N on a line.

        P d = sqrt(3) f on the triangular lattice (equation 20), P d^2 = 2 sqrt(2) f in fcc. With ``finite_overlap`` the
        boundary shrinks with the balls, and the spacing a takes the place of d.
        """
        return self.at(Load("pressure", pressure), finite_overlap=finite_overlap)

    def at_overlap(self, overlap: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """State at the overlap delta = d - a, m; where balls differ it may be negative, as long as some touch."""
        return self.at(Load("overlap", overlap), finite_overlap=finite_overlap)


@cache  # a sweep has many packings of one lattice
def _require_sound(structure: Lattice, present: tuple[float, ...], motions: Motions, pushed: bool) -> None:
    eta, torsion, bending = present
    lattice = ContactLattice.of(structure, eta, torsion=torsion, bending=bending, motions=motions)
    lattice.sound_velocities(np.eye(lattice.periods), _LEAST_PUSH if pushed else None)


def explain_untouched(load: Load, largest: float) -> InputError:
    """Return the error for an overlap at which even the largest balls are apart.

    ``largest`` is the excess of their diameter over the mean, m.
    """
    why = f"The largest are {largest:g} m wider than the mean"
    return InputError(f"{load} m: no balls touch", why, f"Give an overlap above {-largest:g} m")
