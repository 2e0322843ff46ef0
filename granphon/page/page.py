"""The page of a packing under load: one file with libraries, program and data, for a browser.

The modules of JavaScript are joined and the libraries wrapped; the page's template takes both.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from contextlib import suppress
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np

from granphon.balls.hertz import EXPONENT
from granphon.balls.lattices import one_direction
from granphon.balls.loads import Load, require_of_packing
from granphon.balls.packing import LOSSES, MINDLIN, Packing
from granphon.base.arrays import Array
from granphon.base.errors import InputError, MechanismError
from granphon.base.scales import write_quantity
from granphon.base.text import counted
from granphon.dynamics.damping import GivenLosses, Losses, find_tsuji
from granphon.figures.style import colour_kinds
from granphon.media.choice import MediumChoice, find_medium
from granphon.media.state import NetworkState
from granphon.networks.network import ContactNetwork, given_network
from granphon.observables.validity import find_warnings
from granphon.page.lattice_data import describe_lattice, describe_network
from granphon.page.medium_tables import choose_spread, tabulate_medium
from granphon.phonons.paths import BandPath
from granphon.waves.settings import BandsSettings

#: an import of other modules of the page, on one line
_IMPORT = re.compile(r'^import \{[^}]*\} from "\./(\w+)\.js";\n', re.MULTILINE)
#: statements of libraries: imports from another file, exports of what another file has, and exports
#: of what the file itself has
_IMPORT_OF_FILE = re.compile(r'import\{([^}]*)\}from"[^"]*";')
_EXPORT_OF_FILE = re.compile(r'export\{[^}]*\}from"[^"]*";')
_EXPORT = re.compile(r"export\{([^}]*)\};")
#: number of the layout of a page's data
PAGE_SCHEMA = 1
#: lowest force of the slider over the least of the scene, and highest over the greatest
_LEAST_FORCE_RATIO = 1e-2
_MOST_FORCE_RATIO = 1e2
#: largest overlap of the slider, over the diameter: contacts of larger overlap are not small
_MOST_OVERLAP = 0.05
#: reduced force f* of the first load at the largest width of the slider
_LEAST_REDUCED_FORCE = 0.1
#: largest width of the slider, over the diameter, and least of its largest widths, over the width
#: of the packing
_MOST_WIDTH = 0.5
_WIDTH_RATIO = 2.0
#: largest number of branches on the page of a network
_MOST_BRANCHES = 100
#: sliders of torsion and bending go to this stiffness, over k d^2, or to this multiple of the
#: packing's
_MOST_ROLLING = 0.2
_ROLLING_RATIO = 2.0
#: the slider of eta goes to equal stiffness at least
_MOST_SLIP = 1.0
#: relative difference of sizes or masses up to which balls of a kind are equal; beyond, the page
#: gives their means
_EQUALITY_TOLERANCE = 1e-9


def make_page(
    source: Any,
    media: Sequence[MediumChoice] = (),
    load: Load | None = None,
    *,
    title: str = "granphon",
    **options: Any,
) -> str:
    """Return the text of the page of a ``source``, HTML, with a ``title``.

    With a ``load`` the source is a packing, and the page lets choose among the ``media``. Without a
    load the source is the state of a crystal, a sample or a network, and ``media`` are not used.
    ``options``, and what is raised, are those of :func:`describe_page` for a packing, and of
    :func:`describe_network_page` for others.
    """
    if load is None:
        return fill_template(describe_network_page(source, **options), title)
    return fill_template(describe_page(source, media, load, **options), title)


def describe_network_page(
    source: Any,
    *,
    direction: Sequence[float] | None = None,
    losses: BandsSettings | None = None,
    remarks: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the data from which the page of a network computes; the page has only the sliders of
    the mode.

    Balls are drawn with their radii, and kinds of balls with the names and colours of figures.

    Parameters
    ----------
    source : the state of a crystal, a sample, or a :class:`~granphon.ContactNetwork` that repeats.
    direction : of sound, (p,); x by default.
    losses : of contacts and balls, of which the page shows the Q factor of a mode.
    remarks : sentences that the page shows, after the warnings of the network.

    Returns
    -------
    data : plain numbers and texts by name; SI units unless the key names another unit.

    Raises
    ------
    InputError : the source has no network, the network repeats along no period, has static
        tangential forces or torques, or slip by levers that exceed the arms, or has more branches
        than a browser can compute; or a ``direction`` that is not p finite numbers, or has no
        length.
    """
    state = NetworkState(given_network(source), getattr(source, "warnings", None))
    lattice = state.contact_lattice()
    scales = state.scales
    periods = lattice.periods
    if lattice.n_branches > _MOST_BRANCHES:
        raise InputError(
            f"the network has {lattice.n_branches} branches",
            f"A browser computes up to {_MOST_BRANCHES} while it is looked at",
            "Use gp.Phonons",
        )
    ratios = {"eta": lattice.mindlin_ratio, "torsion": lattice.torsion, "bending": lattice.bending}
    # the rows of a network have the stiffnesses as weights: here a kind of stiffness only counts as
    # present (1) or not (0)
    fixed = {name: float(np.any(ratio)) for name, ratio in ratios.items()}
    radii = state.network.radii[state.network.moving] / scales.length
    names = np.array(state.kinds)
    kinds = []
    for name, colour in colour_kinds(state.kinds).items():
        balls = np.flatnonzero(names == name).tolist()
        kinds.append({"name": name, "colour": colour, "balls": balls})
    return {
        "schema": PAGE_SCHEMA,
        "kinds": kinds,
        "lattice": describe_network(lattice, "network") | {"radii": radii.tolist()},
        "balls": {"diameter": scales.length, "mass": scales.mass, "stiffness": scales.stiffness},
        "fixed": {**fixed, "spacing": 1.0, "push": float(lattice.is_prestressed)},
        "facts": _list_facts(state),
        "units": {"modulus": "N" if periods == 1 else "Pa"},
        "media": [{"name": "network", "words": "network", "valid": 0.0}],
        "limits": {"force": [0.5, 2.0], "width": 0.0, "eta": 1.0, "rolling": 1.0},
        "direction": _choose_direction(direction, periods),
        "start": {
            "force": 1.0,
            "width": 0.0,
            **fixed,
            "mindlin": False,
            "overlap": False,
            "motions": lattice.named_motions.name,
        },
        "remarks": [*find_warnings(state), *remarks],
        "losses": _describe_losses_of_network(losses, state.network),
    }


