"""How the blocks ``balls`` and ``crystal`` of a scene file, and the loads of a crystal, are read and written."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from granphon.balls.ball import Ball
from granphon.balls.contact_laws import DMT, JKR, Hertz, PowerLaw, TabulatedLaw
from granphon.balls.lattices import LATTICES
from granphon.balls.layers import EDGES, read_axis
from granphon.balls.material import Material
from granphon.balls.motions import allowed_motions
from granphon.base.errors import InputError, Refused, message
from granphon.base.quantities import ADHESION, INERTIA, LENGTH, LOADS, MASS, Quantity, tensor_quantities
from granphon.base.text import show
from granphon.base.validation import Rule, above_zero, block, choice, each, is_whole, label, number, read_inside, whole
from granphon.media.crystal import STRUCTURES
from granphon.scene.rules import PARTS, Context, Kind, read_lattice, read_values, refusing, write_lattice, write_values

_PLACE = Quantity("length", "m", "8 mm", "m, mm, um, nm", "any")
_MATERIAL = ("young_modulus", "poisson_ratio", "density", "yield_strength")
_FORCE = Quantity("force", "N", "2 N", "mN, N, kN", "any")


def _column(quantity: Quantity) -> Kind:
    return Kind.plain(
        partial(each, rule=quantity.read, what="values"), lambda values: [quantity.write(one) for one in values]
    )


_ADHESION = {"adhesion": Kind.plain(ADHESION.read, ADHESION.write)}
#: the laws by their words in a scene, and how their numbers are read and written
_LAWS: dict[str, tuple[type[Any], dict[str, Kind]]] = {
    "hertz": (Hertz, {}),
    "power": (PowerLaw, {name: Kind.plain(above_zero, float) for name in ("exponent", "coefficient")}),
    "dmt": (DMT, _ADHESION),
    "jkr": (JKR, _ADHESION),
    "tabulated": (TabulatedLaw, {"overlap": _column(LOADS["overlap"]), "force": _column(_FORCE)}),
}
_ALLOWED_LAW = f"{', '.join(_LAWS)}, with its numbers, or a block of pairs of kinds, as {{A B: hertz}}"


# -- kinds of balls ---------------------------------------------------------------------------------------------------


def _read_balls(value: Any, at: Context) -> tuple[tuple[str, Ball], ...]:
    """Read kinds of balls: a block of names, each with a material, a diameter, and a mass and inertia if these differ."""
    if not isinstance(value, dict) or not value:
        raise Refused(show(value), "a block of kinds of balls by name, each with its material and diameter")
    material = partial(block, rules={name: PARTS[name].rule(at) for name in _MATERIAL}, needed=_MATERIAL[:3])
    rules: dict[str, Rule] = {
        "material": material, "diameter": LENGTH.read, "mass": MASS.read, "inertia": INERTIA.read,
        "spread": PARTS["spread"].rule(at),
    }  # fmt: skip
    out = []
    for name, given in value.items():
        kind = label(name)
        if "." in kind or " " in kind or kind == "floor":
            raise Refused(show(name), "a name without a point or a space, and not 'floor'", path=(name,))
        found = read_inside(name, partial(block, rules=rules, needed=("material", "diameter")), given)
        try:
            out.append((kind, Ball(Material(**found.pop("material")), **found)))
        except InputError as error:
            key = next((key for key in ("mass", "inertia") if key in given and str(error).startswith(key)), "diameter")
            raise Refused(show(given[key]), "a ball that double precision can hold", str(error), (name, key)) from None
    return tuple(out)


def _write_balls(kinds: Any, at: Context) -> dict[str, Any]:
    out = {}
    for name, ball in kinds:
        material = {key: PARTS[key].write(one, at) for key in _MATERIAL if (one := getattr(ball.material, key)) is not None}
        out[name] = {
            "material": material, "diameter": LENGTH.write(ball.diameter), "mass": MASS.write(ball.mass),
            "inertia": INERTIA.write(ball.inertia),
        } | ({"spread": PARTS["spread"].write(ball.spread, at)} if ball.spread else {})  # fmt: skip
    return out


BALLS = Kind(_read_balls, _write_balls)


# -- how they are arranged --------------------------------------------------------------------------------------------


def _read_structure(value: Any) -> Any:
    """Read the name of a lattice or structure, or the block of a lattice."""
    if isinstance(value, str) and (known := {name.lower(): name for name in STRUCTURES}.get(value.lower())):
        return known
    try:
        return read_lattice(value)
    except Refused as refused:
        allowed = f"{', '.join((*LATTICES, *STRUCTURES))}, or a block of name, cell and sites"
        raise Refused(refused.found, allowed, refused.mend, refused.path) from None


def _read_vectors(value: Any) -> tuple[tuple[float, ...], ...]:
    """Read vectors, each a list of lengths."""

    def length(one: Any) -> float:
        return 0.0 if is_whole(one) and one == 0 else _PLACE.read(one)

    if value == []:
        return ()
    return each(value, partial(each, rule=length, what="lengths"), "vectors")


def _read_site(value: Any) -> tuple[tuple[float, ...], str]:
    given = block(value, {"kind": label, "at": lambda one: _read_vectors([one])[0]}, ("kind", "at"))
    return given["at"], given["kind"]


def _read_counts(value: Any, what: str, high: int, low: int = 1) -> tuple[int, ...]:
    """Read one or more whole numbers, as a list or as words."""
    words = [int(one) if one.isdecimal() else one for one in value.split()] if isinstance(value, str) else value
    return each(words if isinstance(words, list | tuple) else [words], partial(whole, low=low, high=high), what)


def _read_cut(value: Any) -> tuple[Any, int, tuple[str, str]]:
    rules: dict[str, Rule] = {"axis": read_axis, "layers": partial(whole, low=1, high=1_000_000), "edges": _read_edges}
    given = block(value, rules, ("axis", "layers"))
    return given["axis"], given["layers"], given.get("edges", ("free", "free"))


def _read_edges(value: Any) -> tuple[str, str]:
    words = value.split() if isinstance(value, str) else value
    if not isinstance(words, list | tuple) or len(words) not in (1, 2):
        raise Refused(show(value), f"one word for both faces, or two for the lower and the upper: {', '.join(EDGES)}")
    found = each(list(words), partial(choice, options=EDGES), "edges")
    return found[0], found[-1]


def _read_cuts(value: Any) -> tuple[Any, ...]:
    return each(value, _read_cut, "cuts") if isinstance(value, list) else (_read_cut(value),)


def _write_cuts(cuts: Any) -> Any:
    out = [{"axis": list(a) if isinstance(a, tuple) else a, "layers": n, "edges": " ".join(edges)} for a, n, edges in cuts]
    return (out if len(out) > 1 else out[0]) if out else None


def _read_replaced(value: Any) -> tuple[tuple[int, str], ...]:
    if not isinstance(value, dict) or not value:
        raise Refused(show(value), "a block of numbers of balls and the kinds that take their places, as {12: S}")
    numbers = [int(index) if isinstance(index, str) and index.isdecimal() else index for index in value]
    kinds = [read_inside(index, label, kind) for index, kind in value.items()]
    return tuple(zip([whole(number, 0) for number in numbers], kinds, strict=True))


def _read_law(value: Any) -> Any:
    """Read a law, or a block of pairs of kinds with a law for each; returns the law, or items of pairs."""
    name, given = next(iter(value.items())) if isinstance(value, dict) and len(value) == 1 else (value, {})
    if isinstance(name, str) and name in _LAWS:
        made, rules = _LAWS[name]
        found = read_inside(name, partial(block, rules={key: one.rule(Context()) for key, one in rules.items()},
                                          needed=tuple(rules)), given or {})  # fmt: skip
        with refusing(given or name, f"numbers of the law {name}", name):
            return made(**found)
    if not isinstance(value, dict) or not all(isinstance(pair, str) and len(pair.split()) == 2 for pair in value):
        raise Refused(show(value), _ALLOWED_LAW)
    return tuple((tuple(pair.split()), read_inside(pair, _read_law, one)) for pair, one in value.items())


def _write_law(law: Any) -> Any:
    if isinstance(law, tuple):
        return {" ".join(pair): _write_law(one) for pair, one in law}
    for name, (made, rules) in _LAWS.items():
        if type(law) is made:
            fields = {key: f"{key}s" if made is TabulatedLaw else key for key in rules}
            numbers = {key: rules[key].write(getattr(law, field), Context()) for key, field in fields.items()}
            return {name: numbers} if numbers else name
    what = f"the law {law!r}"
    raise InputError(message(what, "A scene file has no words for it", f"Use {', '.join(_LAWS)}, or granphon.sweep"))


def _read_motions(value: Any) -> str:
    return choice(value, tuple(dict.fromkeys(name for d in (1, 2, 3) for name in allowed_motions(d))))


STRUCTURE = Kind.plain(
    _read_structure, lambda one: None if one is None else one if isinstance(one, str) else write_lattice(one)
)
ORDER = Kind.plain(partial(each, rule=label, what="names of kinds"), lambda one: list(one) or None)
CELL = Kind.plain(_read_vectors, lambda rows: [[_PLACE.write(x) for x in row] for row in rows] or None)
SITES = Kind.plain(
    partial(each, rule=_read_site, what="sites"),
    lambda sites: [{"kind": kind, "at": [_PLACE.write(x) for x in place]} for place, kind in sites] or None,
)
REPEAT = Kind.plain(lambda value: _read_counts(value, "numbers of cells", 1_000_000), lambda one: list(one) or None)
CUT = Kind.plain(_read_cuts, _write_cuts)
REPLACE = Kind.plain(_read_replaced, lambda pairs: dict(pairs) or None)
REMOVE = Kind.plain(lambda value: _read_counts(value, "numbers of balls", 10_000_000, 0), lambda one: list(one) or None)
SEED = Kind.plain(partial(whole, low=0))
LAW = Kind.plain(_read_law, _write_law)
MOTIONS = Kind.plain(_read_motions)


# -- loads ------------------------------------------------------------------------------------------------------------


def tensor_kind(name: str) -> Kind:
    """Return the kind of a stress or strain: a list in Voigt order, or a symmetric matrix, along the periods."""

    def read(value: Any, at: Context) -> tuple[float, ...]:
        quantity, p = tensor_quantities(at.lattice.periods)[name], at.lattice.periods
        size = {1: 1, 2: 3, 3: 6}.get(p, 0)
        unit = "numbers" if name == "strain" else "quantities"
        allowed = f"{size} {unit} in Voigt order, or {p} rows of {p}; tension and extension are positive"

        def one(value: Any) -> float:
            if name == "strain":
                return number(value, -1e300, 1e300)
            return 0.0 if is_whole(value) and value == 0 else quantity.read(value)

        listed = value if isinstance(value, list | tuple) else [value]
        if len(listed) == p and p > 1 and all(isinstance(row, list | tuple) and len(row) == p for row in listed):
            rows = np.array(each(list(listed), partial(each, rule=one, what="numbers"), "rows"))
            if not np.array_equal(rows, rows.T):
                raise Refused(show(value), "a symmetric matrix")
            pairs = ((0, 0), (1, 1), (0, 1)) if p == 2 else ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
            shear = 2.0 if name == "strain" else 1.0
            found = tuple(float(rows[a, b]) * (shear if a != b else 1.0) for a, b in pairs)
        elif len(listed) == size:
            found = tuple(each(list(listed), one, "numbers"))
        else:
            raise Refused(show(value), allowed)
        if not any(found):
            raise Refused(f"{show(value)}, which is zero", allowed)
        return found

    def write(load: Any, at: Context) -> Any:
        if load.kind != name:
            return None
        size = load.values[0] if load.size == 1 else 1.0
        plain = tuple(one * size for one in load.tensor)
        most = max(map(abs, plain))
        if tuple(one / most for one in plain) != load.tensor:  # to the last bit: the tensor of size one, and its size
            plain = load.tensor
        return [*plain] if name == "strain" else [tensor_quantities(at.lattice.periods)[name].write(one) for one in plain]

    return Kind(read, write)


def _write_times(load: Any) -> Any:
    if load.tensor is None:
        return None
    written = tuple(one * load.values[0] for one in load.tensor)
    most = max(map(abs, written))
    if load.size == 1 and tuple(one / most for one in written) == load.tensor:
        return None
    return write_values(load.values, float)


TIMES = Kind.plain(lambda value: read_values(value, above_zero), _write_times)


def split_tensor(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a :class:`~granphon.Load` from the keys of a block with a stress or strain."""
    name = next(one for one in ("stress", "strain") if one in found)
    size = max(map(abs, found[name]))
    return {
        "kind": name, "array": tuple(size * one for one in found.get("times", (1.0,))),
        "tensor": tuple(one / size for one in found[name]),
    }  # fmt: skip
