"""The keys of a scene file: one table, by which scenes are read, checked and written, and the page of the reference is made.

Defaults of keys that a file leaves out are those of the classes of which a scene is made.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.balls.loads import balls_on_side
from granphon.balls.motions import allowed_motions
from granphon.base.errors import Refused
from granphon.base.quantities import LENGTH, LOADS, NUMBER
from granphon.base.scales import write_quantity
from granphon.base.text import Document, show
from granphon.base.validation import block, read_inside, refuse_unknown_key, whole
from granphon.phonons.paths import BandPath, read_labels
from granphon.scene import rules
from granphon.scene.rules import PARTS, SCENE_SCHEMA, Context, Kind
from granphon.waves.settings import POLARISATIONS, wave_rules, write_setting

#: the default of a key that has none
NEEDED = "required"


class Field(NamedTuple):
    """One key of a scene file.

    Attributes
    ----------
    key : the block and the key in it, or the key at the top level.
    place : the attribute of a scene that has the value, with those that lead to it; if it is None the key is not written.
    kind : how the value is read and written.
    words : what it is, for the page of the reference.
    default : what it is if it is left out, in words; empty if that is the plain default of the class.
    """

    key: str
    place: str
    kind: Kind
    words: str
    default: str = ""


def _load(kind: str, words: str) -> Field:
    """Return the field of a kind of load."""
    return Field(f"load.{kind}", "load", rules.load_kind(kind), words, "one load is required")


def _wave(key: str, words: str, default: str) -> Field:
    """Return a field of the blocks about waves in a simulated array."""
    name, own = key.split(".")
    read = wave_rules(name)[own]
    place = f"waves.{key}" if name == "spectrum" else key  # a spectrum that is not observed is not written
    return Field(key, place, Kind.plain(read, partial(write_setting, own)), words, default)


def _part(name: str, words: str, default: str = "", place: str = "", kind: Kind | None = None) -> Field:
    """Return a field of the material or of the packing."""
    block = "material" if name in ("young_modulus", "poisson_ratio", "density", "yield_strength") else "packing"
    own = name if block == "packing" else f"material.{name}"
    return Field(f"{block}.{name}", place or f"packing.{own}", kind or PARTS[name], words, default)


def _unless_zero(kind: Kind) -> Kind:
    return Kind(kind.read, lambda value, at: kind.write(value, at) if value else None)


_OWN_MOTIONS = Kind(  # those that the lattice has by default are left out
    PARTS["motions"].read,
    lambda value, at: None if value == next(iter(allowed_motions(at.lattice.dimension))) else value,
)
FIELDS: tuple[Field, ...] = (
    Field("schema", "schema", Kind.plain(rules.read_schema), "version of this format", f"`{SCENE_SCHEMA}`"),
    _part("young_modulus", "Young modulus of the material", NEEDED),
    _part("poisson_ratio", "Poisson ratio of the material", NEEDED),
    _part("density", "density of the material, not of the packing", NEEDED),
    _part("yield_strength", "uniaxial yield stress; you are warned where contacts would flow", "none: not checked"),
    _part("lattice", "how the balls are arranged, see [lattices](#lattices)", place="packing.structure"),
    _part("diameter", "diameter of a ball; the mean, if they differ", NEEDED),
    _part("spread", "how diameters differ, see [spread](#spread)", "equal balls", kind=rules.OWN_SPREAD),
    _part("friction", "whether contacts resist shear; without friction, torsion and bending balls do not rotate"),
    _part(
        "finite_overlap", "keep the [terms of relative order overlap/diameter](../explanation/model.md#finite-overlap)",
        place="finite_overlap",
    ),
    _part(
        "motions", "how each ball moves, see [lattices](#lattices)",
        "`longitudinal` on a chain, `in_plane` in the plane, `all` in space", kind=_OWN_MOTIONS,
    ),
    _part(
        "torsion", "stiffness of a contact against twist, over k d²; `mindlin`: that of Hertz contacts without slip", "`0`",
        kind=_unless_zero(PARTS["torsion"]),
    ),
    _part("bending", "stiffness of a contact against rolling, over k d²", "`0`", kind=_unless_zero(PARTS["bending"])),
    _load("force", "mean force between touching balls"),
    _load("pressure", "force per length of the boundary; on a chain the force, N; in space the force per area, Pa"),
    _load("overlap", "how far touching balls are pressed into each other; may be negative if balls differ"),
    _load("side_force", "push F on each side of a hexagonal frame: the contact force is F/(n √3)"),
    Field(
        "load.balls_per_side", "load.balls_per_side", Kind.plain(balls_on_side),
        "the number n of balls that lean on a side of that frame", "required with `side_force`",
    ),
    Field(
        "medium", "media", rules.MEDIUM, "how a spread of diameters is averaged, see [media](#media)",
        "`ema`; `ala` for equal balls",
    ),
    Field(
        "sweep", "parameters", rules.PARAMETERS_SWEPT,
        "parameters of the packing, each with the values that it takes, see [sweep](#sweep)", "none",
    ),
    Field(
        "observe", "observe", Kind.plain(rules.read_observables),
        "what to compute; nothing else is computed. `spectrum` and `pulse` are of simulations,"
        " and so is `dos` where there are several states",
    ),
    Field(
        "direction", "direction", Kind(lambda value, at: rules.read_directions(value, at.lattice)),
        "direction of sound, Cartesian, or a list of directions, see [direction](#direction)", "x",
    ),
    _wave("spectrum.polarisation", f"`{'`, `'.join(POLARISATIONS)}`, one or a list", "`longitudinal`"),
    _wave(
        "spectrum.resolution", "standard deviation of the kernel at frequency zero",
        "1/256 of a bound of the frequencies, about",
    ),
    _wave(
        "spectrum.points",
        "wave vectors between two corners of `phonopy.band`; each becomes the nearest one that the array has", "`21`",
    ),
    _wave("pulse.frequency", "frequency of the burst that is sent", NEEDED),
    _wave(
        "pulse.distance", "of the receiving plane from the source, along `direction`",
        "half the length of the array along the direction; a quarter with `ends: periodic`",
    ),
    _wave("pulse.cycles", "periods of the burst", "`5`"),
    _wave("pulse.polarisation", "the way in which the source pushes", "`longitudinal`"),
    _wave("pulse.source", "`plane`, the first plane of balls; `ball`, one of them", "`plane`"),
    _wave("pulse.ends", "`free`, `walls` (balls there are held), or `periodic`, where the pulse runs both ways", "`free`"),
    _wave("pulse.damping", "viscosity of a contact over its stiffness", "`0 s`"),
    Field(
        "phonopy.dim", "dim", rules.grid_kind(("3 1 1", "3 3 1", "3 3 3"), 2, 100, 2),
        "cells of the supercell for force constants, along each period; `3 1 1` on a chain, `3 3 3` in space",
        "the smallest that is large enough",
    ),
    Field(
        "phonopy.band", "band", Kind(lambda value, at: BandPath.read(value, at.lattice), lambda path, _: str(path)),
        "corners of the path: letters, or three numbers each, in fractions of the reciprocal cell",
        "Γ-K-M-Γ; Γ-X-M-Γ on the square lattice; Γ-X on a chain; in space ASE's",
    ),
    Field(
        "phonopy.band_labels", "band.labels", Kind.plain(read_labels), "a label for each corner",
        "the letters of the path; none for one in numbers",
    ),
    Field(
        "phonopy.band_points", "band_points", Kind.plain(partial(whole, low=2, high=100_000)),
        "points on each segment, both ends counted",
    ),
    Field(
        # in space a 1 would be the mesh of a plane
        "phonopy.mesh", "mesh", rules.grid_kind(("1024 1 1", "64 64 1", "32 32 32"), 1, 4096, 2),
        "wave vectors for the density of states, along each period; `1024 1 1` on a chain, `32 32 32` in space",
        "`64 64 1`; `1024 1 1` on a chain; `32 32 32` in space",
    ),
)  # fmt: skip

#: the fields of each block by their keys; those at the top level stand alone under their own key
_BLOCKS: dict[str, dict[str, Field]] = {}
for _field in FIELDS:
    _BLOCKS.setdefault(_field.key.partition(".")[0], {})[_field.key.partition(".")[2]] = _field
#: the blocks that a scene must have
_NEEDED_BLOCKS = ("material", "packing", "load")
#: what a block "load" must hold, in words for messages
_ONE_LOAD = "exactly one of force, pressure, overlap, or side_force with balls_per_side"


# -- writing and checking -------------------------------------------------------------------------------------------


def write_blocks(scene: Any, at: Context) -> dict[str, Any]:
    """Return what the file of a scene holds, with every default written out, as plain data."""
    out: dict[str, Any] = {}
    for name, fields in _BLOCKS.items():
        for key, field in fields.items():
            value = scene
            for attribute in field.place.split("."):
                value = None if value is None else getattr(value, attribute)
            # a key is left out where it has no value, and where its kind writes none
            if value is not None and (value := field.kind.write(value, at)) is not None:
                out |= {name: out.get(name, {}) | {key: value} if key else value}
    return out


def scene_rule(place: str, at: Context) -> Any:
    """Return the rule of the attribute ``place`` of a scene."""
    (found,) = (field.kind.rule(at) for field in FIELDS if field.place == place)
    return found


# -- reading --------------------------------------------------------------------------------------------------------


def read_blocks(document: Document, folder: Path) -> dict[str, Any]:
    """Read the values in ``document``, in SI units, each block as a mapping; tables it names are sought in ``folder``.

    :class:`~granphon.base.errors.SceneError` tells one mistake. An unknown key comes first, as a misspelt key is often the
    reason why another is missing; then the first value that its rule refuses; then a missing key.
    """
    data: Any = document.data
    if isinstance(data, list):
        raise document.error((), f"found a list; allowed: a block of keys: {', '.join(_BLOCKS)}.")
    try:
        _require_known(data)
        at = Context(_find_lattice(data), folder=folder)
        return block(data, {name: partial(_read_block, name, at=at) for name in _BLOCKS}, _NEEDED_BLOCKS)
    except Refused as refused:
        with suppress(LookupError, TypeError, Refused, AttributeError):
            # a width in per cent is told as the length that it is of the diameter
            value = data
            for key in refused.path:
                value = value[key]
            told = re.fullmatch(rf"\s*({NUMBER})\s*(?:%|percent)\s*", value)
            if told and refused.path[:2] in (("packing", "spread"), ("sweep", "width"), ("sweep", "spread")):
                diameter = LENGTH.read(data["packing"]["diameter"])
                width = write_quantity(float(told[1]) / 100.0 * diameter, "m")
                mend = f"{told[1]} % of {write_quantity(diameter, 'm')} is {width}: write '{width}'."
                refused = Refused(refused.found, refused.allowed, mend, refused.path)
        raise document.error(refused.path, str(refused)) from None


def _read_block(name: str, value: Any, at: Context) -> Any:
    """Read a block, or the value of a key at the top level."""
    fields = _BLOCKS[name]
    if "" in fields:
        return fields[""].kind.read(value, at)
    if name in ("phonopy", "spectrum") and value is None:
        return {}  # every key below it is commented out
    if name == "load" and isinstance(value, dict):  # block() refuses another value, with the keys that are allowed
        given = [kind for kind in LOADS if kind in value]
        if not given:
            raise Refused("balls_per_side without side_force" if value else "no load", _ONE_LOAD)
        if len(given) > 1:
            raise Refused(" and ".join(given), _ONE_LOAD, "Remove all but one.")
        if ("side_force" in value) != ("balls_per_side" in value):
            raise Refused("side_force alone" if "side_force" in value else f"{given[0]} and balls_per_side", _ONE_LOAD)
    needed = [key for key, field in fields.items() if field.default == NEEDED]
    return block(value, {key: field.kind.rule(at) for key, field in fields.items()}, needed)


def _require_known(data: Any) -> None:
    """Refuse the first unknown key, and say to which block it belongs if another block has such a key."""
    known = {"": list(_BLOCKS)} | {name: list(fields) for name, fields in _BLOCKS.items() if "" not in fields}
    for name, keys in known.items():
        given = data.get(name) if name and isinstance(data, Mapping) else data
        ranges = isinstance(given, dict) and {"from", "to", "points", "scale"} & set(given)
        if name == "load" and (isinstance(given, list) or ranges):
            found, mend = f"{show(given)}, without the kind of load", "Write 'force:' before it, or another."
            raise Refused(found, _ONE_LOAD, mend, ("load",))
        for key in given if isinstance(given, Mapping) else ():
            if key not in keys:
                home = next((home for home in known if key in known[home]), name)
                mend = "" if home == name else f"It belongs under '{home}'." if home else "It belongs at the top level."
                refused = refuse_unknown_key(key, keys, mend)
                raise refused.under(name) if name else refused


def _find_lattice(data: Any) -> Lattice:
    """Read the lattice of a scene before its other values, whose rules depend on it."""
    readers = {"packing": PARTS["lattice"].rule(Context()), "sweep": rules.read_lattices}
    found = {}
    for name, rule in readers.items():
        inside = data.get(name) if isinstance(data, Mapping) else None
        if isinstance(inside, Mapping) and "lattice" in inside:
            found[name] = read_inside(name, partial(read_inside, "lattice", rule), inside["lattice"])
    return rules.choose_lattice(find_lattice(found.get("packing", TRIANGULAR)), found.get("sweep", ()))
