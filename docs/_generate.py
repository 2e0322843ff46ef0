"""The tables of the reference, from what they describe: ``python docs/_generate.py`` writes them
into their pages.

With names, as in ``python docs/_generate.py rooms media``, only the tables between the marks of
these names; ``text`` are the texts of the interface, ``docs/reference/api/*.txt``.

What a key allows is asked of the rule that reads it; defaults and units are those of the schema;
commands and their options are those of the command line; the fields of output files are read from
files that small scenes wrote just now. Only what things *mean* is written here, and what has no
meaning yet is an error.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
import sys
import tempfile
import tomllib
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from importlib import import_module
from inspect import Parameter, cleandoc, signature
from io import StringIO
from pathlib import Path
from typing import Any, get_args, get_type_hints

from _meanings import (
    ATTRIBUTES,
    BANDED,
    FIELD_UNITS,
    FIELDS,
    FITTED,
    MEASURED,
    PACKINGS,
    RANGE,
    RUNGS,
    SAMPLE,
    SPREAD_BLOCKS,
    SPREADS,
    SWEPT,
)
from _text import write_interface
from typer.models import OptionInfo

from granphon.balls.diameters import Normal
from granphon.balls.material import Material
from granphon.balls.packing import LOSS_PARAMETERS, PARAMETERS, Packing, find_unit
from granphon.base.errors import Refused
from granphon.base.quantities import DENSITY, FREQUENCY, LENGTH, LOADS, MODULUS, TIME, WIDTH
from granphon.base.results import Result
from granphon.base.settings import SCALES, list_settings, read_values
from granphon.base.tables import Table
from granphon.base.text import plain_yaml
from granphon.cli.main import app
from granphon.cli.main import main as granphon
from granphon.fits.fit import WidthFit
from granphon.media.arrangement import Arrangement
from granphon.media.choice import MEDIA
from granphon.media.state import ContactState
from granphon.observables.catalogue import CATALOGUE
from granphon.runs.dataset import load_sweep
from granphon.scene import file_keys
from granphon.scene.file import BLOCKS
from granphon.scene.file_keys import PARTS, Context
from granphon.scene.outputs import OUTPUTS
from granphon.scene.scene import Scene
from granphon.tradeoffs.measure import TradeOff
from granphon.waves.settings import DriveSettings, Shaker

HERE = Path(__file__).parent
PAGES = [
    HERE / "development.md",
    *(
        HERE / "reference" / f"{name}.md"
        for name in ("api", "api/results", "scene", "commands", "files")
    ),
]
_REGION = re.compile(r"(<!-- (\w+): python docs/_generate\.py -->\n).*?(<!-- end -->)", re.DOTALL)
_UNITS = {
    kind.allowed: kind.unit
    for kind in (LENGTH, MODULUS, DENSITY, WIDTH, FREQUENCY, TIME, *LOADS.values())
}
#: what the fields of all files mean, and their units
MEANINGS = {name: one.meaning for name, one in CATALOGUE.items()} | FIELDS
UNITS = {name: one.unit for name, one in CATALOGUE.items()} | FIELD_UNITS

_STEEL = "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}"
_ARRAY = "simulation: {shape: 8 8, samples: 2}"
_CUBE = "simulation: {shape: 2 2 2, samples: 2}"
_LOADED = "simulation: {shape: 4 4, samples: 2, friction_history: true, friction_coefficient: 0.2}"
#: small scenes that between them write every file, and every field
SCENES = {
    "all": "packing: {diameter: 8 mm}\nload: {force: 5 N}\nobserve: [velocities, bands, dos]\n"
    "phonopy: {band_points: 3, mesh: 6 6 1}",
    "ema": "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\nload: {force: 5 N}",
    "square": "packing: {diameter: 8 mm, lattice: square}\nload: {force: 5 N}",
    "array": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{force: 5"
    f" N}}\nmedium: {{{_ARRAY}}}",
    "squeezed": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{overlap: 1"
    f" um}}\nmedium: {{{_ARRAY}}}",
    "sweep": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{force: [5 N, 9"
    f" N]}}\n"
    f"medium: [ema, {_ARRAY}]\nsweep: {{width: [1 um, 2 um]}}\nobserve: [bands]\nphonopy:"
    f" {{band_points: 2}}",
    "arrays": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{pressure: [2"
    f" kN/m, 3 kN/m]}}\n"
    f"medium: {{{_ARRAY}}}",
    "loaded": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{force: 5"
    f" N}}\nmedium: {{{_LOADED}}}",
    "path": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}}}\nload: {{force: [2 N, 5"
    f" N]}}\nmedium: {{{_LOADED}}}",
    "choice": "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\nload: {force: 40 N}\nmedium:"
    " auto",
    "choices": "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\nload: {force: [40 N, 90"
    " N]}\nmedium: auto",
    "squares": "packing: {diameter: 8 mm, lattice: square}\nload: {force: [5 N, 9 N]}",
    "chains": "packing: {diameter: 8 mm, lattice: chain, motions: all, torsion: 0.01, bending:"
    " 0.01}\n"
    "load: {force: [5 N, 9 N]}",
    "chain": "packing: {diameter: 8 mm, lattice: chain, motions: all, torsion: 0.01, bending:"
    " 0.01}\nload: {force: 5 N}",
    "membrane": "packing: {diameter: 8 mm, motions: all, bending: 0.01}\nload: {force: 5 N}",
    "membranes": "packing: {diameter: 8 mm, motions: all, bending: 0.01}\nload: {force: [5 N,"
    " 9 N]}",
    "waves": "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\nload: {force: [20 N, 40 N]}\n"
    "medium: {simulation: {shape: 8 20, samples: 2}}\ndirection: [0, 1]\nobserve: [dos,"
    " spectrum, pulse]\n"
    "spectrum: {points: 3}\npulse: {frequency: 12 kHz, cycles: 2, distance: 50 mm}",
    "edge": "packing: {diameter: 8 mm, lattice: square}\nload: {force: 5 N}\nobserve: [surface]\n"
    "surface: {axis: 1, points: 3}",
    **{
        f"response_{of}": f"packing: {{diameter: 8 mm, lattice: chain}}\nload: {{force:"
        f" {load}}}\nobserve: [response]\n"
        f"response: {{frequencies: [1 kHz, 2 kHz, 3 kHz, 4 kHz, 5 kHz], source: plane,"
        f" receiver: plane, quantity: {of}, "
        "damping: 9 us, cut: {axis: 0, layers: 3, edges: floor free}}"
        for of, load in (
            ("displacement", "5 N"),
            ("velocity", "[5 N, 9 N]"),
            ("transmissibility", "5 N"),
        )
    },
    **{
        f"motion_{of}": f"packing: {{diameter: 8 mm, lattice: chain}}\nload: {{force:"
        f" {load}}}\nobserve: [motion]\n"
        "motion: {drive: {balls: 0, impact: 0.1 m/s}, cut: {axis: 0, layers: 8}, duration:"
        " 0.1 ms, frames: 41}"
        for of, load in (("one", "5 N"), ("many", "[5 N, 9 N]"))
    },
    "motion_samples": "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\nload: {force: [20 N, 40"
    " N]}\n"
    "medium: {simulation: {shape: 4 6, samples: 2}}\nobserve: [motion]\n"
    "motion: {drive: {balls: lower, impact: 0.1 m/s, direction: 0 1}, cut: {axis: 1, layers:"
    " 1}, duration: 50 us}",
    "crystals": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}, lattice: fcc}}\nload:"
    f" {{force: [20 N, 40 N]}}\n"
    f"medium: {{{_CUBE}}}",
    "cube": f"packing: {{diameter: 8 mm, spread: {{uniform: 2 um}}, lattice: fcc}}\nload:"
    f" {{force: 20 N}}\n"
    f"medium: {{{_CUBE}}}",
    "crystal": "packing: {diameter: 8 mm, lattice: fcc}\nload: {force: 5 N}\nobserve:"
    " [bands]\nphonopy: {band_points: 3}\n"
    "bands: {damping: 1 us, loss_factor: 0.01}",
}


# -- tables ----------------------------------------------------------------------------------------


def table(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [
        "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |"
        for line in (heads, *rows)
    ]
    return "\n".join([lines[0], "|" + "---|" * len(heads), *lines[1:]])


def meaning(words: Mapping[str, Any], name: str) -> Any:
    """What is written here about ``name``; an error if it is new."""
    if name not in words:
        raise SystemExit(f"docs/_meanings.py does not say what {name} means: add it there")
    return words[name]


def literal(value: Any) -> str:
    """A value as a scene has it."""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{' '.join(map(str, value))}`"
    if isinstance(value, float):
        return f"`{value:g}`"
    return f"`{value}`"


def told(attempt: Callable[[], Any]) -> str:
    """What a rule says is allowed, when it is given what it cannot take."""
    try:
        attempt()
    except Refused as refused:
        return re.split(r"\.(?: [A-Z]|$)", str(refused).split("; allowed: ", 1)[1])[0]
    raise SystemExit("docs/_generate.py: a rule has taken what it should refuse")


def known(attempt: Callable[[], Any]) -> list[str]:
    """The keys of a block, as the refusal of another one lists them."""
    return told(attempt).removeprefix("a block of keys: ").split(", ")


# -- the interface ---------------------------------------------------------------------------------


def interface_pages() -> list[Path]:
    """The pages of the interface, in their order."""
    index = HERE / "reference" / "api.md"
    return [
        index.parent / f"{name}.md"
        for name in re.findall(r"^api/\w+$", index.read_text(encoding="utf-8"), re.MULTILINE)
    ]


def interface() -> str:
    """The names on each page of the interface, with their links."""
    rows = []
    for page in interface_pages():
        text = page.read_text(encoding="utf-8")
        names = re.findall(
            r"^\.\. auto(class|function|exception|module):: (\S+)$", text, re.MULTILINE
        )
        title = text.partition("\n")[0].removeprefix("# ")
        rows.append(
            [
                f"[{title}](api/{page.name}) ([text](api/{page.stem}.txt))",
                ", ".join(f"{{py:obj}}`{'~' * (kind != 'module')}{name}`" for kind, name in names),
            ]
        )
    return table(("page", "names"), rows)


def result_units() -> str:
    """The unit of each field of the results that the pages of the interface have."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in interface_pages())
    documented = re.findall(r"autoclass:: (\S+)\.(\w+)", text)
    rows = []
    for module, name in documented:
        result = getattr(import_module(module), name)
        if not (isinstance(result, type) and issubclass(result, Result)) or result is Result:
            continue
        parent = next(base for base in result.__mro__[1:] if "units" in vars(base))
        inherited = parent.units if issubclass(parent, ContactState) else {}
        units = [
            f"`{field}` {unit}" for field, unit in result.units.items() if field not in inherited
        ]
        parent_words = [f"those of {{class}}`~{module}.{parent.__name__}`"] if inherited else []
        if units:
            rows.append([f"{{class}}`~{module}.{name}`", ", ".join([*parent_words, *units])])
    return table(("result", "fields and their units"), rows)


