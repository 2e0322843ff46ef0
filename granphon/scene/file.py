"""The scene file: its keys in one table, by which it is read, checked and written, and the place of
every error in it.

The page of the reference is made of the same table. Defaults of keys that a file leaves out are
those of the classes of which a scene is made.
"""

from __future__ import annotations

import math
import os
import re
import textwrap
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial, reduce
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.balls.loads import Load, balls_on_side
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions
from granphon.balls.packing import Packing
from granphon.base.errors import ConvergenceError, GranphonError, InstabilityError, Refused
from granphon.base.quantities import ACCELERATION, LENGTH, LOAD_KINDS, NUMBER, TENSORS
from granphon.base.scales import write_quantity
from granphon.base.text import Document, parse_yaml, read_text, show
from granphon.base.validation import block, read_inside, refuse_unknown_key, whole
from granphon.media.arrangement import Arrangement
from granphon.phonons.paths import BandPath, read_labels
from granphon.scene import rules
from granphon.scene.rules import (
    PARTS,
    SCENE_SCHEMA,
    Context,
    Kind,
    choose_lattice,
    split_tensor,
    table_named,
)
from granphon.waves.settings import (
    FRAMES,
    NETWORK_BLOCKS,
    POLARISATIONS,
    BandsSettings,
    PulseSettings,
    SpectrumSettings,
    SurfaceSettings,
    named_tables,
    wave_rules,
    write_setting,
)

#: column at which the words of a key stand in a preset
_WORDS_AT = 38
#: the default of a key that has none
NEEDED = "required"


class Field(NamedTuple):
    """One key of a scene file.

    Attributes
    ----------
    key : the block and the key in it, or the key at the top level.
    place : the attribute of a scene that has the value, with those that lead to it; if it is None
        the key is not written.
    kind : how the value is read and written.
    words : what it is, for the page of the reference.
    default : what it is if it is left out, in words; empty if that is the plain default of the
        class.
    """

    key: str
    place: str
    kind: Kind
    words: str
    default: str = ""


def _load(kind: str, words: str) -> Field:
    return Field(f"load.{kind}", "load", rules.load_kind(kind), words, "one load is required")


def _wave(key: str, words: str, default: str, kind: Kind | None = None) -> Field:
    name, own = key.split(".")
    # a spectrum that is not observed is not written
    place = f"waves.{key}" if name == "spectrum" else key
    return Field(
        key,
        place,
        kind or Kind.plain(wave_rules(name)[own], partial(write_setting, own)),
        words,
        default,
    )


def _network(name: str) -> tuple[Field, Field]:
    """Return the fields of a block about the network of a state that say how it is repeated and
    cut.
    """
    return (
        _wave(f"{name}.repeat", "cells of the network along each period", "one cell", rules.REPEAT),
        _wave(
            f"{name}.cut",
            "block `axis`, `layers`, `edges` of a strip, slab or column of the network, or a list",
            "none",
            rules.CUT,
        ),
    )


def _part(
    name: str, words: str, default: str = "", place: str = "", kind: Kind | None = None
) -> Field:
    block = (
        "material"
        if name in ("young_modulus", "poisson_ratio", "density", "yield_strength")
        else "packing"
    )
    own = name if block == "packing" else f"material.{name}"
    return Field(f"{block}.{name}", place or f"packing.{own}", kind or PARTS[name], words, default)


def _unless_zero(kind: Kind) -> Kind:
    return Kind(kind.read, lambda value, at: kind.write(value, at) if value else None)