def _list_facts(state: NetworkState) -> list[list[str]]:
    """Return pairs of texts, the name and the value of each fact on a network that its page
    shows. The mean force is that of the contacts that are pressed; a network without such contacts
    has no mean force.
    """
    lattice = state.contact_lattice()
    network = state.network
    scales = state.scales
    facts = [
        ["Balls that move, of the cell", str(lattice.n_balls)],
        ["Contacts", str(len(lattice.contacts))],
        ["Mean diameter", write_quantity(scales.length, "m")],
        ["Mean mass", write_quantity(1e3 * scales.mass, "g")],
        ["Mean normal stiffness", write_quantity(scales.stiffness, "N/m")],
    ]
    # contacts that touch without a force, or pull, would hide how strongly balls are pressed
    pressing_forces = network.normal_force[network.normal_force > 0.0]
    if pressing_forces.size:
        mean_force = write_quantity(float(pressing_forces.mean()), "N")
        facts.append(["Mean force of a contact", mean_force])
    names = np.array(state.kinds)
    radii = network.radii[network.moving]
    masses = network.masses[network.moving]
    for name in colour_kinds(state.kinds):
        balls = np.flatnonzero(names == name)
        facts.append([name, _describe_kind(masses[balls], radii[balls])])
    return facts


def _choose_direction(direction: Sequence[float] | None, periods: int) -> list[float]:
    """Return the direction of sound that a page shows at first, of length one, with a component
    for each of the ``periods``; x by default. InputError for what is not one direction.
    """
    x_axis = (1.0, 0.0, 0.0)[:periods]
    components = x_axis if direction is None else direction
    vector: list[float] = one_direction(components, periods).tolist()
    return vector


def _describe_kind(masses: Array, radii: Array) -> str:
    """Return in words the number, the mass and the diameter of the n balls of a kind, from their
    ``masses`` (n,), kg, and ``radii`` (n,), m.
    """
    mass = write_quantity(1e3 * float(masses.mean()), "g")
    diameter = write_quantity(2.0 * float(radii.mean()), "m")
    relative_spread = max(np.ptp(radii) / radii[0], np.ptp(masses) / masses[0])
    qualifier = "mean " if relative_spread > _EQUALITY_TOLERANCE else ""
    count = counted(masses.size, "ball")
    return f"{count}, {qualifier}{mass}, {qualifier}diameter {diameter}"