# -- the scene -------------------------------------------------------------------------------------


def scene_keys() -> str:
    """Key, meaning, what is allowed, SI unit, default."""
    rows = []
    made = {
        name: one.default
        for kind in (Arrangement, Material, Packing, Scene)
        for name, one in signature(kind).parameters.items()
    }
    for block, name, one in (
        (block, name, one) for block, settings in BLOCKS.items() for name, one in settings.items()
    ):
        allowed = told(partial(one.kind.rule(Context(folder=HERE)), object()))
        several = (
            "; or a list of these, or a [range](#ranges)"
            if block == "load" and name in LOADS
            else ""
        )
        default = one.default or _plain_default(block, made[name or block])
        key = f"{block}.{name}" if name else block
        rows.append([f"`{key}`", one.meaning, allowed + several, one.kind.unit, default])
    return table(("key", "what it is", "allowed", "SI unit", "default"), rows)


def drives() -> str:
    """The keys of a drive of a motion, and of its shaker."""
    rows = []
    for prefix, settings in (("", DriveSettings), ("shaker.", Shaker)):
        for name, declared in list_settings(settings).items():
            allowed = told(partial(declared.kind.rule(Context(folder=HERE)), object()))
            rows.append(
                [
                    f"`{prefix}{name}`",
                    declared.meaning,
                    allowed,
                    declared.kind.unit,
                    declared.default,
                ]
            )
    return table(("key of a drive", "what it is", "allowed", "SI unit", "default"), rows)