_OWN_MOTIONS = Kind(  # those that the lattice has by default are left out
    PARTS["motions"].read,
    lambda value, at: None if value == next(iter(allowed_motions(at.lattice.dimension))) else value,
)
FIELDS: tuple[Field, ...] = (
    Field(
        "schema",
        "schema",
        Kind.plain(rules.read_schema),
        "version of this format",
        f"`{SCENE_SCHEMA}`",
    ),
    _part("young_modulus", "Young modulus of the material", NEEDED),
    _part("poisson_ratio", "Poisson ratio of the material", NEEDED),
    _part("density", "density of the material, not of the packing", NEEDED),
    _part(
        "yield_strength",
        "uniaxial yield stress; you are warned where contacts would flow",
        "none: not checked",
    ),
    _part(
        "lattice",
        "how the balls are arranged, see [lattices](#lattices)",
        place="packing.structure",
    ),
    _part("diameter", "diameter of a ball; the mean, if they differ", NEEDED),
    _part(
        "spread",
        "how diameters differ, see [spread](#spread)",
        "equal balls",
        kind=rules.OWN_SPREAD,
    ),
    _part(
        "friction",
        "whether contacts resist shear; without friction, torsion and bending balls do not rotate",
    ),
    _part(
        "finite_overlap",
        "keep the [terms of relative order"
        " overlap/diameter](../explanation/model.md#finite-overlap)",
        place="finite_overlap",
    ),
    _part(
        "motions",
        "how each ball moves, see [lattices](#lattices)",
        "`longitudinal` on a chain, `in_plane` in the plane, `all` in space",
        kind=_OWN_MOTIONS,
    ),
    _part(
        "torsion",
        "stiffness of a contact against twist, over k d²; `mindlin`: that of Hertz contacts"
        " without slip",
        "`0`",
        kind=_unless_zero(PARTS["torsion"]),
    ),
    _part(
        "bending",
        "stiffness of a contact against rolling, over k d²",
        "`0`",
        kind=_unless_zero(PARTS["bending"]),
    ),
    Field(
        "balls",
        "packing.kinds",
        rules.BALLS,
        "kinds of balls by name, see [crystals](#crystals)",
        NEEDED,
    ),
    *(
        Field(f"crystal.{key}", f"packing.{place}", kind, words, default)
        for key, place, kind, words, default in (
            (
                "lattice",
                "lattice",
                rules.STRUCTURE,
                "a lattice, or `NaCl`, `CsCl`, `zincblende`",
                "`cell` and `sites`",
            ),
            (
                "kinds",
                "order",
                rules.ORDER,
                "names of kinds that follow each other on its sites",
                "all kinds in turn",
            ),
            (
                "cell",
                "cell",
                rules.CELL,
                "vectors along which the crystal repeats, each a list of lengths",
                "`lattice`",
            ),
            (
                "sites",
                "sites",
                rules.SITES,
                "a block `kind`, `at` for each ball: its kind, and its place",
                "`lattice`",
            ),
            (
                "repeat",
                "repeat",
                rules.REPEAT,
                "cells of the supercell along each period",
                "one cell",
            ),
            (
                "cut",
                "cut",
                rules.CUT,
                "block `axis`, `layers`, `edges` of a strip, slab or column, or a list",
                "none",
            ),
            (
                "replace",
                "replace",
                rules.REPLACE,
                "numbers of balls, and the kinds that take their places",
                "none",
            ),
            ("remove", "remove", rules.REMOVE, "numbers of balls that are taken out", "none"),
            (
                "seed",
                "seed",
                rules.SEED,
                "of the diameters, where kinds have a spread: `repeat` is then a sample",
                "`0`",
            ),
            (
                "law",
                "law",
                rules.LAW,
                "the law of contacts, or a block of pairs of kinds with a law for each",
                "`hertz`",
            ),
            ("friction", "friction", PARTS["friction"], "whether contacts resist shear", ""),
            (
                "motions",
                "motions",
                rules.MOTIONS,
                "how each ball moves, see [lattices](#lattices)",
                "as in `packing`",
            ),
            ("torsion", "torsion", PARTS["torsion"], "as in `packing`", "`0`"),
            ("bending", "bending", PARTS["bending"], "as in `packing`", "`0`"),
        )
    ),
    Field(
        "crystal.finite_overlap",
        "finite_overlap",
        PARTS["finite_overlap"],
        "the true geometry: contacts turn, the cell deforms, and static forces enter the response",
    ),
    _load("force", "mean force between touching balls"),
    _load(
        "pressure",
        "force per length of the boundary; on a chain the force, N; in space the force per"
        " area, Pa",
    ),
    _load(
        "overlap",
        "how far touching balls are pressed into each other; may be negative if balls differ",
    ),
    _load("side_force", "push F on each side of a hexagonal frame: the contact force is F/(n √3)"),
    Field(
        "load.balls_per_side",
        "load.balls_per_side",
        Kind.plain(balls_on_side),
        "the number n of balls that lean on a side of that frame",
        "required with `side_force`",
    ),
    Field(
        "load.stress",
        "load",
        rules.tensor_kind("stress"),
        "of a crystal: the stress in Voigt order, or as a matrix; tension is positive",
        "one load is required",
    ),
    Field(
        "load.strain",
        "load",
        rules.tensor_kind("strain"),
        "of a crystal: the strain of its periods from where balls touch; extension is positive",
        "one load is required",
    ),
    Field(
        "load.times",
        "load",
        rules.TIMES,
        "factors by which a stress or strain is multiplied",
        "`1`",
    ),
    Field(
        "load.gravity",
        "load.gravity",
        rules.quantity(ACCELERATION),
        "of a crystal with a floor or clamp: the acceleration towards it, with another load"
        " or alone",
        "none",
    ),
    Field(
        "medium",
        "media",
        rules.MEDIUM,
        "how a spread of diameters is averaged, see [media](#media)",
        "`ema`; `ala` for equal balls",
    ),
    Field(
        "sweep",
        "parameters",
        rules.PARAMETERS_SWEPT,
        "parameters of the packing, each with the values that it takes, see [sweep](#sweep)",
        "none",
    ),
    Field(
        "observe",
        "observe",
        Kind.plain(rules.read_observables),
        "what to compute; nothing else is computed. `spectrum` and `pulse` are of simulations,"
        " and so is `dos` where there are several states",
    ),
    Field(
        "direction",
        "direction",
        Kind(lambda value, at: rules.read_directions(value, at.lattice)),
        "direction of sound, Cartesian, or a list of directions, see [direction](#direction)",
        "x",
    ),
    _wave(
        "spectrum.polarisation", f"`{'`, `'.join(POLARISATIONS)}`, one or a list", "`longitudinal`"
    ),
    _wave(
        "spectrum.resolution",
        "standard deviation of the kernel at frequency zero",
        "1/256 of a bound of the frequencies, about",
    ),
    _wave(
        "spectrum.points",
        "wave vectors between two corners of `phonopy.band`; each becomes the nearest one"
        " that the array has",
        "`21`",
    ),
    _wave("pulse.frequency", "frequency of the burst that is sent", NEEDED),
    _wave(
        "pulse.distance",
        "of the receiving plane from the source, along `direction`",
        "half the length of the array along the direction; a quarter with `ends: periodic`",
    ),
    _wave("pulse.cycles", "periods of the burst", "`5`"),
    _wave("pulse.polarisation", "the way in which the source pushes", "`longitudinal`"),
    _wave("pulse.source", "`plane`, the first plane of balls; `ball`, one of them", "`plane`"),
    _wave(
        "pulse.ends",
        "`free`, `walls` (balls there are held), or `periodic`, where the pulse runs both ways",
        "`free`",
    ),
    _wave("pulse.damping", "viscosity of a contact over its stiffness", "`0 s`"),
    _wave(
        "surface.axis",
        "across the edge: the number of a vector of the cell, or Miller indices, as `1 1 0`",
        NEEDED,
    ),
    _wave(
        "surface.edge",
        "`free`, `clamped` (the outer layer does not move) or `floor` (a plane touches it)",
        "`free`",
    ),
    _wave("surface.points", "wave vectors between two corners of the path along the edge", "`31`"),
    _wave("response.frequencies", "a list, or a range, ascending", NEEDED, rules.FREQUENCIES),
    _wave(
        "response.source",
        "what is driven: `plane`, or a ball and its direction, as `12 x`, or a list",
        NEEDED,
    ),
    _wave(
        "response.receiver",
        "what is heard, likewise; of `plane`, the last one, the mean over its balls",
        NEEDED,
    ),
    _wave(
        "response.damping",
        "viscosity of a contact over its stiffness; of normal and of other motion in a list",
        "`0 s`",
    ),
    _wave(
        "response.loss_factor",
        "loss factor of a contact; of normal and of other motion in a list",
        "`0`",
    ),
    _wave(
        "response.quantity",
        "`displacement` or `velocity` over force, or `transmissibility`: that of a wall that"
        " is moved",
        "`displacement`",
    ),
    _wave(
        "response.direction",
        "across the planes, Cartesian",
        "the first axis along which nothing repeats, or x",
    ),
    _wave(
        "response.polarisation", "the way in which a plane is driven and heard", "`longitudinal`"
    ),
    _wave("response.distance", "of the receiving plane from the first one", "the last plane"),
    *_network("response"),
    _wave("motion.duration", "how long the balls move", NEEDED),
    _wave(
        "motion.drive",
        "what drives them, or a list: balls, a direction, and an impact, shaker, force or"
        " displacement, see [motion](#motion)",
        NEEDED,
        rules.DRIVE,
    ),
    _wave("motion.friction_coefficient", "Coulomb's limit of slip", "contacts do not slide"),
    _wave(
        "motion.damping",
        "viscosity of a contact over its stiffness; of normal and of other motion in a list",
        "`0 s`",
    ),
    _wave(
        "motion.frames",
        "number of times that are kept, the start and the end among them",
        f"`{FRAMES}`",
    ),
    _wave(
        "motion.step",
        "step of time, of which a frame has a whole number",
        "as the stiffest contact allows",
    ),
    _wave(
        "motion.geometry",
        "`lattice`: contacts keep their directions; `exact`: balls may go anywhere, and meet"
        " others",
        "`lattice`",
    ),
    _wave(
        "motion.scheme",
        "steps: `verlet`, explicit; `midpoint`, implicit, which keep the sum of energies",
        "`verlet`",
    ),
    *_network("motion"),
    _wave(
        "bands.damping",
        "viscosity of a contact over its stiffness, of damped bands; as of `response`",
        "`0 s`",
    ),
    _wave("bands.loss_factor", "loss factor of a contact; as of `response`", "`0`"),
    Field(
        "phonopy.dim",
        "dim",
        rules.grid_kind(("3 1 1", "3 3 1", "3 3 3"), 2, 100, 2),
        "cells of the supercell for force constants, along each period; `3 1 1` on a chain,"
        " `3 3 3` in space",
        "the smallest that is large enough",
    ),
    Field(
        "phonopy.band",
        "band",
        Kind(lambda value, at: BandPath.read(value, at.lattice), lambda path, _: str(path)),
        "corners of the path: letters, or three numbers each, in fractions of the reciprocal cell",
        "Γ-K-M-Γ; Γ-X-M-Γ on the square lattice; Γ-X on a chain; in space ASE's",
    ),
    Field(
        "phonopy.band_labels",
        "band.labels",
        Kind.plain(read_labels),
        "a label for each corner",
        "the letters of the path; none for one in numbers",
    ),
    Field(
        "phonopy.band_points",
        "band_points",
        Kind.plain(partial(whole, low=2, high=100_000)),
        "points on each segment, both ends counted",
    ),
    Field(
        # in space a 1 would be the mesh of a plane
        "phonopy.mesh",
        "mesh",
        rules.grid_kind(("1024 1 1", "64 64 1", "32 32 32"), 1, 4096, 2),
        "wave vectors for the density of states, along each period; `1024 1 1` on a chain,"
        " `32 32 32` in space",
        "`64 64 1`; `1024 1 1` on a chain; `32 32 32` in space",
    ),
)

