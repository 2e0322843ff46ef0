"""Settings of waves: the blocks of a scene that say which waves are found, and how.

The blocks ``spectrum`` and ``pulse`` are about a simulated array, ``surface`` is about an edge,
``bands`` about the losses of branches, and ``response``, ``motion`` and ``modes`` are about the
network of any state. A motion has drives of balls: impacts, shakers, forces and displacements over
time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from granphon.balls.ball import Ball, Wall, find_material, name_walls
from granphon.balls.layers import read_axis, read_edge, read_edges
from granphon.balls.material import Material
from granphon.balls.packing import (
    LOSS_PARAMETERS,
    LOSS_QUANTITIES,
    LOSSES,
    SECOND_LOSSES,
    WALL_PARAMETERS,
)
from granphon.base.arrays import Array, Index
from granphon.base.errors import InputError, Refused
from granphon.base.quantities import (
    FREQUENCY,
    LENGTH,
    NUMBER,
    PUSH,
    SINCE,
    TIME,
    VELOCITY,
    WAY,
    Quantity,
)
from granphon.base.settings import (
    Block,
    Kind,
    ValueContext,
    block_kind,
    block_of,
    listed,
    one_or_more,
    read_block,
    read_counts,
    read_values,
    setting,
    whole_from,
    with_unit,
    with_unit_unless_zero,
    word_of,
    write_block,
    write_values,
)
from granphon.base.tables import Table
from granphon.base.text import show
from granphon.base.validation import (
    block,
    choice,
    each,
    finite_list,
    fraction,
    frequencies,
    label,
    number,
    read_inside,
    zero_or_above,
)
from granphon.dynamics.damping import LEAST_RESTITUTION, read_loss
from granphon.networks.network import ContactNetwork
from granphon.waves.sensors import FLOOR, list_open_axes

#: names of the results of the waves in a simulated array
WAVES = ("dos", "spectrum", "pulse")
#: polarisations of the waves of a spectrum
POLARISATIONS = ("longitudinal", "transverse", "rotational")
#: Chebyshev moments of a spectrum, if none are given: a resolution of 0.6 % of the top frequency
MOMENTS = 256
#: number of times of a motion that are kept if no number is given, with the start and the end
FRAMES = 201
#: readings of the signal of a pulse in a period of its burst
READINGS = 24
#: ends of a network through which a pulse travels: balls at the ends are free, or held as walls, or
#: neighbours of those at the other end
ENDS = ("free", "walls", "periodic")
#: directions of contacts in a motion: those of the lattice at rest, or the true ones
GEOMETRIES = ("lattice", "exact")
#: schemes of the steps of a motion
SCHEMES = ("verlet", "midpoint")
#: losses by dashpots of contacts
DASHPOTS = ("damping", "dashpot", "restitution")
#: settings of planes in a response
KEYS_OF_PLANES = ("direction", "polarisation", "distance")
#: polarisations in which a source pushes, and sources of a pulse
_PUSHES = ("longitudinal", "transverse", "out_of_plane")
_SOURCES = ("plane", "ball")
#: quantities of a response, each with the name of the response
RESPONSES = {
    "displacement": "receptance",
    "velocity": "mobility",
    "acceleration": "accelerance",
    "force": "force_transmissibility",
    "transmissibility": "transmissibility",
    "stiffness": "dynamic_stiffness",
}
#: the faces of an array
FACES = ("lower", "upper")
#: text of a receiver that is a contact: the indices of its two balls, of at most nine digits
_CONTACT = re.compile(r"([0-9]{1,9})-([0-9]{1,9})")
#: kinds of drives of balls
DRIVES = ("impact", "shaker", "force", "displacement")
#: words that say whether dashpots may pull in a motion
VISCOUS_PULLS = ("whole", "limited")
#: words that say to which forces Coulomb's limit applies in a motion
COULOMB_LIMITS = ("elastic", "total")


# -- kinds of values -------------------------------------------------------------------------------


def _loss_kind(name: str, quantity: Quantity | None) -> Kind:
    """Return the kind of the loss of this ``name``: a number from zero to the largest of such
    losses, see :func:`read_loss`; a restitution is from :data:`LEAST_RESTITUTION` to 1.

    ``quantity`` has the unit of the loss, which zero may lack; it is None for a loss without a
    unit.
    """
    if name == "restitution":
        return Kind.plain(partial(number, low=LEAST_RESTITUTION, high=1.0))
    if quantity is None:
        return Kind.plain(partial(read_loss, name, rule=zero_or_above))

    number_kind = with_unit_unless_zero(quantity)

    def read(value: Any, context: ValueContext) -> Any:
        """Return the loss in SI units, with a unit in a scene file unless it is zero."""
        return read_loss(name, value, number_kind.rule(context))

    def write(value: Any, context: ValueContext) -> Any:
        """Return the loss as a text with its unit; zero stays a number."""
        return number_kind.write(value, context) if value else value

    return number_kind._replace(read=read, write=write)


def _one_or_two(kind: Kind, parts: str = "of normal motion, and of all other") -> Kind:
    """Return the kind of a setting that is one value of this ``kind`` for all motions, or a list of
    two values, for the two ``parts`` of motions that a message names.
    """
    pair = listed(kind)

    def read(value: Any, context: ValueContext) -> Any:
        """Return one value, or a tuple of two; Refused for a list of another length."""
        if not isinstance(value, list | tuple):
            return kind.read(value, context)
        if len(value) != 2:
            raise Refused(show(value), f"one value, or two: {parts}")
        return pair.read(value, context)

    def write(value: Any, context: ValueContext) -> Any:
        """Return the one value as written, or the list of two."""
        return (pair if isinstance(value, tuple) else kind).write(value, context)

    return Kind(read, write, kind.unit)


#: the kind of each loss, by its name, of one value for all motions; zero is written without a unit
LOSS_KINDS = {name: _loss_kind(name, quantity) for name, quantity in LOSS_QUANTITIES.items()}


def _read_frequencies(value: Any, context: ValueContext) -> tuple[float, ...]:
    """Return frequencies, Hz, ascending, read from a list or a range of a scene file, or from an
    array in Hz.

    Raises :class:`Refused` for what are no frequencies, below zero, or not in ascending order.
    """
    values = read_values(value, FREQUENCY.read) if context.written else value
    return tuple(frequencies(values).tolist())


_FREQUENCIES = Kind(
    _read_frequencies, lambda values, _: write_values(values, FREQUENCY.write), FREQUENCY.unit
)


def _read_place(value: Any) -> str:
    """Return the text of one place of a source or receiver, with single spaces between its words.

    Raises :class:`Refused` for a text that :func:`find_place` does not understand.
    """
    words = value.split() if isinstance(value, str) else []
    if words in (["plane"], [FLOOR]) or (len(words) == 1 and _CONTACT.fullmatch(words[0])):
        return words[0]
    if len(words) > 1 and re.fullmatch("[0-9]{1,9}", words[0]):
        direction = words[1:]
        is_axis = len(direction) == 1 and direction[0] in ("x", "y", "z")
        if is_axis or _is_vector(direction):
            return " ".join(words)
    raise Refused(
        show(value),
        "plane, floor, the number of a ball and its direction, such as 12 x or 12 0.6 0.8, the"
        " balls of a contact, such as 3-4, or a list of these",
    )


def find_place(text: str) -> Any:
    """Return a place of a source or receiver in the form that ``Waves.response`` takes: "plane",
    "floor", (ball, direction), or the contact (i, j). The ``text`` of the place is one that
    :func:`_read_place` has returned.
    """
    ball, *direction = text.split()
    if not direction:
        match = _CONTACT.fullmatch(ball)
        return (int(match[1]), int(match[2])) if match else text
    if direction[0] in ("x", "y", "z"):
        return int(ball), direction[0]
    return int(ball), [float(component) for component in direction]


def _is_vector(words: list[str]) -> bool:
    """Return whether ``words`` are one to three finite numbers, not all zero."""
    if not 1 <= len(words) <= 3 or not all(re.fullmatch(NUMBER, word) for word in words):
        return False
    components = [float(word) for word in words]
    return any(components) and all(map(math.isfinite, components))


def read_direction(value: Any) -> tuple[float, ...]:
    """Return the one to three components of a Cartesian vector, read from a list of numbers or
    fractions such as "1/2", or from a text of these.

    Raises :class:`Refused` for another number of components, for zeros alone, and for what is no
    such number or fraction, or a number above 1000 in magnitude.
    """
    words: Any = value.split() if isinstance(value, str) else value
    if not isinstance(words, list | tuple):
        words = [words]
    components = each(words, partial(fraction, largest=1e3), "numbers")
    if len(components) > 3 or not any(components):
        raise Refused(show(value), "one to three numbers, not all zero, such as 0 1")
    return components


# places and polarisations are written as lists, also if there is only one
_PLACES = Kind(one_or_more(Kind.plain(_read_place), "places", "each place once").read)
_POLARISATION = one_or_more(
    word_of(*POLARISATIONS), "polarisations", f"{', '.join(POLARISATIONS)}, each once"
)
DIRECTION = Kind.plain(read_direction)
_POINTS = whole_from(2, 10_000)


# -- how a network is repeated and cut -------------------------------------------------------------


def _is_nothing(value: Any) -> bool:
    """Whether a ``value`` is the empty tuple; an empty list or array is not."""
    return isinstance(value, tuple) and not value


def _read_repeat(value: Any) -> tuple[int, ...]:
    """Return the numbers of cells along each period, from 1 to a million each, as
    :func:`read_counts` reads them; an empty tuple, which repeats nothing, stays empty. Raises
    :class:`Refused` for other numbers.
    """
    return () if _is_nothing(value) else read_counts(value, "numbers of cells", 1, 1_000_000)


def _read_cut(value: Any, context: ValueContext) -> tuple[Any, int, tuple[str | Wall, str | Wall]]:
    """Return the axis, the number of layers, and the two edges of a cut, read from a block of a
    scene file or from a tuple of these, without edges or with them; edges are free by default.

    Raises :class:`Refused` for another value, as for a tuple that is longer or has no number of
    layers.
    """
    entries = value
    if isinstance(value, tuple):
        if len(value) > len(_CUT_KEYS):
            raise Refused(show(value), f"a tuple of {', '.join(_CUT_KEYS)}")
        entries = dict(zip(_CUT_KEYS, value, strict=False))
    cut = block_of(_CUT_KEYS, ("axis", "layers")).read(entries, context)
    return cut["axis"], cut["layers"], cut.get("edges", ("free", "free"))


_MATERIAL = block_kind(Material)


def _read_wall(value: Any, context: ValueContext) -> Any:
    """Return the wall of a block {wall: material}, or {wall: kind of balls}; a ``value`` that is no
    block is returned as it is. Raises :class:`Refused` for a block that has no such wall.
    """
    if not isinstance(value, dict):
        return value

    def read_material(material: Any) -> Any:
        """Return a material, or the name of the kind of balls of whose material the wall is."""
        return label(material) if isinstance(material, str) else _MATERIAL.read(material, context)

    return Wall(block(value, {"wall": read_material}, ("wall",))["wall"])


def _write_edge(edge: str | Wall, context: ValueContext) -> Any:
    """Return an ``edge`` as a scene file has it: a word, or a block of a wall."""
    if isinstance(edge, str):
        return edge
    is_name = isinstance(edge.material, str)
    return {"wall": edge.material if is_name else _MATERIAL.write(edge.material, context)}


def _read_edges(value: Any, context: ValueContext) -> tuple[str | Wall, str | Wall]:
    """Return the lower and the upper edge, read from a list of one or two or from one text or
    block; each is a word that says how it is held, or a wall. Raises :class:`Refused` for what is
    no such edge, and for more than two.
    """
    read_wall = partial(_read_wall, context=context)
    given_edges = value if isinstance(value, list | tuple) else [value]
    edges = [read_inside(number, read_wall, edge) for number, edge in enumerate(given_edges)]
    return read_edges(edges[0] if len(edges) == 1 else edges)


def _write_edges(edges: tuple[str | Wall, str | Wall], context: ValueContext) -> Any:
    """Return both ``edges`` as a scene file has them: one text of two words, or a list if one is a
    wall.
    """
    written_edges = [_write_edge(edge, context) for edge in edges]
    has_wall = any(isinstance(edge, dict) for edge in written_edges)
    return written_edges if has_wall else " ".join(written_edges)


#: kind of one edge: a word that says how it is held, or a wall
_EDGE = Kind(lambda value, context: read_edge(_read_wall(value, context)), _write_edge)
#: keys of the block of a cut, with their kinds
_CUT_KEYS = {
    "axis": Kind.plain(read_axis),
    "layers": whole_from(1, 1_000_000),
    "edges": Kind(_read_edges, _write_edges),
}
_CUTS = one_or_more(
    Kind(
        _read_cut,
        lambda cut, context: block_of(_CUT_KEYS).write(
            dict(zip(_CUT_KEYS, cut, strict=True)), context
        ),
    ),
    "cuts",
)
#: kind of the numbers of cells along each period of a supercell or network
REPEAT = Kind.plain(_read_repeat, lambda counts: list(counts) or None)
#: kind of the cuts of a crystal or network; an empty tuple is written as nothing
CUT = Kind(
    lambda value, context: () if _is_nothing(value) else _CUTS.read(value, context),
    lambda cuts, context: _CUTS.write(cuts, context) if cuts else None,
)


# -- blocks ----------------------------------------------------------------------------------------


class LossSettings(Block, kw_only=True):
    """Losses of contacts and balls; see :meth:`granphon.waves.waves.Waves.response`."""

    damping: float | tuple[float, float] = setting(
        _one_or_two(LOSS_KINDS["damping"]),
        "viscosity of a contact over its stiffness; of normal and of other motion in a list",
        default=0.0,
        title="damping of contacts in the {block}",
    )
    drag: float | tuple[float, float] | None = setting(
        _one_or_two(LOSS_KINDS["drag"], "of displacements, and of rotations"),
        "rate at which balls slow down by themselves; of displacements and of rotations in a list",
        default=None,
        absent="none",
        title="drag of balls in the {block}",
    )
    dashpot: float | tuple[float, float] | None = setting(
        _one_or_two(LOSS_KINDS["dashpot"]),
        "viscosity of a contact, whatever its stiffness; of normal motion and of slip in a list",
        default=None,
        absent="none",
        title="dashpot of contacts in the {block}",
    )
    restitution: float | None = setting(
        LOSS_KINDS["restitution"],
        "velocity after a collision over that before, whose dashpot each contact has; up to 1",
        default=None,
        absent="none",
        title="restitution of contacts in the {block}",
    )

    @property
    def has_dashpots(self) -> bool:
        """Whether contacts have dashpots: a damping or a dashpot above zero, or a restitution, even
        one of 1.
        """
        dashpots = (self.damping, self.dashpot)
        return self.restitution is not None or any(loss and np.any(loss) for loss in dashpots)

    @property
    def losses(self) -> dict[str, Any]:
        """The losses by name, in SI units, as arguments of ``Waves.response``; without those that
        are None or that these settings do not have.
        """
        losses = {name: getattr(self, name, None) for name in LOSSES}
        return {name: loss for name, loss in losses.items() if loss is not None}

    def list_given(self) -> list[str]:
        """Return the names of the losses that are not at their default, as parameters of a sweep
        (:data:`~granphon.balls.packing.LOSS_PARAMETERS`). A loss that is a pair has two names; a
        loss with one value for all motions has the first of these.
        """
        names = []
        for setting_of_loss in fields(self):
            name = setting_of_loss.name
            value = getattr(self, name)
            if name in LOSSES and value != setting_of_loss.default:
                names += [name, SECOND_LOSSES[name]] if isinstance(value, tuple) else [name]
        return names

    def with_losses(self, values: Mapping[str, float]) -> Self:
        """Return the settings with other ``values``, SI, of losses, by the names of
        :data:`~granphon.balls.packing.LOSS_PARAMETERS`; losses that these settings do not have are
        passed over.

        If only the first of a pair gets a value, the second gets it too.
        """
        new_losses: dict[str, Any] = {}
        for name in dict.fromkeys(LOSS_PARAMETERS[parameter] for parameter in values):
            if not hasattr(self, name):
                continue
            loss = getattr(self, name) or 0.0
            first, second = loss if isinstance(loss, tuple) else (loss, loss)
            if name in values:
                first = values[name]
                second = first
            # a loss that is never a pair has no second parameter
            second = values.get(SECOND_LOSSES.get(name, ""), second)
            new_losses[name] = first if second == first else (first, second)
        return replace(self, **new_losses)


class LinearLossSettings(LossSettings, kw_only=True):
    """Losses of waves that have one frequency, which may also have loss factors."""

    loss_factor: float | tuple[float, float] = setting(
        _one_or_two(LOSS_KINDS["loss_factor"]),
        "loss factor of a contact; of normal and of other motion in a list",
        default=0.0,
        title="loss factor of contacts in the {block}",
    )


def require_losses(names: Iterable[str], settings: Sequence[Block | None]) -> None:
    """Raise :class:`InputError` if one of the swept parameters, of these ``names``, is a loss that
    none of the ``settings`` of observed results has, or that one of them already gives. Among the
    settings None stands for a result that is not observed, or has no block.
    """
    for name in names:
        loss = LOSS_PARAMETERS.get(name)
        if loss is None:
            continue
        blocks_with_loss = [
            block_of_result
            for block_of_result in settings
            if isinstance(block_of_result, LossSettings) and hasattr(block_of_result, loss)
        ]
        if not blocks_with_loss:
            why = "Losses are those of a response, motion, pulse, or of bands with a block bands"
            if loss not in [common_loss.name for common_loss in fields(LossSettings)]:
                why = f"A {loss} is that of a response, or of bands with a block bands"
            raise InputError(
                f"nothing that is observed depends on {name}",
                why,
                "Observe one of these, or leave the parameter out",
            )
        for block_of_result in blocks_with_loss:
            if name in block_of_result.list_given():
                raise InputError(
                    f"{name} is swept, and given in the block {block_of_result.block}",
                    "Each state has one value",
                    f"Leave {block_of_result.block}.{loss} out, or do not sweep over {name}",
                )


class EdgeSettings(Block, kw_only=True):
    """Settings with edges, at which walls may stand."""

    #: key of the block under which its edges are given
    key_of_edges: ClassVar[str] = "cut"

    @property
    def edges(self) -> tuple[str | Wall, ...]:
        """Each edge: a word that says how it is held, or a wall. Subclasses define it."""
        raise NotImplementedError

    def with_edges(self, edges: Sequence[str | Wall]) -> Self:
        """Return the settings with other :attr:`edges`, as many as before; subclasses define it."""
        raise NotImplementedError

    @property
    def kinds_of_walls(self) -> set[str]:
        """Names of the kinds of balls after whose materials walls are made."""
        walls = [edge for edge in self.edges if isinstance(edge, Wall)]
        return {wall.material for wall in walls if isinstance(wall.material, str)}

    def with_materials(self, kinds: Mapping[str, Ball]) -> Self:
        """Return the settings in which walls that name one of ``kinds`` of balls have the material
        of that kind.
        """
        edges = list[str | Wall]()
        for edge in self.edges:
            if isinstance(edge, Wall) and edge.material in kinds:
                edges.append(find_material(edge, kinds))
            else:
                edges.append(edge)
        return self.with_edges(edges)

    def list_walls(self, kinds: Mapping[str, Ball]) -> dict[str, Wall]:
        """Return the walls at the edges by their names, such as "response.wall"; ``kinds`` are the
        kinds of balls, after whose materials walls may be made. Two walls of one material are one
        entry, unless the later has another name of its own.

        Raises :class:`InputError` for the material of a kind that there is not, and for a name that
        a kind, the floor, or a wall of another material has
        (:func:`~granphon.balls.ball.name_walls`).
        """
        walls = [edge for edge in name_walls(self.edges, kinds, ()) if isinstance(edge, Wall)]
        return {f"{self.block}.{wall.name}": wall for wall in walls}

    def with_walls(self, values: Mapping[str, float], kinds: Mapping[str, Ball]) -> Self:
        """Return the settings with other ``values``, SI, of the parameters of walls, by names such
        as "response.wall.young_modulus"; names of walls that stand at none of these edges are
        passed over. ``kinds`` are the kinds of balls, after whose materials walls may be made.
        """
        walls = self.list_walls(kinds)
        for name, value in values.items():
            wall_name, _, parameter = name.rpartition(".")
            if wall_name in walls:
                wall = walls[wall_name]
                material = replace(wall.solid, **{parameter: value})
                walls[wall_name] = replace(wall, material=material)
        new_edges = list[str | Wall]()
        named_edges = name_walls(self.edges, kinds, ())
        for edge, named_edge in zip(self.edges, named_edges, strict=True):
            if isinstance(edge, Wall) and isinstance(named_edge, Wall):
                # a wall without a name stays without one, as a wall of the state at rest may have
                # the name that this wall has among the edges of the block
                edge = replace(walls[f"{self.block}.{named_edge.name}"], name=edge.name)
            new_edges.append(edge)
        return self.with_edges(new_edges)


def is_of_wall(name: str) -> bool:
    """Return whether the ``name`` of a swept parameter is that of a parameter of a wall at an edge
    of a block, such as "response.wall.young_modulus".
    """
    block_name, _, parameter_of_wall = name.partition(".")
    wall, _, parameter = parameter_of_wall.rpartition(".")
    return bool(wall) and block_name in _EDGE_BLOCKS and parameter in WALL_PARAMETERS


def require_walls(
    names: Iterable[str], settings: Sequence[Block | None], kinds: Mapping[str, Ball]
) -> None:
    """Raise :class:`InputError` if one of the swept parameters, of these ``names``, is that of a
    wall which stands at no edge of the ``settings`` of observed results, or for what
    :meth:`EdgeSettings.list_walls` raises, which also says when two walls are one; ``kinds`` are
    the kinds of balls, after whose materials walls may be made. If none of the ``names`` is that of
    a parameter of a wall, nothing is raised.
    """
    wall_parameters = list(filter(is_of_wall, names))
    if not wall_parameters:
        return
    walls = list[str]()
    for block_of_result in settings:
        if isinstance(block_of_result, EdgeSettings):
            walls += block_of_result.list_walls(kinds)
    for name in wall_parameters:
        wall = name.rpartition(".")[0]
        if wall not in walls:
            why = f"The walls are {', '.join(walls)}" if walls else "No edge has a wall"
            mend = "Use one of these" if walls else "Give a wall in the cut of the block"
            raise InputError(f"nothing that is observed has a wall {wall}", why, mend)


class SpectrumSettings(Block):
    """Spectral functions along the path of the bands."""

    block = "spectrum"

    polarisation: tuple[str, ...] = setting(
        Kind(_POLARISATION.read),
        f"`{'`, `'.join(POLARISATIONS)}`, one or a list",
        default=("longitudinal",),
        title="polarisation",
    )
    resolution: float | None = setting(
        with_unit(FREQUENCY),
        "standard deviation of the kernel at frequency zero",
        default=None,
        absent="0.6 % of a bound of the frequencies, about",
    )
    points: int = setting(
        _POINTS,
        "wave vectors between two corners of `phonopy.band`; each becomes the nearest one that the"
        " array has",
        default=21,
        title="points of a leg",
    )


class PulseSettings(LossSettings):
    """A pulse through the array; see :meth:`granphon.waves.waves.Waves.transmit`."""

    block = "pulse"

    frequency: float = setting(
        with_unit(FREQUENCY), "frequency of the burst that is sent", title="frequency of the pulse"
    )
    distance: float | None = setting(
        with_unit(LENGTH),
        "of the receiving plane from the source, along `direction`",
        default=None,
        absent="half the length of the array along the direction; a quarter with `ends: periodic`",
    )
    cycles: float = setting(
        Kind.plain(partial(number, low=1.0, high=1e4)),
        "periods of the burst",
        default=5.0,
        title="cycles of the pulse",
    )
    polarisation: str = setting(
        word_of(*_PUSHES),
        "the way in which the source pushes",
        default="longitudinal",
        title="polarisation of the pulse",
    )
    source: str = setting(
        word_of(*_SOURCES),
        "`plane`, the first plane of balls; `ball`, one of them",
        default="plane",
    )
    ends: str = setting(
        word_of(*ENDS),
        "`free`, `walls` (balls there are held), or `periodic`, where the pulse runs both ways",
        default="free",
    )


class SurfaceSettings(EdgeSettings):
    """Waves of an edge, along the path of its own zone; see :class:`granphon.Surface`."""

    block = "surface"
    key_of_edges = "edge"

    axis: Any = setting(
        Kind.plain(read_axis),
        "across the edge: the number of a vector of the cell, or Miller indices, as `1 1 0`",
        title="axis across the edge",
    )
    edge: str | Wall = setting(
        _EDGE,
        "`free`, `clamped` (the outer layer does not move), `floor` (a plane touches it), or"
        " `{wall: ...}`, an elastic plane of a material or a kind",
        default="free",
        title="edge",
    )
    points: int = setting(
        _POINTS, "wave vectors between two corners of the path along the edge", default=31
    )

    @property
    def edges(self) -> tuple[str | Wall, ...]:
        """The one edge, as a tuple: a word that says how it is held, or a wall."""
        return (self.edge,)

    def with_edges(self, edges: Sequence[str | Wall]) -> Self:
        """Return the settings with another edge, the one in ``edges``."""
        (edge,) = edges
        return replace(self, edge=edge)


class NetworkSettings(EdgeSettings, kw_only=True):
    """Settings of a result for the network of each state, or of each sample of a simulation."""

    #: keys of settings that depend on the network: a network may turn out not to allow their values
    of_network: ClassVar[tuple[str, ...]] = ("repeat", "cut")

    repeat: tuple[int, ...] = setting(
        REPEAT, "cells of the network along each period", default=(), absent="one cell"
    )
    cut: tuple[tuple[Any, int, tuple[str | Wall, str | Wall]], ...] = setting(
        CUT,
        "block `axis`, `layers`, `edges` of a strip, slab or column of the network, or a list",
        default=(),
        absent="none",
    )

    @property
    def edges(self) -> tuple[str | Wall, ...]:
        """The lower and the upper edge of each cut, one cut after the other: words that say how
        they are held, or walls.
        """
        return tuple(edge for _, _, edges in self.cut for edge in edges)

    def with_edges(self, edges: Sequence[str | Wall]) -> Self:
        """Return the settings with other ``edges`` of the cuts, in the order of :attr:`edges`."""
        pairs = zip(edges[::2], edges[1::2], strict=True)
        cuts = zip(self.cut, pairs, strict=True)
        return replace(self, cut=tuple((axis, layers, pair) for (axis, layers, _), pair in cuts))

    def count_balls(self, number: int) -> int:
        """Return the number of balls of a network after it is repeated and cut, from the ``number``
        before; or of its cells, from their number before. Flat walls that a cut adds do not count.
        """
        n_layers = math.prod(layers for _, layers, _ in self.cut)
        return number * math.prod(self.repeat) * n_layers

    def shape(self, network: Any) -> Any:
        """Return the ``network`` after it is repeated and cut as these settings say."""
        if self.repeat:
            network = network.repeat(self.repeat)
        for axis, layers, edges in self.cut:
            # a tuple has Miller indices, which a network takes as a list
            network = network.cut(list(axis) if isinstance(axis, tuple) else axis, layers, edges)
        return network

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of the result in a data set, by its name. Subclasses
        define it.
        """
        raise NotImplementedError


