"""The values of a scene, checked one by one and against each other, and their text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, cast

from granphon.balls.lattices import TRIANGULAR, Lattice
from granphon.balls.layers import Layers
from granphon.balls.loads import Load
from granphon.balls.neighbours import touch_once_at_most
from granphon.balls.on_site import HOLDING_PARAMETERS
from granphon.balls.packing import LOSS_PARAMETERS, Axis, Packing, change_packing, find_unit
from granphon.base.errors import InputError, Refused, brief
from granphon.base.quantities import ACCELERATION, LENGTH, find_load_unit
from granphon.base.settings import describe_settings, read_block
from granphon.base.tables import Heading, table_text
from granphon.base.text import MOST_SCENE_BYTES, dump_yaml, require_path, show, spell
from granphon.base.validation import read_inside, require, text
from granphon.media.choice import MediumChoice, default_medium, require_finite_overlap
from granphon.media.medium import CRYSTAL
from granphon.phonons.paths import BAND_POINTS, MESHES, BandPath, read_paths
from granphon.runs.plan import list_parameters_of_branches
from granphon.runs.tasks import list_swept, require_arrays
from granphon.scene import file_keys
from granphon.scene.design_settings import DesignSettings, require_variables
from granphon.scene.file import SETTINGS, SceneSource, write_blocks
from granphon.scene.file_keys import Context
from granphon.scene.outputs import is_of_arrays_alone
from granphon.waves.sensors import find_unused
from granphon.waves.settings import BLOCKS as WAVE_BLOCKS
from granphon.waves.settings import (
    DASHPOTS,
    KEYS_OF_PLANES,
    NETWORK_BLOCKS,
    WAVES,
    BandsSettings,
    EdgeSettings,
    ModesSettings,
    MotionSettings,
    PulseSettings,
    ResponseSettings,
    SpectrumSettings,
    SurfaceSettings,
    WaveSettings,
    require_losses,
    require_walls,
)

if TYPE_CHECKING:
    from granphon.media.arrangement import Arrangement
    from granphon.media.network_file import NetworkFiles

#: settings of a spectrum whose values are all defaults
_DEFAULT_SPECTRUM = SpectrumSettings()
#: the keys in a file by whose rules attributes of a scene are checked
_KEYS_OF_RULES = {
    "media": file_keys.MEDIUM,
    "finite_overlap": file_keys.PACKING["finite_overlap"],
    "observe": file_keys.OBSERVE,
    **{name: file_keys.PHONOPY[name] for name in ("band_points", "mesh", "dim")},
    "direction": file_keys.DIRECTION,
    "correlations": file_keys.CORRELATIONS,
}
#: those of these attributes that may be None, which no rule reads
_ATTRIBUTES_WITHOUT_VALUE = frozenset({"direction", "dim"})
#: the parameters that may change the lattice or the motions of balls, so the number of branches
_PARAMETERS_OF_MOTIONS = ("lattice", "motions", "friction", "torsion", "bending")
#: words for the losses and walls that a sweep may vary, in the refusal of others
_WORDS_FOR_SWEEP = "a parameter of what is observed, which no block gives"
#: greatest number of directions of sound that the description of a scene names
_MOST_DIRECTIONS = 4
#: limit of the number of cells along each period up to which the smallest supercell is sought
_MOST_CELLS = 100


class Conflict(NamedTuple):
    """A reason for which an observable cannot be observed.

    Attributes
    ----------
    name : the observable.
    holds : whether the reason holds in the scene: true for any value that is neither zero, empty
        nor None.
    problem : words behind the name in the message, such as "of a simulation".
    allowed : words for what can be observed instead.
    mend : what the user can do, a sentence.
    """

    name: str
    holds: Any
    problem: str
    allowed: str
    mend: str


@dataclass(frozen=True)
class SceneValues:
    """The values of a :class:`~granphon.scene.scene.Scene`, which describes each of them."""

    schema: ClassVar[int] = file_keys.SCENE_SCHEMA

    packing: Packing | Arrangement | NetworkFiles
    load: Load
    _: KW_ONLY
    media: tuple[MediumChoice, ...] = ()
    parameters: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    finite_overlap: bool = False
    observe: tuple[str, ...] = ("velocities",)
    direction: tuple[Any, ...] | None = None
    band: BandPath | None = None
    band_points: int = BAND_POINTS
    mesh: tuple[int, ...] = ()  # the default of the lattice
    dim: tuple[int, ...] | None = None
    surface: SurfaceSettings | None = None
    spectrum: SpectrumSettings = _DEFAULT_SPECTRUM
    pulse: PulseSettings | None = None
    response: ResponseSettings | None = None
    motion: MotionSettings | None = None
    modes: ModesSettings | None = None
    bands: BandsSettings | None = None
    design: DesignSettings | None = None
    #: paths in the file of the parameters that have a standard error, and the error, SI
    errors: tuple[tuple[tuple[str | int, ...], Any], ...] = ()
    #: names of two such parameters, and the correlation of their errors
    correlations: tuple[tuple[str, str, float], ...] = ()
    source: Path | None = field(default=None, compare=False)
    #: document and file that the scene was read from; a copy made by ``replace`` has none, as its
    #: values may differ
    origin: SceneSource = field(default=SceneSource(), init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Replace the arguments by the values that the scene keeps, and check these one by one and
        then together: lists become tuples, names become media, a crystal becomes its arrangement,
        and defaults that depend on other values are filled in. Refused or InputError for a value
        that is not allowed.
        """
        self._settle_balls_and_load()
        self._settle_source()
        lattice = self._settle_parameters()
        context = Context(lattice, written=False)
        self._settle_single_values(context)
        given_path = self.band
        self._settle_path(lattice)
        self._settle_blocks(context)
        self._require_consistency(given_path)
        self._settle_errors()

    def _assign(self, name: str, value: Any) -> None:
        """Set the attribute ``name`` to ``value`` while the scene, which is frozen, is made."""
        object.__setattr__(self, name, value)

    def _settle_balls_and_load(self) -> None:
        """Set the balls of the scene, and for a packing in files whether it keeps the terms of
        finite overlap, which the files say. InputError for an argument that is no balls or no load,
        for loads in more than one dimension, and for a packing in files under another load than its
        own.
        """
        self._assign("packing", _read_balls(self.packing))
        if not isinstance(self.load, Load):
            raise InputError(f"load is {show(self.load)}", mend="Give a granphon.Load")
        if self.load.array.ndim > 1:
            problem = f"the load has the shape {self.load.shape}"
            raise InputError(problem, mend="Give one number, or a list of them")
        if self.packing.is_network:
            files = cast("NetworkFiles", self.packing)
            if self.load != files.load:
                raise InputError(
                    f"load is {brief(self.load)}",
                    "The contacts of a packing in files bear the forces that the files hold",
                    "Give the attribute load of the packing",
                )
            # so that a scene which is read from the text of this one is the same
            self._assign("finite_overlap", files.network.prestress)

    def _settle_source(self) -> None:
        """Set the path of the file of the scene, if one is given; InputError for what is no
        path.
        """
        if self.source is not None:
            require_path(self.source)
            self._assign("source", Path(self.source))

    def _settle_parameters(self) -> Lattice:
        """Set the swept parameters, and return the lattice to which other values refer. If the
        swept lattices have another number of periods than the lattice of the packing, or lie in
        another dimension, the packing is set on the first of the swept ones. InputError for a name
        or a value that no parameter has, and for a name that is given twice.
        """
        axes: dict[str, Axis] = {}
        for given_name, values in _read_pairs("parameters", self.parameters):
            name = require("the name of a parameter", text, given_name)
            if name in axes:
                raise InputError(f"{name} is swept twice", mend="Give all its values in one list")
            axes[name] = Axis.of(name, values)
        self._assign("parameters", tuple((axis.name, axis.values) for axis in axes.values()))
        lattices = dict(self.parameters).get("lattice", ())
        lattice = file_keys.choose_lattice(self.packing.structure, lattices)
        if lattice != self.packing.structure:
            self._assign("packing", change_packing(self.packing, {"lattice": lattices[0]}))
        return lattice

    def _settle_single_values(self, context: Context) -> None:
        """Set each value that the rule of a key reads, by this rule; the default media and the
        default mesh, which depend on the balls and the lattice, first.
        """
        if _is_left_out(self.mesh):
            self._assign("mesh", MESHES[context.lattice.periods - 1])
        if _is_left_out(self.media):
            self._assign("media", default_medium(self.packing, self.balls_differ))
        for name, declared in _KEYS_OF_RULES.items():
            value = getattr(self, name)
            if value is not None or name not in _ATTRIBUTES_WITHOUT_VALUE:
                self._assign(name, require(name, declared.kind.rule(context), value))

    def _settle_path(self, lattice: Lattice) -> None:
        """Set the default path of the bands, or of the spectrum of a packing in files, if none is
        given; InputError for a given one that is no :class:`~granphon.BandPath`.

        If the scene observes neither bands nor a spectrum, a default is set only on a ``lattice``
        of two periods. On others ``band`` stays None: ASE, which knows the paths in space, is asked
        only if a path is needed.
        """
        band: Any = self.band
        if band is not None:
            if not isinstance(band, BandPath):
                mend = "Give a granphon.BandPath, as BandPath.parse returns"
                raise InputError(f"band is {brief(band)}", mend=mend)
            return
        needs_path = lattice.periods == 2 or bool({"bands", "spectrum"} & set(self.observe))
        if needs_path:
            is_of_waves = self.packing.is_network and "bands" not in self.observe
            path = _find_wave_path(self.packing) if is_of_waves else BandPath.default(lattice)
            self._assign("band", path)

    def _settle_blocks(self, context: Context) -> None:
        """Set the settings of each block, from settings or from mappings. Modes that are observed,
        and a spectrum, have default settings if none are given. Refused or InputError for settings
        that the block cannot have, such as a wall of a kind that there is not.
        """
        spectrum: Any = self.spectrum
        if spectrum is None:
            self._assign("spectrum", _DEFAULT_SPECTRUM)
        if self.modes is None and "modes" in self.observe:
            self._assign("modes", ModesSettings())
        for block, settings in SETTINGS.items():
            value = getattr(self, block)
            if value is not None:
                rule = partial(read_block, settings, context=context)
                self._assign(block, require(block, rule, value))
            self.observed_settings(block)  # refuses such a wall

    def _settle_errors(self) -> None:
        """Set the standard errors, SI, and their correlations. Refused or InputError for errors
        that the parameters of the scene cannot have.
        """
        self._assign("errors", _read_pairs("errors", self.errors))
        _require_paths(self.errors)
        if self.errors or self.correlations:
            # imported here: few scenes have errors
            from granphon.scene.uncertainty import settle_correlations, settle_errors

            self._assign("errors", settle_errors(self))
            self._assign("correlations", settle_correlations(self))

    @property
    def path(self) -> BandPath:
        """The path in reciprocal space of the bands and of a spectrum: ``band``, or the default of
        the lattice where that is None.
        """
        return BandPath.default(self.packing.structure) if self.band is None else self.band

    @property
    def directions(self) -> tuple[tuple[float, ...], ...]:
        """The directions of sound that the scene names, (n, p); empty if it names none."""
        if not self.direction:
            return ()
        return self.direction if isinstance(self.direction[0], tuple) else (self.direction,)

    @property
    def balls_differ(self) -> bool:
        """Whether the diameters of the balls differ, or a sweep over "width" or "spread" says how
        they do.
        """
        return self.packing.width > 0.0 or not {"width", "spread"}.isdisjoint(dict(self.parameters))

    def observed_settings(self, block: str) -> Any:
        """Return the settings of a ``block`` such as "response", in which walls of kinds that the
        crystal lacks have their materials; None if the scene does not observe what the block is
        about.
        """
        settings = getattr(self, block) if block in self.observe else None
        if isinstance(settings, EdgeSettings) and settings.kinds_of_walls:
            return self._find_materials(settings)
        return settings

    @property
    def _written_spectrum(self) -> SpectrumSettings | None:
        """The settings of the spectrum as a file has them: None if the scene does not observe a
        spectrum and all of them are defaults, so that the file needs no block.
        """
        is_needed = "spectrum" in self.observe or self.spectrum != _DEFAULT_SPECTRUM
        return self.spectrum if is_needed else None

    @cached_property
    def waves(self) -> WaveSettings | None:
        """The waves that the scene observes: in simulated arrays and in packings in files a density
        of states, spectral functions and a pulse, and in the network of each state what the blocks
        of networks ask for; None for a scene that observes none of these. A density of states that
        is observed counts also where the state is a lattice, whose phonons have it.
        """
        blocks = map(self.observed_settings, NETWORK_BLOCKS)
        settings_of_networks = tuple(settings for settings in blocks if settings is not None)
        if not settings_of_networks and not set(WAVES) & set(self.observe):
            return None
        spectrum = self.observed_settings("spectrum")
        pulse = self.observed_settings("pulse")
        return WaveSettings(
            dos="dos" in self.observe,
            spectrum=spectrum,
            path=() if spectrum is None else self.path.paths,
            labels=() if spectrum is None else self.path.names,
            pulse=pulse,
            direction=None if pulse is None else self.direction,
            of_networks=settings_of_networks,
        )

    @property
    def swept(self) -> dict[str, int]:
        """The axes along which the states of the scene lie, each with the number of its values:
        "load" and "medium" where there are several, and each swept parameter, also one of a single
        value. A scene of one state that is no sweep has none.
        """
        return list_swept(self.load, self.media, self.parameters)

    def to_yaml(self) -> str:
        """Return the text of the scene, in which defaults are written out as by
        :func:`~granphon.scene.file.write_blocks`, and quantities are in SI units.

        The text gives the same scene, to the last bit, when it is read again. A measured spread of
        a packing with more than 1000 diameters is written as the name of a table, whose text is
        :attr:`diameters`. :class:`~granphon.base.errors.InputError` if a file has no words for the
        law of contacts, or for a crystal that was given as it is, or if the text is too long.
        """
        return self._text

    @cached_property
    def _text(self) -> str:
        """The text of :meth:`to_yaml`."""
        if self.packing.medium_name == CRYSTAL:
            cast("Arrangement", self.packing).require_words()
        blocks = write_blocks(self, Context(self.packing.structure))
        if self.errors:
            from granphon.scene.uncertainty import write_errors

            write_errors(self, blocks)
        document = dump_yaml(blocks)
        n_bytes = len(document.encode())
        if n_bytes > MOST_SCENE_BYTES:
            problem = (
                f"the scene takes {n_bytes // 1000} kB as a text; a scene file holds"
                f" {MOST_SCENE_BYTES // 1000} kB"
            )
            raise InputError(problem, mend="Give long lists as a range, or call granphon.sweep")
        return document

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of the settings of the scene, of more than four
        directions of sound the first four and the number of the others; no state is computed. The
        components of a stress or strain are multiples of the load, in the unit "of that".
        """
        # imported here: a run does not need words for figures
        from granphon.figures.words import describe_medium

        load = self.load
        structure = self.packing.structure
        media = [
            describe_medium(choice.label, structure.periods, structure.n_balls)
            for choice in self.media
        ]
        if len(media) > 1 and not self.balls_differ:
            media.append("the same for equal balls")
        load_unit = find_load_unit(load.kind, structure.periods, structure.pressed_axes)
        sweeps = [
            # a name with a point is a key of the file
            ("sweep of " + (name if "." in name else spell(name)), values, find_unit(name) or "")
            for name, values in self.parameters
        ]
        rows: list[tuple[str, Any, str]] = [
            *self.packing.describe(),
            (load.kind.replace("_", " "), load.array, load_unit),
            ("components", load.tensor, "of that"),
            ("balls per side", load.balls_per_side, ""),
            ("gravity", load.gravity, ACCELERATION.unit),
            ("medium", media, ""),
            *sweeps,
            ("finite overlap", self.finite_overlap, ""),
            ("observe", self.observe, ""),
            *self._describe_directions(),
            *self._describe_observed(),
        ]
        return [(name, value, unit) for name, value, unit in rows if value is not None]

    def _describe_directions(self) -> list[tuple[str, Any, str]]:
        """Return rows (name, value, unit) of the directions of sound, of more than
        ``_MOST_DIRECTIONS`` the first and the number of the others; directions have no unit.
        """
        first_directions = self.directions[:_MOST_DIRECTIONS]
        rows: list[tuple[str, Any, str]] = [
            ("direction", direction, "") for direction in first_directions
        ]
        n_others = len(self.directions) - len(first_directions)
        if n_others:
            rows.append(("further directions", n_others, ""))
        return rows

    def _describe_observed(self) -> list[tuple[str, Any, str]]:
        """Return names, values and SI units of the settings of the observables that the scene
        observes.
        """
        rows: list[tuple[str, Any, str]] = []
        if {"bands", "spectrum"} & set(self.observe):
            path = " ".join(self.path.labels) if self.path.labels else str(self.path)
            rows.append(("path", path, ""))
        if "bands" in self.observe:
            rows.append(("points of a segment", self.band_points, ""))
        for name in SETTINGS:
            settings = self.observed_settings(name)
            if settings is not None:
                rows += describe_settings(settings)
        if "dos" in self.observe and not self.packing.is_network:
            rows.append(("mesh", " x ".join(map(str, self.mesh)), ""))
        return rows

    @cached_property
    def diameters(self) -> str | None:
        """Text of ``diameters.csv``: the measured diameters of a packing, m, if they are too many
        for the scene file; else None.
        """
        spread: Any = self.packing.spread
        if not file_keys.is_long(spread):
            return None
        rows = ([diameter] for diameter in spread.diameters)
        return table_text([Heading("diameter", LENGTH.unit)], rows)

    @property
    def parameters_of_branches(self) -> list[str]:
        """Names of the swept parameters on which the number of branches or the zone may depend. A
        scene that sweeps over them cannot observe bands.
        """
        return list_parameters_of_branches(self.packing, self.parameters)

    def _list_numbers_of_branches(self) -> set[int]:
        """Return the numbers of branches that the states of the scene have, each once."""
        distinct_values: dict[str, Sequence[Any]] = {}
        for name, values in self.parameters:
            if name in ("torsion", "bending"):
                # the motions of balls depend on whether such a stiffness is zero alone
                distinct_values[name] = list({bool(value): value for value in values}.values())
            elif name in _PARAMETERS_OF_MOTIONS:
                distinct_values[name] = values
        numbers = set[int]()
        for combination in product(*distinct_values.values()):
            # what the packing cannot have is refused later, with its place
            with suppress(InputError):
                changes = dict(zip(distinct_values, combination, strict=True))
                balls = change_packing(self.packing, changes) if changes else self.packing
                numbers.add(balls.ball_motions.count * balls.structure.n_balls)
        return numbers

    # -- values that exclude each other, by the key in the file ------------------------------------

    def _list_conflicts_of_sound(self) -> list[Conflict]:
        """Return every reason for which long waves, or their sensitivities, cannot be observed,
        whether or not it holds in this scene.
        """
        velocities_of_held = Conflict(
            "velocities",
            self.packing.is_held or not HOLDING_PARAMETERS.isdisjoint(dict(self.parameters)),
            "of balls that are held",
            "bands, gaps, cutoffs, onsets, dos of these",
            "Long waves move all balls together, which a floor, a clamp or springs to the ground"
            " hold: write observe: [onsets], the cut-off frequencies from which waves begin.",
        )
        has_frequencies = not file_keys.DIFFERENTIATED_OBSERVABLES.isdisjoint(self.observe)
        sensitivities_of_held = velocities_of_held._replace(
            name="sensitivities",
            holds=velocities_of_held.holds and not has_frequencies,
            allowed="cutoffs beside sensitivities of these",
            mend="Derivatives are those of long waves, which these lack, and of what is observed"
            " beside them: write observe: [sensitivities, cutoffs].",
        )
        sensitivities_of_files = Conflict(
            "sensitivities",
            self.packing.is_network,
            "of a packing in files",
            "sensitivities of a packing or crystal",
            "Files have no parameters to change: gp.Phonons(network).sensitivities has"
            " derivatives by each contact and ball.",
        )
        has_derivatives_of_cutoffs = {"sensitivities", "cutoffs"}.issubset(self.observe)
        sensitivities_of_uneven_cutoffs = Conflict(
            "sensitivities",
            has_derivatives_of_cutoffs and len(self._list_numbers_of_branches()) > 1,
            "of cutoffs of states that differ in the number of branches",
            "sensitivities of cutoffs where all states have the same number of branches",
            "Make a scene of each, or leave cutoffs out.",
        )
        return [
            velocities_of_held,
            sensitivities_of_held,
            sensitivities_of_files,
            sensitivities_of_uneven_cutoffs,
        ]

    def _list_conflicts(self) -> list[Conflict]:
        """Return every reason for which an observable cannot be observed, whether or not it holds
        in this scene.
        """
        first_block = next(iter(NETWORK_BLOCKS))
        conflicts_without_period = [
            Conflict(
                name,
                not self.packing.repeats,
                "of what repeats nowhere",
                f"{', '.join(NETWORK_BLOCKS)} of these",
                f"Waves of this kind need a period: write observe: [{first_block}].",
            )
            for name in file_keys.OBSERVABLES
            if name not in ("pulse", *NETWORK_BLOCKS, "design")  # these need no period
        ]
        pulse = Conflict(
            "pulse",
            self.pulse is None,
            "without a frequency",
            "pulse with a block 'pulse'",
            "Add a block such as pulse: {frequency: 6.5 kHz}.",
        )
        onsets = Conflict(
            "onsets",
            len(self.directions) > 1,
            "along several directions",
            "onsets along one direction, that of their curvatures",
            "Make a scene of each.",
        )
        return [
            *self._list_conflicts_of_sound(),
            onsets,
            *conflicts_without_period,
            *self._list_conflicts_of_surface(),
            pulse,
            *self._list_conflicts_of_networks(),
            *self._list_conflicts_of_bands(),
            *self._list_conflicts_of_design(),
        ]

    def _list_conflicts_of_surface(self) -> list[Conflict]:
        """Return the reasons for which the waves of an edge cannot be observed, whether or not they
        hold in this scene.
        """
        swept_names = [name for name in dict(self.parameters) if name in ("lattice", "motions")]
        return [
            Conflict(
                "surface",
                self.surface is None,
                "without an axis",
                "surface with a block 'surface'",
                "Add a block such as surface: {axis: 1}.",
            ),
            Conflict(
                "surface",
                any(choice.simulates for choice in self.media),
                "of a simulation",
                "surface of a lattice or crystal",
                "An array has no edge of its own: take another medium.",
            ),
            Conflict(
                "surface",
                swept_names,
                f"with a sweep over {' and '.join(swept_names)}",
                "surface of one lattice",
                "Make a scene of each.",
            ),
        ]

    def _list_conflicts_of_networks(self) -> list[Conflict]:
        """Return the reasons for which what the blocks of networks ask for, such as a response, a
        motion or modes, cannot be observed, whether or not they hold in this scene.
        """
        conflicts_without_settings = [
            Conflict(
                name,
                getattr(self, name) is None,
                "without its settings",
                f"{name} with a block '{name}'",
                f"Add a block '{name}'.",
            )
            for name in NETWORK_BLOCKS
        ]
        conflicts_of_mixed_media = [
            Conflict(
                name,
                len({choice.simulates for choice in self.media}) > 1,
                "of lattices and of arrays",
                f"{name} of one or the other",
                "Make a scene of each.",
            )
            for name in NETWORK_BLOCKS
        ]
        return conflicts_without_settings + conflicts_of_mixed_media

    def _list_conflicts_of_bands(self) -> list[Conflict]:
        """Return the reasons for which bands cannot be observed, whether or not they hold in this
        scene.
        """
        swept_names = self.parameters_of_branches
        return [
            Conflict(
                "bands",
                self.bands is not None and any(choice.simulates for choice in self.media),
                "with losses of a simulation",
                "damped bands of a lattice or crystal",
                "Observe the response of the array, or leave the block 'bands' out.",
            ),
            Conflict(
                "bands",
                swept_names,
                f"with a sweep over {' and '.join(swept_names)}",
                "velocities, as the branches differ in number or zone",
                "Make a scene of each.",
            ),
        ]

    def _require_arrays(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if the scene observes waves that only
        simulated arrays have, and a medium makes no array, or the spectra of the arrays of all
        states do not fit into one table.
        """
        names = [
            name for name in WAVES if name in self.observe and is_of_arrays_alone(name, self.swept)
        ]
        if self.packing.is_network:
            # the network of the files has spectra, and carries a pulse
            names = [name for name in names if name == "dos"]
        if not names:
            return
        owners = "one state, or of arrays" if names == ["dos"] else "arrays"
        allowed = f"{', '.join(names)} of {owners} that a medium: simulation makes"
        with file_keys.refusing(names[0], allowed, "observe"):
            require_arrays(self.media, self.packing.structure, dict(self.parameters), names)

    def _list_conflicts_of_design(self) -> list[Conflict]:
        """Return the reasons for which no design can be sought, whether or not they hold in this
        scene.
        """
        make_conflict = partial(Conflict, "design")
        return [
            make_conflict(
                self.design is None,
                "without a goal",
                "design with a block 'design'",
                "Add a block such as design: {goal: widest_gap, vary: {mass: [10 g, 40 g]}}.",
            ),
            make_conflict(
                self.swept,
                "of several states",
                "design of one state",
                "Keep one load, one medium, and no block 'sweep'.",
            ),
            make_conflict(
                any(choice.simulates for choice in self.media),
                "of a simulation",
                "design of a lattice or crystal",
                "Take another medium; in Python gp.design(state.samples[0], ...) is the design of a"
                " sample.",
            ),
            make_conflict(
                self.errors,
                "of quantities with standard errors",
                "design of exact quantities",
                "The best for other values is another network: make a scene without errors.",
            ),
        ]

    def _find_materials(self, settings: EdgeSettings) -> EdgeSettings:
        """Return the ``settings`` of an edge with the material of each wall that the scene gives as
        that of a kind of balls. Walls of kinds in the crystal itself stay as they are: their
        parameters may be swept, and the crystal finds the material. Refused for a kind that the
        scene does not have.
        """
        from granphon.media.arrangement import Arrangement, find_kinds  # other scenes have no kinds

        if not isinstance(self.packing, Arrangement):
            return settings
        kinds = find_kinds(self.packing)
        unknown_kinds = sorted(settings.kinds_of_walls - set(kinds))
        if unknown_kinds:
            path = (settings.block, settings.key_of_edges)
            allowed = f"a wall of a material, or of that of a kind of balls: {', '.join(kinds)}"
            raise Refused(repr(unknown_kinds[0]), allowed, path=path)
        names_in_crystal = self.packing.kind_names
        return settings.with_materials(
            {name: ball for name, ball in kinds.items() if name not in names_in_crystal}
        )

    def _require_consistency(self, given_path: BandPath | None) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if values that are allowed one by one
        exclude each other. ``given_path`` is the argument ``band``, the path of the bands; None if
        none was given.
        """
        structure = self.packing.structure
        self._require_supercell()
        self._require_media()
        self._require_arrays()
        self._require_swept()
        self._require_observable()
        self._require_settings()
        if "pulse" in self.observe and len(self.directions) > 1:
            raise Refused("several directions with a pulse", "one direction", path=("direction",))
        if given_path is not None:
            # a path of another dimension is refused, at the key phonopy.band
            rule = partial(read_paths, periods=structure.periods)
            read_inside("phonopy", partial(read_inside, "band", rule), str(given_path))
        if self.load.kind == "side_force" and structure != TRIANGULAR:
            allowed = "on the triangular lattice only, whose frame is a hexagon"
            raise Refused("a side_force", allowed, path=("load", "side_force"))

    def _require_observable(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` for the first reason for which an observable
        of the scene cannot be observed.
        """
        for conflict in self._list_conflicts():
            if conflict.name in self.observe and conflict.holds:
                found = f"{conflict.name!r} {conflict.problem}"
                raise Refused(found, conflict.allowed, conflict.mend, ("observe",))

    def _require_settings(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` for settings of a block that these balls
        cannot have, or that exclude each other.
        """
        if self.packing.medium_name == CRYSTAL:
            for name, settings in (("spectrum", self._written_spectrum), ("pulse", self.pulse)):
                if settings is not None:
                    allowed = f"{name} of arrays, which packings have"
                    raise Refused(f"{name} of a crystal", allowed, "Leave it out.", (name,))
        if "design" in self.observe:
            require_variables(self)
        surface = self.observed_settings("surface")
        if surface is not None:
            allowed = "an axis across which the balls repeat"
            with file_keys.refusing(surface.axis, allowed, "surface", "axis"):
                Layers.across(surface.axis, self.packing.structure.vectors)
        if self.response is not None:
            _require_planes(self.response)
        if self.motion is not None:
            _require_limits(self.motion, dict(self.parameters))

    def _require_media(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` for a medium that these balls cannot have,
        or that does not keep the terms of finite overlap if the scene keeps these.
        """
        if self.finite_overlap:
            with file_keys.refusing(True, "false, with a simulation", "packing", "finite_overlap"):
                require_finite_overlap(self.media)
        for choice in self.media:
            with file_keys.refusing(choice.label, "a medium of these balls", "medium"):
                choice.require_for(self.packing)

    def _require_swept(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` for a swept loss that nothing observed has,
        or that a block gives, and for a swept wall that stands at no edge of what is observed.
        """
        if not self.parameters:
            return
        from granphon.media.arrangement import find_kinds  # other scenes have no kinds

        settings_of_blocks = [self.observed_settings(block) for block in WAVE_BLOCKS]
        for name, _ in self.parameters:
            with file_keys.refusing(name, _WORDS_FOR_SWEEP, "sweep"):
                require_losses([name], settings_of_blocks)
                require_walls([name], settings_of_blocks, find_kinds(self.packing))

    def _require_supercell(self) -> None:
        """Raise :class:`~granphon.base.errors.Refused` if the supercell is so small that two of its
        balls touch twice, through different periodic images; the refusal names the smallest
        supercell that is large enough, of those with the same number of cells along each period.
        """
        structure = self.packing.structure
        touch_once = partial(touch_once_at_most, structure.vectors, contact=structure.reach)
        if self.dim is None or touch_once(self.dim):
            return
        supercells = ((n_cells,) * structure.periods for n_cells in range(1, _MOST_CELLS))
        smallest_supercell = next(supercell for supercell in supercells if touch_once(supercell))
        allowed = f"{file_keys.write_grid(smallest_supercell)} or more"
        raise Refused(file_keys.write_grid(self.dim), allowed, path=("phonopy", "dim"))


def _require_planes(settings: ResponseSettings) -> None:
    """Raise :class:`~granphon.base.errors.Refused` for a key of planes of balls that the
    ``settings`` give and that has no use (:func:`~granphon.waves.sensors.find_unused`): a distance
    where no plane is heard, a direction or polarisation where no plane is driven or heard.
    """
    given_values = {name: getattr(settings, name) for name in KEYS_OF_PLANES}
    name = find_unused(settings.source, settings.receiver, given_values)
    if not name:
        return
    path = ("response", name)
    if name == "distance":
        raise Refused(
            "a distance, and no plane that is heard",
            "a distance with receiver: plane",
            "Leave distance out.",
            path,
        )
    raise Refused(
        f"a {name} of a plane, and no plane",
        f"a {name} with source: plane or receiver: plane",
        f"Leave {name} out: a ball has its direction behind its number, as in 12 x.",
        path,
    )


def _require_limits(settings: MotionSettings, swept: Mapping[str, Any]) -> None:
    """Raise :class:`~granphon.base.errors.Refused` for a limit in the ``settings`` of forces that
    no contact has: of slip that is not limited, or of dashpots that are neither given nor
    ``swept``.
    """
    if settings.coulomb == "total" and settings.friction_coefficient is None:
        raise Refused(
            "total, and no friction_coefficient",
            "total with a friction_coefficient, without which contacts do not slide",
            path=("motion", "coulomb"),
        )
    sweeps_dashpots = any(LOSS_PARAMETERS.get(name) in DASHPOTS for name in swept)
    if settings.viscous_pull == "limited" and not (settings.has_dashpots or sweeps_dashpots):
        raise Refused(
            "limited, and no dashpot",
            "limited with a damping, dashpot or restitution, by which contacts pull",
            path=("motion", "viscous_pull"),
        )


def _read_balls(packing: Any) -> Packing | Arrangement | NetworkFiles:
    """Return the balls of a scene from its argument ``packing``; a crystal becomes its arrangement.
    InputError for an argument of another type than :class:`granphon.Scene` takes.
    """
    if isinstance(packing, Packing) or getattr(packing, "is_network", False):
        return cast("Packing | NetworkFiles", packing)
    from granphon.media.arrangement import given_balls  # other scenes have no kinds

    return given_balls(packing)


def _is_left_out(value: object) -> bool:
    """Whether an argument is None or an empty list, in place of which a default stands; an argument
    of any other type is for a rule to read.
    """
    return value is None or (isinstance(value, tuple | list) and not value)


def _read_pairs(name: str, value: Any) -> tuple[tuple[Any, Any], ...]:
    """Return the pairs of an argument, called ``name``: those of a mapping, or of a list of pairs;
    InputError for any other ``value``.
    """
    entries: Any = value.items() if isinstance(value, Mapping) else value
    try:
        return tuple((first, second) for first, second in entries)
    except (TypeError, ValueError):
        mend = "Give a mapping, or a list of pairs"
        raise InputError(f"{name} is {brief(value)}", mend=mend) from None


def _require_paths(errors: Sequence[tuple[Any, Any]]) -> None:
    """Raise InputError unless the first of each pair in ``errors`` is a path in a scene file, keys
    and indices in lists from zero, and each path is given once.
    """
    paths = set()
    for path, _ in errors:
        if not isinstance(path, tuple) or not path or not all(map(_is_key, path)):
            mend = 'Give the keys that lead to the quantity, as ("material", "young_modulus")'
            raise InputError(f"errors has the path {brief(path)}", mend=mend)
        if path in paths:
            raise InputError(f"errors has the path {brief(path)} twice", mend="Give each one once")
        paths.add(path)


def _is_key(key: object) -> bool:
    """Whether ``key`` is a key of a mapping in a scene file, or an index of a list, from zero."""
    is_index = isinstance(key, int) and not isinstance(key, bool) and key >= 0
    return is_index or isinstance(key, str)


def _find_wave_path(packing: Any) -> BandPath:
    """Return the default path of the spectral functions of a packing in files: from wave vector
    zero along the first period up to the wave length of two mean diameters.
    """
    lengths = [
        math.hypot(*vector)
        for vector, is_period in zip(packing.network.cell, packing.network.pbc, strict=True)
        if is_period
    ]
    # number of wave lengths in the period; without a period the path is not used, as spectra are
    # refused
    n_waves = max(round(lengths[0] / (2.0 * packing.diameter)), 1) if lengths else 1
    return BandPath((((0.0, 0.0, 0.0), (float(n_waves), 0.0, 0.0)),))