#: the fields of each block by their keys; those at the top level stand alone under their own key
_BLOCKS: dict[str, dict[str, Field]] = {}
for _field in FIELDS:
    _BLOCKS.setdefault(_field.key.partition(".")[0], {})[_field.key.partition(".")[2]] = _field
#: the blocks that a scene must have
_NEEDED_BLOCKS = ("material", "packing", "load")
#: the blocks of a scene with balls of several kinds, which stand in place of the first two
_CRYSTAL_BLOCKS = ("balls", "crystal")
#: what a block "load" must hold, in words for messages; and that of a crystal
_ONE_LOAD = "exactly one of force, pressure, overlap, or side_force with balls_per_side"
_ONE_LOAD_OF_CRYSTAL = (
    "exactly one of force, pressure, overlap, stress, strain; with gravity none of them is needed"
)


# -- writing and checking --------------------------------------------------------------------------


def write_blocks(scene: Any, at: Context) -> dict[str, Any]:
    """Return what the file of a scene holds, with every default written out, as plain data."""
    out: dict[str, Any] = {}
    others = _NEEDED_BLOCKS[:2] if scene.packing.kind_names else _CRYSTAL_BLOCKS
    for name, fields in _BLOCKS.items():
        for key, field in fields.items():
            value = scene if name not in others else None
            for attribute in field.place.split("."):
                value = None if value is None else getattr(value, attribute)
            # a key is left out where it has no value, and where its kind writes none
            if value is not None and (value := field.kind.write(value, at)) is not None:
                out |= {name: out.get(name, {}) | {key: value} if key else value}
    return out


