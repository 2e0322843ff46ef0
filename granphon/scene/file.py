"""The scene file: its keys in one table, by which a file is read, checked and written, and the key
at which each error stands.

The page of the reference is made of the same table. Defaults of keys that a file leaves out are
the defaults of the classes of which a scene is made.
"""

from __future__ import annotations

import math
import os
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial, reduce
from importlib.resources import files
from operator import getitem
from pathlib import Path
from typing import TYPE_CHECKING, Any

from granphon.balls.lattices import TRIANGULAR, Lattice, find_lattice
from granphon.balls.loads import Load
from granphon.balls.material import Material
from granphon.balls.packing import MOST_ROLLING, Packing
from granphon.base.errors import (
    ConvergenceError,
    GranphonError,
    InputError,
    InstabilityError,
    Refused,
)
from granphon.base.quantities import (
    LENGTH,
    LOAD_KINDS,
    NUMBER,
    PLUS_MINUS,
    TENSORS,
    find_written_unit,
)
from granphon.base.scales import write_quantity
from granphon.base.settings import NEEDED, Block, Setting, list_settings
from granphon.base.text import Document, parse_yaml, plain_yaml, read_text, show
from granphon.base.validation import Rule, block, make_key_refusal, read_inside
from granphon.media.medium import CRYSTAL, NETWORK
from granphon.media.network_file import NetworkFiles
from granphon.phonons.paths import BandPath
from granphon.runs.plan import Places
from granphon.scene import file_keys
from granphon.scene.design_settings import DesignSettings, named_tables_of_goal
from granphon.scene.file_keys import (
    PARTS,
    Context,
    choose_lattice,
    find_table_name,
    split_tensor,
)
from granphon.waves.settings import BLOCKS as WAVE_BLOCKS
from granphon.waves.settings import named_tables

if TYPE_CHECKING:
    from granphon.media.arrangement import Arrangement

#: column at which the words of a key stand in a preset, and the most letters of words in a line
_WORDS_COLUMN = 38
_WORDS_WIDTH = 80
#: what is left out of the words of a key in a preset: links behind "see", the marks of code, and
#: of other links the brackets and the address
_MARKUP = re.compile(r",? see \[[^]]*\]\([^)]*\)|`|\[(?=[^]]*\]\()|(?<=\w)\]\([^)]*\)")
#: the words of blocks that are no words of a key
_WORDS_OF_BLOCKS = {
    "load": "one of these",
    "phonopy": "path and meshes; this block matters to bands, dos and spectrum only",
}
#: lines below the head of a preset
_REMARK_OF_PRESETS = (
    "#",
    '# A quantity is a number and its unit, as in "8 mm". What is commented out shows other'
    " choices.",
)


#: the blocks of settings of what a scene observes, by name
SETTINGS: dict[str, type[Block]] = {**WAVE_BLOCKS, DesignSettings.block: DesignSettings}
#: the keys of each block, as they are declared; a value at the top level stands alone under an
#: empty key
BLOCKS: dict[str, Mapping[str, Setting]] = {
    "schema": {"": file_keys.SCHEMA},
    "material": list_settings(Material),
    "packing": file_keys.PACKING,
    "balls": {"": file_keys.BALLS},
    "crystal": file_keys.CRYSTAL,
    "network": list_settings(NetworkFiles),
    "load": file_keys.LOAD,
    "medium": {"": file_keys.MEDIUM},
    "sweep": {"": file_keys.SWEEP},
    "correlations": {"": file_keys.CORRELATIONS},
    "observe": {"": file_keys.OBSERVE},
    "direction": {"": file_keys.DIRECTION},
    **{name: list_settings(settings) for name, settings in SETTINGS.items()},
    "phonopy": file_keys.PHONOPY,
}
#: the attribute of a scene that has the values of a block, or the value of a key in it, where the
#: attribute has another name than the block or the key
_ATTRIBUTES = {
    "material": "packing.material",
    "crystal": "packing",
    "network": "packing",
    "balls": "packing.kinds",
    "medium": "media",
    "sweep": "parameters",
    # of a spectrum that is not observed the defaults are not written
    "spectrum": "_written_spectrum",
    "packing.lattice": "packing.structure",
    "packing.finite_overlap": "finite_overlap",
    "crystal.kinds": "packing.order",
    "crystal.finite_overlap": "finite_overlap",
    **{f"phonopy.{key}": key for key in file_keys.PHONOPY},
    "phonopy.band_labels": "band.labels",
    # each key writes what it holds of the load
    **{f"load.{key}": "load" for key in (*LOAD_KINDS, "times")},
}
#: the blocks of the balls of a packing, and the blocks that a scene of a packing must have
_PACKING_BLOCKS = ("material", "packing")
_NEEDED_BLOCKS = (*_PACKING_BLOCKS, "load")
#: the blocks of a scene with balls of several kinds, which stand in place of material and packing
_CRYSTAL_BLOCKS = ("balls", "crystal")
#: the block of a scene with a packing in files, which stands in place of all of these blocks
_FILES_BLOCKS = ("network",)
#: the blocks of the balls of a scene, by the name of the medium that such balls have
_BLOCKS_OF_MEDIA = {
    "": _PACKING_BLOCKS,
    CRYSTAL: _CRYSTAL_BLOCKS,
    NETWORK: _FILES_BLOCKS,
}
#: content of a block "load" of a packing, and of a crystal, in words for messages
_ONE_LOAD = "exactly one of force, pressure, overlap, or side_force with balls_per_side"
_ONE_LOAD_OF_CRYSTAL = (
    "exactly one of force, pressure, overlap, stress, strain; with gravity none of them is needed"
)