def _describe_losses(losses: BandsSettings | None) -> dict[str, Any] | None:
    """Return the losses of contacts that are all alike, from which the page finds the Q factor of a
    mode; None without losses.

    "factors" are loss factors, "damping" times, s, and "dashpot" viscosities, N s/m. Each is a pair
    of the loss of normal motion and the loss of all other motion of a contact; in the first two
    each loss is a list over contacts, here of one number. "drag" is the pair of the drags, 1/s, of
    displacements and of rotations, and "tsuji" the factor alpha of the dashpot that a restitution
    gives.
    """
    given_losses = dict(losses.losses) if losses is not None else {}
    restitution = given_losses.pop("restitution", 1.0)  # 1 is no loss
    if restitution == 1.0 and not any(np.any(loss) for loss in given_losses.values()):
        return None
    pairs = {name: np.broadcast_to(given_losses.get(name, 0.0), 2).tolist() for name in LOSSES}
    return {
        "factors": [[factor] for factor in pairs["loss_factor"]],
        "damping": [[time] for time in pairs["damping"]],
        "dashpot": pairs["dashpot"],
        "tsuji": float(find_tsuji(restitution)),
        "drag": pairs["drag"],
    }


def _describe_losses_of_network(
    losses: BandsSettings | None, network: ContactNetwork
) -> dict[str, Any] | None:
    """Return the losses of the contacts of a network as :func:`_describe_losses` does. "factors"
    and "damping" list one number for each contact; the times in "damping" hold those of dashpots
    and restitution too, so that "dashpot" and "tsuji" are zero.
    """
    description = _describe_losses(losses)
    if losses is None or description is None:
        return None
    contact_losses = Losses.of(network, GivenLosses(**losses.losses))
    return description | {
        "factors": contact_losses.factors[:, network.in_lattice].tolist(),
        "damping": contact_losses.times[:, network.in_lattice].tolist(),
        "dashpot": [0.0, 0.0],
        "tsuji": 0.0,
    }


def describe_page(
    packing: Packing,
    media: Sequence[MediumChoice],
    load: Load,
    *,
    finite_overlap: bool = False,
    path: BandPath | None = None,
    direction: Sequence[float] | None = None,
    losses: BandsSettings | None = None,
    remarks: Sequence[str] = (),
) -> dict[str, Any]:
    """Return the data from which a page computes, as plain numbers and texts; SI units unless the
    key names another unit.

    Parameters
    ----------
    packing : the balls.
    media : the media among which the page lets choose, "ala" if there are none; an automatic medium
        stands for the medium that it takes at the first load, which a remark names. Of equal balls
        on a lattice of two or three periods "ema" takes the place of "ala" alone, for the slider of
        the width.
    load : one load or more. The page begins at the first load, and its slider reaches beyond all
        loads.
    finite_overlap : whether the page begins with the terms of relative order delta/d.
    path : the path of the bands, by default that of the lattice.
    direction : of sound, (p,); x by default.
    losses : of contacts and balls, of which the page shows the Q factor of a mode.
    remarks : sentences that the page shows.

    Raises
    ------
    InputError : a ``direction`` that is not p finite numbers, or has no length; a load that
        crystals alone bear, or that the balls cannot carry; an automatic medium that cannot be
        chosen; a medium that is registered, does not take these balls, has no solution at any load
        of the page (PrecisionError), or has no stiffness on the lattice of balls that differ
        (MechanismError).
    ConvergenceError : the samples of a simulation are not found.
    """
    require_of_packing(load)
    structure = packing.structure
    law = packing.law
    direction_of_page = _choose_direction(direction, structure.periods)
    choices, notes = _choose_media(packing, media, load)
    forces = _find_forces(packing, choices[0], load)
    is_averaged_lattice = [medium.name for medium in choices] == ["ala"]
    has_width_slider = structure.periods > 1
    if packing.spread is None and is_averaged_lattice and has_width_slider:
        # the slider of the width needs a medium of unequal balls; at W = 0 both media are equal
        choices = [MediumChoice("ema")]
    stiffness = law.stiffness(law.overlap(forces[0]))
    torsion = float(packing.find_torsion(forces[0], stiffness))
    limits = _Limits.of(packing, forces, torsion)
    tables = _tabulate_media(packing, choices, limits)
    if all(table["refusal"] for table in tables):  # the page can show equal balls alone
        limits = limits._replace(width=0.0)
    pressure: float | None = None
    with suppress(InputError):  # the stress of some lattices is not a pressure
        pressure = packing.pressure_per_force
    return {
        "schema": PAGE_SCHEMA,
        "lattice": describe_lattice(packing, path or BandPath.default(structure)),
        "balls": _describe_balls(packing),
        "pressure": pressure,
        "units": structure.units_of(("pressure", "modulus")),
        "media": tables,
        "limits": {
            "force": [limits.least_force, limits.most_force],
            "width": limits.width if has_width_slider else 0.0,
            "eta": limits.slip,
            "rolling": limits.rolling,
        },
        "direction": direction_of_page,
        "start": {
            "force": forces[0],
            "width": packing.width if has_width_slider else 0.0,
            "eta": packing.mindlin_ratio,
            "torsion": torsion,
            "mindlin": packing.torsion == MINDLIN,
            "bending": packing.bending,
            "overlap": bool(finite_overlap),
            "motions": packing.named_motions.name,
        },
        "remarks": [*remarks, *notes],
        "losses": _describe_losses(losses),
    }


