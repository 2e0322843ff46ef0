"""The scene: what to compute, read from a YAML file and checked before anything is done.

Quantities carry their units ("8 mm") in the file only; a :class:`Scene` holds SI floats. Every mistake in a file is one
:class:`~granphon.base.errors.SceneError` that names file, line and key, what was found, what is allowed, and the likely
intention.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, cast

from granphon.balls.contact_table import contacts_apart
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import Load, force_of_frame
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis
from granphon.base.errors import GranphonError, InputError, Refused, message
from granphon.base.progress import Progress, silent
from granphon.base.quantities import DENSITY, LENGTH, LOADS, MODULUS
from granphon.base.text import MOST_SCENE_BYTES, dump_yaml
from granphon.base.validation import require, truth
from granphon.media.choice import MediumChoice, Rung, no_simulation
from granphon.media.state import ContactState
from granphon.phonons.paths import BandPath
from granphon.scene import fields as rules
from granphon.scene.plan import Plan
from granphon.scene.reader import Origin
from granphon.scene.result_files import DIAMETERS_FILE

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from xarray import Dataset

    from granphon.media.cost import Cost
    from granphon.scene.run import RunResult, SweepResult

__all__ = ["BandPath", "Load", "Scene", "force_of_frame"]


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
    #: what the scene was read from; a copy with other values was not
    _origin: Origin = field(default=Origin(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        axes = tuple(Axis.of(name, values) for name, values in dict(self.parameters).items())
        object.__setattr__(self, "parameters", tuple((axis.name, axis.values) for axis in axes))
        if isinstance(self.media, tuple | list) and not self.media:
            object.__setattr__(self, "media", "ema" if self.balls_differ else "ala")
        checks: dict[str, Callable[[Any], Any]] = {
            "media": rules.read_media, "finite_overlap": truth, "observe": rules.read_observables,
            "band_points": rules.segment_points, "mesh": rules.mesh_numbers,
        }  # fmt: skip
        if self.dim is not None:
            checks["dim"] = rules.supercell
        for name, rule in checks.items():
            object.__setattr__(self, name, require(name, rule, getattr(self, name)))
        if self.band is None:
            object.__setattr__(self, "band", BandPath.default(self.packing.structure))
        if self.load.array.ndim > 1:
            raise InputError(message(f"the load has the shape {self.load.shape}", mend="Give one number, or a list of them"))
        self._require_consistency()

    @property
    def path(self) -> BandPath:
        """The path of the bands."""
        return cast("BandPath", self.band)  # set when the scene was made

    @property
    def inputs(self) -> tuple[Path, ...]:
        """The files that the scene was read from: its own, and the tables of measured diameters that it names."""
        return self._origin.inputs

    @property
    def balls_differ(self) -> bool:
        """Whether diameters differ, or a sweep makes them."""
        return self.packing.width > 0.0 or not {"width", "spread"}.isdisjoint(dict(self.parameters))

    @cached_property
    def plan(self) -> Plan:
        """The cases of the scene, what serves them, their states and costs: each is found once."""
        return Plan.of(self, self._origin)

    @property
    def rung(self) -> Rung:
        """The medium of a scene of one state, chosen if that is automatic, and its expected error.

        :class:`~granphon.base.errors.InputError` if none can be chosen, or if the scene is a sweep.
        """
        (rung,) = self.plan.case.rungs
        return rung

    @property
    def is_sweep(self) -> bool:
        """Whether there is more than one load or medium, or a parameter is swept."""
        return len(self.load.values) > 1 or len(self.media) > 1 or bool(self.parameters)

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; :class:`~granphon.base.errors.SceneError` names whatever is wrong with it."""
        return cls._of(Origin.of_file(path))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Read a scene from a text, which messages call ``name``; raises as :meth:`from_yaml`.

        Files that it names are looked for in the working folder.
        """
        return cls._of(Origin.of_text(text, name))

    @classmethod
    def _of(cls, origin: Origin) -> Self:
        given = origin.read()
        with origin.at():
            scene = cls(**given)
        object.__setattr__(scene, "_origin", origin)
        scene.plan.require()
        return scene

    def state(self) -> ContactState:
        """The contacts under the load.

        :class:`~granphon.base.errors.InputError` if the balls cannot carry it, or if the scene is a sweep.
        """
        case = self.plan.case
        _ = case.rungs  # an error of the choice is not one of the load
        with case.at_load(0):
            return case.state

    def states(self, simulations: bool = True, lists: bool = True) -> Iterator[tuple[str, ContactState]]:
        """Every medium at every combination of parameters, in words, and its contacts: (n_loads,), or () for one load.

        Each is solved when its turn comes, ``simulations``, and effective media of long ``lists`` of diameters, only if they
        are wanted. :class:`~granphon.base.errors.InputError` at the first that cannot carry the loads.
        """
        return self.plan.states(simulations, lists)

    def survey(self) -> tuple[Iterator[tuple[str, ContactState]], str]:
        """The :meth:`states` that are found in a moment, and what is left out, in words, empty if nothing is.

        Neither simulations nor effective media of long lists of diameters; of more than 100 media and packings or 20 000
        states, those of the least and the greatest load and value of each parameter.
        """
        return self.plan.survey()

    def cost(self) -> Cost | None:
        """Memory and time that the scene will take, its parts one after the other; None if that is next to nothing.

        :class:`~granphon.base.errors.InputError` if more memory is needed than is available on this machine now.
        """
        return self.plan.cost()

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
            if error.load_index is None:
                raise
            with self._origin.at_load(self.load.kind, error.load_index):
                raise

    def to_yaml(self) -> str:
        """The scene with every default written out and quantities in SI; read again it is the same scene to the last bit.

        A measured spread of more than 1000 diameters is written as the name of a table, whose text is :attr:`diameters`.
        :class:`~granphon.base.errors.InputError` if the lattice is none that a file can name, or the text is too long.
        """
        packing, material = self.packing, self.packing.material
        blocks: dict[str, Any] = {"schema": rules.SCENE_SCHEMA}
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
        if len(text.encode()) > MOST_SCENE_BYTES:
            size, most = len(text.encode()) // 1000, MOST_SCENE_BYTES // 1000
            what = f"the scene takes {size} kB as a text; a scene file holds {most} kB"
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

    # -- what does not go together, by its key in the file --------------------------------------------------------------

    def _require_consistency(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if the values, each of them allowed, do not go together."""
        structure, dim, swept = self.packing.structure, self.dim, dict(self.parameters)
        if dim is not None and not contacts_apart(structure.vectors, dim, 1.0):
            # two balls of the supercell would touch through two images
            least = next(n for n in range(1, 100) if contacts_apart(structure.vectors, (n, n), 1.0))
            raise Refused(f"{dim[0]} {dim[1]} 1", f"{least} {least} 1 or more", path=("phonopy", "dim"))
        if self.finite_overlap:
            try:
                no_simulation(self.media)
            except InputError as error:
                raise Refused("true", "false, with a simulation", str(error), ("packing", "finite_overlap")) from None
        if "dos" in self.observe and self.is_sweep:
            allowed = "velocities, bands, where there are several loads or media or a sweep"
            raise Refused("'dos'", allowed, "Make a scene of each state whose density of states you want.", ("observe",))
        changing = [name for name in ("friction", "lattice") if name in swept]
        if "bands" in self.observe and changing:
            allowed = "velocities, as the branches differ in number or zone"
            raise Refused(f"'bands' with a sweep over {changing[0]}", allowed, "Make a scene of each.", ("observe",))
        if self.load.kind == "side_force" and structure != TRIANGULAR:
            allowed = "on the triangular lattice only, whose frame is a hexagon"
            raise Refused("a side_force", allowed, path=("load", "side_force"))
