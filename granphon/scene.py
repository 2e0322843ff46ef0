"""The scene: what to compute, read from a YAML file and checked before anything is done.

Quantities carry their units ("8 mm") in the file only; a :class:`Scene` holds SI floats. Every mistake in a file is one
:class:`~granphon.errors.SceneError` that names file, line and key, what was found, what is allowed, and the likely
intention.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, cast

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from granphon import quantities as q
from granphon.contact import Material, positive
from granphon.errors import GranphonError, InputError, message
from granphon.files import Document, closest, parse_yaml, read_text, shown
from granphon.geometry import LATTICES, TRIANGULAR, contacts_apart
from granphon.medium import AveragedLattice, ContactState
from granphon.observables import contact_lattice
from granphon.packing import Packing
from granphon.progress import Progress, silent

if TYPE_CHECKING:
    from granphon.run import RunResult

__all__ = ["BandPath", "Load", "Scene", "force_of_frame"]

# -- the shape of the file ------------------------------------------------------------------------------------------


class _Block(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class _Material(_Block):
    young_modulus: Annotated[float, PlainValidator(q.MODULUS.read)]
    poisson_ratio: Annotated[float, PlainValidator(q.poisson_ratio)]
    density: Annotated[float, PlainValidator(q.DENSITY.read)]
    yield_strength: Annotated[float | None, PlainValidator(q.MODULUS.read)] = None


class _PackingBlock(_Block):
    lattice: Annotated[str, PlainValidator(q.lattice_name)] = "triangular"
    diameter: Annotated[float, PlainValidator(q.LENGTH.read)]
    spread: Annotated[None, PlainValidator(q.no_spread)] = None
    friction: Annotated[bool, PlainValidator(q.truth)] = True
    finite_overlap: Annotated[bool, PlainValidator(q.truth)] = False


class _LoadBlock(_Block):
    force: Annotated[float | None, PlainValidator(q.LOADS["force"].read)] = None
    pressure: Annotated[float | None, PlainValidator(q.LOADS["pressure"].read)] = None
    overlap: Annotated[float | None, PlainValidator(q.LOADS["overlap"].read)] = None
    side_force: Annotated[float | None, PlainValidator(q.LOADS["side_force"].read)] = None
    balls_per_side: Annotated[int | None, PlainValidator(q.balls_on_side)] = None

    @model_validator(mode="before")
    @classmethod
    def _exactly_one(cls, value: Any) -> Any:
        allowed = "exactly one of force, pressure, overlap, or side_force with balls_per_side"
        if isinstance(value, list) or (isinstance(value, dict) and {"from", "to", "points", "scale"} & set(value)):
            raise q.Refused(f"{shown(value)}, where one load is needed", allowed, q.ONE_LOAD)
        if not isinstance(value, dict) or not set(value) <= set(cls.model_fields):
            return value  # reported as the wrong kind, or as unknown keys
        given = [kind for kind in q.LOADS if kind in value]
        if not given:
            raise q.Refused("balls_per_side without side_force" if value else "no load", allowed)
        if len(given) > 1:
            raise q.Refused(" and ".join(given), allowed, "Remove all but one.")
        if ("side_force" in value) != ("balls_per_side" in value):
            raise q.Refused("side_force alone" if "side_force" in value else f"{given[0]} and balls_per_side", allowed)
        return value


class _PhonopyBlock(_Block):
    dim: Annotated[tuple[int, int] | None, PlainValidator(q.supercell)] = None
    band: Annotated[tuple[Any, ...] | None, PlainValidator(q.band_paths)] = None
    band_labels: Annotated[tuple[str, ...] | None, PlainValidator(q.label_words)] = None
    band_points: Annotated[int, PlainValidator(q.segment_points)] = 101
    mesh: Annotated[tuple[int, int], PlainValidator(q.mesh_numbers)] = (64, 64)

    @model_validator(mode="before")
    @classmethod
    def _empty(cls, value: Any) -> Any:
        return {} if value is None else value  # every key below "phonopy:" commented out


class _File(_Block):
    version: Annotated[int, PlainValidator(q.schema_number)] = Field(q.SCHEMA, alias="schema")
    material: _Material
    packing: _PackingBlock
    load: _LoadBlock
    medium: Annotated[str, PlainValidator(q.medium_name)] = "ala"
    observe: Annotated[tuple[str, ...], PlainValidator(q.observed)] = ("velocities",)
    phonopy: _PhonopyBlock = _PhonopyBlock()


_BLOCKS: dict[str, type[_Block]] = {
    "material": _Material, "packing": _PackingBlock, "load": _LoadBlock, "phonopy": _PhonopyBlock,
}  # fmt: skip
#: what the keys without a default want
_NEEDED = {
    "young_modulus": q.MODULUS.allowed,
    "poisson_ratio": "a plain number, -1 < poisson_ratio <= 0.5",
    "density": q.DENSITY.allowed,
    "diameter": q.LENGTH.allowed,
}


def _keys(block: str | None) -> list[str]:
    model = _BLOCKS[block] if block else _File
    return [info.alias or name for name, info in model.model_fields.items()]


def _validated(document: Document) -> _File:
    if not isinstance(document.data, dict):
        found = "a list" if isinstance(document.data, list) else shown(document.data)
        raise document.error((), f"found {found}; allowed: a block of keys: {', '.join(_keys(None))}.")
    try:
        return _File.model_validate(document.data)
    except ValidationError as error:
        # one at a time: an unknown key explains a missing one, and is told first
        ranks = {"extra_forbidden": 0, "missing": 2}
        first = min(error.errors(), key=lambda e: (ranks.get(e["type"], 1), document.line(e["loc"])))
        raise document.error(first["loc"], _told(first)) from None


def _told(error: Any) -> str:
    kind, path = error["type"], error["loc"]
    block, key = (str(path[0]) if len(path) > 1 else None), str(path[-1])
    if kind == "extra_forbidden":
        known, mend = _keys(block), ""
        home = next((name for name in (None, *_BLOCKS) if key in _keys(name)), block)
        if home != block:
            mend = f" It belongs under '{home}'." if home else " It belongs at the top level."
        elif meant := closest(key, known):
            mend = f" Did you mean '{meant}'?"
        return f"found an unknown key; allowed: {', '.join(known)}.{mend}"
    if kind == "missing":
        needed = f"a block of keys: {', '.join(_keys(key))}" if key in _BLOCKS else _NEEDED[key]
        return f"found nothing, and it has no default; allowed: {needed}."
    if kind == "value_error":
        return str(error["ctx"]["error"])
    return f"found {shown(error['input'])}; allowed: a block of keys: {', '.join(_keys(key))}."


# -- the scene ------------------------------------------------------------------------------------------------------


def force_of_frame(side_force: float, balls_per_side: int) -> float:
    """Contact force f, N, in a hexagonal frame whose sides are each pressed with ``side_force`` F onto n balls.

    f = F / (n sqrt 3). A side is as long as the n balls that lean on it, so that P = F/(n d), and P d = sqrt(3) f (equation
    20). Seen from one ball: it passes F/n on to two contacts at 30 degrees to the push. The overlap drops out.

    Section IV has n = 31 and "~990 N" for f = 18.446 N; the formula gives 18.438 N at 990 N, and 18.446 N at 990.4 N.
    """
    return side_force / (balls_per_side * math.sqrt(3.0))


@dataclass(frozen=True)
class Load:
    """The load of a scene: ``kind`` (force, pressure, overlap, side_force), ``value`` in SI (N, N/m, m, N).

    ``balls_per_side`` belongs to a side force, and to no other.
    """

    kind: str
    value: float
    balls_per_side: int | None = None

    def __post_init__(self) -> None:
        if self.kind not in q.LOADS:
            raise InputError(message(f"unknown kind of load {self.kind!r}", mend="Use " + ", ".join(q.LOADS)))
        object.__setattr__(self, "value", positive(self.kind, self.value, q.LOADS[self.kind].unit))
        if (self.kind == "side_force") != (self.balls_per_side is not None):
            raise InputError(message("balls_per_side belongs to a side_force, and a side_force needs it"))
        if self.balls_per_side is not None:
            _ruled("balls_per_side", q.balls_on_side, self.balls_per_side)


@dataclass(frozen=True)
class BandPath:
    """Where bands are drawn: paths that do not join, each of two points or more, and a label for every point or for none.

    ``paths`` are tuples of tuples of q-points, three fractions of the reciprocal cell each.
    """

    paths: tuple[tuple[tuple[float, float, float], ...], ...]
    labels: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        count = sum(map(len, self.paths))
        if self.labels is not None and len(self.labels) != count:
            raise InputError(f"found {len(self.labels)} labels; allowed: {count}, one for each point of the band.")

    @classmethod
    def parse(cls, points: str, labels: str | Sequence[str] | None = None) -> Self:
        """From phonopy's notation, "0 0 0 1/3 1/3 0" and "G K"."""
        named = None if labels is None else _ruled("band_labels", q.label_words, labels)
        return cls(_ruled("band", q.band_paths, points), named)

    @classmethod
    def default(cls, packing: Packing) -> Self:
        """Around the irreducible zone of the packing's lattice: G-K-M-G, or G-X-M-G on a square cell."""
        (ax, ay), (bx, by) = packing.structure.cell
        cosine = (ax * bx + ay * by) / math.hypot(ax, ay) / math.hypot(bx, by)
        if abs(cosine) < 1e-6:
            return cls.parse("0 0 0 1/2 0 0 1/2 1/2 0 0 0 0", "G X M G")
        return cls.parse("0 0 0 1/3 1/3 0 1/2 0 0 0 0 0", "G K M G")

    @property
    def arrays(self) -> list[np.ndarray[Any, np.dtype[np.float64]]]:
        """Each path as an array (n_points, 3)."""
        return [np.array(path) for path in self.paths]

    def __str__(self) -> str:
        return ", ".join(" ".join(_as_fraction(x) for point in path for x in point) for path in self.paths)