def _describe_balls(packing: Packing) -> dict[str, Any]:
    """Return the numbers of the balls of a packing, SI, by name, with "spread", the word for the
    shape of the distribution of diameters that the slider of the width changes.
    """
    material = packing.material
    return {
        "diameter": packing.diameter,
        "mass": packing.mass,
        "coefficient": packing.law.coefficient,
        "power": EXPONENT,
        "shear_modulus": material.shear_modulus,
        "density": packing.effective_density,
        "mindlin_ratio": material.mindlin_ratio,
        "spread": choose_spread(packing).kind,
    }


class _Limits(NamedTuple):
    """The ends of the sliders of a page.

    Attributes
    ----------
    least_force, most_force : of a contact, N.
    width : largest width of the distribution of diameters, m.
    slip : largest eta.
    rolling : largest torsion and bending, over k d^2.
    """

    least_force: float
    most_force: float
    width: float
    slip: float
    rolling: float

    @classmethod
    def of(cls, packing: Packing, forces: Sequence[float], torsion: float) -> _Limits:
        """Return the ends for a packing.

        ``forces`` are the contact forces, N, of :func:`_find_forces`: first that at the first load
        of the scene, and among them the least and the greatest; ``torsion``, over k d^2, is that of
        a contact at the first load.
        """
        law = packing.law
        # the slider of the force ends at a multiple of the greatest force, at the latest where the
        # overlap is largest, unless the scene's own forces are beyond
        largest_force = max(float(law.force(_MOST_OVERLAP * packing.diameter)), max(forces))
        # the slider of the width ends where f* of the first load falls to _LEAST_REDUCED_FORCE, but
        # not below a multiple of the packing's width, nor above a part of the diameter
        width_at_first_load = float(law.overlap(forces[0] / _LEAST_REDUCED_FORCE))
        largest_width = max(width_at_first_load, _WIDTH_RATIO * packing.width)
        return cls(
            least_force=_LEAST_FORCE_RATIO * min(forces),
            most_force=min(_MOST_FORCE_RATIO * max(forces), largest_force),
            width=min(largest_width, _MOST_WIDTH * packing.diameter),
            slip=max(_MOST_SLIP, packing.mindlin_ratio),
            rolling=max(_MOST_ROLLING, _ROLLING_RATIO * packing.bending, _ROLLING_RATIO * torsion),
        )


def _choose_media(
    packing: Packing, media: Sequence[MediumChoice], load: Load
) -> tuple[list[MediumChoice], list[str]]:
    """Return the media of a page, none of which is automatic, and a sentence for each medium that
    takes the place of an automatic one. ``media`` are those of the scene, "ala" if there are none.
    """
    first_load = load.applied.flat[np.array([0])]  # a list of one load
    media_of_page = []
    notes = []
    for choice in list(dict.fromkeys(media)) or [MediumChoice("ala")]:
        medium = choice.choose(packing, first_load)[0].medium
        if medium != choice:
            words = f"{find_medium(medium.name).words} ({medium.label})"
            notes.append(
                f"At the first load the medium {choice.label} takes the {words}; the page"
                f" keeps it at all loads."
            )
        media_of_page.append(medium)
    return media_of_page, notes


def _find_forces(packing: Packing, medium: MediumChoice, load: Load) -> list[float]:
    """Return the forces of a contact, N, in the ``medium`` at the first, the least and the greatest
    load, in this order; if there are one or two loads, the forces at these loads.
    """
    applied = load.applied
    amounts = applied.flat.array
    if load.size > 2:
        amounts = amounts[[0, np.argmin(load.array), np.argmax(load.array)]]
    forces = []
    for amount in amounts:
        state: Any = medium.of(packing).at(Load(applied.kind, float(amount)))
        forces.append(float(state.force))
    return forces


