"""Media and packings in words, as the legends of figures name them; this module does not load
matplotlib.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from granphon.balls.packing import Packing
from granphon.base.quantities import load_quantities
from granphon.base.scales import write_quantity
from granphon.media.choice import find_medium
from granphon.media.simulation import DEFAULT_SHAPES

#: a space at which no line ends
_NO_BREAK = "\u00a0"
#: what the options of media mean in a legend; the value stands for {}
_OPTIONS = {
    "local_field=paper": "local field of the paper",
    "friction_history=true": "loaded with friction",
    "geometry=exact": "exact geometry",
    "geometry=lattice": "lattice geometry",
    "tolerance": "error below {}",
    "seed": "seed {}",
    "start": "from {}",
    "start=gas": "from the gas",
    "ordered=true": "as a path",
    "friction_coefficient": "friction coefficient {}",
}
#: symbols of the numbers that describe balls, and their units, with the names under which sweeps
#: vary them
_SYMBOLS = {
    "young_modulus": ("E", "Pa"),
    "poisson_ratio": ("ν", ""),
    "density": ("ρ", "kg/m³"),
    "diameter": ("d", "m"),
    "width": ("W", "m"),
    "mass": ("m", "kg"),
}
#: what is said of motions, and of terms of finite overlap, where nothing was asked for: a title
#: leaves these out
DEFAULTS = frozenset({"motions of the lattice", "no torsion", "no bending", "overlap ≪ diameter"})


def describe_medium(label: str, periods: int = 2, balls: int = 1) -> str:
    """Return a medium in words: "simulation, 4 samples of 32 x 32 balls" for
    ``simulation(samples=4, shape=32 32)``.

    ``periods`` and ``balls`` are the number of periods of the lattice, and that of balls in its
    cell.
    """
    name, _, inner = label.removesuffix(")").partition("(")
    try:
        words = [str(find_medium(name).words)]
    except KeyError:
        return label
    options = dict(one.split("=", 1) for one in inner.split(", ") if "=" in one)
    if name == "simulation":
        shape = options.pop("shape", " ".join(map(str, DEFAULT_SHAPES[periods]))).replace(
            " ", " x "
        )
        samples = int(options.pop("samples", 1))
        several = f"{samples} samples" if samples > 1 else "a sample"
        words.append(f"{several} of {shape} {'balls' if balls == 1 else 'cells'}")
    for option, value in options.items():
        if option == "tolerance":
            value = f"{100.0 * float(value):g} %"
        if option == "start" and value != "gas":
            load, _, size = value.rpartition(" ")
            value = (
                f"{load} {write_value(float(size), load_quantities(periods)[load].unit)}"
                if load
                else f"a* of {size}"
            )
        plain = _OPTIONS.get(f"{option}={value}") or _OPTIONS.get(
            option, option.replace("_", " ") + " {}"
        )
        words.append(plain.format(value))
    return ", ".join(words)


def write_unit(unit: str) -> str:
    """Return a unit, or a quantity, with "µ" in the place of "u"."""
    return unit.replace("u", "µ")


def write_value(value: float, unit: str) -> str:
    """Return a number with its unit as it stands in a legend, five digits at most: "2.04 µm"."""
    if unit not in ("m", "Pa", "N", "Hz", "N/m"):
        return f"{value:.5g} {unit}".rstrip()
    return write_unit(write_quantity(value, unit))


def describe_parameter(name: str, value: Any) -> tuple[str, str]:
    """Return the kind of fact that a parameter of a packing is, and its value in words: ("spread",
    "W = 2 µm").

    Those of a kind of ball, "A.diameter", are told with the kind: "d = 8 mm of A".
    """
    kind, _, own = name.rpartition(".")
    if kind:
        return name, f"{describe_parameter(own, value)[1]} of {kind}"
    if name in _SYMBOLS and not isinstance(value, str):
        symbol, own = _SYMBOLS[name]
        text = f"{symbol} = {write_value(float(value), own)}"
        return ("spread", text if value else "equal balls") if name == "width" else (name, text)
    if name == "friction":
        return name, "with friction" if str(value) == "True" else "without friction"
    if name == "lattice":
        return name, f"{value} lattice"
    if name == "motions":
        return name, f"motions {str(value).replace('_', ' ')}"
    if name in ("torsion", "bending"):
        return name, f"{name} {value:.4g}" if isinstance(
            value, float
        ) and value else f"no {name}" if not value else (f"{name} of {str(value).capitalize()}")
    return name, f"{name.replace('_', ' ')} {value}"


def list_facts(packing: Packing) -> dict[str, str]:
    """Return what balls and their contacts are, in words by kind; what two packings share has the
    same words.
    """
    ball = packing.material
    spread = packing.spread
    kind = type(spread).__name__.lower()
    facts = dict(
        describe_parameter(name, value)
        for name, value in (
            ("lattice", packing.structure.name),
            ("young_modulus", ball.young_modulus),
            ("poisson_ratio", ball.poisson_ratio),
            ("density", ball.density),
            ("diameter", packing.diameter),
            ("width", packing.width),
            ("friction", packing.friction),
            ("motions", packing.motions or "of the lattice"),
            ("torsion", packing.torsion),
            ("bending", packing.bending),
        )
    )
    if spread is not None and packing.width and kind != "uniform":
        facts["spread"] += f" ({kind})"
    return facts | {"overlap": describe_overlap(False)}


def describe_overlap(finite: bool) -> str:
    """Return in words whether states have the terms of relative order delta/d."""
    return "finite overlap" if finite else "overlap ≪ diameter"


def find_differing(facts: Sequence[Mapping[str, str]]) -> tuple[list[str], list[str]]:
    """Return the kinds of fact that several mappings do not share, and in words what all share,
    without what is usual.
    """
    kinds = list(dict.fromkeys(kind for facts_of_packing in facts for kind in facts_of_packing))
    differing = [
        kind
        for kind in kinds
        if len({facts_of_packing.get(kind) for facts_of_packing in facts}) > 1
    ]
    return differing, [
        facts[0][kind] for kind in kinds if kind not in differing and facts[0][kind] not in DEFAULTS
    ]


def join_facts(facts: Iterable[str], letters: int) -> str:
    """Return facts in one text, in lines of so many letters at most that break between facts, or at
    commas in them.
    """
    text = ", ".join(facts).replace(" ", _NO_BREAK).replace(f",{_NO_BREAK}", ", ")
    return textwrap.fill(text, letters, break_long_words=False, break_on_hyphens=False)