# -- writing and checking --------------------------------------------------------------------------


def write_blocks(scene: Any, context: Context) -> dict[str, Any]:
    """Return the blocks of the file of a scene, by name, as plain data.

    Values that are defaults are written too, unless their kind writes none: None, what is empty,
    and torsion and bending of zero. Left out are blocks of settings that the scene does not have, a
    spectrum that is not observed and has all defaults, blocks that belong to other balls than those
    of the scene, and of a packing in files the load and the medium as well. The ``context`` is the
    one in which :func:`read_blocks` reads the blocks again.
    """
    blocks: dict[str, Any] = {}
    absent_blocks = set().union(*_BLOCKS_OF_MEDIA.values())
    absent_blocks -= {*_BLOCKS_OF_MEDIA[scene.packing.medium_name]}
    if scene.packing.is_network:
        absent_blocks |= {"load", "medium"}
    for name, settings in BLOCKS.items():
        is_not_set = name in SETTINGS and _find_value(scene, name, "") is None
        if name in absent_blocks or is_not_set:
            continue
        for key, declared in settings.items():
            value = _find_value(scene, name, key)
            # a key is left out where it has no value, and where its kind writes none
            plain_value = None if value is None else declared.kind.write(value, context)
            if plain_value is None:
                continue
            if key:
                blocks.setdefault(name, {})[key] = plain_value
            else:  # the value stands at the top level
                blocks[name] = plain_value
    return blocks


def _find_value(scene: Any, name: str, key: str) -> Any:
    """Return the value that a scene has for the ``key`` of the block ``name``, or, if the key is
    empty, for the block itself; None if an attribute on the way to the value is None.
    """
    attribute_of_block = _ATTRIBUTES.get(name, name)
    path = attribute_of_block
    if key:
        path = _ATTRIBUTES.get(f"{name}.{key}", f"{attribute_of_block}.{key}")
    value = scene
    for attribute in path.split("."):
        if value is None:
            return None
        value = getattr(value, attribute)
    return value


def write_preset(name: str) -> str:
    """Return the text of the scene ``name`` that comes with the package, with comments that say
    what its keys mean. Of several keys with the same words, the first has the comment.
    """
    text = (files("granphon") / "data" / f"{name}.yaml").read_text(encoding="utf-8")
    lines = list[str]()
    explained = set[str]()
    block_name = ""
    for line in text.splitlines():
        if not line and not block_name:  # the end of the head of the file
            lines += _REMARK_OF_PRESETS
        key_line = re.match(r"( *)(?:# )?(\w+):", line)
        if key_line is None:
            lines.append(line)
            continue
        indent, key = key_line.groups()
        if not indent:
            block_name = key
        words = _explain_key(block_name, key if indent else "")
        if words and words not in explained:
            explained.add(words)
            lines += _comment_line(line, words)
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _comment_line(line: str, words: str) -> list[str]:
    """Return the lines of text for one ``line`` of a preset with its comment: the first words stand
    behind the line, the others on lines below. The ``words`` are Markdown, whose marks are removed.
    """
    plain_words = _MARKUP.sub("", words)
    first_words, *more_words = textwrap.wrap(plain_words, _WORDS_WIDTH)
    lines = [f"{line:<{_WORDS_COLUMN}} # {first_words}"]
    lines += [f"{'':<{_WORDS_COLUMN}} #    {words_of_line}" for words_of_line in more_words]
    return lines


def _explain_key(block_name: str, key: str) -> str:
    """Return the words that explain the ``key`` in the block ``block_name``, or, if the key is
    empty, the block itself or a value at the top level; an empty text if there are none.
    """
    names = [block_name]
    if block_name == "balls":  # kinds of balls have keys of the blocks material and packing
        names += _PACKING_BLOCKS
    for name in names:
        declared = BLOCKS.get(name, {}).get(key)
        if declared is not None:
            return declared.meaning
    return "" if key else _WORDS_OF_BLOCKS.get(block_name, "")


# -- reading ---------------------------------------------------------------------------------------


def read_blocks(document: Document, folder: Path) -> dict[str, Any]:
    """Return the values in ``document``, in SI units, each block as a mapping by its name; tables
    that the document names are sought in ``folder``.

    Of several mistakes :class:`~granphon.base.errors.SceneError` names the first in this order:

    1. an unknown key, at the top level or right in a block, as a misspelt key is often the reason
       why another is missing; and loads without their kind;
    2. a block beside another in whose place it stands, and a mistake in what the rules of other
       values depend on: the lattices, balls and crystal, or the files of a packing;
    3. block by block in the order of the document, a value that its rule refuses, or else a missing
       key of the block;
    4. a missing block.
    """
    data: Any = document.data
    if isinstance(data, list):
        raise document.error((), f"found a list; allowed: a block of keys: {', '.join(BLOCKS)}.")
    try:
        _require_known_keys(data)
        if isinstance(data, Mapping) and set(_FILES_BLOCKS) & set(data):
            return _read_files_scene(document, folder)
        if isinstance(data, Mapping) and set(_CRYSTAL_BLOCKS) & set(data):
            return _read_crystal_scene(document, folder)
        context = Context(_find_lattice(data), folder=folder)
        return block(data, _make_readers(context), _NEEDED_BLOCKS)
    except Refused as refused:
        with suppress(LookupError, TypeError, Refused, AttributeError):
            refused = _convert_percent(refused, data)
        raise document.error(refused.path, str(refused)) from None


