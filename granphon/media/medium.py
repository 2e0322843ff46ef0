"""Media: the state of a packing under a load given as a force, a pressure or an overlap; and the
media that are contact laws.

The media of Section III are, in order of accuracy, the averaged lattice (equations 23 and 24), the
averaged force (25) and the effective medium (28-46). They differ only in their contact law. For
equal balls all are the averaged lattice, which is then exact. So they are on a line, where all
contacts carry the same force even if balls differ.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import Any, ClassVar, Generic, Literal, Self, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.diameters import PointShape
from granphon.balls.hertz import LEAST_NORMAL
from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.loads import Load, require_compressive, require_of_packing
from granphon.balls.motions import Motions
from granphon.balls.packing import Packing, given_packing, require_shallow
from granphon.base.arrays import ROUNDING, Array
from granphon.base.differences import Course, differentiate
from granphon.base.errors import InputError
from granphon.base.memory import require_memory
from granphon.base.validation import Rule, choice, one_of
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.dynamics.local_field import LocalField, local_field, paper_local_field
from granphon.laws.effective import EffectiveLaw
from granphon.laws.spread import AveragedLaw
from granphon.media.newtons import in_newtons
from granphon.media.state import ContactState, Law, read_finite_overlap

#: names of the media whose modules are imported when one of them is asked for
SIMULATION = "simulation"
CRYSTAL = "crystal"
NETWORK = "network"


@dataclass(frozen=True)
class Option:
    """An option of a medium, which a scene or a sweep may set.

    Attributes
    ----------
    default : value of the option if none is given.
    rule : rule of :mod:`granphon.base.validation` that reads its value.
    meaning : what the option does, in words for the reference.
    absent : what holds by ``default``, in words, where the default itself does not say it.
    """

    default: Any
    rule: Rule
    meaning: str
    absent: str = ""


#: a prestress f/(k a) so small that a lattice which buckles under it does so under any
_LEAST_PUSH = 1e-30
#: type of the states that a medium returns
StateT = TypeVar("StateT", bound=ContactState, covariant=True)
#: relative step of a parameter for a difference of the fourth order, if each state is found anew
_STEP_ANEW = 2e-3
#: the same step if states follow from a law, whose numbers have more digits
_STEP_OF_LAW = 2e-4
#: function of a relative step of a parameter; returns the medium and the load with the parameter
#: larger by that step
Change = Callable[[float], tuple[Any, Load]]


class Medium(ABC, Generic[StateT]):
    """A medium finds the state of a packing at a load. The load is given as a force, a pressure or
    an overlap; the methods ``at_force``, ``at_pressure`` and ``at_overlap`` all call :meth:`at`.

    ``finite_overlap`` says whether to keep the terms of relative order delta/d; None and False
    leave them out, but in a simulation None leaves the choice to the geometry or the load. The
    state stores the choice, and all functions of a state read it there.
    """

    # the balls under load
    packing: Any
    # the word for the medium in scenes and sweeps, and its name in figures and tables
    name: ClassVar[str]
    words: ClassVar[str]
    # what a scene or a sweep may set of the medium besides the packing, by name
    options: ClassVar[Mapping[str, Option]] = {}
    # words for the states that take so long that a survey leaves them out; simulations have words
    # of their own
    slow_part = ""

    @property
    def is_solved_anew(self) -> bool:
        """Whether each packing of a sweep has a law of its own, which takes time to solve."""
        return False

    @property
    def is_quick(self) -> bool:
        """Whether the states of the medium take less than 0.1 s, so that they are found when a
        scene is only checked.
        """
        return True

    @property
    def arrays(self) -> tuple[Any, ...]:
        """The medium itself if it simulates arrays, ball by ball; none otherwise."""
        return ()

    @property
    def local_field(self) -> LocalField | None:
        """The local field: how far the lattice around a ball gives way; None for a medium that does
        not use it.
        """
        return None

    def prepare(self) -> None:
        """Find what all states need of the lattice, and keep it. Most media need nothing, and do
        nothing here.

        A medium that needs something raises :class:`~granphon.base.errors.MechanismError` if the
        lattice does not have it.
        """
        return

    def has_finite_overlap(self, wants_terms: bool) -> bool:
        """Return whether the states of the medium have the terms of relative order delta/d, where
        ``wants_terms`` says whether the user asks for them. States of this medium have them just
        then.

        A simulation may have them unasked: if it names no geometry, the load decides. The answer is
        then False, and the media of :meth:`by_geometry` know.
        """
        return wants_terms

    def require_sound(self, pushed: bool = False) -> None:
        """Raise, before a state is found, if the lattice is known to have no sound.

        The error is :class:`~granphon.base.errors.MechanismError` if the lattice gives way without
        a force. It is :class:`~granphon.base.errors.InstabilityError` if the states have prestress
        (``pushed``), and the lattice buckles under any prestress, however small.
        """
        packing = self.packing
        stiffnesses = (packing.mindlin_ratio, packing.torsion, packing.bending)
        # only whether a stiffness is zero matters: with 1 for any other, packings of one lattice
        # share the answer that is kept
        unit_stiffnesses = tuple(1.0 if stiffness else 0.0 for stiffness in stiffnesses)
        _require_sound(packing.structure, unit_stiffnesses, packing.ball_motions, pushed)

    def require(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for an applied load that no array can
        bear, as far as that is known before anything is solved. A medium that does not simulate
        raises nothing.
        """
        return

    def count_start(self, load: Load) -> float:
        """Return the cost of :meth:`require_start` at a ``load``: the number of balls of an array
        that takes as long to come to rest; zero if no start is solved. A simulation raises
        :class:`~granphon.base.errors.InputError` for loads that it does not bear.
        """
        return 0.0

    def require_start(self, load: Load) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for a load below the start of a history
        of friction; the start is solved for that. A medium without such a history raises nothing.
        """
        return

    def by_geometry(
        self, load: Load, finite_overlap: bool | None = None
    ) -> list[tuple[Self, list[int]]]:
        """Return pairs: the medium in one geometry, and the indices, in C order, of the values of
        the applied ``load`` that have this geometry.

        Only a simulation that names no geometry has more than one pair; there ``finite_overlap``,
        unless it is None, decides, see :func:`~granphon.media.left_out.choose_geometries`.
        """
        return [(self, list(range(load.size)))]

    @abstractmethod
    def at(self, load: Load, *, finite_overlap: bool | None = None) -> StateT:
        """Return the state at a load, with the shape of the values of the load; ``finite_overlap``
        is as in the class.
        """

    def follow(
        self, load: Load, changes: Sequence[Change], finite_overlap: bool | None = None
    ) -> tuple[Any, list[Course[Any]]]:
        """Return the state at a single load, and its course along each of the ``changes``, all with
        ``finite_overlap`` as in the class.

        A change maps a relative step of a parameter to the changed medium and load, and its course
        maps the step to their state. Here each state is computed from scratch, which also holds
        where states depend on the path to the load; a medium that knows the derivative of its
        states overrides this.
        """
        state = self.at(load, finite_overlap=finite_overlap)

        def find_anew(change: Change) -> Course[Any]:
            """Return the course along a ``change`` whose states are computed anew at each step."""

            def find_state(step: float) -> Any:
                """Return the state of the changed medium at the changed load."""
                medium, changed_load = change(step)
                return medium.at(changed_load, finite_overlap=finite_overlap)

            return Course(find_state, _STEP_ANEW)

        return state, [find_anew(change) for change in changes]

    def at_force(self, force: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """Return the state at the mean contact ``force`` f, N; ``finite_overlap`` is as in the
        class.
        """
        return self.at(Load("force", force), finite_overlap=finite_overlap)

    def at_pressure(self, pressure: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """Return the state at the pressure P: N/m in the plane, Pa in space, N on a line.

        P d = sqrt(3) f on the triangular lattice (equation 20), P d^2 = 2 sqrt(2) f in fcc. With
        ``finite_overlap`` the boundary shrinks with the balls, and the spacing a takes the place of
        d.
        """
        return self.at(Load("pressure", pressure), finite_overlap=finite_overlap)

    def at_overlap(self, overlap: ArrayLike, *, finite_overlap: bool | None = None) -> StateT:
        """Return the state at the overlap delta = d - a, m.

        Where balls differ the overlap may be negative, as long as some balls touch: but not where
        the law is that of equal balls, as in the averaged lattice, and on a line.
        """
        return self.at(Load("overlap", overlap), finite_overlap=finite_overlap)


@cache  # a sweep has many packings of one lattice
def _require_sound(
    structure: Lattice, unit_stiffnesses: tuple[float, ...], motions: Motions, pushed: bool
) -> None:
    """Raise as :meth:`Medium.require_sound` does, for the lattice ``structure`` of balls with these
    ``motions``, ``pushed`` or not. ``unit_stiffnesses`` are three numbers for the stiffnesses of
    contacts against slip, twist and rolling: 0 for zero, 1 for any other.
    """
    eta, torsion, bending = unit_stiffnesses
    lattice = ContactLattice.of(structure, eta, torsion=torsion, bending=bending, motions=motions)
    prestress = _LEAST_PUSH if pushed else None
    # the velocities are not used: finding them raises the errors
    lattice.sound_velocities(np.eye(lattice.periods), prestress)


def explain_untouched(load: Load, largest_excess: float) -> InputError:
    """Return the error for a ``load``, an overlap, at which even the largest balls are apart.

    ``largest_excess`` is the excess of their diameter over the mean, m.
    """
    why = f"The largest are {largest_excess:g} m wider than the mean"
    mend = f"Give an overlap above {-largest_excess:g} m"
    return InputError(f"{load} m: no balls touch", why, mend)


# -- media that are contact laws -------------------------------------------------------------------


#: rough time of the effective medium, s: for a density of diameters, and for 64 listed ones
_DENSITY_TIME = 0.03
_LIST_TIME = 0.25
#: overlaps at which contacts open for 64 listed diameters: one for each pair
_LIST_OPENINGS = 64 * 65 / 2
#: exponent with which the time grows with the number of these overlaps
_LIST_POWER = 1.25
#: time below which work is done even when a scene is only checked and not run, s
_QUICK_TIME = 0.1
#: largest number of Newton steps for the overlap under a boundary that shrinks
_MOST_STEPS = 100
#: spacing over diameter below which such a boundary counts as shrunk to nothing: the difference of
#: diameter and overlap has lost the digits of the pressure
_LEAST_SPACING = 1e-6
#: where the effective medium has its local field from; the first is the default
_LOCAL_FIELDS = ("computed", "paper")


@dataclass(frozen=True)
class LawMedium(Medium[ContactState]):
    """A medium that consists of a contact law: ``at_*`` take scalars or arrays, in SI.

    A medium of your own is a subclass with a ``name``, its ``words`` in figures, and
    :attr:`spread_law`.

    Parameters
    ----------
    packing : the balls; InputError for anything but a :class:`~granphon.Packing`.

    ``at_*`` raise :class:`~granphon.base.errors.InputError` for a load that is not finite, not
    compressive, of a kind that crystals alone bear, too small or too large for double precision, or
    so large that it presses balls together by their whole diameter; and for more loads than memory
    holds. They raise :class:`~granphon.base.errors.PrecisionError` for a load so low that the law
    is not known there. With ``finite_overlap`` every result from the state includes the terms of
    relative order delta/d, and pressure and density are those of a boundary that shrinks with the
    balls.
    """

    packing: Packing
    # memory for finding the state at one load, bytes
    _load_bytes: ClassVar[float] = 160.0

    @cached_property
    def law(self) -> Law:
        """Contact law of the medium; Hertz's law for equal balls, and on a line, in every
        medium.
        """
        return self.spread_law if self.packing.spread_matters else self.packing.law

    @property
    @abstractmethod
    def spread_law(self) -> Law:
        """Contact law of the medium for balls that differ, in SI."""

    def __post_init__(self) -> None:
        given_packing(self.packing)

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> ContactState:
        """Return the state at a load, with the shape of the load. :meth:`at_force`,
        :meth:`at_pressure` and :meth:`at_overlap` take the values of the load in SI.

        Raises the errors that the class lists.
        """
        require_of_packing(load)
        require_memory(
            f"states at {load.size:,} loads", self._load_bytes * load.size, "Take fewer loads"
        )
        applied = load.applied
        has_finite_overlap = read_finite_overlap(finite_overlap)
        packing = self.packing
        describe_load = partial(applied.describe, packing.structure.periods)
        with np.errstate(all="ignore"):  # numbers beyond double precision are refused below
            force, overlap = self._solve(applied, has_finite_overlap)
            stiffness = np.asarray(self.law.stiffness(overlap))
            length = np.maximum(np.abs(overlap), packing.width)  # over which the force changes
            # all numbers of a state must be within double precision, also those found later
            sizes = [
                force,
                stiffness,
                length,
                stiffness / length,  # of the size of the slope of the stiffness
                force / packing.diameter,  # of the size of the pressure
                stiffness / packing.diameter,  # of the size of the moduli
            ]
        if not all(np.all((size >= LEAST_NORMAL) & (size < np.inf)) for size in sizes):
            raise InputError(f"{describe_load()} is too small or too large for double precision")
        greatest_overlap = float(np.max(overlap / packing.diameter))
        require_shallow(packing.material.young_modulus, greatest_overlap, describe_load)
        return ContactState(
            packing=packing,
            medium=self.name,
            law=self.law,
            force=force[()],
            overlap=overlap[()],
            normal_stiffness=stiffness[()],
            finite_overlap=has_finite_overlap,
        )

    def _solve(self, load: Load, has_finite_overlap: bool) -> tuple[Array, Array]:
        """Return the mean contact force, N, and the overlap, m, at an applied load, both with the
        shape of the load. With finite overlap, the boundary on which a pressure acts shrinks with
        the balls.

        Raises the errors of the law for a load that it refuses, and InputError for an overlap at
        which no balls touch.
        """
        law = self.law
        if load.kind == "overlap":
            overlap = load.array
            if law.least_overlap == 0.0:
                require_compressive("overlap", overlap)
            if np.any(overlap <= law.least_overlap):
                raise explain_untouched(load, -law.least_overlap)
            return np.asarray(law.force(overlap)), overlap
        if load.kind != "pressure":
            return load.array, np.asarray(law.overlap(load.array))
        force, _ = self._ask_force(load, 0.0)
        overlap = np.asarray(law.overlap(force))
        # on a line a pressure is the force, whatever the length of the boundary
        if has_finite_overlap and self.packing.structure.periods > 1:
            overlap = self._shrink_boundary(load, overlap)
            force = np.asarray(law.force(overlap))
        return force, overlap

    def _ask_force(self, load: Load, shrinkage: Any) -> tuple[Any, Any]:
        """Return the mean force f, N, that contacts must exert under a force or a pressure, and the
        derivative of f, N/m, by the ``shrinkage`` s, m, of the spacing at the boundary.

        Under a pressure P, with p periods, f is P (d - s)^(p - 1) over the pressure factor of the
        lattice. A boundary that follows the balls has s = delta, any other s = 0.
        """
        if load.kind != "pressure":
            return load.array, 0.0
        structure = self.packing.structure
        power = structure.periods - 1
        pressure_over_factor = load.array / structure.pressure_factor
        spacing = self.packing.diameter - shrinkage
        slope = -power * pressure_over_factor * spacing ** (power - 1) if power else 0.0
        return pressure_over_factor * spacing**power, slope

    def _shrink_boundary(self, load: Load, overlap: Array) -> Array:
        """Return the overlap delta, m, at which contacts exert the force that a pressure, the
        ``load``, asks of them on a boundary that has shrunk with the balls.

        The search begins at the larger ``overlap`` of a boundary that does not shrink, or at the
        diameter if this is less, where the boundary has shrunk to nothing and asks for no force.
        Up to there the force of the law rises with the overlap, and the force that the boundary
        asks for falls: they meet once. Newton's method descends to this overlap, or under a huge
        pressure jumps below it once and ascends. If the boundary shrinks to nothing, the overlap is
        the diameter, which :meth:`at` refuses.
        """
        law = self.law
        diameter = self.packing.diameter
        overlap = np.minimum(overlap, diameter)
        for _ in range(_MOST_STEPS):
            force, slope = self._ask_force(load, overlap)
            step = (law.force(overlap) - force) / (law.stiffness(overlap) - slope)
            overlap = overlap - step
            if np.all(np.abs(step) <= ROUNDING * np.abs(overlap)):
                break
        return np.where(diameter - overlap < _LEAST_SPACING * diameter, diameter, overlap)

    def follow(
        self, load: Load, changes: Sequence[Change], finite_overlap: bool | None = None
    ) -> tuple[ContactState, list[Course[Any]]]:
        """Return the state at a single load, and its course with each of the ``changes``; see
        :meth:`Medium.follow`. To first order the overlap changes so that the contacts of the
        changed medium exert the force that the changed load asks of them.
        """
        state = self.at(load, finite_overlap=finite_overlap)
        return state, [self._follow(state, load.applied, change) for change in changes]

    def _follow(self, state: ContactState, load: Load, change: Change) -> Course[Any]:
        """Return the course of a ``state`` under an applied ``load`` with a ``change``."""
        derivative = self._differentiate_overlap(state, load, change)

        def find_state(step: float) -> ContactState:
            """Return the state at a ``step``, whose overlap changes in proportion to the step."""
            medium, law, _ = self._apply(change, step)
            changed_overlap = state.overlap + step * derivative
            return replace(
                state,
                packing=medium.packing,
                law=law,
                force=law.force(changed_overlap),
                overlap=changed_overlap,
                normal_stiffness=law.stiffness(changed_overlap),
            )

        return Course(find_state, _STEP_OF_LAW)

    def _apply(self, change: Change, step: float) -> tuple[LawMedium, Law, Load]:
        """Return the medium changed by a ``step`` of the ``change``, its law to first order in the
        distance from the law of this medium, and the changed load, applied.
        """
        medium, changed_load = change(step)
        return medium, medium._law_near(self), changed_load.applied

    def _differentiate_overlap(self, state: ContactState, load: Load, change: Change) -> Any:
        """Return the derivative of the overlap of a ``state``, m, by the step of a ``change``.

        A given overlap changes as the ``load`` says. Under a force or a pressure the changed
        contacts at the old overlap lack some force; the overlap changes by this force over the
        resistance.
        """
        if load.kind == "overlap":
            return differentiate(lambda step: change(step)[1].applied.array, _STEP_OF_LAW)
        overlap = state.overlap
        shrinkage = overlap if state.finite_overlap else 0.0

        def find_missing_force(step: float) -> Any:
            """Return the force, N, that contacts lack at a step if the overlap stays."""
            medium, law, changed_load = self._apply(change, step)
            required_force, _ = medium._ask_force(changed_load, shrinkage)
            return required_force - law.force(overlap)

        # by the overlap the force of contacts rises with k, and the required force falls if the
        # boundary shrinks
        _, slope = self._ask_force(load, shrinkage)
        resistance = state.normal_stiffness - (slope if state.finite_overlap else 0.0)
        return differentiate(find_missing_force, _STEP_OF_LAW) / resistance

    def _law_near(self, origin: Any) -> Law:
        """Return the law of this medium. A subclass may return an approximation, to first order in
        the distance from the law of the medium ``origin``, if that is quicker.
        """
        return self.law


@dataclass(frozen=True)
class AveragedLattice(LawMedium):
    """The averaged lattice: all balls have the mean diameter, f = (2/3) E* d^(1/2) delta^(3/2)
    (equation 23).

    The medium is exact for equal balls, and on a line.

    Parameters
    ----------
    packing : the balls, as in :class:`LawMedium`.
    """

    name = "ala"
    words = "averaged lattice"

    @property
    def spread_law(self) -> Law:
        """Contact law of the medium for balls that differ, in SI."""
        return self.packing.law


class _ReducedMedium(LawMedium):
    """A medium whose law of balls that differ knows forces as f*; its errors are in newtons."""

    @in_newtons
    def at(self, load: Load, *, finite_overlap: bool | None = None) -> ContactState:
        """Return the state at a load, see :meth:`LawMedium.at`."""
        return super().at(load, finite_overlap=finite_overlap)


@dataclass(frozen=True)
class AveragedForce(_ReducedMedium):
    """The averaged force: balls differ and stay at the sites of the lattice; f is the mean over
    pairs (equation 25).

    On a line balls cannot stay at the sites, because all contacts carry the same force: there the
    law is Hertz's.

    Parameters
    ----------
    packing : the balls, as in :class:`LawMedium`.
    """

    name = "afa"
    words = "averaged force"
    _load_bytes = 420.0

    @property
    def spread_law(self) -> Law:
        """Contact law of the medium for balls that differ, in SI."""
        packing = self.packing
        if not packing.spread:
            return packing.law
        return AveragedLaw(packing.law.coefficient, packing.width, packing.spread.shape)


@dataclass(frozen=True, init=False)
class EffectiveMedium(_ReducedMedium):
    """The effective medium: balls that differ displace their neighbours, in the average lattice of
    all (equations 28-46).

    The only property of the lattice in its law is Xi (:attr:`local_field`), so that the medium
    serves in one, two and three dimensions. The medium is valid from f* = 0.08 (Section IV, by
    comparison with simulations of the triangular lattice); ``valid`` of a state says so. The law is
    solved from f* = 1e-6, and force and stiffness are accurate to 1e-8 or better from f* = 1e-4.
    Each pair of listed diameters puts a kink into the law, which is resolved. For some lists with
    diameters rarer than about 1 % the stiffness falls to zero at a higher f* than 1e-6, and the
    equation has no solution below. On a line the law is Hertz's.

    Friction makes Xi larger: the lattice around a ball gives way less, by springs eta k against
    slip. There is no other friction in the statics of the medium: contacts bear no tangential force
    at rest and do not slide, there is no friction coefficient, and the path to the load does not
    matter. :class:`DirectSimulation` with ``friction_history`` has all of this. At a given overlap
    the friction of the medium adds too much force at low load, and less than half of what it should
    from a* = 0.8 to 1. In sound every contact has the shear stiffness eta k, as with
    ``shear_response="stick"``.

    Parameters
    ----------
    packing : the balls.
    local_field : "computed"; or "paper" for alpha and beta as printed in the paper, which do not
        satisfy their own definition, and belong to the triangular lattice.

    Raises
    ------
    InputError : another word, "paper" on another lattice or with bending, or something else than a
        :class:`~granphon.Packing`.
    """

    name = "ema"
    words = "effective medium"
    slow_part = "the effective medium of long lists of diameters"
    options = {
        "local_field": Option(
            _LOCAL_FIELDS[0],
            partial(choice, options=_LOCAL_FIELDS),
            "computed, or what the paper prints, which is [wrong](../errata.md), to reproduce its"
            " curves",
        )
    }
    #: where the local field is from: the argument ``local_field``
    source: str

    def __init__(
        self, packing: Packing, local_field: Literal["computed", "paper"] = "computed"
    ) -> None:
        one_of("local_field", local_field, _LOCAL_FIELDS)
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "source", local_field)
        self.__post_init__()
        if local_field == "paper":
            self._require_field_of_paper()

    def _require_field_of_paper(self) -> None:
        """Raise :class:`~granphon.base.errors.InputError` for balls whose local field the paper
        does not give.
        """
        case = ""
        if self.packing.structure != TRIANGULAR:
            case = f"of the {self.packing.structure.name} lattice"
        elif self.packing.bending:
            case = "with bending"
        if case:
            raise InputError(f"the paper gives no local field {case}", mend="Use 'computed'")

    def __repr__(self) -> str:
        return f"EffectiveMedium({self.packing!r}, local_field={self.source!r})"

    @property
    def seconds(self) -> float:
        """Rough time, s, in which the law is solved once for all loads; zero for equal balls and on
        a line, where the law is Hertz's. For listed diameters the time grows with the number of
        overlaps at which contacts open, one for each pair.
        """
        if not (self.packing.spread and self.packing.spread_matters):
            return 0.0
        shape = self.packing.spread.shape
        if not isinstance(shape, PointShape):
            return _DENSITY_TIME
        relative_openings = shape.openings.size / _LIST_OPENINGS
        list_time = float(_LIST_TIME * relative_openings**_LIST_POWER)
        return max(_DENSITY_TIME, list_time)

    @property
    def is_quick(self) -> bool:
        """Whether the states take less than 0.1 s; those of long lists of diameters take longer."""
        return self.seconds < _QUICK_TIME

    @property
    def is_solved_anew(self) -> bool:
        """Whether each packing of a sweep has a law of its own, which takes time to solve: with
        listed diameters, but not on a line, where the law is Hertz's.
        """
        spread = self.packing.spread
        is_listed = spread is not None and spread.mean is not None
        return is_listed and self.packing.spread_matters

    def prepare(self) -> None:
        """Find the local field, and keep it, if balls differ; raise
        :class:`~granphon.base.errors.MechanismError` if the lattice has none.
        """
        if self.packing.width:
            _ = self.local_field

    @cached_property
    def local_field(self) -> LocalField:
        """Local-field factor Xi, with alpha and beta, of the packing's lattice, Mindlin ratio,
        torsion and bending.

        Without friction, torsion and bending some lattices have none, and
        :class:`~granphon.base.errors.MechanismError` is raised. With ``torsion="mindlin"`` torsion
        is left out, because it is of the order delta/d, as other terms that the medium leaves out.
        """
        packing = self.packing
        eta = packing.mindlin_ratio
        if self.source == "paper":
            return paper_local_field(eta)
        torsion = packing.torsion if isinstance(packing.torsion, float) else 0.0
        return local_field(packing.structure, eta, bending=packing.bending, torsion=torsion)

    @property
    def spread_law(self) -> Law:
        """Contact law of the medium for balls that differ, in SI. On a lattice where the load alone
        fixes the force of every contact, the law is that of equal balls.
        """
        spread = self.packing.spread
        law = self.packing.law
        if not spread or self.local_field.is_determinate:
            return law
        return EffectiveLaw(law.coefficient, spread.width, spread.shape, self.local_field.xi)

    def _law_near(self, origin: Any) -> Law:
        """Return the law to first order in its distance from that of the medium ``origin``. If the
        local fields differ, the law itself would have to be solved anew, which takes longer.
        """
        law = self.law
        return law.near(origin.law) if isinstance(law, EffectiveLaw) else law