def _as_fraction(x: float) -> str:
    near = Fraction(x).limit_denominator(100)
    return str(near) if float(near) == x else repr(x)


def _check_supercell(packing: Packing, dim: tuple[int, int] | None) -> None:
    """Raise if two balls of the supercell would touch through two images."""
    if dim is not None and not contacts_apart(packing.structure.vectors, dim, 1.0):
        least = next(n for n in range(1, 100) if contacts_apart(packing.structure.vectors, (n, n), 1.0))
        raise InputError(f"found {dim[0]} {dim[1]} 1; allowed: {least} {least} 1 or more.")


def _ruled(name: str, rule: Any, value: Any) -> Any:
    try:
        return rule(value)
    except q.Refused as refused:
        raise InputError(f"{name}: {refused}") from None


@dataclass(frozen=True)
class Scene:
    """What to compute, in SI units.

    Attributes
    ----------
    packing, load : which balls, and how they are pressed.
    medium : "ala", "afa" or "ema"; for equal balls all are the averaged lattice.
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
    medium: str = "ala"
    finite_overlap: bool = False
    observe: tuple[str, ...] = ("velocities",)
    band: BandPath | None = None
    band_points: int = 101
    mesh: tuple[int, int] = (64, 64)
    dim: tuple[int, int] | None = None
    source: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        rules = {
            "medium": q.medium_name, "finite_overlap": q.truth, "observe": q.observed,
            "band_points": q.segment_points, "mesh": q.mesh_numbers,
        }  # fmt: skip
        if self.dim is not None:
            rules["dim"] = q.supercell
        for name, rule in rules.items():
            object.__setattr__(self, name, _ruled(name, rule, getattr(self, name)))
        if self.band is None:
            object.__setattr__(self, "band", BandPath.default(self.packing))
        _check_supercell(self.packing, self.dim)
        if self.load.kind == "side_force" and self.packing.structure != TRIANGULAR:
            raise InputError("found a side_force; allowed: on the triangular lattice only, whose frame is a hexagon.")

    @property
    def path(self) -> BandPath:
        """The path of the bands."""
        return cast("BandPath", self.band)  # set when the scene was made

    @classmethod
    def from_yaml(cls, path: str | os.PathLike[str]) -> Self:
        """Read a scene file; :class:`~granphon.errors.SceneError` names whatever is wrong with it."""
        return cls._of(parse_yaml(read_text(path), str(path)), Path(path))

    @classmethod
    def from_text(cls, text: str, name: str = "<scene>") -> Self:
        """Read a scene from a text, which messages call ``name``; raises as :meth:`from_yaml`."""
        return cls._of(parse_yaml(text, name), None)

    @classmethod
    def _of(cls, document: Document, source: Path | None) -> Self:
        file = _validated(document)
        balls, phonopy = file.packing, file.phonopy
        kind = next(kind for kind in q.LOADS if getattr(file.load, kind) is not None)
        given = document.data["load"][kind]
        size = f"found {shown(document.data['packing']['diameter'])}; allowed: a ball that double precision can hold. "
        with _located(document, ("packing", "diameter"), size):
            packing = Packing(
                Material(**file.material.model_dump()), balls.diameter, lattice=balls.lattice, friction=balls.friction
            )
        band = None
        if phonopy.band is not None or phonopy.band_labels is not None:
            with _located(document, ("phonopy", "band_labels")):
                band = BandPath(phonopy.band or BandPath.default(packing).paths, phonopy.band_labels)
        with _located(document, ("phonopy", "dim")):
            _check_supercell(packing, phonopy.dim)
        with _located(document, ("load", kind)):
            scene = cls(
                packing, Load(kind, getattr(file.load, kind), file.load.balls_per_side), medium=file.medium,
                finite_overlap=balls.finite_overlap, observe=file.observe, band=band, band_points=phonopy.band_points,
                mesh=phonopy.mesh, dim=phonopy.dim, source=source,
            )  # fmt: skip
        with _located(document, ("load", kind), f"found {shown(given)}; allowed: a load that the balls can carry. "):
            state = scene.state()
        with _located(document, ("packing", "lattice"), f"found {balls.lattice!r}; allowed: a lattice that is rigid. "):
            contact_lattice(state, scene.finite_overlap)
        return scene

    def state(self) -> ContactState:
        """The contacts under the load; :class:`~granphon.errors.InputError` if the balls cannot carry it."""
        load, medium = self.load, AveragedLattice(self.packing)
        with np.errstate(all="ignore"):
            if load.kind == "overlap":
                state = medium.at_overlap(load.value, self.finite_overlap)
            elif load.kind == "pressure":
                state = medium.at_pressure(load.value, self.finite_overlap)
            elif load.balls_per_side is not None:
                state = medium.at_force(force_of_frame(load.value, load.balls_per_side), self.finite_overlap)
            else:
                state = medium.at_force(load.value, self.finite_overlap)
            scale = state.scales
            if not (0.0 < scale.frequency < math.inf and 0.0 < scale.velocity < math.inf):
                raise InputError("the frequencies or velocities are beyond double precision.")
        return state

    def to_yaml(self) -> str:
        """The scene with every default written out and quantities in SI; read again it is the same scene to the last bit."""
        packing, material, load = self.packing, self.packing.material, self.load
        if LATTICES.get(packing.structure.name) != packing.structure:
            raise InputError(message("a scene file names its lattice", mend="Use one of " + ", ".join(LATTICES)))
        lines = [
            f"schema: {q.SCHEMA}", "material:", f"  young_modulus: {material.young_modulus!r} Pa",
            f"  poisson_ratio: {material.poisson_ratio!r}", f"  density: {material.density!r} kg/m^3",
        ]  # fmt: skip
        if material.yield_strength is not None:
            lines.append(f"  yield_strength: {material.yield_strength!r} Pa")
        lines += [
            "packing:", f"  lattice: {packing.structure.name}", f"  diameter: {packing.diameter!r} m",
            f"  friction: {json.dumps(packing.friction)}", f"  finite_overlap: {json.dumps(self.finite_overlap)}",
            "load:", f"  {load.kind}: {load.value!r} {q.LOADS[load.kind].unit}",
        ]  # fmt: skip
        if load.balls_per_side is not None:
            lines.append(f"  balls_per_side: {load.balls_per_side}")
        lines += [f"medium: {self.medium}", f"observe: [{', '.join(self.observe)}]", "phonopy:"]
        if self.dim is not None:
            lines.append(f"  dim: {self.dim[0]} {self.dim[1]} 1")
        lines.append(f'  band: "{self.path}"')
        if self.path.labels is not None:
            lines.append(f"  band_labels: [{', '.join(json.dumps(w, ensure_ascii=False) for w in self.path.labels)}]")
        lines += [f"  band_points: {self.band_points}", f"  mesh: {self.mesh[0]} {self.mesh[1]} 1"]
        return "\n".join(lines) + "\n"

    def run(
        self,
        folder: str | os.PathLike[str],
        force: bool = False,
        progress: Progress | None = None,
        figures: bool = True,
    ) -> RunResult:
        """Compute what the scene asks for and write it into ``folder``; see :func:`granphon.run.run`."""
        from granphon.run import run

        return run(self, folder, force=force, progress=progress or silent, figures=figures)


@contextmanager
def _located(document: Document, path: Sequence[str], before: str = "") -> Iterator[None]:
    """Turn an error of the library into one that names file, line and key."""
    try:
        yield
    except (GranphonError, ArithmeticError) as error:
        raise document.error(path, f"{before}{error}") from None