def _convert_percent(refused: Refused, data: Any) -> Refused:
    """Return the refusal of a width of a packing that is written in per cent, with the length to
    write instead, which is this part of the diameter; return any other refusal unchanged, also of
    a part that is zero, negative or infinite in double precision.

    ``data`` is the plain data of the document. Raises LookupError, TypeError, AttributeError or
    Refused where the keys of the refusal lead to no text, or the diameter cannot be read.
    """
    value = data
    for key in refused.path:
        value = value[key]
    percent = re.fullmatch(rf"\s*({NUMBER})\s*(?:%|percent)\s*", value)
    width_keys = (("packing", "spread"), ("sweep", "width"), ("sweep", "spread"))
    if percent is None or refused.path[:2] not in width_keys:
        return refused
    diameter = LENGTH.read(data["packing"]["diameter"])
    width = float(percent[1]) / 100.0 * diameter
    if not 0.0 < width < math.inf:
        return refused
    written_width = write_quantity(width, "m")
    part = f"{percent[1]} % of {write_quantity(diameter, 'm')}"
    mend = f"{part} is {written_width}: write '{written_width}'."
    return Refused(refused.found, refused.allowed, mend, refused.path)


def _read_crystal_scene(document: Document, folder: Path) -> dict[str, Any]:
    """Return the values in a document with balls of several kinds, by block as :func:`read_blocks`
    returns them. The blocks balls and crystal are read first, as what the other values mean depends
    on them; the crystal that they make is in the result under "packing", key "arrangement".
    """
    data = document.data
    packing_blocks = [name for name in _PACKING_BLOCKS if name in data]
    if packing_blocks:
        crystal_blocks = " and ".join(name for name in _CRYSTAL_BLOCKS if name in data)
        raise Refused(
            f"{packing_blocks[0]} beside {crystal_blocks}",
            "balls and crystal in place of material and packing",
            "Remove it: the balls have their materials, and the crystal its lattice.",
            (packing_blocks[0],),
        )
    readers_of_all = _make_readers(Context(folder=folder))
    crystal_values = block(
        {name: data[name] for name in _CRYSTAL_BLOCKS if name in data},
        {name: readers_of_all[name] for name in _CRYSTAL_BLOCKS},
        _CRYSTAL_BLOCKS,
    )
    settings: dict[str, Any] = dict(crystal_values["crystal"])
    packing: dict[str, Any] = {}
    if "finite_overlap" in settings:
        packing["finite_overlap"] = settings.pop("finite_overlap")
    arrangement = _make_arrangement(document, crystal_values["balls"], settings)
    packing["arrangement"] = arrangement
    context = Context(arrangement.structure, parameters=arrangement.parameters, folder=folder)
    # spectrum and pulse are of arrays, which packings have
    unused_blocks = (*_CRYSTAL_BLOCKS, *_PACKING_BLOCKS, "spectrum", "pulse")
    readers = _make_readers(context, unused_blocks)
    blocks = {name: value for name, value in data.items() if name not in _CRYSTAL_BLOCKS}
    return block(blocks, readers, ("load",)) | {"packing": packing}


def _read_files_scene(document: Document, folder: Path) -> dict[str, Any]:
    """Return the values in a document with a packing in files, by block as :func:`read_blocks`
    returns them. The files are read first, as what the other values mean depends on them; the
    packing that they hold is in the result under "packing", key "arrangement". There is no block
    "load", as the files hold the contact forces.
    """
    data = document.data
    excluded_blocks = (*_NEEDED_BLOCKS, *_CRYSTAL_BLOCKS, "medium", "sweep")
    for name in excluded_blocks:
        if name in data:
            allowed = "network alone, as files have their balls, their contacts and their forces"
            raise Refused(f"{name} beside network", allowed, "Remove it.", (name,))
    rule = _make_readers(Context(folder=folder))["network"]
    values = read_inside("network", rule, data["network"])
    try:
        packing = NetworkFiles(**values)
    except GranphonError as error:
        raise document.error(("network",), str(error)) from None
    context = Context(packing.structure, folder=folder)
    readers = _make_readers(context, (*_FILES_BLOCKS, *excluded_blocks))
    blocks = {name: value for name, value in data.items() if name not in _FILES_BLOCKS}
    return block(blocks, readers, ()) | {"packing": {"arrangement": packing}}


def _make_arrangement(document: Document, kinds: Any, settings: Mapping[str, Any]) -> Arrangement:
    """Return the crystal of the ``kinds`` of balls, pairs of a name and a ball, and of the values
    ``settings`` of its block by key.

    Refused for keys that do not go together. If the crystal cannot be made, SceneError names the
    key of the step that fails, or the block if no single step does.
    """
    names = [name for name in ("lattice", "cell", "sites") if name in settings]
    if names not in (["lattice"], ["cell", "sites"]):
        problem = " and ".join(names) or "no lattice"
        raise Refused(problem, "a lattice, or cell and sites", path=("crystal",))
    if "kinds" in settings and "lattice" not in settings:
        raise Refused(
            "kinds with cell and sites",
            "kinds with a lattice",
            "Each site has its kind.",
            ("crystal", "kinds"),
        )
    from granphon.media.arrangement import Arrangement  # scenes of packings load no crystal

    make = partial(Arrangement, kinds)
    arguments = {"order" if key == "kinds" else key: value for key, value in settings.items()}
    try:
        return make(**arguments)
    except GranphonError as error:
        path = ("crystal", *_find_failing_step(make, arguments))
        raise document.error(path, str(error)) from None


