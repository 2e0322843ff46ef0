"""The samples of a simulation: their balls, whose diameters are given or drawn from a seed; how contacts are directed, and
how the samples are loaded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.array.geometry import require_small
from granphon.balls.diameters import Measured
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.motions import Motions, allowed_motions
from granphon.balls.packing import Packing, given_packing
from granphon.base.errors import InputError, MechanismError
from granphon.base.results import read_only
from granphon.base.validation import choice, finite_array, lengths, require, whole, whole_number
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.media.equilibria import require_load
from granphon.media.friction_history import HISTORY_OPTIONS, FrictionHistory
from granphon.media.left_out import EXACT, GEOMETRIES, LATTICE, can_be_exact, choose_geometries
from granphon.media.medium import Option

Array = NDArray[np.float64]
#: the largest seed of a sample
_MOST_SEED = 2**64 - 1
#: default numbers of cells of a sample, with one, two and three periods
DEFAULT_SHAPES = {1: (16_384,), 2: (128, 128), 3: (24, 24, 24)}
#: rule of validation for the numbers of cells in a scene; ``periods`` says how many they must be
read_cells = partial(lengths, low=1, high=20_000)
#: greatest numbers of balls along a side of a sample, of its cells, and of samples, far beyond what fits into memory
_MOST_SIDE, _MOST_CELLS, _MOST_SAMPLES = 2**31, 2**48, 2**31
#: number of wave vectors along each axis at which a lattice is probed for motions that cost nothing (corners, edges and
#: faces of the zone are among them), and the frequency, in (k/M)^1/2, below which a wave costs nothing
_PROBED, _SOFT = 12, 1e-6
#: least width over diameter: where overlaps are more than 1e20 widths, some samples find no equilibrium
_LEAST_WIDTH = 1e-20


def read_geometry(value: Any) -> str | None:
    """Read the name of a geometry; None leaves it to the load. It is a rule of :mod:`granphon.base.validation`."""
    return None if value is None else choice(value, options=GEOMETRIES)


@dataclass(frozen=True, eq=False)
class SampledBalls:
    """One or more samples; the base class of :class:`granphon.DirectSimulation`, which describes the fields.

    ``executor`` and ``workers`` do not change results, so that comparisons leave them out.
    """

    packing: Packing
    shape: tuple[int, ...] | None = None
    seed: int = 0
    samples: int = 1
    diameters: Array | None = None
    executor: Executor | None = field(default=None, compare=False, repr=False)
    workers: int = field(default=1, compare=False, repr=False)
    friction_history: bool = False
    friction_coefficient: float | None = FrictionHistory.friction_coefficient
    geometry: str | None = None
    start: float | Load | str = FrictionHistory.start
    shear_response: str = FrictionHistory.shear_response
    step_tolerance: float = FrictionHistory.step_tolerance
    ordered: bool = FrictionHistory.ordered

    #: what a scene may set; it cannot give diameters, and says elsewhere where it runs
    options: ClassVar[Mapping[str, Option]] = {
        "shape": Option(shape, read_cells),
        "seed": Option(seed, partial(whole, low=0, high=_MOST_SEED)),
        "samples": Option(samples, partial(whole, low=1, high=10_000)),
        "geometry": Option(geometry, read_geometry),
        **HISTORY_OPTIONS,
    }

    def __post_init__(self) -> None:
        given_packing(self.packing)
        history = self.history
        for name, value in history.options.items():
            object.__setattr__(self, name, value)
        held = history.from_gas and history.friction_coefficient != 0
        require_standing(self.packing, history.is_loaded, history.is_loaded and held)
        periods, shape = self.packing.structure.periods, self.shape
        if shape is not None:
            shape = require("shape", partial(lengths, low=1, high=_MOST_SIDE, periods=periods), shape)
            if math.prod(shape) > _MOST_CELLS:
                what = f"shape is {shape}, which are {float(math.prod(shape)):.3g} cells"
                raise InputError(what, f"No memory holds more than {_MOST_CELLS:.3g}", "Give fewer")
        object.__setattr__(self, "shape", shape or DEFAULT_SHAPES[periods])
        if self.diameters is not None:
            self._take_diameters(self.diameters)
        if 0.0 < self.packing.width < _LEAST_WIDTH * self.packing.diameter:
            what = f"the width of the diameters is {self.packing.relative_width:.3g} of their mean"
            raise InputError(what, f"Samples are simulated from {_LEAST_WIDTH:g} on", "Leave the spread out")
        object.__setattr__(self, "samples", whole_number("samples", self.samples, 1, _MOST_SAMPLES))
        object.__setattr__(self, "seed", whole_number("seed", self.seed, 0, _MOST_SEED + 1 - self.samples))
        whole_number("workers", self.workers, 1)
        if self.diameters is not None and self.samples > 1:
            raise InputError("diameters are given, which make one sample", mend="Leave samples out")
        if self.executor is not None and not hasattr(self.executor, "submit"):
            raise InputError(f"executor is {self.executor!r}", mend="Give a concurrent.futures.Executor, or none")
        geometry = require("geometry", read_geometry, self.geometry)
        if geometry is None and not can_be_exact(self.packing):
            geometry = LATTICE
        elif geometry is None and history.is_loaded:
            geometry = EXACT  # otherwise the load decides
        object.__setattr__(self, "geometry", geometry)
        if geometry == EXACT and not self.packing.spread_matters:
            what = "on a line" if self.packing.width else "of equal balls"
            why = f"The contacts {what} have the directions of the lattice anyway"
            raise InputError(f"the exact geometry {what} is not simulated", why, "Use a medium with finite_overlap")
        require_small(self.ratio)
        if history.is_loaded and self.packing.structure.periods == 1:
            why = "On a line contacts do not slip, so that friction does nothing"
            raise InputError("a chain has no friction_history", why, "Leave it out")
        if history.is_loaded and not self.packing.mindlin_ratio > 0.0:
            why = "The balls of this packing resist no slip (its mindlin_ratio is zero)"
            raise InputError("friction_history needs contacts with friction", why, "Give the packing friction=True")
        # a start that no sample can bear is refused, solving none
        start = history.start
        if isinstance(start, float) and self.packing.width:
            start = Load("overlap", self.packing.width * (start - 0.5))
        if history.is_loaded and isinstance(start, Load):
            try:
                require_load(self.packing, start.applied, self._largest)
            except InputError as error:
                refused = InputError(f"the start of the loading: {error}")
                refused.option = "start"
                raise refused from None

    @cached_property
    def history(self) -> FrictionHistory:
        """How samples are loaded: the options of a history, read as one; see :meth:`FrictionHistory.read`."""
        given = {name: getattr(self, name) for name in HISTORY_OPTIONS}
        return require("DirectSimulation", FrictionHistory.read, given)  # type: ignore[no-any-return]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SampledBalls):
            return NotImplemented
        return self._key == other._key and bool(np.all(np.asarray(self.diameters) == np.asarray(other.diameters)))

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        """Everything that determines the results, except the values of given diameters."""
        given = self.diameters is not None
        return self.packing, self.shape, self.seed, self.samples, given, self.geometry, self.history

    def _take_diameters(self, diameters: ArrayLike) -> None:
        """Store given diameters (m); the sample takes their shape, and the packing their spread if it has none."""
        array, packing = read_only(finite_array("diameters", diameters, "m", "above zero")), self.packing
        lengths, n = packing.structure.periods, packing.structure.n_balls
        if array.ndim != lengths + (n > 1) or (n > 1 and array.shape[-1] != n):
            wanted = ", ".join([*(f"L{axis + 1}" for axis in range(lengths)), *[str(n)] * (n > 1)])
            raise InputError(f"diameters have the shape {array.shape}", mend=f"Give an array ({wanted})")
        if packing.spread is None and np.ptp(array):
            # the packing takes the mean of the shifted list, which rounding may have changed
            spread = Measured(tuple((packing.diameter + (array - np.mean(array))).ravel().tolist()))
            packing = replace(packing, spread=spread, diameter=spread.mean)
        object.__setattr__(self, "packing", packing)
        object.__setattr__(self, "diameters", array)
        own = array.shape[:lengths]
        if self.shape not in (DEFAULT_SHAPES[lengths], own):
            what = f"shape is {self.shape!r}, and the diameters have the shape {array.shape}"
            raise InputError(what, "The diameters determine the shape of the sample", "Leave shape out")
        object.__setattr__(self, "shape", own)

    @property
    def cells(self) -> tuple[int, ...]:
        """Numbers of cells (L1, ..., Lp) of a sample: ``shape``, or its default."""
        return self.shape or DEFAULT_SHAPES[self.packing.structure.periods]

    @property
    def balls(self) -> int:
        """Number of balls of a sample."""
        return math.prod(self.cells) * self.packing.structure.n_balls

    @property
    def is_exact(self) -> bool:
        """Whether contacts have the geometry of the displaced balls, and so finite overlap, whatever the load."""
        return self.geometry == EXACT

    @property
    def ratio(self) -> float:
        """W/d in the exact geometry of contacts; zero where they keep the directions of the lattice."""
        return self.packing.relative_width if self.is_exact else 0.0

    def by_geometry(self, load: Load, finite_overlap: bool | None = None) -> list[tuple[Self, list[int]]]:
        """Return this simulation in each geometry, by word, that it has at values of an applied load, and their places.

        Where no geometry is named, each load has its own (:func:`~granphon.media.left_out.choose_geometries`).
        """
        if self.geometry is not None:
            return [(self, list(range(load.size)))]
        words = choose_geometries(self.packing, load.applied.flat, finite_overlap)
        return [
            (replace(self, geometry=word), [place for place, one in enumerate(words) if one == word])
            for word in dict.fromkeys(words)
        ]

    @property
    def floats(self) -> bool:
        """Whether loose balls float in their cages as samples are pressed from the gas: in the directions of the lattice."""
        return self.history.is_loaded and self.history.from_gas and not self.ratio

    @property
    def resists_slip(self) -> bool:
        """Whether contacts have springs against slip under sound: not where all of them slide, as mu is zero."""
        all_slide = self.history.friction_coefficient == 0.0 and self.history.shear_response != "stick"
        return self.packing.mindlin_ratio > 0.0 and not all_slide

    @property
    def _largest(self) -> float:
        """Excess of the diameter of the largest ball over the mean, m: of those that are given, or that may be drawn."""
        # diameters that are given may be larger than the largest of the packing's spread
        given = self.packing.width_units.width * float(np.max(self.deviations(0))) if self.diameters is not None else 0.0
        return max(given, self.packing.spread.largest if self.packing.spread else 0.0)

    def seed_of(self, index: int) -> int | None:
        """Return the seed of a sample; None if the diameters are given."""
        return None if self.diameters is not None else self.seed + index

    def deviations(self, index: int) -> Array:
        """Return the reduced deviations x = Delta/W of the diameters of a sample, with mean zero.

        Their shape is (L1, ..., Lp); with n > 1 balls in the cell it is (n, L1, ..., Lp).
        """
        packing = self.packing
        n = packing.structure.n_balls
        shape = (*self.cells, n) if n > 1 else self.cells
        given = np.zeros(shape)
        if packing.spread is not None:
            given = self.diameters if self.diameters is not None else packing.spread.sample(shape, self.seed + index)
        if n > 1:
            given = np.ascontiguousarray(np.moveaxis(given, -1, 0))
        if packing.spread is None:
            return given
        # the mean is subtracted twice, so that what remains is zero to the rounding of the deviations, not of the diameters
        off = given - np.mean(given)
        return np.asarray((off - np.mean(off)) / packing.width_units.width)


def require_standing(packing: Packing, history: bool = False, by_friction: bool = False) -> None:
    """Raise an error unless the balls of a packing stand without friction, and move as simulated balls do.

    They need not stand without it if they are held ``by_friction``. The error says what would simulate them; whether they
    are loaded with a ``history`` of friction makes a difference there.

    Raises :class:`~granphon.base.errors.MechanismError` for a lattice that has a motion without a cost in energy, and
    :class:`~granphon.base.errors.InputError` for motions that a simulation does not have.
    """
    structure = packing.structure
    own = next(iter(allowed_motions(structure.periods).values()))  # along the periods of the lattice
    if structure.dimension > structure.periods or packing.motions not in (None, own.name):
        what, mend = f"the motions {packing.motions!r}", f"Use another medium, or the motions {own.name!r}"
        if structure.dimension > structure.periods:
            what, mend = f"a lattice of {structure.periods} periods in space", "Use another medium"
        why = "Simulated balls move along the periods of their lattice"
        raise InputError(f"balls with {what} are not simulated", why, mend)
    falls = None if by_friction else _explain_fall(structure, own)
    if falls is None:
        return
    what = f"the {structure.name} lattice is not simulated, because it does not stand without friction"
    mend = "use another medium, or a lattice with more contacts, such as the triangular lattice, fcc or hcp"
    friction = "" if packing.friction else "friction: true of the packing and "
    if ContactLattice.of(structure, packing.material.mindlin_ratio, bending=packing.bending).mechanism:
        mend = f"Friction does not hold it either: {mend}"
    elif history:
        keys = f"{friction}start: gas, and a friction_coefficient above zero"
        mend = f"Start the history at the gas ({keys}), from which friction holds it; or {mend}"
    else:
        keys = f"{friction}friction_history: true with a friction_coefficient and start: gas"
        mend = f"A simulation with {keys} simulates it; or {mend}"
    raise MechanismError(what, falls, mend)


@lru_cache(maxsize=64)
def _explain_fall(structure: Lattice, motions: Motions) -> str | None:
    """Return which waves of the lattice without friction cost no energy; None if all do, but translations of the whole."""
    still = ContactLattice.of(structure, 0.0, motions=motions)
    if still.mechanism:
        return still.mechanism
    ticks = [np.arange(_PROBED) / _PROBED] * structure.periods
    fractions = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, structure.periods)[1:]
    stands = np.all(still.frequencies(still.wavevectors(fractions))[:, 0] > _SOFT)
    return None if stands else "Some of its waves cost no energy"