def _plain_default(key: str, value: Any) -> str:
    return f"`[{', '.join(value)}]`" if key == "observe" else literal(value)


def spreads() -> str:
    """The forms of a spread, from the rule that reads them."""

    def probe(value: Any) -> Callable[[], Any]:
        return lambda: PARTS["spread"].read(value, Context(folder=HERE))

    rows = []
    for kind in told(probe(object())).removeprefix("exactly one of ").split(", "):
        alone = told(probe({kind: object()}))
        if not alone.startswith("a block of keys"):
            rows.append([kind, alone, _UNITS.get(alone, ""), ""])
        inner = known(probe({kind: {"?": 0}})) if kind in SPREAD_BLOCKS else []
        for key in inner + (["diameters"] if kind == "measured" else []):
            other_keys = {} if (kind, key) == ("measured", "diameters") else SPREAD_BLOCKS[kind]
            allowed = told(probe({kind: {**other_keys, key: object()}}))
            default = f"{Normal(1.0).cutoff:g}" if key == "cutoff" else ""
            rows.append(
                [
                    f"{kind}.{key}",
                    allowed,
                    "m" if key == "diameters" else _UNITS.get(allowed, ""),
                    default,
                ]
            )
    return table(
        ("form", "what it is", "allowed", "SI unit", "default"),
        (
            [f"`{name}`", meaning(SPREADS, name), allowed, unit, default]
            for name, allowed, unit, default in rows
        ),
    )