def _find_failing_step(
    make: Callable[..., Arrangement], arguments: Mapping[str, Any]
) -> tuple[str, ...]:
    """Return the path, a tuple of one key, of the step at which ``make`` fails to make a crystal of
    its ``arguments``: "repeat", "cut", "replace" or "remove". The path is empty if the crystal
    cannot be made even without any of the steps.

    The crystal is made with more and more of the steps, in the order in which they are done. The
    step that fails is the one after the last success.
    """
    steps = ("repeat", "cut", "replace", "remove")
    failing_step: tuple[str, ...] = ()
    for index, step in enumerate(steps):
        arguments_before_step = {
            key: value for key, value in arguments.items() if key not in steps[index:]
        }
        with suppress(GranphonError):
            make(**arguments_before_step)
            failing_step = (step,)
    return failing_step


def _make_readers(context: Context, unused_blocks: Sequence[str] = ()) -> dict[str, Rule]:
    """Return for each block of :data:`BLOCKS`, by name, the rule that reads its value; the
    ``unused_blocks`` are left out.
    """
    names = [name for name in BLOCKS if name not in unused_blocks]
    return {name: partial(_read_block, name, context=context) for name in names}


def _read_block(name: str, value: Any, context: Context) -> Any:
    """Return the values of the block ``name`` by key, in SI units, from its plain ``value``; for a
    name whose value stands alone at the top level, as that of "observe", return this value.

    Refused for a value that a rule refuses, and for a missing key.
    """
    settings = BLOCKS[name]
    if "" in settings:
        return settings[""].kind.read(value, context)
    if name in ("phonopy", "spectrum") and value is None:
        return {}  # every key below the name of the block is commented out
    if name == "load" and isinstance(value, dict):
        # a value of another type is refused below, with the keys that are allowed
        _require_one_load(value, is_crystal=bool(context.parameters))
    readers = {key: declared.kind.rule(context) for key, declared in settings.items()}
    needed_keys = [key for key, declared in settings.items() if declared.default == NEEDED]
    if name != "packing" or not _has_measured_spread(value):
        return block(value, readers, needed_keys)
    # the mean of the measured diameters takes the place of the key "diameter"
    needed_keys.remove("diameter")
    values = block(value, readers, needed_keys)
    return {"diameter": values["spread"].mean, **values}


def _has_measured_spread(packing: Any) -> bool:
    """Return whether a plain block ``packing`` has a spread of measured diameters."""
    spread = packing.get("spread") if isinstance(packing, Mapping) else None
    return isinstance(spread, Mapping) and "measured" in spread


def _require_one_load(value: Mapping[str, Any], *, is_crystal: bool) -> None:
    """Raise Refused unless the plain ``value`` of the block "load" has exactly one kind of load,
    with the keys that belong to this kind. With ``is_crystal`` gravity may stand alone, without a
    kind of load; without it the load is that of a packing, which has no tensor and no gravity.
    """
    allowed = _ONE_LOAD_OF_CRYSTAL if is_crystal else _ONE_LOAD
    crystal_keys = [key for key in ("stress", "strain", "times", "gravity") if key in value]
    if crystal_keys and not is_crystal:
        raise Refused(
            f"{crystal_keys[0]} of a packing, all contacts of which bear the same",
            allowed,
            "Describe the balls by the blocks balls and crystal.",
            (crystal_keys[0],),
        )
    has_balls_per_side = "balls_per_side" in value
    kinds = [kind for kind in LOAD_KINDS if kind in value]
    if len(kinds) > 1:
        raise Refused(" and ".join(kinds), allowed, "Remove all but one.")
    if not kinds and "gravity" not in value:
        problem = "balls_per_side without side_force" if has_balls_per_side else "no load"
        raise Refused(problem, allowed)
    load = kinds[0] if kinds else "gravity"
    if "times" in value and load not in TENSORS:
        raise Refused(f"times with {load}", "times with stress or strain", path=("times",))
    if load == "side_force" and not has_balls_per_side:
        raise Refused("side_force alone", allowed)
    if load != "side_force" and has_balls_per_side:
        raise Refused(f"{load} and balls_per_side", allowed)


def _require_known_keys(data: Any) -> None:
    """Raise Refused for the first unknown key in the plain ``data`` of a document, and for loads
    without their kind. The top level is checked first, then the blocks in the order of
    :data:`BLOCKS`, but not what their values hold. If the key belongs to another block, the error
    names this block.
    """
    keys_of_blocks = {"": list(BLOCKS)}  # the top level
    for name, settings in BLOCKS.items():
        if "" not in settings:
            keys_of_blocks[name] = list(settings)
    for name, keys in keys_of_blocks.items():
        value = data.get(name) if name and isinstance(data, Mapping) else data
        if name == "load":
            _require_kind_of_load(value)
        if not isinstance(value, Mapping):
            continue
        for key in value:
            if key not in keys:
                refused = make_key_refusal(key, keys, _suggest_block(key, keys_of_blocks))
                raise refused.under(name) if name else refused


