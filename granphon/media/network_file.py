"""A packing of another program in a scene: the files that hold its balls and contacts, the cell
that they make, and the medium of such a packing.

The files stand where a scene, a sweep and their tasks have a packing. The forces of contacts are
those of the files, so that the load is their mean.
"""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from granphon.balls.hertz import overlap_from
from granphon.balls.lattices import Lattice
from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.balls.motions import Motions, allowed_motions
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import LENGTH, STIFFNESS, TIME, TURN_STIFFNESS, WAY
from granphon.base.settings import (
    IN_PYTHON,
    Block,
    Kind,
    block_kind,
    listed,
    one_or_more,
    setting,
    whole_from,
    with_unit,
    with_unit_unless_zero,
    word_of,
    write_block,
)
from granphon.base.text import counted, list_names, show
from granphon.base.validation import choice, each, label, read_inside, text, truth
from granphon.media.cells import QUICK_BALLS, CrystalCell
from granphon.media.medium import NETWORK, Medium
from granphon.media.state import NetworkState
from granphon.networks.faults import FAULT_ACTIONS
from granphon.networks.network import READERS, ContactNetwork
from granphon.networks.sources import SLIP_LEVERS, TANGENTIAL_LAWS

#: names of the tables in which a run keeps the packing that it has read
TABLES = ("balls.csv", "contacts.csv")
#: kinds of the parameters of a reader that take its files
_BY_PLACE = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
#: settings that are no options of a reader
_OF_FILES = ("format", "files")
#: all words for the motions of balls, of any dimension
_MOTIONS = tuple(
    dict.fromkeys(motions for dimension in (1, 2, 3) for motions in allowed_motions(dimension))
)


def _read_cell(value: Any, context: Any) -> tuple[Any, ...]:
    """Return the periods of a cell, m, from the ``value`` in a scene: a tuple of lengths, or a
    tuple of vectors, each a tuple of components. The ``context`` says whether lengths have units.

    Components may be below zero, and a component of zero needs no unit.
    """
    if isinstance(value, list | tuple) and value and isinstance(value[0], list | tuple):
        read_vector = listed(with_unit_unless_zero(WAY), "lengths").rule(context)
        return each(value, read_vector, "vectors")
    return each(value, with_unit(LENGTH).rule(context), "lengths")


def _write_cell(cell: tuple[Any, ...], _context: Any) -> list[Any]:
    """Return the periods of a cell, m, as a scene has them, with units; see :func:`_read_cell`."""
    if isinstance(cell[0], tuple):
        return [
            [WAY.write(component) if component else 0 for component in vector] for vector in cell
        ]
    return [LENGTH.write(length) for length in cell]


def _read_twisting(value: Any, context: Any) -> float | str:
    """Return a stiffness against twist, N m, from a ``value``, which has its unit if the
    ``context`` is a file, and is in SI in Python; or "marshall", which stands for Marshall's law of
    LAMMPS.
    """
    if value == "marshall":
        return "marshall"
    stiffness: float = with_unit(TURN_STIFFNESS).read(value, context)
    return stiffness


def _read_rolling(value: Any, context: Any) -> float | str:
    """Return a stiffness against rolling, N/m, from a ``value``, which has its unit if the
    ``context`` is a file, and is in SI in Python; or "epsd2", which stands for the model of that
    name of LIGGGHTS.
    """
    if value == "epsd2":
        return "epsd2"
    stiffness: float = _STIFFNESS.read(value, context)
    return stiffness


def _read_columns(value: Any) -> Any:
    """Return names of columns from a list, or headings by the names of columns from a block; either
    has at least one. The function is a rule of :mod:`granphon.base.validation`.
    """
    if not isinstance(value, Mapping):
        return each(value, text, "names of columns")
    if not value:
        raise Refused("an empty block", "a block of columns and headings, as {radius: R (mm)}")
    return {text(name): read_inside(name, text, heading) for name, heading in value.items()}


def _read_frozen(value: Any) -> dict[str, Any]:
    """Return values by the names of columns from a block that has at least one. The function is a
    rule of :mod:`granphon.base.validation`.
    """
    if not isinstance(value, Mapping) or not value:
        found = "an empty block" if isinstance(value, Mapping) else show(value)
        raise Refused(found, "a block of columns and values, as {type: 2}")
    return {text(name): entry for name, entry in value.items()}