def scene_rule(place: str, at: Context) -> Any:
    """Return the rule of the attribute ``place`` of a scene."""
    return next(field.kind.rule(at) for field in FIELDS if field.place == place)


def write_preset(name: str) -> str:
    """Return the text of a scene of the package, in which the words of each key stand where it
    comes first.
    """
    text = (files("granphon") / "data" / f"{name}.yaml").read_text(encoding="utf-8")
    out, block, told = list[str](), "", set[str]()
    for line in text.splitlines():
        if not line and not block:
            out += [
                "#",
                '# A quantity is a number and its unit, as in "8 mm". What is commented out'
                " shows other choices.",
            ]
        out.append(line)
        if (found := re.match(r"( *)(?:# )?(\w+):", line)) is None:
            continue
        block = block if found[1] else found[2]
        # kinds of balls have keys of the blocks material and packing
        fields = [
            _BLOCKS.get(name, {}).get(found[2] if found[1] else "")
            for name in (block, *_NEEDED_BLOCKS[:2])
        ]
        field = next((one for one in fields if one is not None), None)
        drawn = "path and meshes; this block matters to bands, dos and spectrum only"
        words = (
            {"load:": "one of these", "phonopy:": drawn}.get(line, "")
            if field is None
            else field.words
        )
        if words and words not in told:
            told.add(words)
            plain = re.sub(
                r",? see \[[^]]*\]\([^)]*\)|`|\[(?=[^]]*\]\()|(?<=\w)\]\([^)]*\)", "", words
            )
            first, *others = textwrap.wrap(plain, 80)
            out[-1] = f"{line:<{_WORDS_AT}} # {first}"
            out += [f"{'':<{_WORDS_AT}} #    {one}" for one in others]
    return "\n".join(out) + "\n"


