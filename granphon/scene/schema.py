"""The scene file as a schema: its blocks, the rule of each key, and what a mistake is told.

Every mistake is one :class:`~granphon.base.errors.SceneError` that names file, line and key, what was found, what is
allowed, and the likely intention.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, ValidationInfo, model_validator

from granphon.balls.loads import balls_on_side
from granphon.base.quantities import DENSITY, LENGTH, LOADS, MODULUS, Refused
from granphon.base.text import Document, shown
from granphon.base.validation import truth, unknown_key
from granphon.media.choice import MediumChoice
from granphon.phonons.paths import read_labels, read_paths
from granphon.scene import fields as rules

__all__ = ["SceneFile", "validated"]


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _in_folder(rule: Callable[[Any, Path], Any]) -> Callable[[Any, ValidationInfo], Any]:
    """A rule that looks for files where the scene is."""
    return lambda value, info: rule(value, (info.context or {})["folder"])


def _load(kind: str) -> PlainValidator:
    return PlainValidator(partial(rules.values, rule=LOADS[kind].read))


class _Material(_Block):
    young_modulus: Annotated[float, PlainValidator(MODULUS.read)]
    poisson_ratio: Annotated[float, PlainValidator(rules.poisson_ratio)]
    density: Annotated[float, PlainValidator(DENSITY.read)]
    yield_strength: Annotated[float | None, PlainValidator(MODULUS.read)] = None


class _Packing(_Block):
    lattice: Annotated[str, PlainValidator(rules.lattice_name)] = "triangular"
    diameter: Annotated[float, PlainValidator(LENGTH.read)]
    spread: Annotated[Any, PlainValidator(_in_folder(rules.spread))] = None
    friction: Annotated[bool, PlainValidator(truth)] = True
    finite_overlap: Annotated[bool, PlainValidator(truth)] = False


class _Load(_Block):
    force: Annotated[tuple[float, ...] | None, _load("force")] = None
    pressure: Annotated[tuple[float, ...] | None, _load("pressure")] = None
    overlap: Annotated[tuple[float, ...] | None, _load("overlap")] = None
    side_force: Annotated[tuple[float, ...] | None, _load("side_force")] = None
    balls_per_side: Annotated[int | None, PlainValidator(balls_on_side)] = None

    @model_validator(mode="before")
    @classmethod
    def _exactly_one(cls, value: Any) -> Any:
        allowed = "exactly one of force, pressure, overlap, or side_force with balls_per_side"
        if isinstance(value, list) or (isinstance(value, dict) and {"from", "to", "points", "scale"} & set(value)):
            raise Refused(f"{shown(value)}, without the kind of load", allowed, "Write 'force:' before it, or another.")
        if not isinstance(value, dict) or not set(value) <= set(cls.model_fields):
            return value  # reported as the wrong kind, or as unknown keys
        given = [kind for kind in LOADS if kind in value]
        if not given:
            raise Refused("balls_per_side without side_force" if value else "no load", allowed)
        if len(given) > 1:
            raise Refused(" and ".join(given), allowed, "Remove all but one.")
        if ("side_force" in value) != ("balls_per_side" in value):
            raise Refused("side_force alone" if "side_force" in value else f"{given[0]} and balls_per_side", allowed)
        return value


class _Phonopy(_Block):
    dim: Annotated[tuple[int, int] | None, PlainValidator(rules.supercell)] = None
    band: Annotated[tuple[Any, ...] | None, PlainValidator(read_paths)] = None
    band_labels: Annotated[tuple[str, ...] | None, PlainValidator(read_labels)] = None
    band_points: Annotated[int, PlainValidator(rules.segment_points)] = 101
    mesh: Annotated[tuple[int, int], PlainValidator(rules.mesh_numbers)] = (64, 64)

    @model_validator(mode="before")
    @classmethod
    def _empty(cls, value: Any) -> Any:
        return {} if value is None else value  # every key below "phonopy:" commented out


class SceneFile(_Block):
    """What a scene file may hold, read: quantities in SI, defaults filled in."""

    version: Annotated[int, PlainValidator(rules.schema_number)] = Field(rules.SCHEMA, alias="schema")
    material: _Material
    packing: _Packing
    load: _Load
    medium: Annotated[tuple[MediumChoice, ...], PlainValidator(rules.media)] = ()
    sweep: Annotated[tuple[tuple[str, tuple[Any, ...]], ...], PlainValidator(_in_folder(rules.parameters))] = ()
    observe: Annotated[tuple[str, ...], PlainValidator(rules.observed)] = ("velocities",)
    phonopy: _Phonopy = _Phonopy()


_BLOCKS: dict[str, type[_Block]] = {"material": _Material, "packing": _Packing, "load": _Load, "phonopy": _Phonopy}
#: what the keys without a default want
_NEEDED = {
    "young_modulus": MODULUS.allowed,
    "poisson_ratio": "a plain number, -1 < poisson_ratio <= 0.5",
    "density": DENSITY.allowed,
    "diameter": LENGTH.allowed,
}


def _keys(block: str | None) -> list[str]:
    model = _BLOCKS[block] if block else SceneFile
    return [info.alias or name for name, info in model.model_fields.items()]


def validated(document: Document, folder: Path) -> SceneFile:
    """The file that ``document`` is; tables that it names are looked for in ``folder``."""
    if not isinstance(document.data, dict):
        found = "a list" if isinstance(document.data, list) else shown(document.data)
        raise document.error((), f"found {found}; allowed: a block of keys: {', '.join(_keys(None))}.")
    try:
        return SceneFile.model_validate(document.data, context={"folder": folder})
    except ValidationError as error:
        # one at a time: an unknown key explains a missing one, and is told first
        ranks = {"extra_forbidden": 0, "missing": 2}
        first = min(error.errors(), key=lambda e: (ranks.get(e["type"], 1), document.line(e["loc"])))
        raise document.error(first["loc"] + getattr(first.get("ctx", {}).get("error"), "path", ()), _told(first)) from None


def _told(error: Any) -> str:
    kind, path = error["type"], error["loc"]
    block, key = (str(path[0]) if len(path) > 1 else None), str(path[-1])
    if kind == "extra_forbidden":
        home = next((name for name in (None, *_BLOCKS) if key in _keys(name)), block)
        place = "" if home == block else f"It belongs under '{home}'." if home else "It belongs at the top level."
        return str(unknown_key(key, _keys(block), place))
    if kind == "missing":
        needed = f"a block of keys: {', '.join(_keys(key))}" if key in _BLOCKS else _NEEDED[key]
        return f"found nothing, and it has no default; allowed: {needed}."
    if kind == "value_error":
        return str(error["ctx"]["error"])
    return f"found {shown(error['input'])}; allowed: a block of keys: {', '.join(_keys(key))}."