class ResponseSettings(NetworkSettings, LinearLossSettings):
    """The response at given frequencies; see :meth:`granphon.waves.waves.Waves.response`."""

    block = "response"
    of_network = ("repeat", "cut", "source", "receiver")

    frequencies: tuple[float, ...] = setting(
        _FREQUENCIES, "a list, or a range, ascending", title="frequencies of the response"
    )
    source: tuple[str, ...] = setting(
        _PLACES,
        "what is driven: `plane`, `floor`, or a ball and its direction, as `12 x`, or a list",
        title="source",
    )
    receiver: tuple[str, ...] = setting(
        _PLACES,
        "what is heard, likewise; of `plane`, the last one, the mean over its balls; of a force"
        " the balls of a contact, as `3-4`, `floor`, or a sensor in a ball, as `12 x`",
        title="receiver",
    )
    quantity: str = setting(
        word_of(*RESPONSES),
        "`displacement`, `velocity`, `acceleration` or `force` over force; of a wall that is moved"
        " `transmissibility`, or `stiffness`, the force over its displacement",
        default="displacement",
        title="quantity of the response",
    )
    direction: tuple[float, ...] | None = setting(
        DIRECTION,
        "across the planes, Cartesian",
        default=None,
        absent="the first axis along which nothing repeats, or x",
    )
    polarisation: str | None = setting(
        word_of(*_PUSHES),
        "the way in which a plane is driven and heard",
        default=None,
        absent="`longitudinal`",
    )
    distance: float | None = setting(
        with_unit(LENGTH),
        "of the receiving plane from the first one",
        default=None,
        absent="the last plane",
    )

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of the result in a data set, by its name."""
        return {
            "response_frequency": (self.frequencies, FREQUENCY.unit),
            "receiver": (self.receiver, ""),
        }


class BandsSettings(LinearLossSettings):
    """How contacts and balls damp the branches of bands; see :meth:`granphon.Phonons.damped`."""

    block = "bands"


# -- what drives balls -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Signal:
    """A quantity as a function of time: linear between the ``times``, and constant before the first
    and after the last.

    Attributes
    ----------
    times : (n,) s, ascending.
    values : (n,) displacement, m, or force, N, at each of the times.
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Make tuples of numbers of both lists.

        Raises :class:`InputError` for what is no list of one or more finite numbers; and
        :class:`Refused` for lists of one entry or of different lengths, and for times that are
        below 0 s or do not ascend.
        """
        object.__setattr__(self, "times", finite_list("times", self.times, "s"))
        object.__setattr__(self, "values", finite_list("values", self.values, ""))
        if len(self.times) != len(self.values) or len(self.times) < 2:
            fault = f"{len(self.times)} times and {len(self.values)} values"
            raise Refused(fault, "two or more times, each with a value")
        is_early = np.diff(self.times, prepend=-math.inf) <= 0.0  # not after the time before
        is_early[0] = self.times[0] < 0.0  # no time is before the first
        if np.any(is_early):
            row = int(np.argmax(is_early))
            raise Refused(
                f"the time {self.times[row]:g} s in row {row + 1}",
                "times from 0 s on, each after the one before",
            )

    def __call__(self, time: float) -> float:
        """Return the value, m or N, at a ``time``, s."""
        return float(np.interp(time, self.times, self.values))

    @property
    def greatest(self) -> float:
        """The greatest magnitude of the values, m or N."""
        return max(map(abs, self.values))

    def find_lost_share(self, step: float, end: float) -> float:
        """Return the share of the signal that is lost by sampling at each ``step``, s, from the
        time zero to ``end``, s: the area between the signal and straight lines through its samples,
        over the area under the magnitude of the signal; zero if the signal is zero.
        """
        # only samples beside the times of the signal matter, as elsewhere the signal is straight
        step_numbers = np.floor(np.divide(self.times, step))
        sample_times = step * np.union1d(step_numbers, step_numbers + 1.0)
        times = np.unique(np.clip([0.0, *self.times, *sample_times, end], 0.0, end))
        signal = np.interp(times, self.times, self.values)
        samples = np.interp(sample_times, self.times, self.values)
        differences = signal - np.interp(times, sample_times, samples)
        signal_area = _find_area(times, signal)
        return _find_area(times, differences) / signal_area if signal_area else 0.0


def _find_area(times: Array, values: Array) -> float:
    """Return the area under the magnitude of a quantity that is linear between its ``values`` (n,)
    at ascending ``times`` (n,), s; in the unit of the quantity times s.
    """
    start = np.abs(values[:-1])
    end = np.abs(values[1:])
    sums = start + end
    changes_sign = np.sign(values[:-1]) * np.sign(values[1:]) < 0.0
    # where the quantity changes its sign, the trapezoid becomes two triangles
    shares = np.divide(start, sums, out=np.zeros_like(sums), where=changes_sign)
    double_means = np.where(changes_sign, shares * start + (1.0 - shares) * end, sums)
    return 0.5 * float(np.diff(times) @ double_means)


def _read_table(folder: Path, file: str, name: str, quantity: Quantity) -> Signal:
    """Return the signal of a table, which is a ``file`` in a ``folder``: its columns "time" and
    ``name``; ``quantity`` has the unit of the second.

    Raises :class:`Refused` for a file that is not there or no such table, and for values that are
    no signal.
    """
    try:
        table = Table.read(folder / file, quoted=False)
        times = table.column("time", SINCE)
        values = table.column(name, quantity)
    except Refused:  # a value is wrong, and the message names its row
        raise
    except InputError as error:  # the file is missing, or is no such table
        allowed = f"a table with the columns time and {name}"
        raise Refused(show(file), allowed, str(error)) from None
    return Signal(tuple(times.tolist()), tuple(values.tolist()))


def _signal_kind(name: str, quantity: Quantity) -> Kind:
    """Return the kind of a signal of a force or a displacement, which ``name`` says; the
    ``quantity`` has its unit. The signal is read from the name of a file with a table, from a block
    of two lists, "time" and ``name``, or from a signal, and is written as such a block.
    """
    columns = {"time": listed(with_unit(SINCE)), name: listed(with_unit(quantity))}
    lists = block_of(columns, tuple(columns))

    def read(value: Any, context: ValueContext) -> Signal:
        """Return the signal of a file, of a block or of a signal."""
        if isinstance(value, str) and context.written:
            return _read_table(context.folder, value, name, quantity)
        entries = split(value) if isinstance(value, Signal) else value
        return Signal(*lists.read(entries, context).values())

    def split(signal: Signal) -> dict[str, Any]:
        """Return the two lists of the block of a signal, by name."""
        return {"time": signal.times, name: signal.values}

    return Kind(read, lambda signal, context: lists.write(split(signal), context))


class Shaker(Block):
    """A displacement A r(t) sin(2 pi f t) of amplitude A and frequency f, whose factor r rises from
    0 to 1 as half a cosine over the first periods, the ramp.
    """

    block = "shaker"

    amplitude: float = setting(with_unit(LENGTH), "greatest displacement of the shaker")
    frequency: float = setting(with_unit(FREQUENCY), "frequency of the shaker")
    ramp: float = setting(
        Kind.plain(partial(number, low=0.0, high=1e6)),
        "periods over which the amplitude rises",
        default=5.0,
    )

    def __call__(self, time: float) -> float:
        """Return the displacement, m, at a ``time``, s."""
        periods = self.frequency * time
        rise = 1.0
        if periods < self.ramp:
            rise = 0.5 - 0.5 * np.cos(np.pi * periods / self.ramp)
        return float(self.amplitude * rise * np.sin(2.0 * np.pi * periods))


def _read_balls(value: Any) -> tuple[int, ...] | str:
    """Return one of :data:`FACES`, or the indices of balls that a number, a list of numbers or a
    text of these gives.

    Raises :class:`Refused` for another word, for what are no whole numbers from 0 to 100,000,000,
    and for a ball that is given twice.
    """
    if isinstance(value, str) and not value[:1].isdecimal():
        return choice(value, FACES)
    balls = read_counts(value, "numbers of balls", 0, 100_000_000)
    if len(set(balls)) < len(balls):
        raise Refused(show(value), "each ball once")
    return balls


class DriveSettings(Block):
    """A drive of some balls along a direction, of one of four kinds.

    A face of the array is its floor; without a floor its clamped balls, if no ball of its outer
    layer moves; else the balls of its outer layer. Exactly one of ``impact``, ``shaker``, ``force``
    and ``displacement`` is not None: :class:`MotionSettings` refuses other drives.
    """

    block = "drive"

    balls: tuple[int, ...] | str = setting(
        Kind.plain(_read_balls), "their numbers, or `lower` or `upper`: a face of the array"
    )
    direction: tuple[float, ...] | None = setting(
        DIRECTION, "Cartesian, of the drive", default=None, absent="x"
    )
    impact: float | None = setting(
        with_unit(VELOCITY), "velocity at the start", default=None, absent="none"
    )
    shaker: Shaker | None = setting(
        block_kind(Shaker), "a displacement to and fro", default=None, absent="none"
    )
    force: Signal | None = setting(
        _signal_kind("force", PUSH), "force on each ball over time", default=None, absent="none"
    )
    displacement: Signal | None = setting(
        _signal_kind("displacement", WAY),
        "displacement over time",
        default=None,
        absent="none",
    )

    @property
    def kind(self) -> str:
        """The kind of the drive, one of :data:`DRIVES`."""
        return next(name for name in DRIVES if getattr(self, name) is not None)

    @property
    def extremes(self) -> dict[str, float]:
        """The speed, m/s, force, N, and displacement, m, that the drive reaches, as arguments of
        :meth:`granphon.NonlinearWaves.find_step`.
        """
        amplitude = self.shaker.amplitude if self.shaker else 0.0
        return {
            "speed": abs(self.impact or 0.0),
            "force": self.force.greatest if self.force else 0.0,
            "displacement": self.displacement.greatest if self.displacement else abs(amplitude),
        }

    def find_balls(self, network: ContactNetwork) -> Index:
        """Return the indices (k,) of the bodies that the drive moves in a ``network``. Indices that
        were given are returned as they are, also those of balls that the network does not have.

        Raises :class:`InputError` for a face of a network that repeats along all its axes.
        """
        if not isinstance(self.balls, str):
            return np.array(self.balls, np.intp)
        n_periods = int(np.sum(network.pbc))
        if n_periods >= network.dimension:
            fault = f"the array has no {self.balls} face"
            raise InputError(
                fault,
                "It repeats along all its axes",
                "Cut it (motion.cut), or give numbers of balls",
            )
        # where periods are oblique to all axes, the last axis leads out of the network
        axis = min(list_open_axes(network), default=n_periods)
        heights = network.positions[:, axis].copy()
        for wall, (point, _) in network.walls.items():  # a flat wall may have any position
            heights[wall] = point[axis]
        sign = -1.0 if self.balls == FACES[0] else 1.0
        return _find_face(network, sign * heights)


def _find_face(network: ContactNetwork, heights: Array) -> Index:
    """Return the indices (k,) of the bodies at the face with the greatest heights: the floor if
    there is one, else the clamped balls if no ball of the outer layer moves, else the balls of the
    outer layer.

    ``heights`` (n,), m, are those of all balls, and of points on walls, and grow towards the face.
    """
    is_ball = np.isfinite(network.radii)  # the radius of a flat wall is infinite
    top = float(np.max(heights[is_ball]))
    floor = np.flatnonzero(~is_ball & (heights > top))
    if floor.size:
        return floor
    mean_radius = float(np.mean(network.radii[is_ball]))
    is_outer = is_ball & (heights > top - 0.5 * mean_radius)
    if np.any(network.moving[is_outer]):
        return np.flatnonzero(is_outer)
    # clamped balls move as one body, however many layers they fill
    middle = 0.5 * (top + float(np.min(heights[is_ball])))
    is_clamped = is_ball & ~network.moving & (heights > middle)
    return np.flatnonzero(is_clamped)


def _read_drive(value: Any, context: ValueContext) -> DriveSettings:
    """Return the drive that a block of a scene file gives, or a drive itself.

    Raises :class:`Refused` unless exactly one of :data:`DRIVES` is given.
    """
    entries = value
    if isinstance(value, DriveSettings):
        entries = {field.name: getattr(value, field.name) for field in fields(value)}
    kinds = []
    if isinstance(entries, dict):
        kinds = [name for name in DRIVES if entries.get(name) is not None]
    if len(kinds) > 1:
        raise Refused(" and ".join(kinds), f"exactly one of {', '.join(DRIVES)}")
    drive = read_block(DriveSettings, value, context)
    if not kinds:
        raise Refused("balls alone", f"exactly one of {', '.join(DRIVES)}")
    return drive


class MotionSettings(NetworkSettings, LossSettings):
    """Balls that move by the whole of their contact law; see :class:`granphon.NonlinearWaves`."""

    block = "motion"
    of_network = ("repeat", "cut", "drive")

    duration: float = setting(
        with_unit(TIME), "how long the balls move", title="duration of the motion"
    )
    drive: tuple[DriveSettings, ...] = setting(
        one_or_more(Kind(_read_drive, write_block), "drives"),
        "what drives them, or a list: balls, a direction, and an impact, shaker, force or"
        " displacement, see [motion](#motion)",
    )
    friction_coefficient: float | None = setting(
        Kind.plain(zero_or_above),
        "Coulomb's limit of slip; states of a sweep without friction do not use it",
        default=None,
        absent="contacts do not slide",
        title="friction coefficient of the motion",
    )
    viscous_pull: Any = setting(
        word_of(*VISCOUS_PULLS),
        "`whole`: dashpots may pull, where balls part; `limited`: the normal force never pulls by"
        " them",
        default="whole",
    )
    coulomb: Any = setting(
        word_of(*COULOMB_LIMITS),
        "Coulomb's limit: `elastic`, of the forces of springs; `total`, with those of dashpots",
        default="elastic",
    )
    frames: int = setting(
        whole_from(2, 1_000_000),
        "number of times that are kept, the start and the end among them",
        default=FRAMES,
        title="times of the motion",
    )
    step: float | None = setting(
        with_unit(TIME),
        "step of time, of which a frame has a whole number",
        default=None,
        absent="as the stiffest contact allows",
    )
    geometry: Any = setting(
        word_of(*GEOMETRIES),
        "`lattice`: contacts keep their directions; `exact`: balls may go anywhere, and meet"
        " others",
        default="lattice",
        title="geometry of the motion",
    )
    scheme: Any = setting(
        word_of(*SCHEMES),
        "steps: `verlet`, explicit; `midpoint`, implicit, which keep the sum of energies",
        default="verlet",
    )

    @property
    def extremes(self) -> dict[str, float]:
        """The greatest speed, force and displacement of any drive, as
        :attr:`DriveSettings.extremes`.
        """
        extremes_of_drives = [drive.extremes for drive in self.drive]
        return {
            name: max(extremes[name] for extremes in extremes_of_drives)
            for name in extremes_of_drives[0]
        }

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of the result in a data set, by its name."""
        times = self.duration / (self.frames - 1) * np.arange(self.frames)
        return {"motion_time": (tuple(times.tolist()), TIME.unit)}