# -- reading ---------------------------------------------------------------------------------------


def read_blocks(document: Document, folder: Path) -> dict[str, Any]:
    """Read the values in ``document``, in SI units, each block as a mapping; tables it names are
    sought in ``folder``.

    :class:`~granphon.base.errors.SceneError` tells one mistake. An unknown key comes first, as a
    misspelt key is often the reason why another is missing; then the first value that its rule
    refuses; then a missing key.
    """
    data: Any = document.data
    if isinstance(data, list):
        raise document.error((), f"found a list; allowed: a block of keys: {', '.join(_BLOCKS)}.")
    try:
        _require_known(data)
        if isinstance(data, Mapping) and set(_CRYSTAL_BLOCKS) & set(data):
            return _read_crystal_scene(document, folder)
        at = Context(_find_lattice(data), folder=folder)
        return block(
            data, {name: partial(_read_block, name, at=at) for name in _BLOCKS}, _NEEDED_BLOCKS
        )
    except Refused as refused:
        with suppress(LookupError, TypeError, Refused, AttributeError):
            # a width in per cent is told as the length that it is of the diameter
            value = data
            for key in refused.path:
                value = value[key]
            told = re.fullmatch(rf"\s*({NUMBER})\s*(?:%|percent)\s*", value)
            if told and refused.path[:2] in (
                ("packing", "spread"),
                ("sweep", "width"),
                ("sweep", "spread"),
            ):
                diameter = LENGTH.read(data["packing"]["diameter"])
                width = write_quantity(float(told[1]) / 100.0 * diameter, "m")
                mend = (
                    f"{told[1]} % of {write_quantity(diameter, 'm')} is {width}: write '{width}'."
                )
                refused = Refused(refused.found, refused.allowed, mend, refused.path)
        raise document.error(refused.path, str(refused)) from None


def _read_crystal_scene(document: Document, folder: Path) -> dict[str, Any]:
    """Read a scene with balls of several kinds, whose crystal says what the other values mean; it
    is under "packing".
    """
    data = document.data
    first = Context(folder=folder)
    if beside := [name for name in _NEEDED_BLOCKS[:2] if name in data]:
        mend = "Remove it: the balls have their materials, and the crystal its lattice."
        raise Refused(
            f"{beside[0]} beside {' and '.join(name for name in _CRYSTAL_BLOCKS if name in data)}",
            "balls and crystal in place of material and packing",
            mend,
            (beside[0],),
        )
    own = block(
        {name: data[name] for name in _CRYSTAL_BLOCKS if name in data},
        {name: partial(_read_block, name, at=first) for name in _CRYSTAL_BLOCKS},
        _CRYSTAL_BLOCKS,
    )
    given: dict[str, Any] = dict(own["crystal"])
    finite = {"finite_overlap": given.pop("finite_overlap")} if "finite_overlap" in given else {}
    if ("lattice" in given) == ("cell" in given or "sites" in given) or ("cell" in given) != (
        "sites" in given
    ):
        found = (
            " and ".join(name for name in ("lattice", "cell", "sites") if name in given)
            or "no lattice"
        )
        raise Refused(found, "a lattice, or cell and sites", path=("crystal",))
    if "kinds" in given and "lattice" not in given:
        raise Refused(
            "kinds with cell and sites",
            "kinds with a lattice",
            "Each site has its kind.",
            ("crystal", "kinds"),
        )
    # as the table has it, the kinds in turn are the attribute "order"
    places = {key: field.place.rpartition(".")[2] for key, field in _BLOCKS["crystal"].items()}
    made = {places[key]: value for key, value in given.items()}
    try:
        arrangement = Arrangement(own["balls"], **made)
    except GranphonError as error:
        # the first step without which the crystal can be made
        steps = ("repeat", "cut", "replace", "remove")
        place: tuple[str, ...] = ("crystal",)
        for number, step in enumerate(steps):
            with suppress(GranphonError):
                Arrangement(
                    own["balls"],
                    **{key: value for key, value in made.items() if key not in steps[number:]},
                )
                place = ("crystal", step)
        raise document.error(place, str(error)) from None
    at = Context(arrangement.structure, kinds=arrangement.kind_names, folder=folder)
    # arrays are those of packings
    unused = (
        *_CRYSTAL_BLOCKS,
        *_NEEDED_BLOCKS[:2],
        "spectrum",
        "pulse",
    )
    rest = {name: partial(_read_block, name, at=at) for name in _BLOCKS if name not in unused}
    others = {name: value for name, value in data.items() if name not in _CRYSTAL_BLOCKS}
    return block(others, rest, ("load",)) | {"packing": finite | {"arrangement": arrangement}}