def _require_kind_of_load(value: Any) -> None:
    """Raise Refused if the ``value`` of the block "load" is a list or a range of loads."""
    is_range = isinstance(value, dict) and {"from", "to", "points", "scale"} & set(value)
    if isinstance(value, list) or is_range:
        problem = f"{show(value)}, without the kind of load"
        mend = "Write 'force:' before it, or another."
        raise Refused(problem, _ONE_LOAD, mend, ("load",))


def _suggest_block(key: Any, keys_of_blocks: Mapping[str, Sequence[str]]) -> str:
    """Return a sentence that says under which block the ``key`` belongs, the first that has it; an
    empty text if no block has it. ``keys_of_blocks`` are the keys by the name of the block, those
    of the top level under "".
    """
    names = [name for name, keys in keys_of_blocks.items() if key in keys]
    if not names:
        return ""
    name = names[0]
    if not name:
        return "It belongs at the top level."
    if name in _CRYSTAL_BLOCKS:
        blocks = " and ".join(_CRYSTAL_BLOCKS)
        return f"It belongs under '{name}': {blocks} in place of material and packing."
    return f"It belongs under '{name}'."


def _find_lattice(data: Any) -> Lattice:
    """Return the lattice, in the plain ``data`` of a scene, on which the rules of other values
    depend: the lattice of the packing, by default triangular; but if the scene sweeps over lattices
    with another number of periods or dimension, the first of these. Refused for a value that is no
    lattice.
    """
    readers = {"packing": PARTS["lattice"].rule(Context()), "sweep": file_keys.read_lattices}
    lattices = {}
    for name, rule in readers.items():
        values = data.get(name) if isinstance(data, Mapping) else None
        if isinstance(values, Mapping) and "lattice" in values:
            # a refusal is placed at the key "lattice" of the block
            read = partial(read_inside, "lattice", rule)
            lattices[name] = read_inside(name, read, values["lattice"])
    packing_lattice = find_lattice(lattices.get("packing", TRIANGULAR))
    return file_keys.choose_lattice(packing_lattice, lattices.get("sweep", ()))


# -- the file of a scene ---------------------------------------------------------------------------


#: words for what the keys of motions, and of stiffnesses that resist rolling and twist, may hold
_ALLOWED_OF_MOTIONS = {
    "motions": "motions of this lattice",
    **dict.fromkeys(
        ("torsion", "bending"),
        f"up to {MOST_ROLLING:g}, and 0 where no motion is resisted by it",
    ),
}
#: ordinary values of the quantities of which the scales of a ball are made, SI by name
_ORDINARY_QUANTITIES = {"young_modulus": 1e10, "density": 1e3, "diameter": 1e-2}


def _find_strangest_quantity(quantities: Mapping[str, float]) -> str:
    """Return the name of the quantity of a ball that differs from its ordinary value by the
    greatest factor; the ``quantities`` have young_modulus, density and diameter, SI, all above
    zero.
    """

    def find_distance(name: str) -> float:
        """Return the magnitude of the logarithm of the quantity ``name`` over its ordinary
        value.
        """
        return abs(math.log(quantities[name]) - math.log(_ORDINARY_QUANTITIES[name]))

    return max(_ORDINARY_QUANTITIES, key=find_distance)


def _find_key_of_values(load: Mapping[str, Any], kind: str) -> str:
    """Return the key that holds the values of a load of this ``kind`` in the plain data ``load`` of
    the block "load": for a stress or strain with factors the key of the factors, and for gravity
    alone, which is kept as a pressure of zero, the key of gravity.
    """
    if kind in TENSORS and "times" in load:
        return "times"  # factors by which the tensor is multiplied
    return kind if kind in load else "gravity"


def _find_place_of_value(values: Any, index: int, *, is_list: bool) -> tuple[str, tuple[Any, ...]]:
    """Return words for the value number ``index``, from 0, of the plain ``values`` of a key, and
    the path from this key to the value.

    The path is empty for one value or a tensor. In a list of values, ``is_list``, it is the index.
    In a range it is "from" for the first value and "to" for the last; it is empty for a value
    between them, which stands nowhere in the file.
    """
    if is_list:
        return show(values[index]), (index,)
    if not isinstance(values, dict):
        return show(values), ()
    first = show(values["from"])
    last = show(values["to"])
    points = values["points"]
    if index == 0:
        return first, ("from",)
    if index == points - 1:
        return last, ("to",)
    return f"value {index + 1} of {points} from {first} to {last}", ()


def _find_entries_with_errors(data: Any) -> dict[tuple[Any, ...], Any]:
    """Return the entries of the plain ``data`` of a document that have standard errors, by their
    paths and in the order of the document: texts such as "8 mm +- 4 um", and blocks {fit: FILE}. A
    document that is no block of keys is no scene, and has none.
    """
    if not isinstance(data, Mapping):
        return {}
    entries_with_errors: dict[tuple[Any, ...], Any] = {}
    open_entries: list[tuple[tuple[Any, ...], Any]] = [((key,), data[key]) for key in data]
    while open_entries:
        path, entry = open_entries.pop()
        items: Any = ()
        if isinstance(entry, str):
            if PLUS_MINUS.search(entry):
                entries_with_errors[path] = entry
        elif isinstance(entry, list):
            items = enumerate(entry)
        elif isinstance(entry, Mapping) and file_keys.FIT in entry:
            entries_with_errors[path] = entry
        elif isinstance(entry, Mapping):
            items = entry.items()
        for key, inner in items:
            open_entries.append(((*path, key), inner))
    # the entries that were added last were looked at first: their order is that of the document
    # from its end
    return dict(reversed(entries_with_errors.items()))