class ModesSettings(NetworkSettings):
    """The lowest modes of a network; see :meth:`granphon.waves.waves.Waves.modes`."""

    block = "modes"
    of_network = ("repeat", "cut", "count")

    count: int = setting(
        whole_from(1, 10_000),
        "number of the lowest modes that cost energy",
        default=6,
        title="lowest modes",
    )

    @property
    def coordinates(self) -> dict[str, tuple[tuple[Any, ...], str]]:
        """Values and unit of each dimension of the result in a data set, by its name."""
        return {"mode": (tuple(range(1, self.count + 1)), "")}


#: the blocks of a scene about waves, in the order in which a scene file has them
BLOCKS: dict[str, type[Block]] = {
    settings.block: settings
    for settings in (
        SpectrumSettings,
        PulseSettings,
        SurfaceSettings,
        ResponseSettings,
        MotionSettings,
        ModesSettings,
        BandsSettings,
    )
}
#: the names of the blocks with edges
_EDGE_BLOCKS = [name for name, settings in BLOCKS.items() if issubclass(settings, EdgeSettings)]
#: the blocks about the network of a state, by the word with which a scene observes them
NETWORK_BLOCKS: dict[str, type[NetworkSettings]] = {
    "response": ResponseSettings,
    "motion": MotionSettings,
    "modes": ModesSettings,
}