def media() -> str:
    """The words for a medium."""
    return table(("medium", "what it is"), ([f"`{name}`", meaning(RUNGS, name)] for name in MEDIA))


def medium_options() -> str:
    """The options of each medium."""
    rows = [
        [
            f"`{name}`",
            f"`{key}`",
            one.meaning,
            told(partial(one.rule, object())),
            one.absent or literal(one.default),
        ]
        for name, options in ((name, medium.options) for name, medium in MEDIA.items())
        for key, one in options.items()
    ]
    return table(("medium", "option", "what it is", "allowed", "default"), rows)


def sweep_parameters() -> str:
    """What a block ``sweep`` may hold."""
    rows = []
    for name in (*PARAMETERS, *LOSS_PARAMETERS):
        unit = find_unit(name)
        allowed = told(lambda name=name: file_keys.SWEEP.kind.read({name: object()}, Context()))
        several = "a list" if unit is None else "one, a list, or a [range](#ranges)"
        rows.append(
            [
                f"`{name}`",
                PACKINGS.get(name) or meaning(MEANINGS, name),
                f"{several}: {_element(name, allowed)}",
                unit or "",
            ]
        )
    return table(("parameter", "what is swept", "allowed", "SI unit"), rows)


def _element(name: str, allowed: str) -> str:
    if not allowed.startswith("a list"):
        return allowed
    return told(lambda: file_keys.SWEEP.kind.read({name: [object()]}, Context()))


def ranges() -> str:
    """The keys of a range."""
    full = {"from": "1 N", "to": "2 N", "points": 2}
    rows = []
    for key in known(lambda: read_values({"?": 0}, LOADS["force"].read)):
        allowed = (
            "as a single value"
            if key in ("from", "to")
            else told(lambda key=key: read_values({**full, key: object()}, LOADS["force"].read))
        )
        rows.append(
            [
                f"`{key}`",
                meaning(RANGE, key),
                allowed,
                literal(SCALES[0]) if key == "scale" else "required",
            ]
        )
    return table(("key of a range", "what it is", "allowed", "default"), rows)


# -- the commands ----------------------------------------------------------------------------------


def commands() -> str:
    """Every command with its arguments and options, from the functions that carry them out."""
    parts = []
    for command in app.registered_commands:
        call: Any = command.callback
        text, _, examples = cleandoc(call.__doc__).partition("\n\n\b\n")
        kinds = get_type_hints(call, include_extras=True)
        rows = [_parameter(one, kinds[one.name]) for one in signature(call).parameters.values()]
        parts += [
            f"## granphon {command.name or call.__name__}",
            _as_code(re.sub(r"(?<!\n)\n(?!\n)", " ", text)),
            *(
                [table(("argument or option", "what it is", "value", "default"), rows)]
                if rows
                else []
            ),
            "```text\n" + "\n".join(line.strip() for line in examples.splitlines()[1:]) + "\n```",
        ]
    return "\n\n".join(parts)


