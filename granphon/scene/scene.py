"""The scene: what to compute, read from a YAML file and checked before anything is done.

Quantities carry their units ("8 mm") in the file only; a :class:`Scene` holds SI floats. Every mistake in a file is one
:class:`~granphon.base.errors.SceneError` that names file, line and key, what was found, what is allowed, and the likely
intention.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

import numpy as np

from granphon.balls.contact_table import contacts_apart
from granphon.balls.diameters import Discrete, Measured
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import Load, force_of_frame
from granphon.balls.material import Material
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis, changed, counted
from granphon.base.errors import GranphonError, InputError, message
from granphon.base.progress import Progress, silent
from granphon.base.quantities import DENSITY, LENGTH, LOADS, MODULUS
from granphon.base.text import MAX_BYTES, Document, dump_yaml, parse_yaml, read_text, shown
from granphon.base.validation import ruled, truth
from granphon.dynamics.modes import ContactLattice
from granphon.media.choice import MediumChoice, Rung, no_simulation
from granphon.media.mean_field import EffectiveMedium
from granphon.media.simulation import DirectSimulation
from granphon.media.state import ContactState
from granphon.observables.acoustics import contact_lattice
from granphon.phonons.paths import BandPath
from granphon.scene import fields as rules
from granphon.scene.plan import MOST_CASES, Plan
from granphon.scene.result_files import DIAMETERS_FILE
from granphon.scene.schema import SceneFile, validated

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from xarray import Dataset

    from granphon.media.cost import Cost
    from granphon.scene.run import RunResult, SweepResult

__all__ = ["BandPath", "Load", "Scene", "force_of_frame"]

#: as many states are looked at one by one
_MOST_STATES = 20_000


@dataclass(frozen=True)
class Scene:
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : which balls, and how they are pressed.
    media : how a spread of diameters is averaged, one or more; by default "ema" where balls differ, "ala" where they do not.
        Names ("ala", "afa", "ema", "simulation") and mappings with options are taken too, alone or in a list.
    parameters : of the packing that are swept, each with its values; a mapping is taken too.
    finite_overlap : keep the terms of relative order delta/d.
    observe : which of "velocities", "bands", "dos" to compute.
    band, band_points : the path of the bands, and points on each segment of it; None: the lattice's own path.
    mesh : wave vectors along each reciprocal vector for the density of states.
    dim : supercell of the exported force constants; None: as small as serves.
    source : the file the scene was read from.

    Raises
    ------
    InputError : a value that is not allowed.
    """

    packing: Packing
    load: Load
    _: KW_ONLY
    media: tuple[MediumChoice, ...] = ()
    parameters: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    finite_overlap: bool = False
    observe: tuple[str, ...] = ("velocities",)
    band: BandPath | None = None
    band_points: int = 101
    mesh: tuple[int, int] = (64, 64)
    dim: tuple[int, int] | None = None
    source: Path | None = field(default=None, compare=False)
    #: where the scene was read from; a copy with other values was not
    _document: Document | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        axes = tuple(Axis.of(name, values) for name, values in dict(self.parameters).items())
        object.__setattr__(self, "parameters", tuple((axis.name, axis.values) for axis in axes))
        if isinstance(self.media, tuple | list) and not self.media:
            object.__setattr__(self, "media", "ema" if self.balls_differ else "ala")
        checks: dict[str, Callable[[Any], Any]] = {
            "media": rules.media, "finite_overlap": truth, "observe": rules.observed,
            "band_points": rules.segment_points, "mesh": rules.mesh_numbers,
        }  # fmt: skip
        if self.dim is not None:
            checks["dim"] = rules.supercell
        for name, rule in checks.items():
            object.__setattr__(self, name, ruled(name, rule, getattr(self, name)))
        if self.band is None:
            object.__setattr__(self, "band", BandPath.default(self.packing.structure))
        if self.finite_overlap:
            no_simulation(self.media)
        _check_supercell(self.packing, self.dim)
        _check_observed(self.observe, len(self.load.values) > 1 or len(self.media) > 1, dict(self.parameters))
        if self.load.array.ndim > 1:
            raise InputError(message(f"the load has the shape {self.load.shape}", mend="Give one number, or a list of them"))
        if self.load.kind == "side_force" and self.packing.structure != TRIANGULAR:
            raise InputError("found a side_force; allowed: on the triangular lattice only, whose frame is a hexagon.")

    @property
    def path(self) -> BandPath:
        """The path of the bands."""
        return cast("BandPath", self.band)  # set when the scene was made

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files that the scene was read from: its own, and the tables of measured diameters that it names."""
        if self._document is None:
            return ()
        folder = self.source.parent if self.source else Path()
        data = self._document.data
        spreads = [data["packing"].get("spread"), *data.get("sweep", {}).get("spread", [])]
        own = () if self.source is None else (self.source,)
        return (*own, *(folder / name for spread in spreads if (name := rules.table_named(spread)) is not None))

    @property
    def balls_differ(self) -> bool:
        """Whether diameters differ, or a sweep makes them."""
        return self.packing.width > 0.0 or not {"width", "spread"}.isdisjoint(dict(self.parameters))

    @cached_property
    def rung(self) -> Rung:
        """The medium of a scene of one state, chosen if that is automatic, and its expected error.

        :class:`~granphon.base.errors.InputError` if none can be chosen, or if the scene is a sweep.
        """
        if self.is_sweep:
            raise InputError(message("the scene is a sweep", "It has many states", "Use states(), or run it"))
        with nullcontext() if self._document is None else self._located_medium(self._document, self.media[0]):
            (rung,) = self.media[0].rungs(self.packing, self.load.applied)
            return rung

    @property
    def _single_load(self) -> Load:
        """The applied load of a scene of one load, without an axis."""
        load = self.load.applied
        return Load(load.kind, load.values[0])

    @property
    def is_sweep(self) -> bool:
        """Whether there is more than one load or medium, or a parameter is swept."""
        return len(self.load.values) > 1 or len(self.media) > 1 or bool(self.parameters)

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; :class:`~granphon.base.errors.SceneError` names whatever is wrong with it."""
        return cls._of(parse_yaml(read_text(path), str(path)), Path(path))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Read a scene from a text, which messages call ``name``; raises as :meth:`from_yaml`.

        Files that it names are looked for in the working folder.
        """
        return cls._of(parse_yaml(text, name), None)

    @classmethod
    def _of(cls, document: Document, source: Path | None) -> Self:
        file = validated(document, source.parent if source else Path())
        packing, phonopy = _packing_of(document, file), file.phonopy
        kind, values = next((kind, v) for kind in LOADS if (v := getattr(file.load, kind)) is not None)
        band = None
        if phonopy.band is not None or phonopy.band_labels is not None:
            with _located(document, ("phonopy", "band_labels")):
                band = BandPath(phonopy.band or BandPath.default(packing.structure).paths, phonopy.band_labels)
        with _located(document, ("phonopy", "dim")):
            _check_supercell(packing, phonopy.dim)
        if file.packing.finite_overlap:
            with _located(document, ("packing", "finite_overlap"), "found true; allowed: false, with a simulation. "):
                no_simulation(file.medium)
        with _located(document, ("observe",)):
            _check_observed(file.observe, len(values) > 1 or len(file.medium) > 1, dict(file.sweep))
        with _located(document, ("load", kind)):
            scene = cls(
                packing, Load(kind, values, file.load.balls_per_side), media=file.medium, parameters=file.sweep,
                finite_overlap=file.packing.finite_overlap, observe=file.observe, band=band, band_points=phonopy.band_points,
                mesh=phonopy.mesh, dim=phonopy.dim, source=source,
            )  # fmt: skip
        object.__setattr__(scene, "_document", document)
        scene._require_packings(document)
        return scene

    def _require_packings(self, document: Document) -> None:
        """Raise if a packing is not rigid, has no such medium, or one that is solved in a moment cannot carry a load.

        Of very many packings those at the ends of the axes: what holds at two values of a parameter holds between them.
        """
        self._require_values(document)
        lattice = ("sweep", "lattice") if "lattice" in dict(self.parameters) else ("packing", "lattice")
        with _located(document, ("sweep",)):
            counted(self._plan.axes)
            cases = list(self._plan.few)
        for label, packing, choice in cases:
            where = label.removeprefix(choice.label).removeprefix(", ")
            found = f"found {packing.structure.name!r}; allowed: a lattice that is rigid. "
            with _located(document, lattice, found + (where and f"{where}: ")):
                ContactLattice.of(packing.structure, packing.mindlin_ratio)
            with _located(document, ("medium",), f"found {choice.label!r}; allowed: a medium for this lattice. "):
                choice.of(packing)
            # every list of diameters is solved anew, and a sweep solves it in its own processes
            listed = isinstance(packing.spread, Discrete | Measured) and choice.name == EffectiveMedium.name
            if not (self.is_sweep and listed):
                self._require_loads(document, packing, choice, label)

    def _require_loads(self, document: Document, packing: Packing, choice: MediumChoice, label: str) -> None:
        """Raise if a medium cannot carry one of the loads; it can carry all if it carries the least and the greatest."""
        load = self.load.applied
        for index in {int(np.argmin(load.array)), int(np.argmax(load.array))}:
            one = Load(load.kind, load.values[index])
            with self._located_medium(document, choice):
                (rung,) = choice.rungs(packing, one)
            if not (rung.is_quick or rung.medium.simulates):
                continue  # a long list of diameters is solved by the run alone
            with self._located_load(document, index, f"{label}: "):
                medium = rung.medium.of(packing)
                if isinstance(medium, DirectSimulation):
                    medium.require(one)
                    continue
                contact_lattice(_finite(self._state(packing, rung, one)))

    def _located_medium(self, document: Document, choice: MediumChoice) -> AbstractContextManager[None]:
        return _located(document, ("medium",), f"found {choice.label!r}; allowed: a tolerance that is met at every load. ")

    def _located_load(self, document: Document, index: int, before: str = "") -> AbstractContextManager[None]:
        path, given = _place(document, "load", self.load.kind, index)
        return _located(document, path, f"found {shown(given)}; allowed: a load that the balls can carry. {before}")

    def _require_values(self, document: Document) -> None:
        """Raise at the first value of a parameter that the packing cannot have."""
        for axis in self._plan.axes:
            with suppress(GranphonError, ArithmeticError):
                for value in axis.ends.values:
                    changed(self.packing, {axis.name: value})
                continue
            for index, value in enumerate(axis.values):
                path, given = _place(document, "sweep", axis.name, index)
                with _located(document, path, f"found {shown(given)}; allowed: a value that the packing can have. "):
                    changed(self.packing, {axis.name: value})

    @cached_property
    def _plan(self) -> Plan:
        return Plan(self.packing, tuple(Axis(*axis) for axis in self.parameters), self.media, self.load.applied)

    def _state(self, packing: Packing, rung: Rung, load: Load) -> ContactState:
        """The state in the medium of a rung."""
        with np.errstate(all="ignore"):
            # left out, nobody has said it
            state = rung.medium.of(packing).at(load, finite_overlap=self.finite_overlap or None)
        return replace(state, chosen=rung.chosen)

    def state(self) -> ContactState:
        """The contacts under the load.

        :class:`~granphon.base.errors.InputError` if the balls cannot carry it, or if the scene is a sweep.
        """
        rung = self.rung
        located = nullcontext() if self._document is None else self._located_load(self._document, 0)
        with located:
            return _finite(self._state(self.packing, rung, self._single_load))

    def states(self, simulations: bool = True, lists: bool = True) -> Iterator[tuple[str, ContactState]]:
        """Every medium at every combination of parameters, in words, and its contacts: (n_loads,), or () for one load.

        Each is solved when its turn comes, ``simulations``, and effective media of long ``lists`` of diameters, only if they
        are wanted. :class:`~granphon.base.errors.InputError` at the first that cannot carry the loads.
        """
        load = self.load.applied
        for label, packing, choice in self._plan:
            if self._document is not None and not choice.simulates:
                self._require_loads(self._document, packing, choice, label)
            for rung in choice.rungs(packing, load):
                if rung.is_quick or (simulations if rung.medium.simulates else lists):
                    some = rung.load if load.size > 1 or choice.is_automatic else self._single_load
                    where = f"{label}: {rung.medium.label}" if choice.is_automatic else label
                    yield where, self._state(packing, rung, some)

    def survey(self) -> tuple[Iterator[tuple[str, ContactState]], str]:
        """The :meth:`states` that are found in a moment, and what is left out, in words, empty if nothing is.

        Neither simulations nor effective media of long lists of diameters; of more than 100 media and packings or 20 000
        states, those of the least and the greatest load and value of each parameter.
        """
        few, left = self, []
        if self._plan.cases > MOST_CASES or self._plan.states > _MOST_STATES:
            ends = tuple(dict.fromkeys((min(self.load.values), max(self.load.values))))
            swept = tuple((axis.name, axis.values) for axis in self._plan.ends.axes)
            few = replace(self, load=replace(self.load, array=ends), parameters=swept)
            left.append(f"all but the ends of {self._plan.states:,} states")
        if any(
            not (rung.is_quick or rung.medium.simulates)
            for _, packing, choice in few._plan
            for rung in choice.rungs(packing, few._plan.load)
        ):
            left.append("the effective medium of long lists of diameters")
        return few.states(simulations=False, lists=False), " and ".join(left)

    def cost(self) -> Cost | None:
        """Memory and time that the scene will take, its parts one after the other; None if that is next to nothing.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this machine now.
        """
        from granphon.media.cost import Cost, available_memory

        parts = [part for part in self._parts() if part[2].tells]
        total = sum((cost for _, _, cost in parts), Cost())
        if parts and total.memory > (free := available_memory()):
            path, mend, _ = max(parts, key=lambda part: part[2].memory)
            what = f"{total.text}, and this machine has {free / 1e9:.3g} GB of memory available"
            if self._document is not None:
                raise self._document.error(path, f"{what}. {mend}.")
            raise InputError(message(what, mend=mend))
        return total if parts else None

    def _parts(self) -> Iterator[tuple[tuple[str, ...], str, Cost]]:
        """What will take something: where the scene asks for it, how it could be less, and what it takes."""
        from granphon.media.cost import bands, density_of_states, force_constants, sweep_states

        plan, packing, exponents = self._plan, self.packing, self.is_sweep or "velocities" in self.observe
        yield ("medium",), "Take fewer balls (medium.simulation.shape), samples or loads", plan.simulations(exponents)
        structure, seen = packing.structure, {"bands", "dos"} & set(self.observe)
        branches = structure.n_balls * (3 if packing.friction else 2)
        points = self.band_points * sum(len(path) - 1 for path in self.path.paths) if "bands" in seen else 0
        if self.is_sweep:
            path = ("phonopy", "band_points") if points else ("sweep",) if self.parameters else ("load", self.load.kind)
            mend = "Take fewer loads or values" + (", or points of the bands (phonopy.band_points)" if points else "")
            yield path, mend, sweep_states(plan.cases, len(self.load.values), points * branches)
            return
        if "bands" in seen:
            yield ("phonopy", "band_points"), "Take fewer points", bands(points, branches)
        if "dos" in seen:
            yield ("phonopy", "mesh"), "Take a coarser mesh", density_of_states(self.mesh, branches)
        if seen and self.dim is not None:
            mend = "Take a smaller supercell: bands and densities of states do not depend on it"
            yield ("phonopy", "dim"), mend, force_constants(self.dim, structure.n_balls)

    def sweep(self, progress: Progress = silent, executor: Executor | None = None, **options: Any) -> Dataset:
        """Every state of the scene as one data set, see :func:`granphon.sweeps.sweep.sweep`, which has the other keywords
        too.

        A load that cannot be carried is a :class:`~granphon.base.errors.SceneError` if the scene was read from a file.
        """
        from granphon.sweeps.sweep import sweep

        load = self.load.applied
        given: dict[str, Any] = {load.kind: load.values, "media": self.media, "finite_overlap": self.finite_overlap}
        given |= dict(self.parameters) | options
        if "bands" in self.observe:
            given |= {"bands": self.path.arrays, "npoints": self.band_points, "labels": self.path.labels}
        try:
            return sweep(self.packing, progress=progress, executor=executor, **given)
        except GranphonError as error:
            index = getattr(error, "load_index", None)
            if self._document is None or index is None:
                raise
            with self._located_load(self._document, index):
                raise

    def to_yaml(self) -> str:
        """The scene with every default written out and quantities in SI; read again it is the same scene to the last bit.

        A measured spread of more than 1000 diameters is written as the name of a table, whose text is :attr:`diameters`.
        :class:`~granphon.base.errors.InputError` if the lattice is none that a file can name, or the text is too long.
        """
        packing, material = self.packing, self.packing.material
        blocks: dict[str, Any] = {"schema": rules.SCHEMA}
        blocks["material"] = {
            "young_modulus": MODULUS.write(material.young_modulus), "poisson_ratio": material.poisson_ratio,
            "density": DENSITY.write(material.density),
        }  # fmt: skip
        if material.yield_strength is not None:
            blocks["material"]["yield_strength"] = MODULUS.write(material.yield_strength)
        blocks["packing"] = {"lattice": rules.write_lattice(packing.structure), "diameter": LENGTH.write(packing.diameter)}
        if packing.spread is not None:
            blocks["packing"]["spread"] = rules.write_spread(packing.spread, DIAMETERS_FILE)
        blocks["packing"] |= {"friction": packing.friction, "finite_overlap": self.finite_overlap}
        blocks["load"] = {self.load.kind: rules.write_values(self.load.values, LOADS[self.load.kind].write)}
        if self.load.balls_per_side is not None:
            blocks["load"]["balls_per_side"] = self.load.balls_per_side
        media = [{choice.name: choice.settings} if choice.settings else choice.name for choice in self.media]
        blocks["medium"] = media if len(media) > 1 else media[0]
        if self.parameters:
            blocks["sweep"] = {name: rules.write_parameter(name, values) for name, values in self.parameters}
        blocks["observe"] = self.observe
        blocks["phonopy"] = {} if self.dim is None else {"dim": f"{self.dim[0]} {self.dim[1]} 1"}
        blocks["phonopy"]["band"] = str(self.path)
        if self.path.labels is not None:
            blocks["phonopy"]["band_labels"] = self.path.labels
        blocks["phonopy"] |= {"band_points": self.band_points, "mesh": f"{self.mesh[0]} {self.mesh[1]} 1"}
        text = dump_yaml(blocks)
        if len(text.encode()) > MAX_BYTES:
            what = f"the scene takes {len(text.encode()) // 1000} kB as a text; a scene file holds {MAX_BYTES // 1000} kB"
            raise InputError(message(what, mend="Give long lists as a range, or call granphon.sweep"))
        return text

    @cached_property
    def diameters(self) -> str | None:
        """The text of ``diameters.csv``: the measured diameters, if they are too many for the scene file; else None."""
        return rules.diameters_table(self.packing.spread)

    def run(
        self,
        folder: str | os.PathLike[str],
        force: bool = False,
        progress: Progress | None = None,
        figures: bool = True,
        resume: bool = False,
        executor: Executor | None = None,
    ) -> RunResult | SweepResult:
        """Compute what the scene asks for and write it into ``folder``; see :func:`granphon.scene.run.run`."""
        from granphon.scene.run import run

        self.cost()  # refuses what there is no memory for
        told = progress or silent
        return run(self, folder, force=force, progress=told, figures=figures, resume=resume, executor=executor)


# -- checks, and where in the file they belong ----------------------------------------------------------------------


def _packing_of(document: Document, file: SceneFile) -> Packing:
    balls, given = file.packing, document.data["packing"]
    size = f"found {shown(given['diameter'])}; allowed: a ball that double precision can hold. "
    with _located(document, ("packing", "diameter"), size):
        material = Material(**file.material.model_dump())
        packing = Packing(material, balls.diameter, lattice=balls.lattice, friction=balls.friction)
    if balls.spread is None:
        return packing
    ((kind, value),) = given["spread"].items()
    found = f"found {shown(value)}; allowed: diameters about the packing's, all above zero. "
    with _located(document, ("packing", "spread", kind), found):
        return replace(packing, spread=balls.spread)


def _place(document: Document, block: str, key: str, index: int) -> tuple[tuple[str | int, ...], Any]:
    """Where one of the values of a key stands, and what stands there: the one value, one of a list, or an end of a range."""
    given = document.data[block][key]
    if isinstance(given, list):
        return (block, key, index), given[index]
    if isinstance(given, dict):
        end = "to" if index else "from"
        return (block, key, end), given[end]
    return (block, key), given


def _finite(state: ContactState) -> ContactState:
    scale = state.scales
    if not (0.0 < scale.frequency < math.inf and 0.0 < scale.velocity < math.inf):
        raise InputError("the frequencies or velocities are beyond double precision.")
    return state


def _check_supercell(packing: Packing, dim: tuple[int, int] | None) -> None:
    """Raise if two balls of the supercell would touch through two images."""
    if dim is not None and not contacts_apart(packing.structure.vectors, dim, 1.0):
        least = next(n for n in range(1, 100) if contacts_apart(packing.structure.vectors, (n, n), 1.0))
        raise InputError(f"found {dim[0]} {dim[1]} 1; allowed: {least} {least} 1 or more.")


def _check_observed(observe: Sequence[str], several: bool, parameters: Mapping[str, Any]) -> None:
    """Raise if what is observed makes no array over a sweep."""
    if "dos" in observe and (several or parameters):
        allowed = "velocities, bands, where there are several loads or media or a sweep"
        raise InputError(f"found 'dos'; allowed: {allowed}. Make a scene of each state whose density of states you want.")
    changing = [name for name in ("friction", "lattice") if name in parameters]
    if "bands" in observe and changing:
        found = f"found 'bands' with a sweep over {changing[0]}"
        raise InputError(f"{found}; allowed: velocities, as the branches differ in number or zone. Make a scene of each.")


@contextmanager
def _located(document: Document, path: Sequence[str | int], before: str = "") -> Iterator[None]:
    """Turn an error of the library into one that names file, line and key."""
    try:
        yield
    except (GranphonError, ArithmeticError) as error:
        raise document.error(path, f"{before}{error}") from None
