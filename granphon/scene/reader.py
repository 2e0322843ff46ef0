"""Reading a scene file: turning a document into the arguments of a scene, and naming the place of every error in it."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.balls.packing import Packing
from granphon.base.errors import ConvergenceError, GranphonError, InstabilityError
from granphon.base.text import Document, parse_yaml, read_text, show
from granphon.phonons.paths import BandPath
from granphon.scene.fields import read_blocks
from granphon.scene.rules import choose_lattice, table_named
from granphon.waves.settings import PulseSettings, SpectrumSettings

#: ordinary values of what the scales of a ball are made of, Pa, kg/m^3 and m
_ORDINARY = {"young_modulus": 1e10, "density": 1e3, "diameter": 1e-2}
#: what an option of a medium may be that turns out to be wrong when it is carried out
_ALLOWED = {"start": "a load that the balls bear without friction, or gas"}
#: the blocks of a scene file about waves in a simulated array, with their classes
_WAVES = {"spectrum": SpectrumSettings, "pulse": PulseSettings}


@dataclass(frozen=True)
class SceneSource:
    """The document that a scene was read from, and the path of its file; both are None for a scene made in Python.

    A document that was read from a text has no path. The context managers turn errors of the library into
    :class:`~granphon.base.errors.SceneError`, which names file, line and key, and so do those of a computation that fails,
    as :class:`~granphon.base.errors.ConvergenceError`; without a document errors pass unchanged.
    """

    document: Document | None = None
    path: Path | None = None

    @classmethod
    def of_file(cls, path: str | os.PathLike[str]) -> SceneSource:
        """Read the document in a scene file; :class:`~granphon.base.errors.SceneError` if it is not YAML."""
        return cls(parse_yaml(read_text(path), str(path)), Path(path))

    @property
    def folder(self) -> Path:
        """Folder to which the names of files in the scene are relative."""
        return self.path.parent if self.path else Path()

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Paths of the files that were read: the scene file, and the tables of measured diameters that it names."""
        if self.document is None:
            return ()
        data = self.document.data
        spreads = [data["packing"].get("spread"), *data.get("sweep", {}).get("spread", [])]
        own = () if self.path is None else (self.path,)
        return (*own, *(self.folder / name for spread in spreads if (name := table_named(spread)) is not None))

    # -- places in the file ---------------------------------------------------------------------------------------------

    @contextmanager
    def at(self, *path: str | int, before: str = "") -> Iterator[None]:
        """Place errors of the block at the key ``path``, else at the key that a rule refused, with ``before`` in front."""
        try:
            yield
        except (GranphonError, ArithmeticError) as error:
            if self.document is None:
                raise
            place = path or getattr(error, "path", ())
            if (option := getattr(error, "option", None)) is not None:
                # the medium that has this option; if none of them has it, or several have, the media
                media = self.document.data.get("medium")
                each = [((at,), one) for at, one in enumerate(media)] if isinstance(media, list) else [((), media)]
                found = [
                    (("medium", *here, name, option), options[option])
                    for here, one in each
                    for name, options in (one.items() if isinstance(one, Mapping) else ())
                    if isinstance(options, Mapping) and option in options
                ]
                place, given = ("medium",), f"{'several times' if found else 'no'} {option}"
                if len(found) == 1:
                    ((place, value),) = found
                    given = show(value)
                    if isinstance(value, Mapping):
                        given = f"{{{', '.join(f'{key}: {one}' for key, one in value.items())}}}"
                before = f"found {given}; allowed: {_ALLOWED[option]}; "
            placed: GranphonError = self.document.error(place, f"{before}{error}")
            if isinstance(error, ConvergenceError):  # the scene is not wrong, the computation has failed
                placed = ConvergenceError(str(placed))
            placed.reached = getattr(error, "reached", None)
            raise placed from None

    @contextmanager
    def where_it_buckles(self) -> Iterator[None]:
        """Place an error of the block that says that the lattice buckles at the key which keeps the static force."""
        try:
            yield
        except InstabilityError:
            with self.at("packing", "finite_overlap", before="found true; allowed: false where the lattice buckles; "):
                raise

    def at_medium(self, label: str, allowed: str) -> AbstractContextManager[None]:
        """Place errors of the block at the key of the medium ``label``; ``allowed`` says what may stand there."""
        by_default = self.document is not None and "medium" not in self.document.data
        return self.at("medium", before=f"found {label!r}{', the default' * by_default}; allowed: {allowed}; ")

    def at_index(self, block: str, key: str, index: int, before: str = "") -> AbstractContextManager[None]:
        """Place errors of the block at a value of a load, or of a parameter of the sweep, with ``before`` in front.

        The key holds one value, a list, or a range. Of a range, the place is "from" for the first value and "to" for the
        last; a value between them has no key of its own, and its place is the range.
        """
        if self.document is None:
            return self.at()
        given = self.document.data[block][key]
        path: tuple[str | int, ...] = (block, key)
        found, place = show(given), path
        if isinstance(given, list):
            found, place = show(given[index]), (*path, index)
        elif isinstance(given, dict):
            first, last, points = given["from"], given["to"], given["points"]
            if 0 < index < points - 1:
                found = f"value {index + 1} of {points} from {show(first)} to {show(last)}"
            else:
                found, place = show(last if index else first), (*path, "to" if index else "from")
        allowed = "a load that the balls can carry" if block == "load" else "a value that the packing can have"
        return self.at(*place, before=f"found {found}; allowed: {allowed}; {before}")

    # -- what a scene is made of ----------------------------------------------------------------------------------------

    def read(self) -> dict[str, Any]:
        """Read the arguments of a scene that the document gives; SceneError names the first mistake."""
        if self.document is None:
            raise ValueError("there is no document")
        data: Any = self.document.data
        given = read_blocks(self.document, self.folder)
        drawing, load, own = given.get("phonopy", {}), given["load"], given["packing"]
        # the scales of the ball are made of all three: the one that is farthest from the ordinary is probably wrong
        made = {**given["material"], "diameter": own["diameter"]}
        key = max(_ORDINARY, key=lambda name: abs(math.log(made[name]) - math.log(_ORDINARY[name])))
        name_of_block = "packing" if key == "diameter" else "material"
        size = f"found {show(data[name_of_block][key])}; allowed: a ball that double precision can hold; "
        with self.at(name_of_block, key, before=size):
            names = [name for name in ("diameter", "lattice", "friction") if name in own]
            packing = Packing(Material(**given["material"]), **{name: own[name] for name in names})
        # what motions there may be, and what resists them, depends on the dimension of the lattices of a sweep
        lattices = dict(given.get("sweep", ())).get("lattice", ())
        if choose_lattice(packing.structure, lattices) != packing.structure:
            packing = replace(packing, lattice=lattices[0])
        for name in [name for name in ("motions", "torsion", "bending") if name in own]:
            allowed = (
                "motions of this lattice" if name == "motions" else "up to 1e6, and 0 where no motion is resisted by it"
            )
            with self.at("packing", name, before=f"found {show(data['packing'][name])}; allowed: {allowed}; "):
                packing = replace(packing, **{name: own[name]})
        if "spread" in own:
            ((kind, value),) = data["packing"]["spread"].items()
            found = f"found {show(value)}; allowed: diameters about the packing's, all above zero; "
            with self.at("packing", "spread", kind, before=found):
                packing = replace(packing, spread=own["spread"])
        kind = next(key for key in load if key != "balls_per_side")
        with self.at("load", kind):
            out: dict[str, Any] = {"packing": packing, "load": Load(kind, load[kind], load.get("balls_per_side"))}
        if "band" in drawing or "band_labels" in drawing:
            with self.at("phonopy", "band_labels"):
                path = drawing["band"] if "band" in drawing else BandPath.default(packing.structure)
                out["band"] = replace(path, labels=drawing.get("band_labels", path.labels))
        named = {"medium": "media", "sweep": "parameters", "observe": "observe", "direction": "direction"}
        out |= {argument: given[key] for key, argument in named.items() if key in given}
        out |= {key: made_of(**given[key]) for key, made_of in _WAVES.items() if key in given}
        out |= {key: drawing[key] for key in ("band_points", "mesh", "dim") if key in drawing}
        out |= {"finite_overlap": own["finite_overlap"]} if "finite_overlap" in own else {}
        return out | {"source": self.path}