def _read_file(value: Any, context: Any) -> Path:
    """Return the path of a file; a relative path starts at the folder of the scene, that of the
    ``context``.
    """
    return Path(context.folder / (value if isinstance(value, Path) else text(value)))


#: kind of a setting that is a file
_FILE = Kind(_read_file, lambda path, _: str(path.resolve()))


def _read_words(value: Any) -> tuple[str, ...]:
    """Return the words, at least one, of a text or of a list of words. The function is a rule of
    :mod:`granphon.base.validation`.
    """
    words = value.split() if isinstance(value, str) else value
    if isinstance(value, str) and not words:
        raise Refused(show(value), "one or more names")
    return each(words, text, "names")


#: kinds of settings: words, and a stiffness, N/m
_WORDS = Kind.plain(_read_words, list)
_STIFFNESS = with_unit(STIFFNESS)


class NetworkFiles(Block, kw_only=True):
    """Balls and contacts that a program has left in files: the block ``network`` of a scene.

    Two of these blocks are equal if their networks and materials are, whatever files they come
    from.

    All but ``format`` and ``files`` are options of the reader; None for its default.

    Raises
    ------
    InputError : an option that the reader does not have, ``walls`` of LIGGGHTS, a number of files
        that the reader does not take, and what the reader refuses.
    """

    block = "network"

    format: str = setting(
        Kind.plain(lambda value: choice(value, READERS)),
        "the program: `lammps`, `liggghts`, `mercury`, or `tables`, as of YADE",
        title="packing of",
    )
    files: tuple[Path, ...] = setting(
        one_or_more(_FILE, "files"),
        "of balls and of contacts, in the order of the reader; of LIGGGHTS a third one of walls",
    )
    material: Material | None = setting(
        block_kind(Material), "of the balls", default=None, absent="that of the files"
    )
    step: int | None = setting(
        whole_from(0), "time step, of several", default=None, absent="the last"
    )
    time: float | None = setting(
        with_unit(TIME), "time of MercuryDPM, of several", default=None, absent="the last"
    )
    units: str | None = setting(
        Kind.plain(label), "style of units of LAMMPS", default=None, absent="as the file says"
    )
    columns: Any = setting(
        Kind.plain(_read_columns),
        "names of columns, in their order; of tables a block of names and headings",
        default=None,
        absent="those of the file",
    )
    keywords: tuple[str, ...] | None = setting(
        _WORDS, "of the compute of LIGGGHTS", default=None, absent="none"
    )
    normal_stiffness: float | None = setting(
        _STIFFNESS, "of all contacts of a linear law", default=None, absent="Hertz's"
    )
    shear_stiffness: float | None = setting(
        _STIFFNESS, "of all contacts of a linear law", default=None, absent="Mindlin's"
    )
    rolling_stiffness: Any = setting(
        _STIFFNESS._replace(
            read=_read_rolling,
            write=lambda value, context: value if isinstance(value, str)
            else _STIFFNESS.write(value, context),
        ),
        "against rolling, k of k R², or `epsd2` of LIGGGHTS", default=None, absent="none",
    )  # fmt: skip
    twisting_stiffness: Any = setting(
        Kind(_read_twisting, lambda value, context: value if isinstance(value, str)
             else TURN_STIFFNESS.write(value)),
        "against twist, or `marshall`", default=None, absent="none",
    )  # fmt: skip
    walls: tuple[str, ...] | None = setting(
        _WORDS, "names of the walls of LAMMPS", default=None, absent="none"
    )
    frozen: dict[str, Any] | None = setting(
        Kind.plain(_read_frozen),
        "columns and values of balls that do not move, as `{type: 2}`",
        default=None,
        absent="none",
    )
    cell: tuple[Any, ...] | None = setting(
        Kind(_read_cell, _write_cell),
        "lengths of the periods of tables, or their vectors",
        default=None,
        absent="that of the files",
    )
    pbc: tuple[bool, ...] | None = setting(
        listed(Kind.plain(truth), "truth values"),
        "along which vectors of the cell the packing repeats",
        default=None,
        absent="as the files say",
    )
    dimension: int | None = setting(
        whole_from(1, 3), "of the packing", default=None, absent="that of the places"
    )
    motions: str | None = setting(
        word_of(*_MOTIONS), "how each ball moves", default=None, absent="all of the dimension"
    )
    friction: bool | None = setting(
        Kind.plain(truth), "whether contacts resist shear", default=None, absent="`true`"
    )
    prestress: bool | None = setting(
        Kind.plain(truth), "whether static forces act", default=None, absent="`false`"
    )
    tangential_law: str | None = setting(
        word_of(*TANGENTIAL_LAWS),
        "how static tangential forces change with the overlap",
        default=None,
        absent="`liggghts` of LIGGGHTS, else `mindlin/force`",
    )
    slip_levers: str | None = setting(
        word_of(*SLIP_LEVERS),
        "by which rotations make slip, with static forces",
        default=None,
        absent="`radii` of LAMMPS, `yade` with the law `yade`, else `arms`",
    )
    keep_rattlers: bool | None = setting(
        Kind.plain(truth), "whether balls that carry no load stay", default=None, absent="`false`"
    )
    held_by: int | None = setting(
        whole_from(0),
        "least number of contacts that hold a ball",
        default=None,
        absent="2, without friction more",
    )
    bad: str | None = setting(
        word_of(*FAULT_ACTIONS),
        "what becomes of contacts with faults",
        default=None,
        absent="`refuse`",
    )

    #: name of the medium of such balls, and attributes that an arrangement of balls has too
    medium_name: ClassVar[str] = NETWORK
    #: whether the balls are those of a network in files, whose waves are its own
    is_network: ClassVar[bool] = True
    kinds: ClassVar[tuple[Any, ...]] = ()
    spread: ClassVar[None] = None
    width: ClassVar[float] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.network  # the errors of the files are raised now

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, NetworkFiles):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        # arrays have no hash, and blocks that are equal have as many contacts
        return hash(self.network.n_contacts)

    @property
    def _key(self) -> tuple[Any, ...]:
        """What two blocks are compared by: the network without its ``contact_model``, in whose
        place the material stands, and the material.
        """
        return replace(self.network, contact_model=None), self.material

    @cached_property
    def network(self) -> ContactNetwork:
        """The network, read once from the files with the options that are given.

        Raises :class:`~granphon.base.errors.InputError` for an option that the reader does not
        have, for ``walls`` of LIGGGHTS, for a number of files that the reader does not take, and
        for what the reader refuses.
        """
        files = list(self.files)
        options = {
            name: getattr(self, name)
            for name in self._settings
            if name not in _OF_FILES and getattr(self, name) is not None
        }
        # the third file of LIGGGHTS is an option of the reader
        if self.format == "liggghts":
            if self.walls is not None:
                fault = "walls name fixes of LAMMPS, and LIGGGHTS writes its walls to a file"
                mend = f"Write it third: files: [atoms, pairs, {self.walls[0]}]"
                raise InputError(fault, mend=mend)
            if len(files) == 3:
                options["walls"] = files.pop()
        # a reader may be the user's own: what it takes is read from its signature
        parameters = inspect.signature(READERS[self.format]).parameters
        self._require_file_count(files, parameters)
        takes_any_option = any(
            parameter.kind == parameter.VAR_KEYWORD for parameter in parameters.values()
        )
        unknown_options = [name for name in options if name not in parameters]
        if unknown_options and not takes_any_option:
            known_options = [name for name in self._settings if name in parameters]
            fault = f"the reader of {self.format} has no option {unknown_options[0]!r}"
            raise InputError(fault, f"It has {list_names(known_options)}", "Leave it out")
        return ContactNetwork.read(self.format, *files, **options)

    def _require_file_count(
        self, files: list[Path], parameters: Mapping[str, inspect.Parameter]
    ) -> None:
        """Raise InputError if the reader takes another number of ``files``.

        A reader takes a file for each of its ``parameters``, by their names, that is given by place
        and is no setting of this block; a parameter with a default may be left out. A reader with
        ``*files`` takes any number.
        """
        takes_any_number = any(
            parameter.kind == parameter.VAR_POSITIONAL for parameter in parameters.values()
        )
        if takes_any_number:
            return
        file_parameters = [
            parameter
            for name, parameter in parameters.items()
            if parameter.kind in _BY_PLACE and name not in self._settings
        ]
        least_count = sum(parameter.default is parameter.empty for parameter in file_parameters)
        if not least_count <= len(files) <= len(file_parameters):
            names = list_names([parameter.name for parameter in file_parameters])
            fault = f"the reader of {self.format} does not take {counted(len(files), 'file')}"
            raise InputError(fault, f"It takes {names}", "Give these, in this order")

    @property
    def load(self) -> Load:
        """The load of the packing: the mean normal force of the contacts in the files, N.

        Raises :class:`~granphon.base.errors.InputError` if the mean is not above zero, as it may be
        where contacts adhere.
        """
        mean_force = float(np.mean(self.network.normal_force))
        if not mean_force > 0.0:
            raise InputError(
                f"the mean normal force of the contacts in {self.files[-1].name} is"
                f" {mean_force:.6g} N",
                "A scene calls the state of a packing by this force, which must be above zero",
                "Take the network itself, as gp.Waves(gp.ContactNetwork.read(...))",
            )
        return Load("force", mean_force)

    @property
    def block_of_tables(self) -> dict[str, Any]:
        """The block ``network`` of a scene that reads this packing again from the :data:`TABLES` in
        which a run keeps it, as plain data.
        """
        entries: dict[str, Any] = {"format": "tables", "files": list(TABLES)}
        if self.material is not None:
            entries["material"] = write_block(self.material, IN_PYTHON)
        return entries

    # -- attributes that a packing has too ---------------------------------------------------------

    @property
    def kind_names(self) -> tuple[str, ...]:
        """Names of the kinds of the balls; "ball" if the files name none."""
        return tuple(dict.fromkeys(self.network.kinds or ("ball",)))

    @property
    def repeats(self) -> bool:
        """Whether the packing has a period."""
        return any(self.network.pbc)

    @property
    def is_held(self) -> bool:
        """Whether bodies that do not move, or springs to the ground, hold balls."""
        return not np.all(self.network.moving) or self.network.on_site is not None

    @property
    def diameter(self) -> float:
        """Mean diameter of the balls that move, m."""
        return self.network.scales.length

    @property
    def mass(self) -> float:
        """Mean mass of the balls that move, kg."""
        return self.network.scales.mass

    @cached_property
    def structure(self) -> Lattice:
        """The cell of the packing, in units of the mean diameter, in the place of a lattice."""
        return CrystalCell.of_network(self.network, self.diameter)

    @property
    def ball_motions(self) -> Motions:
        """The motions that each ball has."""
        return self.network.ball_motions

    @property
    def mindlin_ratio(self) -> float | None:
        """Ratio of the shear to the normal stiffness; None if contacts do not have one in
        common.
        """
        ratios = self.network.shear_stiffness / self.network.normal_stiffness
        if not ratios.size:
            return None
        # to the rounding of ratios of doubles, with room for stiffnesses that were computed
        has_one_ratio = np.ptp(ratios) <= 1e-9 * np.max(ratios)
        return float(ratios[0]) if has_one_ratio else None

    def describe(self) -> list[tuple[str, Any, str]]:
        """Return the rows of the table of the packing: name, value and SI unit of each quantity."""
        network = self.network
        rows: list[tuple[str, Any, str]] = [
            ("packing of", self.format, ""),
            ("files", ", ".join(file.name for file in self.files), ""),
            ("balls", network.n_balls, ""),
            ("left out, as they carry no load", network.left_out, ""),
            ("contacts", network.n_contacts, ""),
            ("contacts of a ball", network.coordination, ""),
            ("mean diameter", self.diameter, "m"),
            ("static forces act", network.prestress, ""),
            ("motions", network.ball_motions.name.replace("_", " "), ""),
        ]
        return rows + [("note", note, "") for note in network.notes]

    def change(self, values: Mapping[str, Any]) -> NetworkFiles:
        """Return the packing itself; InputError for ``values`` of parameters, which files do not
        have.
        """
        if values:
            fault = f"the packing in {self.files[0]} has no parameter {next(iter(values))!r}"
            raise InputError(fault, "Its numbers are those of the files")
        return self