def _parameter(one: Parameter, annotation: Any) -> list[str]:
    """A row: names, meaning, what it takes, default."""
    plain, info = get_args(annotation)
    options = isinstance(info, OptionInfo)
    # inside Annotated typer keeps the first name where a default would stand
    first = [info.default] if isinstance(info.default, str) else []
    names = [word for decl in (*first, *(info.param_decls or ())) for word in decl.split("/")]
    names = names or [f"--{one.name.replace('_', '-')}"]
    if not options:
        names = [(info.metavar or one.name).strip("[]")]
    value = "" if plain is bool or not options else info.metavar or "TEXT"
    if info.min is not None:
        value += f", {info.min} or more" if info.max is None else f", {info.min} to {info.max}"
    if one.default is one.empty:
        default = "required"
    elif plain is bool:
        default = f"`{names[0]}`" if one.default else "off"
    else:
        default = "none" if one.default is None else literal(one.default)
    return [", ".join(f"`{name}`" for name in names), _as_code(info.help), value, default]


def _as_code(text: str) -> str:
    """With options between backticks: of plain words two dashes would be set as one long one."""
    return re.sub(r"(?<![\w`-])--[a-z][\w-]*", r"`\g<0>`", text)


# -- the files -------------------------------------------------------------------------------------


def files() -> str:
    """Which file is written when: the files of each output, by the table of outputs."""
    rows = []
    for _name, output in OUTPUTS.items():
        if not output.files:
            continue
        first, *others = output.files
        stem = first.partition(".")[0]
        shown = [first]
        shown += [re.sub(rf"\A{stem}\.", ".", name) for name in others]
        rows.append([", ".join(f"`{name}`" for name in shown), output.occasion, output.words])
    return table(("file", "written for", "what is in it"), rows)


class Results:
    """Small scenes, run; what is in their files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, text in SCENES.items():
            scene = folder / f"{name}.yaml"
            scene.write_text(f"{_STEEL}\n{text}\n", encoding="utf-8")
            _do("run", str(scene), "-o", str(folder / name), "--no-figures", "-q")
        data = folder / "data.csv"
        data.write_text("force (N),velocity (m/s)\n2,465\n5,603\n9,681\n18,774\n", encoding="utf-8")
        _do(
            "fit",
            str(folder / "ema.yaml"),
            str(data),
            "-o",
            str(folder / "fit"),
            "--frequency",
            "6.5 kHz",
        )
        self.sweeps = [load_sweep(folder / name / "sweep.nc") for name in MANY]

    def yaml(self, name: str, file: str) -> Any:
        """A whole file, read."""
        return plain_yaml((self.folder / name / file).read_text(encoding="utf-8"), file)

    def row(
        self,
        name: str,
        value: Any,
        units: Mapping[str, str] | None = None,
        words: Mapping[str, str] | None = None,
    ) -> list[str]:
        """A field with its unit or kind, and its meaning."""
        unit = (units or {}).get(name, UNITS.get(name, ""))
        said = meaning(MEANINGS | dict(words or {}), name)
        return [name_with(name, describe(value, unit)), said]


def _do(*words: str) -> None:
    """Carry a command out, quietly."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
        failed = granphon(words)
    if failed:
        raise SystemExit(f"docs/_generate.py: granphon {' '.join(words)}: {said.getvalue()}")


def name_with(name: str, unit: str) -> str:
    """A name with its unit, as tables head their columns; plain numbers have none."""
    return f"`{name}`" if unit in ("", "1", "number") else f"`{name}` ({unit})"


def describe(value: Any, unit: str) -> str:
    """The unit of a number, or what else stands in a file; several are a list."""
    name = kind(value)
    if name == "number":
        return unit
    return f"{name}, {unit}" if name in ("numbers", "matrix") and unit not in ("", "1") else name


def kind(value: Any) -> str:
    """What sort of value stands in a file."""
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, list):
        # those that are empty here hold sentences
        inner = kind(value[0]) if value else "text"
        return "matrix" if inner.endswith("s") else f"{inner}s"
    return {dict: "block", str: "text", float: "number", int: "number", type(None): "text"}[
        type(value)
    ]


#: the scenes of one state, and of many
ONE = ("all", "ema", "square", "array", "squeezed", "choice", "chain", "membrane", "cube", "loaded")
MANY = ("sweep", "arrays", "choices", "squares", "chains", "membranes", "waves", "crystals", "path")
HEADS = ("field (unit or kind)", "what it is")
#: dimensions that together are those of the states of a sweep
STATES = {"load", "medium", *PARAMETERS}


