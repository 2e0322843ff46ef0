"""Media and packings in words, for the legends of figures; this module does not load matplotlib."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from granphon.balls.on_site import SPRING_PARAMETERS
from granphon.balls.packing import Packing
from granphon.base.quantities import load_quantities
from granphon.base.scales import write_quantity
from granphon.base.text import spell
from granphon.media.array_options import DEFAULT_SHAPES
from granphon.media.choice import find_medium, split_label

#: a space at which no line ends
_NO_BREAK = "\u00a0"
#: options of media in words; {} is the place of the value
_OPTIONS = {
    "local_field=paper": "local field of the paper",
    "friction_history=true": "loaded with friction",
    "geometry=exact": "exact geometry",
    "geometry=lattice": "lattice geometry",
    "boundary=stress": "a cell that may shear",
    "tolerance": "error below {}",
    "seed": "seed {}",
    "start": "from {}",
    "start=gas": "from the gas",
    "ordered=true": "as a path",
    "friction_coefficient": "friction coefficient {}",
}
#: symbols and units of the numbers that describe balls, by their names in sweeps
_SYMBOLS = {
    "young_modulus": ("E", "Pa"),
    "poisson_ratio": ("ν", ""),
    "density": ("ρ", "kg/m³"),
    "diameter": ("d", "m"),
    "width": ("W", "m"),
    "mass": ("m", "kg"),
    "damping": ("τ", "s"),
    "loss_factor": ("η", ""),
    "drag": ("γ", "1/s"),
    "dashpot": ("c", "N s/m"),
    "restitution": ("e", ""),
    "tangential_damping": ("τ_t", "s"),
    "tangential_loss_factor": ("η_t", ""),
    "rotational_drag": ("γ_r", "1/s"),
    "tangential_dashpot": ("c_t", "N s/m"),
}
#: facts, in words, that packings have by default, and which a title therefore leaves out
DEFAULTS = frozenset(
    {
        "motions of the lattice",
        "no torsion",
        "no bending",
        "without terms of overlap/diameter",
    }
)


def describe_medium(label: str, periods: int = 2, balls: int = 1) -> str:
    """Return a medium in words: "simulation, 4 samples of 32 x 32 balls" for
    ``simulation(samples=4, shape=32 32)``.

    ``periods`` is the number of periods of the lattice, ``balls`` the number of balls in its cell.
    The ``label`` itself is returned for a medium that is not known.
    """
    name, options = split_label(label)
    try:
        words = [str(find_medium(name).words)]
    except KeyError:
        return label
    if name == "simulation":
        default_shape = " ".join(map(str, DEFAULT_SHAPES[periods]))
        shape = options.pop("shape", default_shape).replace(" ", " x ")
        samples = int(options.pop("samples", 1))
        samples_in_words = f"{samples} samples" if samples > 1 else "a sample"
        words.append(f"{samples_in_words} of {shape} {'balls' if balls == 1 else 'cells'}")
    words += [_describe_option(option, value, periods) for option, value in options.items()]
    return ", ".join(words)


def _describe_option(option: str, value: str, periods: int) -> str:
    """Return an option of a medium in words, from its name and its ``value`` in a label; the number
    of ``periods`` decides the unit of a load.
    """
    if f"{option}={value}" in _OPTIONS:
        return _OPTIONS[f"{option}={value}"]
    default_template = option.replace("_", " ") + " {}"
    return _OPTIONS.get(option, default_template).format(_write_setting(option, value, periods))


def _write_setting(option: str, value: str, periods: int) -> str:
    """Return the ``value`` of an option in a label as it stands in words: tolerances in per cent,
    loads with units, and other values as in the label.
    """
    if option == "tolerance":
        return f"{100.0 * float(value):g} %"
    if option == "start":
        return _describe_start(value, periods)
    return value


def _describe_start(value: str, periods: int) -> str:
    """Return the start of a simulation in words, from the reduced spacing a*, as "0.4", or from the
    name and the size of a load, as "pressure 100"; ``periods`` decide the unit of the load.
    """
    load, _, size = value.rpartition(" ")
    if not load:
        return f"a* of {size}"
    return f"{load} {write_value(float(size), load_quantities(periods)[load].unit)}"


def write_unit(unit: str) -> str:
    """Return a ``unit``, or a number with its unit, with "µ" in the place of every "u"."""
    return unit.replace("u", "µ")


def write_value(value: float, unit: str) -> str:
    """Return a ``value`` in the SI ``unit`` as it stands in a legend, "2.04 µm", with five digits
    at most. Units that are rarely printed with a prefix stay as they are, and a number of the unit
    "1" has no unit.
    """
    if unit == "1":
        return f"{value:.5g}"
    if unit not in ("m", "s", "Pa", "N", "Hz", "N/m"):
        return f"{value:.5g} {unit}".rstrip()
    return write_unit(write_quantity(value, unit))


def describe_parameter(name: str, value: Any) -> tuple[str, str]:
    """Return the kind of fact of a parameter of a packing, and its value in words: ("spread",
    "W = 2 µm").

    A parameter of a kind of ball, "A.diameter", has the kind in its words: "d = 8 mm of A". A
    number is in SI units. The kind of fact is the ``name``, but "spread" for the width of all
    balls, and balls of the width zero are called equal.
    """
    if name in SPRING_PARAMETERS:
        motion = name.partition(".")[2]
        text = f"springs {write_value(float(value), SPRING_PARAMETERS[name])}"
        return name, f"{spell(motion)} {text}" if motion else text
    kind, _, parameter = name.rpartition(".")
    if kind:
        _, text = describe_parameter(parameter, value)
        return name, f"{text} of {kind}"
    if name in _SYMBOLS and not isinstance(value, str):
        symbol, unit = _SYMBOLS[name]
        text = f"{symbol} = {write_value(float(value), unit)}"
        if name == "width":
            return "spread", text if value else "equal balls"
        return name, text
    if name == "friction":  # a truth value, of Python or NumPy, or its text
        return name, "with friction" if str(value) == "True" else "without friction"
    if name == "lattice":
        return name, f"{value} lattice"
    if name == "motions":
        return name, f"motions {str(value).replace('_', ' ')}"
    if name in ("torsion", "bending"):
        if not value:
            return name, f"no {name}"
        if isinstance(value, str):  # the name of a law, "mindlin"
            return name, f"{name} of {value.capitalize()}"
        return name, f"{name} {value:.4g}"
    return name, f"{name.replace('_', ' ')} {value}"


def list_facts(packing: Packing) -> dict[str, str]:
    """Return facts of balls and their contacts, in words by kind of fact: {"diameter": "d = 8 mm"}.

    Equal values have equal words, by which packings are compared; numbers have five digits at most.
    The fact "overlap" is that of states without terms of overlap/diameter; where a medium is known,
    its own words take the place of this (:func:`~granphon.figures.curves.describe_lines`).
    """
    material = packing.material
    spread = packing.spread
    facts = dict(
        describe_parameter(name, value)
        for name, value in (
            ("lattice", packing.structure.name),
            ("young_modulus", material.young_modulus),
            ("poisson_ratio", material.poisson_ratio),
            ("density", material.density),
            ("diameter", packing.diameter),
            ("width", packing.width),
            ("friction", packing.friction),
            ("motions", packing.motions or "of the lattice"),
            ("torsion", packing.torsion),
            ("bending", packing.bending),
        )
    )
    if spread is not None and packing.width and spread.kind != "uniform":
        # the fact of the width, see describe_parameter
        facts["spread"] += f" ({spread.kind})"
    return facts | {"overlap": describe_overlap(has_terms=False)}


def describe_overlap(*, has_terms: bool) -> str:
    """Return in words whether states have the terms of the relative order delta/d, where delta is
    the overlap and d the diameter.
    """
    return f"{'with' if has_terms else 'without'} terms of overlap/diameter"


def find_differing(facts: Sequence[Mapping[str, str]]) -> tuple[list[str], list[str]]:
    """Compare the ``facts`` of several curves, each a mapping from the kind of a fact to its words.
    Return the kinds in which the curves differ, and the words of the facts that all of them share,
    without :data:`DEFAULTS`.
    """
    kinds = list(dict.fromkeys(kind for facts_of_packing in facts for kind in facts_of_packing))
    values_of_kind = {
        kind: {facts_of_packing.get(kind) for facts_of_packing in facts} for kind in kinds
    }
    differing_kinds = [kind for kind in kinds if len(values_of_kind[kind]) > 1]
    shared_facts = [facts[0][kind] for kind in kinds if kind not in differing_kinds]
    return differing_kinds, [text for text in shared_facts if text not in DEFAULTS]


def join_facts(facts: Iterable[str], letters: int) -> str:
    """Return ``facts`` in one text, with commas between them, in lines of at most so many
    ``letters``. A line ends at a comma, and is longer only where a piece between commas is.
    """
    text = ", ".join(facts).replace(" ", _NO_BREAK).replace(f",{_NO_BREAK}", ", ")
    return textwrap.fill(text, letters, break_long_words=False, break_on_hyphens=False)


def wrap_fact(fact: str, letters: int) -> str:
    """Return a ``fact`` in lines of at most so many ``letters``. The name of a kind of balls stays
    on the line of the "of" before it; a line is longer only where a word, or these, are.
    """
    text = fact.replace(" of ", f" of{_NO_BREAK}")
    return textwrap.fill(text, letters, break_long_words=False, break_on_hyphens=False)