def _tabulate_media(
    packing: Packing, media: Sequence[MediumChoice], limits: _Limits
) -> list[dict[str, Any]]:
    """Return the table of each of the ``media``, see :func:`tabulate_medium`, within the ``limits``
    of the sliders; a medium that is there twice has one table.

    Raises :class:`MechanismError` if a medium has no table because the lattice is a mechanism, and
    the balls of the packing differ; and what :func:`tabulate_medium` raises.
    """
    # f* is least at the largest width
    least_reduced = limits.least_force / float(packing.law.force(limits.width))
    tables = []
    for medium in dict.fromkeys(media):
        table = tabulate_medium(packing, medium, least_reduced, limits.slip, limits.rolling)
        if table["refusal"] and packing.spread_matters:  # the page would not show the packing
            raise MechanismError(table["refusal"])
        tables.append(table)
    return tables


def read_asset(name: str) -> str:
    """Return the text of a file of the folder ``assets``; ``name`` is its path in the folder, with
    "/" between folders.
    """
    return files("granphon.page").joinpath("assets", *name.split("/")).read_text(encoding="utf-8")


def join_modules(*names: str) -> str:
    """Return the text of modules of the folder ``assets`` and of those that they import, each once
    and after its imports.

    A module begins with its imports, one on a line, and exports by the word ``export``. The joined
    modules share one scope, so that no two modules may define the same name.
    """
    texts: dict[str, str] = {}  # of modules, in the order in which they are joined
    names_met: set[str] = set()

    def add_module(name: str) -> None:
        """Add the text of a module to ``texts``, after those of its imports; a module that has been
        met before is not added again.
        """
        if name in names_met:
            return
        names_met.add(name)
        text = read_asset(f"{name}.js")
        for imported in _IMPORT.findall(text):
            add_module(imported)
        without_imports = _IMPORT.sub("", text)
        texts[name] = re.sub(r"^export ", "", without_imports, flags=re.MULTILINE)

    for name in names:
        add_module(name)
    return "\n".join(texts.values())


def wrap_three() -> str:
    """Return three.js as a script that defines the object ``THREE``.

    The library consists of two modules. Each becomes the body of a function that returns the
    exports of the module; the second function takes the exports of the first module, the core, as
    its argument.
    """

    def import_from_core(match: re.Match[str]) -> str:
        """Return the statement that takes the imported names from the argument ``core``."""
        members = match[1].replace(" as ", ":")
        return f"const{{{members}}}=core;"

    def return_core(match: re.Match[str]) -> str:
        """Return the statement that returns the exports of the core."""
        return f"return{{{_write_members(match[1])}}};"

    def return_all(match: re.Match[str]) -> str:
        """Return the statement that returns the exports of the core and of the second module."""
        return f"return{{...core,{_write_members(match[1])}}};"

    core = _EXPORT.sub(return_core, read_asset("vendor/three.core.min.js"))
    module = _IMPORT_OF_FILE.sub(import_from_core, read_asset("vendor/three.module.min.js"))
    module = _EXPORT_OF_FILE.sub("", module)
    module = _EXPORT.sub(return_all, module)
    return f"const THREE=((core)=>{{{module}}})((()=>{{{core}}})());"


def _write_members(names: str) -> str:
    """Return the names of an export as members of an object: "a as B,C" becomes "B:a,C"."""
    pairs = (name.split(" as ") for name in names.split(","))
    return ",".join(pair[0] if len(pair) == 1 else f"{pair[1]}:{pair[0]}" for pair in pairs)


def fill_template(data: dict[str, Any], title: str) -> str:
    """Return the text of a page with this ``title``, HTML, which holds the libraries, the program,
    and the ``data`` as JSON. ValueError for a number in ``data`` that is not finite.
    """
    licences = [read_asset(f"vendor/{name}.LICENSE").strip() for name in ("plotly", "three")]
    json_text = json.dumps(data, allow_nan=False, separators=(",", ":"))
    texts = {
        "title": escape(title, quote=False),
        "style": read_asset("style.css"),
        "licences": "\n\n".join(licences),
        "plotly": read_asset("vendor/plotly-basic.min.js"),
        "three": wrap_three(),
        # "<" would end the element, as "</script>"; JSON reads \u003c as the same character
        "data": json_text.replace("<", "\\u003c"),
        "program": join_modules("main"),
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda match: texts[match[1]], read_asset("template.html"))
