"""The scene file as a schema: its blocks, and the rule that reads each key.

The defaults of keys that a file leaves out are not here, but in the classes of which a scene is made.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.balls.loads import balls_on_side
from granphon.balls.material import read_poisson_ratio
from granphon.base.errors import Refused
from granphon.base.quantities import DENSITY, LENGTH, LOADS, MODULUS, NUMBER
from granphon.base.scales import write_quantity
from granphon.base.text import Document, show
from granphon.base.validation import Rule, block, read_inside, refuse_unknown_key, truth, zero_or_above
from granphon.phonons.paths import BandPath, read_labels
from granphon.scene import fields
from granphon.waves.settings import pulse_rules, spectrum_rules

#: keys that a scene file must have: at the top level (""), and in each block
REQUIRED: Mapping[str, tuple[str, ...]] = {
    "": ("material", "packing", "load"), "material": ("young_modulus", "poisson_ratio", "density"), "packing": ("diameter",),
    "pulse": ("frequency",),
}  # fmt: skip

#: what a block "load" must hold, in words for messages
_ONE_LOAD = "exactly one of force, pressure, overlap, or side_force with balls_per_side"


def scene_rules(folder: Path, lattice: Lattice = TRIANGULAR) -> dict[str, Rule | dict[str, Rule]]:
    """Return the rule of each key of a scene file and of its blocks; tables named in the file are sought in ``folder``.

    What motions, pressures, samples, directions, paths and meshes may be depends on the ``lattice``.
    """
    return {
        "schema": fields.read_schema,
        "material": {
            "young_modulus": MODULUS.read, "poisson_ratio": read_poisson_ratio, "density": DENSITY.read,
            "yield_strength": MODULUS.read,
        },
        "packing": {
            "lattice": fields.read_lattice, "diameter": LENGTH.read, "spread": partial(fields.read_spread, folder=folder),
            "friction": truth, "finite_overlap": truth, "motions": partial(fields.read_motions, lattices=(lattice,)),
            "torsion": fields.read_torsion, "bending": zero_or_above,
        },
        "load": {
            **{
                kind: partial(fields.read_values, rule=partial(fields.read_load, kind=kind, lattice=lattice))
                for kind in LOADS
            },
            "balls_per_side": balls_on_side,
        },
        "medium": partial(fields.read_media, lattice=lattice, written=True),
        "sweep": partial(fields.read_parameters, folder=folder, lattice=lattice),
        "observe": fields.read_observables,
        "direction": partial(fields.read_directions, lattice=lattice),
        "spectrum": spectrum_rules(),
        "pulse": pulse_rules(),
        "phonopy": {
            "dim": partial(fields.supercell, lattice=lattice), "band": partial(BandPath.read, structure=lattice),
            "band_labels": read_labels, "band_points": fields.segment_points,
            "mesh": partial(fields.mesh_numbers, lattice=lattice),
        },
    }  # fmt: skip


def read_blocks(document: Document, folder: Path) -> dict[str, Any]:
    """Read the values in ``document``, in SI units, each block as a mapping; tables it names are sought in ``folder``.

    :class:`~granphon.base.errors.SceneError` tells one mistake. An unknown key comes first, as a misspelt key is often the
    reason why another is missing; then the first value that its rule refuses; then a missing key.
    """
    rules = scene_rules(folder)
    if isinstance(document.data, list):
        raise document.error((), f"found a list; allowed: a block of keys: {', '.join(rules)}.")
    try:
        _require_known(document.data, rules)
        rules = scene_rules(folder, _read_lattice(document.data))
        readers = {key: partial(_read_block, key, rule) if isinstance(rule, dict) else rule for key, rule in rules.items()}
        return block(document.data, readers, REQUIRED[""])
    except Refused as refused:
        raise document.error(refused.path, str(_convert_percent(document.data, refused))) from None


def _convert_percent(data: Any, refused: Refused) -> Refused:
    """Return the refusal of a width in per cent with the length that it is of the diameter; any other as it is."""
    value: Any = data
    with suppress(LookupError, TypeError, Refused, AttributeError):
        for key in refused.path:
            value = value[key]
        told = re.fullmatch(rf"\s*({NUMBER})\s*(?:%|percent)\s*", value)
        if told and refused.path[:2] in (("packing", "spread"), ("sweep", "width"), ("sweep", "spread")):
            diameter = LENGTH.read(data["packing"]["diameter"])
            width = write_quantity(float(told[1]) / 100.0 * diameter, "m")
            mend = f"{told[1]} % of {write_quantity(diameter, 'm')} is {width}: write '{width}'."
            return Refused(refused.found, refused.allowed, mend, refused.path)
    return refused


def _require_known(data: Any, rules: Mapping[str, Rule | dict[str, Rule]]) -> None:
    """Refuse the first unknown key, and say to which block it belongs if another block has such a key."""
    known = {"": list(rules)} | {name: list(rule) for name, rule in rules.items() if isinstance(rule, dict)}
    for name, keys in known.items():
        given = data.get(name) if name and isinstance(data, Mapping) else data
        if name == "load":
            _require_kind(given)
        for key in given if isinstance(given, Mapping) else ():
            if key not in keys:
                home = next((home for home in known if key in known[home]), name)
                mend = "" if home == name else f"It belongs under '{home}'." if home else "It belongs at the top level."
                refused = refuse_unknown_key(key, keys, mend)
                raise refused.under(name) if name else refused


def _read_lattice(data: Any) -> Lattice:
    """Read the lattice of a scene before its other values, whose rules depend on it."""
    readers = {"packing": fields.read_lattice, "sweep": fields.read_lattices}
    found = {}
    for name, rule in readers.items():
        inside = data.get(name) if isinstance(data, Mapping) else None
        if isinstance(inside, Mapping) and "lattice" in inside:
            found[name] = read_inside(name, partial(read_inside, "lattice", rule), inside["lattice"])
    return fields.choose_lattice(find_lattice(found.get("packing", TRIANGULAR)), found.get("sweep", ()))


def _read_block(name: str, rules: Mapping[str, Rule], value: Any) -> dict[str, Any]:
    if name in ("phonopy", "spectrum") and value is None:
        return {}  # every key below it is commented out
    if name == "load":
        _require_one_load(value)
    return block(value, rules, REQUIRED.get(name, ()))


def _require_kind(value: Any) -> None:
    """Refuse a block "load" that holds a list or a range of values without the kind of load."""
    if isinstance(value, list) or (isinstance(value, dict) and {"from", "to", "points", "scale"} & set(value)):
        found, mend = f"{show(value)}, without the kind of load", "Write 'force:' before it, or another."
        raise Refused(found, _ONE_LOAD, mend, ("load",))


def _require_one_load(value: Any) -> None:
    """Refuse a block "load" with no load or several, or with only one of ``side_force`` and ``balls_per_side``."""
    if not isinstance(value, dict):
        return  # block() refuses it, with the keys that are allowed
    given = [kind for kind in LOADS if kind in value]
    if not given:
        raise Refused("balls_per_side without side_force" if value else "no load", _ONE_LOAD)
    if len(given) > 1:
        raise Refused(" and ".join(given), _ONE_LOAD, "Remove all but one.")
    if ("side_force" in value) != ("balls_per_side" in value):
        raise Refused("side_force alone" if "side_force" in value else f"{given[0]} and balls_per_side", _ONE_LOAD)