def _read_block(name: str, value: Any, at: Context) -> Any:
    fields = _BLOCKS[name]
    if "" in fields:
        return fields[""].kind.read(value, at)
    if name in ("phonopy", "spectrum") and value is None:
        return {}  # every key below it is commented out
    if name == "load" and isinstance(value, dict):
        # block() refuses another value, with the keys that are allowed
        of_crystal = bool(at.kinds)
        given = [kind for kind in LOAD_KINDS if kind in value]
        one = _ONE_LOAD_OF_CRYSTAL if of_crystal else _ONE_LOAD
        if not of_crystal and (
            wrong := [key for key in ("stress", "strain", "times", "gravity") if key in value]
        ):
            mend = "Describe the balls by the blocks balls and crystal."
            raise Refused(
                f"{wrong[0]} of a packing, all contacts of which bear the same",
                one,
                mend,
                (wrong[0],),
            )
        if not given and not (of_crystal and "gravity" in value):
            raise Refused(
                "balls_per_side without side_force" if "balls_per_side" in value else "no load", one
            )
        if len(given) > 1:
            raise Refused(" and ".join(given), one, "Remove all but one.")
        if "times" in value and not {"stress", "strain"} & set(given):
            raise Refused(
                f"times with {' '.join(given) or 'gravity'}",
                "times with stress or strain",
                path=("times",),
            )
        if ("side_force" in value) != ("balls_per_side" in value):
            raise Refused(
                "side_force alone" if "side_force" in value else f"{given[0]} and balls_per_side",
                one,
            )
    needed = [key for key, field in fields.items() if field.default == NEEDED]
    return block(value, {key: field.kind.rule(at) for key, field in fields.items()}, needed)


def _require_known(data: Any) -> None:
    """Refuse the first unknown key, and say to which block it belongs if another block has such a
    key.
    """
    known = {"": list(_BLOCKS)} | {
        name: list(fields) for name, fields in _BLOCKS.items() if "" not in fields
    }
    for name, keys in known.items():
        given = data.get(name) if name and isinstance(data, Mapping) else data
        ranges = isinstance(given, dict) and {"from", "to", "points", "scale"} & set(given)
        if name == "load" and (isinstance(given, list) or ranges):
            found = f"{show(given)}, without the kind of load"
            mend = "Write 'force:' before it, or another."
            raise Refused(found, _ONE_LOAD, mend, ("load",))
        for key in given if isinstance(given, Mapping) else ():
            if key not in keys:
                home = next((home for home in known if key in known[home]), name)
                mend = (
                    ""
                    if home == name
                    else f"It belongs under '{home}'."
                    if home
                    else "It belongs at the top level."
                )
                refused = refuse_unknown_key(key, keys, mend)
                raise refused.under(name) if name else refused


def _find_lattice(data: Any) -> Lattice:
    """Read the lattice of a scene before its other values, whose rules depend on it."""
    readers = {"packing": PARTS["lattice"].rule(Context()), "sweep": rules.read_lattices}
    found = {}
    for name, rule in readers.items():
        inside = data.get(name) if isinstance(data, Mapping) else None
        if isinstance(inside, Mapping) and "lattice" in inside:
            found[name] = read_inside(
                name, partial(read_inside, "lattice", rule), inside["lattice"]
            )
    return rules.choose_lattice(
        find_lattice(found.get("packing", TRIANGULAR)), found.get("sweep", ())
    )


# -- the file of a scene ---------------------------------------------------------------------------