def merged(*parts: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of all, each where it first comes."""
    return {name: value for part in reversed(parts) for name, value in part.items()}


def in_order(*parts: Mapping[str, Any]) -> list[str]:
    """The keys of all, in an order that agrees with that of each."""
    names: list[str] = []
    for keys in parts:
        place = 0
        for name in keys:
            if name in names:
                place = names.index(name) + 1
            else:
                names.insert(place, name)
                place += 1
    return names


def columns(of: Table, words: Mapping[str, str], said: Container[str] = ()) -> str:
    """The columns of a table that were not ``said``, with the units of their headings or those of
    all files.
    """
    rows = (
        [name_with(one.name, one.unit or UNITS.get(one.name, "")), meaning(words, one.name)]
        for one in of.headings
        if one.name not in said
    )
    return table(("column (unit)", "what it is"), rows)


def is_error(name: str, names: Iterable[str]) -> bool:
    """Whether ``name`` is the standard error of another quantity."""
    return name.endswith("_error") and name.removesuffix("_error") in names


def variables(results: Results) -> dict[str, tuple[tuple[str, ...], str, str]]:
    """The dimensions, the unit and the meaning of each variable of ``sweep.nc``; the dimensions of
    the states are left out.
    """
    found = {}
    for name in in_order(*(dataset.variables for dataset in results.sweeps)):
        array = next(dataset[name] for dataset in results.sweeps if name in dataset.variables)
        dimensions = tuple(str(dim) for dim in array.dims if dim not in STATES)
        said = array.attrs.get("long_name", "") or meaning(SWEPT, name)
        found[name] = dimensions, array.attrs.get("units", ""), said
    return found


def summaries(results: Results) -> tuple[list[str], dict[str, Any], dict[str, str]]:
    """The fields of ``summary.yaml`` in their order, a value of each, and their units."""
    ones = [results.yaml(name, "summary.yaml") for name in ONE]
    many = [results.yaml(name, "summary.yaml") for name in MANY]
    units = merged(*(one["units"] for one in (*ones, *many)))
    extra = [name for name in in_order(*many) if not any(name in one for one in ones)]
    return in_order(*ones) + extra, merged(*ones, *many), units


def list_quantities(results: Results) -> list[str]:
    """Names of what each state has one of, in the summary, the data set and the table; an error if
    the table has other columns than one for each of them and for the coordinates.
    """
    found = variables(results)
    # a load is a coordinate of some data sets, and a quantity of the others
    quantities = {str(name) for dataset in results.sweeps for name in dataset.data_vars}
    names = [name for name, (dimensions, *_) in found.items() if not dimensions]
    heads = {
        heading.name
        for scene in MANY
        for heading in Table.read(results.folder / scene / "sweep.csv").headings
    }
    fields, *_ = summaries(results)
    if heads != set(names):
        raise SystemExit(f"docs/_generate.py: sweep.csv is not as said: {heads ^ set(names)}")
    listed = [name for name in names if name in quantities]
    if lost := {name for name in listed if not is_error(name, found)} - set(fields):
        raise SystemExit(f"docs/_generate.py: summary.yaml has no {lost}")
    return listed


def quantities(results: Results) -> str:
    """Numbers of a state; standard errors are one row."""
    found = variables(results)
    fields, _, units = summaries(results)
    names = list_quantities(results)
    rows = [
        [name_with(name, unit), said]
        for name, (_, unit, said) in found.items()
        if name in names and not is_error(name, found)
    ]
    every = [name for name in in_order(found, fields) if is_error(name, {*found, *fields})]
    for name in every:
        unit = found[name][1] if name in found else units[name]
        of = name.removesuffix("_error")
        if unit != (found[of][1] if of in found else units[of]):
            raise SystemExit(f"docs/_generate.py: {name} has another unit than {of}")
    errors = ", ".join(f"`{name}`" for name in every)
    rows.append([errors, "standard error over samples, in the unit of the quantity"])
    return table(("quantity (unit)", "what it is"), rows)


def summary(results: Results) -> str:
    """Fields that summary.yaml has besides the quantities."""
    fields, values, units = summaries(results)
    shared = {*list_quantities(results), "tensor"}
    rows = [
        results.row(name, values[name], units)
        for name in fields
        if name not in shared and not is_error(name, shared)
    ]
    return table(HEADS, rows)


def sweep_fields(results: Results) -> str:
    """Variables that sweep.nc has besides the quantities, by their dimensions."""
    found = variables(results)
    fields, *_ = summaries(results)
    said_above = {*list_quantities(results), *fields} - {"tensor", *PARAMETERS}
    groups: dict[str, list[list[str]]] = {}
    for name, (dimensions, unit, said) in found.items():
        if is_error(name, found) or name in said_above:
            continue
        if dimensions == (name,):
            dimensions = ()
        head = ", ".join(f"`{dim}`" for dim in dimensions) or "coordinates"
        shown = name_with(name, unit) + (", or another parameter" if name in PARAMETERS else "")
        groups.setdefault(head, []).append([shown, said])
    rows = []
    for head, members in groups.items():
        rows.append([f"*{head}*", ""])
        for said, same in itertools.groupby(members, key=lambda row: row[1]):
            rows.append([", ".join(row[0] for row in same), said])
    return table(("variable (unit), by its *dimensions*", "what it is"), rows)


def sweep_attributes(results: Results) -> str:
    """Global attributes of sweep.nc that are no fields of summary.yaml, or mean something else."""
    fields, *_ = summaries(results)
    names = in_order(*(dataset.attrs for dataset in results.sweeps))
    rows = [
        [f"`{name}`", meaning(ATTRIBUTES, name)]
        for name in names
        if name in ATTRIBUTES or name not in fields
    ]
    return table(("attribute", "what it is"), rows)


def shared_block(results: Results) -> dict[str, Any]:
    """The block ``granphon`` of band.yaml, without what is as in summary.yaml."""
    found = [results.yaml(name, "band.yaml")["granphon"] for name in ("all", "crystal")]
    fields, *_ = summaries(results)
    values = merged(*found)
    return {name: values[name] for name in in_order(*found) if name not in fields}


def band_fields(results: Results) -> str:
    """The block ``granphon`` of band.yaml, without what is as in summary.yaml."""
    block = shared_block(results)
    return table(HEADS, (results.row(name, value, words=BANDED) for name, value in block.items()))


def phonopy_fields(results: Results) -> str:
    """What the block ``granphon`` of phonopy_params.yaml has besides."""
    text = (results.folder / "all" / "phonopy_params.yaml").read_text(encoding="utf-8")
    head = "".join(itertools.takewhile(str.strip, text.splitlines(keepends=True)))
    block = plain_yaml(head, "head")["granphon"]
    shared = results.yaml("all", "band.yaml")["granphon"]
    return table(
        HEADS, (results.row(name, value) for name, value in block.items() if name not in shared)
    )


def sample_fields(results: Results) -> str:
    """Arrays and scalars of sample.extxyz."""
    head = (results.folder / "loaded" / "sample.extxyz").read_text(encoding="utf-8").splitlines()[1]
    columns = re.search(r"Properties=(\S+)", head)[1].split(":")  # type: ignore[index]
    names = [
        (name, int(count))
        for name, _, count in zip(columns[::3], columns[1::3], columns[2::3], strict=True)
    ]
    rows = []
    for name, count in names:
        said, unit = SAMPLE.get(name, (MEANINGS.get(name), UNITS.get(name, "")))
        several = str(count) if count > 1 else ""
        cell = ", ".join(filter(None, (several, unit)))
        rows.append([name_with(name, cell), said or meaning(MEANINGS, name)])
    rows.append(["*of the sample*", ""])
    shared = shared_block(results)
    for name in re.findall(r" (\w+)=(?!\")", head):
        if name not in ("Lattice", "Properties", "pbc", *shared):
            rows.append([name_with(name, UNITS.get(name, "")), meaning(MEANINGS, name)])
    return table(("of each ball (unit)", "what it is"), rows)


def fit_fields(results: Results) -> str:
    """What fit.yaml has besides the attributes of its class, and besides what is as in
    summary.yaml.
    """
    data = results.yaml("fit", "fit.yaml")
    fields, *_ = summaries(results)
    fields = {*fields, *dir(WidthFit), *(field.name for field in dataclasses.fields(WidthFit))}
    rows = [
        results.row(name, value, data["units"], FITTED)
        for name, value in data.items()
        if name not in fields
    ]
    return table(HEADS, rows)


def fit_columns(results: Results) -> str:
    """Columns that fit.csv has besides the fields of fit.yaml."""
    fields = results.yaml("fit", "fit.yaml")
    return columns(Table.read(results.folder / "fit" / "fit.csv"), MEANINGS, fields)


def tradeoff_columns(results: Results) -> str:
    """Columns of tradeoff.csv."""
    empty = TradeOff((), "force", (), (), "", 1, 0.0, 0.0)
    return columns(Table.parse("tradeoff.csv", empty.csv().encode()), MEASURED)


# -- the packages ----------------------------------------------------------------------------------


def rooms() -> str:
    """The packages as the contracts of imports have them: a diagram of their levels, and what each
    is the room of.
    """
    contracts = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "importlinter"
    ]["contracts"]
    (layers,) = (contract for contract in contracts if contract["id"] == "rooms")
    levels = [
        [room.strip() for room in level.split("|")]
        for level in layers["layers"]
        if level != "__main__"
    ]
    packages = {room for level in levels for room in level}
    # a library has a door where all packages but one are forbidden to import it
    doors: dict[str, list[str]] = {}
    for contract in contracts:
        sources = contract.get("source_modules", ())
        open_rooms = packages - {module.removeprefix("granphon.") for module in sources}
        if len(open_rooms) == 1:
            doors.setdefault(open_rooms.pop(), []).extend(contract["forbidden_modules"])
    width = max(len("   ".join(level)) for level in levels)
    diagram = ["```text"]
    for level in levels:
        outside = ", ".join(library for room in level for library in doors.get(room, ()))
        diagram += [
            f"{'   '.join(level):^{width}}" + f"   <-  {outside}" * bool(outside),
            f"{'|':^{width}}",
        ]
    rows = []
    for name in (room for level in reversed(levels) for room in level):
        package = import_module(f"granphon.{name}")
        modules = sorted(
            path.stem
            for path in Path(str(package.__file__)).parent.glob("*.py")
            if path.stem != "__init__"
        )
        purpose = " ".join((package.__doc__ or "").partition("\n\n")[0].split()).rstrip(".")
        rows.append([f"`{name}`", purpose, " ".join(f"`{module}`" for module in modules)])
    drawn = "\n".join(line.rstrip() for line in [*diagram[:-1], "```"])
    return f"{drawn}\n\n{table(('package', 'room of', 'modules'), rows)}"


# -- the pages -------------------------------------------------------------------------------------


#: tables made of the code alone, and those made of files that small scenes write
PLAIN = (
    rooms,
    interface,
    result_units,
    scene_keys,
    drives,
    spreads,
    media,
    medium_options,
    sweep_parameters,
    ranges,
    commands,
    files,
)
READ = (
    quantities,
    summary,
    sweep_fields,
    sweep_attributes,
    band_fields,
    phonopy_fields,
    sample_fields,
    fit_fields,
    fit_columns,
    tradeoff_columns,
)


def regions(names: Sequence[str] = ()) -> dict[str, str]:
    """What stands between the marks, by their names: of all, or of ``names``. Scenes run only where
    it takes their files.
    """
    made = {one.__name__: one() for one in PLAIN if one.__name__ in names or not names}
    read = [one for one in READ if one.__name__ in names or not names]
    if not read:
        return made
    with tempfile.TemporaryDirectory() as folder:
        results = Results(Path(folder))
        return made | {one.__name__: one(results) for one in read}


def marks(text: str) -> list[str]:
    """Names of the regions of a page."""
    return [m[2] for m in _REGION.finditer(text)]


def filled(text: str, found: Mapping[str, str]) -> str:
    """A page with its regions made anew, as far as they were found."""
    return _REGION.sub(
        lambda m: f"{m[1]}\n{found[m[2]]}\n\n{m[3]}" if m[2] in found else m[0], text
    )


def texts(names: Sequence[str] = ()) -> dict[Path, str]:
    """What each file should hold, with the parts of these ``names``, or all, made anew."""
    marked = [name for name in names if name != "text"]
    made = regions(marked) if marked or not names else {}
    page_texts = {page: filled(page.read_text(encoding="utf-8"), made) for page in PAGES}
    if names and "text" not in names:
        return page_texts
    return page_texts | {
        page.with_suffix(".txt"): write_interface(page) for page in interface_pages()
    }


if __name__ == "__main__":
    for file, after in texts(sys.argv[1:]).items():
        if not file.exists() or file.read_text(encoding="utf-8") != after:
            file.write_text(after, encoding="utf-8")
            print(f"wrote {file}", file=sys.stderr)