class LoadedNetwork(NetworkState):
    """The state of a packing in files, with means over its contacts."""

    medium = NETWORK
    regime = None
    n_samples = 0
    chosen_automatically = False
    exponent = None
    exponent_error = None

    def __init__(self, packing: NetworkFiles) -> None:
        super().__init__(packing.network)
        self.packing = packing
        self.name = packing.structure.name

    def __getitem__(self, index: Any) -> LoadedNetwork:
        """Return the state itself, whatever the index: there is one load."""
        return self

    @property
    def mean_errors(self) -> dict[str, Any]:
        """Standard errors over samples, as of a :class:`ContactState`: none."""
        return {}

    @property
    def finite_overlap(self) -> bool:
        """Whether the static forces of the contacts act on small motions, as prestress."""
        return self.network.prestress

    @property
    def valid(self) -> bool:
        """Whether the numbers of the files agree with each other in every comparison that is made,
        see :func:`~granphon.networks.consistency.compare_numbers`.
        """
        from granphon.networks.consistency import compare_numbers

        return all(comparison.holds for comparison in self.network.cached(compare_numbers))

    @property
    def force(self) -> float:
        """Mean normal force, N."""
        return float(np.mean(self.network.normal_force))

    @property
    def overlap(self) -> float:
        """Mean overlap by Hertz's law, m."""
        network = self.network
        return float(np.mean(overlap_from(network.normal_force, network.normal_stiffness)))

    @property
    def normal_stiffness(self) -> float:
        """Mean normal stiffness, N/m."""
        return float(np.mean(self.network.normal_stiffness))

    @property
    def shear_stiffness(self) -> float:
        """Mean shear stiffness, N/m."""
        return float(np.mean(self.network.shear_stiffness))

    @property
    def relative_overlap(self) -> float:
        """Mean overlap over the mean diameter."""
        return self.overlap / self.packing.diameter

    @property
    def contact_fraction(self) -> float:
        """Fraction of the contacts that are pressed, with a normal force above zero."""
        return float(np.mean(self.network.normal_force > 0.0))

    @property
    def pressure(self) -> float:
        """Mean pressure by the virial of the static forces over the cell: N, N/m or Pa with one,
        two or three axes.

        Raises :class:`~granphon.base.errors.InputError` for a packing that does not repeat along
        all of its axes.
        """
        network = self.network
        d = network.dimension
        if not all(network.pbc[:d]):
            raise InputError("a packing with open ends has no pressure of its own")
        normal_force, tangential_force = network.static_forces
        forces = normal_force[:, None] * network.normal + tangential_force
        volume = abs(float(np.linalg.det(network.cell[:d, :d])))
        return float(np.sum(forces * network.vector)) / (d * volume)


class NetworkMedium(Medium[Any]):
    """The medium of a packing in files, whose only state is that of the contacts in the files."""

    name = NETWORK
    words = "packing"

    packing: Any

    def __init__(self, packing: NetworkFiles) -> None:
        self.packing = packing

    @property
    def is_quick(self) -> bool:
        """Whether the sound of the packing takes little time: that of up to :data:`QUICK_BALLS`
        balls does.
        """
        return bool(self.packing.network.n_balls <= QUICK_BALLS)

    def require_sound(self, pushed: bool = False) -> None:
        """Raise nothing, ``pushed`` or not: what the contacts hold is found with the state."""

    def has_finite_overlap(self, wants_terms: bool) -> bool:
        """Return whether the files have static forces that act as prestress; what the user wants,
        ``wants_terms``, changes nothing.
        """
        return bool(self.packing.network.prestress)

    def at(self, load: Load, *, finite_overlap: bool | None = None) -> LoadedNetwork:
        """Return the only state, whatever the load and ``finite_overlap``: force and prestress are
        those of the files.
        """
        return LoadedNetwork(self.packing)
