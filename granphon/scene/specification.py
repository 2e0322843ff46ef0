"""What a scene asks for: its values, checked, in SI units, and the text of its file."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, cast

from granphon.balls.contact_table import touch_once_at_most
from granphon.balls.lattices import TRIANGULAR
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis, change_packing
from granphon.base.errors import InputError, Refused, message
from granphon.base.quantities import LENGTH
from granphon.base.tables import Heading, table_text
from granphon.base.text import MOST_SCENE_BYTES, dump_yaml
from granphon.base.validation import read_inside, require
from granphon.media.choice import MediumChoice, no_simulation
from granphon.phonons.paths import BandPath, read_paths
from granphon.runs.cases import require_arrays
from granphon.scene import rules
from granphon.scene.fields import scene_rule, write_blocks
from granphon.scene.reader import SceneSource
from granphon.scene.rules import Context
from granphon.waves.settings import WAVES, PulseSettings, SpectrumSettings, WaveSettings


@dataclass(frozen=True)
class Specification:
    """The values of a :class:`~granphon.scene.scene.Scene`, which describes them; no state is computed of them here."""

    schema: ClassVar[int] = rules.SCENE_SCHEMA

    packing: Packing
    load: Load
    _: KW_ONLY
    media: tuple[MediumChoice, ...] = ()
    parameters: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    finite_overlap: bool = False
    observe: tuple[str, ...] = ("velocities",)
    direction: tuple[Any, ...] | None = None
    band: BandPath | None = None
    band_points: int = 101
    mesh: tuple[int, ...] | None = None
    dim: tuple[int, ...] | None = None
    spectrum: SpectrumSettings = field(default_factory=SpectrumSettings)
    pulse: PulseSettings | None = None
    source: Path | None = field(default=None, compare=False)
    #: document and file that the scene was read from; a copy made by ``replace`` has none, as its values may differ
    _origin: SceneSource = field(default=SceneSource(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        axes = tuple(Axis.of(name, values) for name, values in dict(self.parameters).items())
        object.__setattr__(self, "parameters", tuple((axis.name, axis.values) for axis in axes))
        swept = dict(self.parameters).get("lattice", ())
        lattice = rules.choose_lattice(self.packing.structure, swept)
        if lattice != self.packing.structure:
            object.__setattr__(self, "packing", change_packing(self.packing, {"lattice": swept[0]}))
        if self.mesh is None:
            object.__setattr__(self, "mesh", rules.MESHES[lattice.periods - 1])
        if isinstance(self.media, tuple | list) and not self.media:
            object.__setattr__(self, "media", "ema" if self.balls_differ else "ala")
        at = Context(lattice, written=False)
        for name in ("media", "finite_overlap", "observe", "band_points", "mesh", "dim", "direction"):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, require(name, scene_rule(name, at), value))
        if all(one.is_exact for one in self.media) and self.balls_differ:
            object.__setattr__(self, "finite_overlap", True)
        # in space ASE knows the path: a scene without bands does not ask it
        if self.band is None and (lattice.periods == 2 or {"bands", "spectrum"} & set(self.observe)):
            object.__setattr__(self, "band", BandPath.default(lattice))
        if self.load.array.ndim > 1:
            raise InputError(message(f"the load has the shape {self.load.shape}", mend="Give one number, or a list of them"))
        self._require_consistency()

    @property
    def path(self) -> BandPath:
        """Path of the bands in reciprocal space; never None, unlike the argument ``band``."""
        return BandPath.default(self.packing.structure) if self.band is None else self.band

    @property
    def grid(self) -> tuple[int, ...]:
        """Numbers of wave vectors for the density of states; never None, unlike the argument ``mesh``."""
        return cast("tuple[int, ...]", self.mesh)  # __post_init__ has replaced None

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Paths of the files that the scene was read from: the scene file, and the tables of measured diameters it names."""
        return self._origin.inputs

    @property
    def directions(self) -> tuple[tuple[float, ...], ...]:
        """The directions of sound that are given, one or many; empty if none is."""
        given = self.direction or ()
        return given if given and isinstance(given[0], tuple) else (given,) * bool(given)

    @property
    def balls_differ(self) -> bool:
        """Whether the diameters of the balls differ, or differ in a sweep over "width" or "spread"."""
        return self.packing.width > 0.0 or not {"width", "spread"}.isdisjoint(dict(self.parameters))

    @cached_property
    def waves(self) -> WaveSettings | None:
        """What is observed of the waves in arrays, where media simulate them; None for nothing."""
        if not set(WAVES) & set(self.observe):
            return None
        spectrum = self.spectrum if "spectrum" in self.observe else None
        path = self.path if spectrum is not None else None
        way = (path.paths, path.names) if path is not None else ((), ())
        pulse = self.pulse if "pulse" in self.observe else None
        return WaveSettings("dos" in self.observe, spectrum, *way, pulse, self.direction if pulse is not None else None)

    @property
    def bands(self) -> dict[str, Any]:
        """The path of the bands, as keywords of :func:`granphon.runs.sweep.sweep`; empty if they are not observed."""
        if "bands" not in self.observe:
            return {}
        return {"bands": self.path.arrays, "npoints": self.band_points, "labels": self.path.labels}

    @property
    def is_single(self) -> bool:
        """Whether there is one state alone: one load, one medium, and no parameter that is swept."""
        return len(self.load.values) == len(self.media) == 1 and not self.parameters

    def to_yaml(self) -> str:
        """Return the text of the scene with every default written out and quantities in SI units.

        Read again, it gives the same scene to the last bit. A measured spread of more than 1000 diameters is written as the
        name of a table, whose text is :attr:`diameters`.
        :class:`~granphon.base.errors.InputError` if a file has no name for the lattice, or the text is too long.
        """
        text = dump_yaml(write_blocks(self, Context(self.packing.structure)))
        if len(text.encode()) > MOST_SCENE_BYTES:
            size, most = len(text.encode()) // 1000, MOST_SCENE_BYTES // 1000
            what = f"the scene takes {size} kB as a text; a scene file holds {most} kB"
            raise InputError(message(what, mend="Give long lists as a range, or call granphon.sweep"))
        return text

    @cached_property
    def diameters(self) -> str | None:
        """Text of ``diameters.csv``: the measured diameters, m, if they are too many for the scene file; else None."""
        given: Any = self.packing.spread
        if not rules.is_long(given):
            return None
        return table_text([Heading("diameter", LENGTH.unit)], ([diameter] for diameter in given.diameters))

    @property
    def parameters_of_branches(self) -> list[str]:
        """Names of swept parameters on which the number of branches or the zone depends: bands are not swept over them."""
        changing = []
        for name, values in self.parameters:
            motions = set[Any]()
            if name in ("motions", "torsion", "bending"):
                with suppress(InputError):  # a value that the packing cannot have is told with its place later
                    motions = {change_packing(self.packing, {name: value}).ball_motions for value in values}
            changing += [name] * (name in ("friction", "lattice") or len(motions) > 1)
        return changing

    # -- values that exclude each other, by the key in the file ---------------------------------------------------------

    def _require_consistency(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if values that are allowed one by one exclude each other."""
        structure, dim = self.packing.structure, self.dim
        if dim is not None and not touch_once_at_most(structure.vectors, dim, 1.0):
            # two balls of the supercell would touch through two images
            sizes = ((n,) * structure.periods for n in range(1, 100))
            least = next(size for size in sizes if touch_once_at_most(structure.vectors, size, 1.0))
            raise Refused(rules.write_grid(dim), f"{rules.write_grid(least)} or more", path=("phonopy", "dim"))
        if self.finite_overlap:
            try:
                no_simulation(self.media)
            except InputError as error:
                raise Refused("true", "false, with a simulation", str(error), ("packing", "finite_overlap")) from None
        # the density of states of one state is that of its lattice, and of a simulation that of the array too
        names = [name for name in WAVES if name in self.observe and (not self.is_single or name != "dos")]
        try:
            require_arrays(self.media, dict(self.parameters), names)
        except InputError as error:
            allowed = f"{', '.join(names)} of arrays that a medium: simulation makes"
            if "dos" in names:
                allowed += ", where there are several loads or media or a sweep"
            raise Refused(f"{names[0]!r}", allowed, str(error), ("observe",)) from None
        if "pulse" in names and self.pulse is None:
            mend = "Add a block such as pulse: {frequency: 6.5 kHz}."
            raise Refused("'pulse' without a frequency", "pulse with a block 'pulse'", mend, ("observe",))
        if "pulse" in names and len(self.directions) > 1:
            raise Refused("several directions with a pulse", "one direction", path=("direction",))
        if "bands" in self.observe and (changing := self.parameters_of_branches):
            allowed = "velocities, as the branches differ in number or zone"
            raise Refused(f"'bands' with a sweep over {changing[0]}", allowed, "Make a scene of each.", ("observe",))
        if self.band is not None:
            path = partial(read_paths, periods=structure.periods)
            read_inside("phonopy", partial(read_inside, "band", path), str(self.band))
        if self.load.kind == "side_force" and structure != TRIANGULAR:
            allowed = "on the triangular lattice only, whose frame is a hexagon"
            raise Refused("a side_force", allowed, path=("load", "side_force"))