@dataclass(frozen=True)
class WaveSettings:
    """Settings of all waves that a scene requests: those in each sample of a simulation, and those
    in the network of any state; plain data.

    Attributes
    ----------
    dos : whether the density of states is requested.
    spectrum : settings of the spectral functions along a path; None if not requested.
    path, labels : pieces of that path, each with its corners in fractions of the reciprocal cell,
        and a label for each corner.
    pulse : settings of the pulse; None if not requested.
    direction : direction of the pulse, Cartesian, (p,); None for x.
    of_networks : settings of the results for the network of each state.
    """

    dos: bool = False
    spectrum: SpectrumSettings | None = None
    path: tuple[Any, ...] = ()
    labels: tuple[str, ...] = ()
    pulse: PulseSettings | None = None
    direction: tuple[Any, ...] | None = None
    of_networks: tuple[NetworkSettings, ...] = ()

    def with_losses(self, losses: Mapping[str, float]) -> WaveSettings:
        """Return the settings with other ``losses``, SI, by name, in the pulse and in all results
        of networks that have these losses; see :meth:`LossSettings.with_losses`.
        """
        networks = (
            settings.with_losses(losses) if isinstance(settings, LossSettings) else settings
            for settings in self.of_networks
        )
        pulse = None if self.pulse is None else self.pulse.with_losses(losses)
        return replace(self, pulse=pulse, of_networks=tuple(networks))

    def with_walls(self, values: Mapping[str, float], kinds: Mapping[str, Ball]) -> WaveSettings:
        """Return the settings with other ``values``, SI, of the parameters of walls at the edges of
        networks, by name; see :meth:`EdgeSettings.with_walls`. ``kinds`` are the kinds of balls.
        """
        networks = tuple(settings.with_walls(values, kinds) for settings in self.of_networks)
        return replace(self, of_networks=networks)

    @property
    def names(self) -> tuple[str, ...]:
        """Those of :data:`WAVES` that are requested."""
        return tuple(name for name in WAVES if getattr(self, name) not in (None, False))


def named_tables(drives: Any) -> list[str]:
    """Return the names of the files with signals to which the ``drives`` of a valid scene file
    refer, one block or a list of blocks.
    """
    drive_blocks = drives if isinstance(drives, list) else [drives]
    names = []
    for drive_block in drive_blocks:
        for kind in ("force", "displacement"):
            signal = drive_block.get(kind)
            if isinstance(signal, str):
                names.append(signal)
    return names