#: ordinary values of what the scales of a ball are made of, Pa, kg/m^3 and m
_ORDINARY = {"young_modulus": 1e10, "density": 1e3, "diameter": 1e-2}
#: the blocks of a scene file about waves, with their classes
_WAVES: dict[str, Any] = {
    "bands": BandsSettings,
    "surface": SurfaceSettings,
    "spectrum": SpectrumSettings,
    "pulse": PulseSettings,
    **NETWORK_BLOCKS,
}


@dataclass(frozen=True)
class SceneSource:
    """The document that a scene was read from, and the path of its file; both are None for a scene
    made in Python.

    A document that was read from a text has no path. The context managers turn errors of the
    library into :class:`~granphon.base.errors.SceneError`, which names file, line and key, and so
    do those of a computation that fails, as :class:`~granphon.base.errors.ConvergenceError`;
    without a document errors pass unchanged.
    """

    document: Document | None = None
    path: Path | None = None

    @classmethod
    def of_file(cls, path: str | os.PathLike[str]) -> SceneSource:
        """Read the document in a scene file; :class:`~granphon.base.errors.SceneError` if it is not
        YAML.
        """
        return cls(parse_yaml(read_text(path), str(path)), Path(path))

    @property
    def folder(self) -> Path:
        """Folder to which the names of files in the scene are relative."""
        return self.path.parent if self.path else Path()

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Paths of the files that were read: the scene file, and the tables of measured diameters
        that it names.
        """
        if self.document is None:
            return ()
        data = self.document.data
        spreads = [data.get("packing", {}).get("spread"), *data.get("sweep", {}).get("spread", [])]
        own = () if self.path is None else (self.path,)
        names = [name for spread in spreads if (name := table_named(spread)) is not None]
        names += named_tables(data["motion"].get("drive", [])) if "motion" in data else []
        return (*own, *(self.folder / name for name in names))

    # -- places in the file ------------------------------------------------------------------------

    @contextmanager
    def at(self, *path: str | int, before: str = "") -> Iterator[None]:
        """Place errors of the block at the key ``path``, else at the key that a rule refused, with
        ``before`` in front.
        """
        try:
            yield
        except (GranphonError, ArithmeticError) as error:
            if self.document is None:
                raise
            place = path or getattr(error, "path", ())
            if (of := getattr(error, "block", None)) is not None:  # the error knows better
                place = of
                before = ""
            if (option := getattr(error, "option", None)) is not None:
                # the medium that has this option; if none of them has it, or several have, the
                # media
                found = [
                    path
                    for path in self.document.lines
                    if path[:1] == ("medium",) and path[-1] == option
                ]
                place = ("medium",)
                given = f"{'several times' if found else 'no'} {option}"
                if len(found) == 1:
                    (place,) = found
                    value = reduce(lambda block, key: block[key], place, self.document.data)
                    given = show(value)
                    if isinstance(value, Mapping):
                        given = f"{{{', '.join(f'{key}: {one}' for key, one in value.items())}}}"
                # as it turned out
                allowed = {"start": "a load that the balls bear without friction, or gas"}
                before = f"found {given}; allowed: {allowed[option]}; "
            placed: GranphonError = self.document.error(place, f"{before}{error}")
            if isinstance(error, ConvergenceError):
                # the scene is not wrong, the computation has failed
                placed = ConvergenceError(str(placed))
            placed.reached = getattr(error, "reached", None)
            raise placed from None

    @contextmanager
    def where_it_buckles(self) -> Iterator[None]:
        """Place an error of the block that says that the lattice buckles at the key which keeps the
        static force.
        """
        try:
            yield
        except InstabilityError:
            with self.at(
                "packing",
                "finite_overlap",
                before="found true; allowed: false where the lattice buckles; ",
            ):
                raise

    def at_medium(self, label: str, allowed: str) -> AbstractContextManager[None]:
        """Place errors of the block at the key of the medium ``label``; ``allowed`` says what may
        stand there.
        """
        by_default = self.document is not None and "medium" not in self.document.data
        return self.at(
            "medium", before=f"found {label!r}{', the default' * by_default}; allowed: {allowed}; "
        )

    def at_index(
        self, block: str, key: str, index: int, before: str = ""
    ) -> AbstractContextManager[None]:
        """Place errors of the block at a value of a load, or of a parameter of the sweep, with
        ``before`` in front.

        The key holds one value, a list, or a range. Of a range, the place is "from" for the first
        value and "to" for the last; a value between them has no key of its own, and its place is
        the range.
        """
        if self.document is None:
            return self.at()
        if block == "load":
            # the values of a tensor are those by which it is multiplied; gravity may be the only
            # load
            key = "times" if key in TENSORS and "times" in self.document.data[block] else key
            key = key if key in self.document.data[block] else "gravity"
        given = self.document.data[block][key]
        path: tuple[str | int, ...] = (block, key)
        found = show(given)
        place = path
        if isinstance(given, list) and key not in TENSORS:
            found, place = show(given[index]), (*path, index)
        elif isinstance(given, dict):
            first = given["from"]
            last = given["to"]
            points = given["points"]
            if 0 < index < points - 1:
                found = f"value {index + 1} of {points} from {show(first)} to {show(last)}"
            else:
                found, place = show(last if index else first), (*path, "to" if index else "from")
        allowed = (
            "a load that the balls can carry"
            if block == "load"
            else "a value that the packing can have"
        )
        return self.at(*place, before=f"found {found}; allowed: {allowed}; {before}")

    # -- what a scene is made of -------------------------------------------------------------------

    def read(self) -> dict[str, Any]:
        """Read the arguments of a scene that the document gives; SceneError names the first
        mistake.
        """
        if self.document is None:
            raise ValueError("there is no document")
        given = read_blocks(self.document, self.folder)
        drawing = given.get("phonopy", {})
        load = given["load"]
        own = given["packing"]
        packing = own["arrangement"] if "arrangement" in own else self._make_packing(given)
        out: dict[str, Any] = {"packing": packing}
        kind = next((key for key in load if key in LOAD_KINDS), "pressure")
        with self.at("load", *[kind] * (kind in load)):
            if kind in TENSORS:
                out["load"] = Load(**split_tensor(load), gravity=load.get("gravity"))
            else:
                out["load"] = Load(
                    kind,
                    load.get(kind, 0.0),
                    load.get("balls_per_side"),
                    gravity=load.get("gravity"),
                )
        if "band" in drawing or "band_labels" in drawing:
            with self.at("phonopy", "band_labels"):
                path = drawing["band"] if "band" in drawing else BandPath.default(packing.structure)
                out["band"] = replace(path, labels=drawing.get("band_labels", path.labels))
        named = {
            "medium": "media",
            "sweep": "parameters",
            "observe": "observe",
            "direction": "direction",
        }
        out |= {argument: given[key] for key, argument in named.items() if key in given}
        out |= {key: made_of(**given[key]) for key, made_of in _WAVES.items() if key in given}
        out |= {key: drawing[key] for key in ("band_points", "mesh", "dim") if key in drawing}
        out |= {"finite_overlap": own["finite_overlap"]} if "finite_overlap" in own else {}
        return out | {"source": self.path}

    def _make_packing(self, given: Mapping[str, Any]) -> Packing:
        """Return the packing of the blocks material and packing, with errors placed at their
        keys.
        """
        assert self.document is not None
        data: Any = self.document.data
        own = given["packing"]
        # the scales of the ball are made of all three: the one that is farthest from the ordinary
        # is probably wrong
        made = {**given["material"], "diameter": own["diameter"]}
        key = max(_ORDINARY, key=lambda name: abs(math.log(made[name]) - math.log(_ORDINARY[name])))
        name_of_block = "packing" if key == "diameter" else "material"
        size = (
            f"found {show(data[name_of_block][key])}; allowed: a ball that double precision can"
            f" hold; "
        )
        with self.at(name_of_block, key, before=size):
            names = [name for name in ("diameter", "lattice", "friction") if name in own]
            packing = Packing(Material(**given["material"]), **{name: own[name] for name in names})
        # what motions there may be, and what resists them, depends on the dimension of the lattices
        # of a sweep
        lattices = dict(given.get("sweep", ())).get("lattice", ())
        if choose_lattice(packing.structure, lattices) != packing.structure:
            packing = replace(packing, lattice=lattices[0])
        for name in [name for name in ("motions", "torsion", "bending") if name in own]:
            allowed = (
                "motions of this lattice"
                if name == "motions"
                else "up to 1e6, and 0 where no motion is resisted by it"
            )
            with self.at(
                "packing", name, before=f"found {show(data['packing'][name])}; allowed: {allowed}; "
            ):
                packing = replace(packing, **{name: own[name]})
        if "spread" in own:
            ((kind, value),) = data["packing"]["spread"].items()
            found = f"found {show(value)}; allowed: diameters about the packing's, all above zero; "
            with self.at("packing", "spread", kind, before=found):
                packing = replace(packing, spread=own["spread"])
        return packing