def _put_values(data: Any, values: Mapping[str, str]) -> Any:
    """Return a copy of the plain ``data`` of a document in which ``values`` are set: texts in YAML,
    by paths such as "load.force", or "load.force.0" in a list. Blocks that the document lacks are
    made. InputError for a path that leads to no place, and for a text that is not YAML.
    """
    changed_data = deepcopy(data)
    for name, text in values.items():
        keys: list[Any] = [
            int(key) if re.fullmatch("[0-9]{1,9}", key) else key for key in name.split(".")
        ]
        try:
            entry: Any = changed_data
            for key in keys[:-1]:
                entry = entry[key] if isinstance(entry, list) else entry.setdefault(key, {})
            entry[keys[-1]] = plain_yaml(text, name)
        except (AttributeError, IndexError, TypeError):
            problem = f"the scene has no place for {name}"
            raise InputError(problem, mend="Name keys as in material.young_modulus") from None
    return changed_data


@dataclass(frozen=True)
class SceneSource(Places):
    """The document that a scene was read from, and the path of its file.

    The context managers turn errors of the library into
    :class:`~granphon.base.errors.SceneError`, which names file, line and key. An error of a
    computation that fails stays a :class:`~granphon.base.errors.ConvergenceError`, and names file,
    line and key too. Without a document errors pass unchanged.

    Attributes
    ----------
    document : the document without standard errors; None for a scene made in Python.
    path : path of the file; None for a scene made in Python or read from a text.
    errors : standard errors of quantities of the document, texts of a number and a unit, each
        behind its path there.
    correlations : the names of two quantities of the same fit, such as "material.young_modulus",
        and the correlation of their errors.
    fits : the files of fits that the document names.

    A source is made of a document with errors, which are moved to the last three attributes.
    """

    document: Document | None = None
    path: Path | None = None
    errors: tuple[tuple[tuple[str | int, ...], str], ...] = ()
    correlations: tuple[tuple[str, str, float], ...] = ()
    fits: tuple[Path, ...] = ()

    def __post_init__(self) -> None:
        """Move the standard errors from the document, which then holds the values alone, to
        ``errors``, ``correlations`` and ``fits``. SceneError for an error that cannot be read.
        """
        entries = {} if self.document is None else _find_entries_with_errors(self.document.data)
        if not entries or self.document is None:
            return
        # imported here: few scenes have errors
        from granphon.scene.written_errors import WrittenErrors

        with self.at():
            written = WrittenErrors.read(entries, self.folder)
        data = deepcopy(self.document.data)
        for (*path_of_block, key), value in written.values.items():
            block_of_value = reduce(getitem, path_of_block, data)
            block_of_value[key] = value
        # the dataclass is frozen: attributes are set past it
        assign = partial(object.__setattr__, self)
        assign("document", replace(self.document, data=data))
        assign("errors", tuple(written.errors.items()))
        assign("correlations", tuple(written.correlations))
        assign("fits", tuple(written.fits))

    @classmethod
    def of_file(
        cls, path: str | os.PathLike[str], values: Mapping[str, str] | None = None
    ) -> SceneSource:
        """Return the source of a scene in the file ``path``. The ``values`` take the place of those
        in the file: texts in YAML, by paths such as "load.force".

        :class:`~granphon.base.errors.MissingSceneError` if there is no such file;
        :class:`~granphon.base.errors.SceneError` if the file cannot be read, its text is not YAML,
        or a standard error in it cannot be read;
        :class:`~granphon.base.errors.InputError` if a text among ``values`` is not YAML, or if
        its path leads to no place.
        """
        document = parse_yaml(read_text(path), str(path))
        if values:
            document = replace(document, data=_put_values(document.data, values))
        return cls(document, Path(path))

    @property
    def folder(self) -> Path:
        """Folder to which the names of files in the scene are relative: that of the scene's file,
        or the working folder for a scene that is not from a file.
        """
        return self.path.parent if self.path else Path()

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Paths of the files that a valid scene reads: the scene file first, if there is one, and
        the files that it names: tables of measured diameters, of the drives of a motion and of
        measured frequencies, the files of a packing, and fits. Empty without a document.
        """
        if self.document is None:
            return ()
        data = self.document.data
        spreads = [data.get("packing", {}).get("spread"), *data.get("sweep", {}).get("spread", [])]
        spreads += [ball.get("spread") for ball in data.get("balls", {}).values()]
        names = [name for name in map(find_table_name, spreads) if name is not None]
        if "motion" in data:
            names += named_tables(data["motion"].get("drive", []))
        if "design" in data:
            names += named_tables_of_goal(data["design"]["goal"])
        files = data.get("network", {}).get("files", [])
        if isinstance(files, str):
            files = [files]
        names += files
        paths = [self.folder / name for name in names] + list(self.fits)
        if self.path is not None:
            paths.insert(0, self.path)
        return tuple(paths)

    @property
    def written_units(self) -> dict[str, str]:
        """The units in which a valid document gives loads and swept parameters, by name; a unit is
        empty where values have none, different ones, or are rows of a matrix.
        """
        if self.document is None:
            return {}
        data = self.document.data
        units = {}
        for name, values in (data.get("load", {}) | data.get("sweep", {})).items():
            texts = [values]
            if isinstance(values, Mapping):
                texts = [values.get("from"), values.get("to")]
            elif isinstance(values, list):
                texts = values
            units_of_values = {find_written_unit(text) for text in texts}
            units[name] = units_of_values.pop() if len(units_of_values) == 1 else ""
        return units

    # -- places in the file ------------------------------------------------------------------------

    @contextmanager
    def at(self, *path: str | int, prefix: str = "") -> Iterator[None]:
        """Raise errors of the with-block again as errors that are placed at the key ``path`` of the
        document, with ``prefix`` before their text. Without a path an error is placed at the path
        that it has itself, as a refusal of a rule has one.

        An error that has an attribute ``option`` or ``block`` is always placed at this option of a
        medium or this block, with words that belong there in place of the prefix.
        """
        try:
            yield
        except (GranphonError, ArithmeticError) as error:
            if self.document is None:
                raise
            key_path, words = self._find_place_of_error(error, path, prefix)
            written_path = self._find_written_path(key_path)
            placed: GranphonError = self.document.error(written_path, f"{words}{error}")
            if isinstance(error, ConvergenceError):
                # the scene is not wrong, the computation has failed
                placed = ConvergenceError(str(placed))
            placed.reached = getattr(error, "reached", None)
            raise placed from None

    def _find_place_of_error(
        self, error: Exception, path: tuple[str | int, ...], prefix: str
    ) -> tuple[tuple[Any, ...], str]:
        """Return the path of the key at which an error is placed, and the words before its text.

        An error with an attribute ``option`` or ``block`` is placed at this option or block. For
        any other error the result is the given ``path``, or without one the path of the error, and
        the ``prefix``.
        """
        option = getattr(error, "option", None)
        if option is not None:
            option_path, words = self._find_option(option)
            # a medium can fail with the option "start" alone, the first load of a history, which
            # the balls must bear
            allowed = "a load that the balls bear without friction, or gas"
            return option_path, f"found {words}; allowed: {allowed}; "
        block_of_error = getattr(error, "block", None)
        if block_of_error is not None:
            return block_of_error, ""
        return path or getattr(error, "path", ()), prefix

    def _find_written_path(self, path: tuple[Any, ...]) -> tuple[Any, ...]:
        """Return a ``path`` with its keys as the document writes them: the key "force" is
        "load.force" where the document has that key in its place, as a design may.
        """
        assert self.document is not None
        value: Any = self.document.data
        written_path = []
        for key in path:
            written_key = key
            if isinstance(value, Mapping) and key not in value:
                longer_keys = (name for name in value if str(name).endswith(f".{key}"))
                written_key = next(longer_keys, key)
            written_path.append(written_key)
            value = value.get(written_key) if isinstance(value, Mapping) else None
        return tuple(written_path)

    def _find_option(self, option: str) -> tuple[tuple[Any, ...], str]:
        """Return the path of the key ``option`` in the block "medium", and its value in words. If
        no medium of the document has the option, or several have it, return the path of the block,
        and words that say so.
        """
        assert self.document is not None
        paths = [
            path for path in self.document.lines if path[:1] == ("medium",) and path[-1] == option
        ]
        if len(paths) != 1:
            quantifier = "several times" if paths else "no"
            return ("medium",), f"{quantifier} {option}"
        (path,) = paths
        value: Any = self.document.data
        for key in path:
            value = value[key]
        if not isinstance(value, Mapping):
            return path, show(value)
        items = ", ".join(f"{key}: {number}" for key, number in value.items())
        return path, f"{{{items}}}"

    @contextmanager
    def where_it_buckles(self) -> Iterator[None]:
        """Place an InstabilityError of the with-block at the key finite_overlap of the packing or
        crystal: no lattice buckles without the static forces that this key keeps. Where the
        document does not ask for these forces, as one with a packing in files, the place is the
        block of the balls.
        """
        try:
            yield
        except InstabilityError:
            data: Any = {} if self.document is None else self.document.data
            blocks_of_balls = ("packing", "crystal", *_FILES_BLOCKS)
            block_name = next((name for name in blocks_of_balls if name in data), "packing")
            path: tuple[str, ...] = (block_name,)
            prefix = ""
            if data.get(block_name, {}).get("finite_overlap"):
                path = (block_name, "finite_overlap")
                prefix = "found true; allowed: false where the lattice buckles; "
            with self.at(*path, prefix=prefix):
                raise

    def at_medium(self, label: str, allowed: str) -> AbstractContextManager[None]:
        """Place errors of the with-block at the key of the medium ``label``; ``allowed`` are words
        for the values of that key.
        """
        words = repr(label)
        if self.document is not None and "medium" not in self.document.data:
            words += ", the default"
        return self.at("medium", prefix=f"found {words}; allowed: {allowed}; ")

    def at_index(
        self, block: str, key: str, index: int, prefix: str = ""
    ) -> AbstractContextManager[None]:
        """Place errors of the with-block, with ``prefix`` before their text, at the value number
        ``index``, from 0, of a load or of a swept parameter. The ``block`` is "load" and the
        ``key`` the kind of load, or the block is "sweep" and the key the name of the parameter.

        The place in one value, a list or a range is that of :func:`_find_place_of_value`.
        """
        if self.document is None:
            return self.at()
        if block not in self.document.data:  # the load of a packing in files is that of the files
            return self.at(*_FILES_BLOCKS, prefix=prefix)
        allowed = "a value that the packing can have"
        written_key = key
        if block == "load":
            allowed = "a load that the balls can carry"
            written_key = _find_key_of_values(self.document.data[block], key)
        values = self.document.data[block][written_key]
        is_list = isinstance(values, list) and written_key not in TENSORS
        words, place = _find_place_of_value(values, index, is_list=is_list)
        prefix_of_value = f"found {words}; allowed: {allowed}; {prefix}"
        return self.at(block, written_key, *place, prefix=prefix_of_value)

    # -- what a scene is made of -------------------------------------------------------------------

    def read(self) -> dict[str, Any]:
        """Return the arguments of :class:`~granphon.Scene` that the document gives, by name. Files
        that the document names are read.

        SceneError names the first mistake; ValueError if there is no document.
        """
        if self.document is None:
            raise ValueError("there is no document")
        blocks = read_blocks(self.document, self.folder)
        packing = blocks["packing"].get("arrangement")
        if packing is None:
            packing = self._make_packing(blocks)
        load = packing.load if "load" not in blocks else self._make_load(blocks["load"])
        arguments: dict[str, Any] = {"packing": packing, "load": load}
        arguments |= self._label_path(blocks.get("phonopy", {}), packing.structure)
        for key in ("medium", "sweep", "observe", "direction"):
            if key in blocks:
                arguments[_ATTRIBUTES.get(key, key)] = blocks[key]
        for key, settings in SETTINGS.items():
            if key in blocks:
                arguments[key] = settings(**blocks[key])
        if "finite_overlap" in blocks["packing"]:
            arguments["finite_overlap"] = blocks["packing"]["finite_overlap"]
        correlations = (*self.correlations, *blocks.get("correlations", ()))
        arguments |= {"errors": self.errors, "correlations": correlations, "source": self.path}
        return arguments

    def _label_path(self, values: Mapping[str, Any], structure: Lattice) -> dict[str, Any]:
        """Return the ``values`` of the block "phonopy" by key, with the labels of "band_labels", if
        there are any, put on the path under "band", by default that of the ``structure``. Errors
        are placed at the key of the labels.
        """
        arguments = dict(values)
        if "band_labels" in arguments:
            with self.at("phonopy", "band_labels"):
                path = arguments.get("band") or BandPath.default(structure)
                arguments["band"] = replace(path, labels=arguments.pop("band_labels"))
        return arguments

    def _make_load(self, values: Mapping[str, Any]) -> Load:
        """Return the load of the ``values`` of the block "load", SI by key; gravity alone is kept
        as a pressure of zero with gravity. Errors are placed at the key of the kind of load, or of
        gravity alone at the block.
        """
        kind = next((key for key in values if key in LOAD_KINDS), None)
        path = ("load",) if kind is None else ("load", kind)
        gravity = values.get("gravity")
        with self.at(*path):
            if kind is None:
                return Load("pressure", 0.0, gravity=gravity)
            if kind in TENSORS:
                return Load(**split_tensor(values), gravity=gravity)
            return Load(kind, values[kind], values.get("balls_per_side"), gravity=gravity)

    def _make_packing(self, blocks: Mapping[str, Any]) -> Packing:
        """Return the packing of the ``blocks`` material and packing, values in SI by key. Errors
        are placed at their keys.
        """
        assert self.document is not None
        data: Any = self.document.data
        values = blocks["packing"]
        # The scales of the ball are made of Young's modulus, density and diameter: of a ball that
        # double precision cannot hold, the one that is farthest from the ordinary is probably
        # wrong.
        quantities = {**blocks["material"], "diameter": values["diameter"]}
        key = _find_strangest_quantity(quantities)
        block_name = "packing" if key == "diameter" else "material"
        written = show(data[block_name].get(key, "the mean of the measured diameters"))
        refusal = f"found {written}; allowed: a ball that double precision can hold; "
        with self.at(block_name, key, prefix=refusal):
            names = [name for name in ("diameter", "lattice", "friction") if name in values]
            material = Material(**blocks["material"])
            packing = Packing(material, **{name: values[name] for name in names})
        # The motions that balls may have, and the stiffnesses that resist them, depend on the
        # dimension. If the lattices of a sweep differ in dimension, or in the number of periods,
        # from the packing's own, the first of them takes its place.
        lattices = dict(blocks.get("sweep", ())).get("lattice", ())
        if choose_lattice(packing.structure, lattices) != packing.structure:
            packing = replace(packing, lattice=lattices[0])
        packing = self._add_motions(packing, values)
        return self._add_spread(packing, values)

    def _add_motions(self, packing: Packing, values: Mapping[str, Any]) -> Packing:
        """Return the ``packing`` with the motions, the torsion and the bending that are among the
        ``values`` of the block packing. Errors are placed at the key of each.
        """
        assert self.document is not None
        for name, allowed in _ALLOWED_OF_MOTIONS.items():
            if name in values:
                written = show(self.document.data["packing"][name])
                prefix = f"found {written}; allowed: {allowed}; "
                with self.at("packing", name, prefix=prefix):
                    packing = replace(packing, **{name: values[name]})
        return packing

    def _add_spread(self, packing: Packing, values: Mapping[str, Any]) -> Packing:
        """Return the ``packing`` of equal balls with the spread that is among the ``values`` of the
        block packing, or unchanged if there is none. Errors are placed at the key of the spread.
        """
        assert self.document is not None
        if "spread" not in values:
            return packing
        ((kind, value),) = self.document.data["packing"]["spread"].items()
        allowed = "diameters about the packing's, all above zero"
        refusal = f"found {show(value)}; allowed: {allowed}; "
        with self.at("packing", "spread", kind, prefix=refusal):
            return replace(packing, spread=values["spread"])
