"""The catalogue of observables: for each quantity its name, SI unit and description, and the
function that finds it.

Sweeps, summaries, figures, the command line and the reference read this catalogue. An observable of
granphon is one entry here and its function; others come by :func:`register_observable`.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from inspect import getattr_static
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from granphon.balls.on_site import ON_SITE, find_unit
from granphon.balls.packing import SWEEP_PARAMETERS
from granphon.base.errors import InputError, brief, one_line
from granphon.base.quantities import is_si
from granphon.base.registry import Registry
from granphon.base.text import spell
from granphon.base.validation import find_unit_of, one_of, real_numbers, require, truth
from granphon.media.array_options import SAMPLE_UNITS
from granphon.media.state import ContactState
from granphon.observables.validity import Validity, validity
from granphon.observables.velocities import (
    Moduli,
    SoundVelocities,
    local_exponent,
    moduli,
    sound_velocities,
)

if TYPE_CHECKING:
    from granphon.media.arrangement import Balls

#: units of the attributes of simulated states, which have those of all states of packings, and
#: those of samples
_STATE_UNITS = {**ContactState.units, **SAMPLE_UNITS}
#: what must be worked out to find an observable, in the order of the names below: nothing beyond
#: the packing; the state; the long waves of the state; its long waves at neighbouring loads, for
#: which a simulation solves two more equilibria; a pulse through each sample; the spectral
#: functions of each sample; its density of states; bands along a given path; the waves of an edge;
#: the edges of gaps in the zone; the lowest and highest frequencies of branches in the zone; the
#: frequencies at which branches begin; derivatives by the parameters; or the network of the state,
#: with its modes and its response to a drive
CostClass = Literal[
    "packing",
    "state",
    "velocities",
    "exponent",
    "pulse",
    "spectrum",
    "dos",
    "bands",
    "surface",
    "gaps",
    "cutoffs",
    "onsets",
    "sensitivities",
    "network",
]
#: costs of the observables of the waves in simulated arrays, at edges, in the zone, and in networks
WAVE_COSTS: tuple[CostClass, ...] = (
    "pulse",
    "spectrum",
    "dos",
    "surface",
    "gaps",
    "cutoffs",
    "onsets",
    "sensitivities",
    "network",
)
#: keys of summary.yaml that no registered observable can have as its name: the outputs of granphon,
#: or the writer of the summary, have them for something else
SUMMARY_KEYS = frozenset({
    "schema", "versions", "source", "observe", "finite_overlap", "medium", "sizes", "states",
    "peaks", "matters_most", "design", "local_field", "errors_from", "ok", "validity", "warnings",
    "files", "units",
})  # fmt: skip
#: first words of labels that keep their capital within a sentence
_CAPITAL_WORDS = ("Young", "Poisson", "Q")


@dataclass(frozen=True)
class Analysis:
    """A state, with the results that several observables share. Each result is found once, and only
    when it is needed.

    Attributes
    ----------
    state : the state of a packing, a sample or a crystal, at one load or many.
    direction : that of the velocities, Cartesian, (p,) for a lattice with p periods, or (n, p) for
        many; None for x.
    failed : by the names of registered observables, why their values could not be found, or at how
        many loads the values are nan; :func:`find_all` fills it.
    """

    state: ContactState
    direction: ArrayLike | None = None
    failed: dict[str, str] = field(default_factory=dict)

    @cached_property
    def validity(self) -> Validity:
        """The conditions under which the model holds."""
        return validity(self.state)

    @cached_property
    def velocities(self) -> SoundVelocities:
        """Sound velocities along the direction, m/s; raises what
        :func:`~granphon.observables.velocities.sound_velocities` raises.
        """
        direction = self.direction
        if direction is None:
            periods = self.state.packing.structure.periods
            direction = np.eye(periods)[0]  # x
        return sound_velocities(self.state, direction)

    @cached_property
    def moduli(self) -> Moduli | None:
        """Elastic moduli; None if the balls do not move along the lattice, or springs to the ground
        resist their rotations. Raises what :func:`~granphon.observables.velocities.moduli` raises.
        """
        has_stress = self.state.reference_lattice.has_symmetric_stress
        if not has_stress or "longitudinal" not in self.state.wave_names:
            return None
        return moduli(self.state)


@dataclass(frozen=True)
class Observable:
    """A quantity that files, tables and figures show, with its name, unit and description.

    Attributes
    ----------
    name : its name in files, data sets and summaries.
    unit : SI unit; "1" for a number without a unit, "" for a quantity that is not a number, or a
        number whose unit nobody gave. Where ``per_dimension`` names a quantity of
        :meth:`Lattice.units_of`, this is the unit in the plane; :func:`entry_of` has that of a
        packing.
    title : a phrase that says what the quantity is; ``long_name`` in data sets.
    label : the name on an axis and in the terminal, without the unit; by default the name in words.
    meaning : the description in the reference; by default the title.
    find : function that returns the value, with the shape of the load followed by ``dims``, or None
        if the state has no such quantity. Instead of a function it is None for a quantity that
        cannot be found from a state alone.
    cost : what must be worked out to find it.
    dims : names of its dimensions besides those of loads, media and parameters.
    swept : whether sweeps store it.
    sampled : whether it is a standard error over samples, which is zero for a medium that does not
        sample.
    per_direction : whether it has a value for each direction of sound, if there are many.
    told : whether the command line prints it, and the summary of several states has its least and
        its greatest value.
    digits : significant digits with which it is printed.
    zero : what is printed in the place of zero, such as "none"; by default the number.
    per_dimension : "pressure", "effective_density" or "modulus", by which the unit depends on the
        number of periods.
    """

    name: str
    unit: str
    title: str
    label: str = ""
    meaning: str = ""
    find: Callable[[Analysis], Any] | None = None
    cost: CostClass = "state"
    dims: tuple[str, ...] = ()
    swept: bool = True
    sampled: bool = False
    per_direction: bool = False
    told: bool = False
    digits: int = 5
    zero: str = ""
    per_dimension: str = ""

    def __post_init__(self) -> None:
        """Put the defaults in place of an empty label and an empty meaning."""
        if not self.label:
            object.__setattr__(self, "label", _write_words(self.name))
        if not self.meaning:
            object.__setattr__(self, "meaning", self.title)

    @property
    def words(self) -> str:
        """The name within a sentence or a table: the label, or the title if the label has a
        formula. The first letter is small, except in the words Young, Poisson and Q.
        """
        if "$" in self.label:
            return self.title
        if self.label.split()[0] in _CAPITAL_WORDS:
            return self.label
        return self.label[:1].lower() + self.label[1:]


def _write_words(name: str) -> str:
    """Return a name as the label of an axis: words, the first with a capital letter.

    A parameter of a kind of balls, "A.density", is "Density of A". The stiffness "on_site" is
    "Springs to the ground", and that of one motion, "on_site.x", is "Springs to the ground, x".
    """
    kind, _, parameter = name.rpartition(".")
    words = spell(parameter)
    if name == ON_SITE:
        return "Springs to the ground"
    if kind == ON_SITE:
        return f"Springs to the ground, {words}"
    words = words.capitalize()
    return f"{words} of {kind}" if kind else words


def _suppress_input_error(find: Callable[[Analysis], Any]) -> Callable[[Analysis], Any]:
    """Return a function that finds the quantity of ``find``, and returns None where ``find`` raises
    :class:`InputError`, for whatever reason: it is for quantities that some states do not have.
    """

    def find_or_none(analysis: Analysis) -> Any:
        """Return the value of the quantity, or None where ``find`` raises InputError."""
        with suppress(InputError):
            return find(analysis)
        return None

    return find_or_none


def _find_direction(analysis: Analysis) -> Any:
    """Return the direction of propagation, a unit vector (p,) or (n, p); None if the direction is x
    alone, (p,), and the velocities are the same in all directions.
    """
    direction = analysis.velocities.direction
    x = np.eye(direction.shape[-1])[0]
    is_x = np.array_equal(direction, x)
    return None if analysis.state.is_isotropic and is_x else direction


def _exclude_finite_overlap(find: Callable[[ContactState], Any]) -> Callable[[Analysis], Any]:
    """Return a function of an analysis that finds the exponent of its state, or its error, by
    ``find``; None for states of a contact law with finite overlap.

    :func:`local_exponent` leaves out the terms of finite overlap that the velocities of such a
    state have. Simulated samples have these terms in both.
    """

    def find_unless_finite(analysis: Analysis) -> Any:
        """Return what ``find`` returns for the state, or None."""
        state = analysis.state
        if state.finite_overlap and not state.n_samples:
            return None
        return find(state)

    return find_unless_finite


def _make_state_entry(name: str, title: str, **fields: Any) -> Observable:
    """Make the entry of the attribute ``name`` of the state, with a ``title`` and ``fields`` of
    :class:`Observable`; its value is None for states that do not have the attribute.

    The unit is that of simulated states, which have the attributes of all states of packings and
    those of samples.
    """

    def find(analysis: Analysis) -> Any:
        """Return the attribute of the state, or None."""
        state = analysis.state
        # looked up without a call, so that an AttributeError inside a property is not hidden; an
        # attribute that a class sets to None is one that its states do not have
        has_attribute = getattr_static(state, name, None) is not None
        return getattr(state, name) if has_attribute else None

    return Observable(name, _STATE_UNITS[name], title, find=find, **fields)


def _make_velocity_entry(name: str, title: str, **fields: Any) -> Observable:
    """Make the entry of the attribute ``name`` of the sound velocities, with a ``title`` and
    ``fields`` of :class:`Observable`; its value is None if there is no such wave.

    Where there are two transverse waves, the value of "transverse", which would hold both, is None,
    as is that of its error: each of the two waves has an entry of its own.
    """
    may_hold_two_waves = name in ("transverse", "transverse_error")

    def find(analysis: Analysis) -> Any:
        """Return the attribute of the velocities, m/s, or None."""
        has_two_waves = analysis.velocities.transverse_slow is not None
        if may_hold_two_waves and has_two_waves:
            return None
        return getattr(analysis.velocities, name)

    return Observable(
        name, "m/s", title, cost="velocities", per_direction=True, find=find, **fields
    )


def _make_modulus_entry(name: str, title: str, **fields: Any) -> Observable:
    """Make the entry of the attribute ``name`` of the moduli, a modulus or its standard error, with
    a ``title`` and ``fields`` of :class:`Observable`; its value is None if the lattice has
    no such modulus, and that of an error if there are fewer than two samples.
    """
    modulus_name = name.removesuffix("_error")

    def find(analysis: Analysis) -> Any:
        """Return the attribute of the moduli, None if there are no moduli or no error; InputError
        if the lattice has no such modulus.
        """
        moduli = analysis.moduli
        if moduli is None:
            return None
        getattr(moduli, modulus_name)  # raises InputError also where an error is asked for
        return getattr(moduli, name)

    return Observable(
        name,
        Moduli.units[name],
        title,
        find=_suppress_input_error(find),
        cost="velocities",
        per_dimension="modulus",
        **fields,
    )


def _make_load_error_entry(name: str, title: str) -> Observable:
    """Make the entry of the standard error over samples of ``name``, "force" or "overlap", with a
    ``title``; its value is None where all samples have the same force, or the same overlap, and of
    fewer than two samples.
    """
    error_name = f"{name}_error"
    return Observable(
        error_name,
        _STATE_UNITS[name],
        title,
        find=lambda analysis: analysis.state.mean_errors.get(error_name),
        swept=False,
    )


def _make_cubic_entry(name: str, title: str, **fields: Any) -> Observable:
    """Make the entry of the pure number ``name`` of the moduli of a square or cubic lattice, with a
    ``title`` and ``fields`` of :class:`Observable`; its value is None for another lattice.
    """

    def find(analysis: Analysis) -> Any:
        """Return the attribute of the moduli, or None."""
        moduli = analysis.moduli
        is_cubic = moduli is not None and moduli.cubic
        return getattr(moduli, name) if is_cubic else None

    return Observable(name, "1", title, find=find, cost="velocities", **fields)


# of a packing
_of_packing = partial(Observable, cost="packing", swept=False)
# of a density of states
_of_dos = partial(Observable, cost="dos", dims=("node",))
# of each plane wave in the spectrum of samples
_of_line = partial(Observable, cost="spectrum", dims=("polarisation", "wavevector"))
# of a network: one number; at each frequency of a drive; all peaks of a response; its highest peak
_of_network = partial(Observable, cost="network")
_of_response = partial(_of_network, dims=("response_frequency", "receiver"))
_of_peaks = partial(_of_network, dims=("receiver", "response_peak"))
_of_peak = partial(_of_network, told=True, digits=7)
# of the modes of networks
_of_modes = partial(_of_network, dims=("mode",))
# of bands along a path
_of_bands = partial(Observable, cost="bands", dims=("segment", "point", "branch"))
_OVER_SAMPLES = "standard error over samples of the"
_LAYER = "of the layer taken one diameter thick"
#: energies of a motion, and what they are
_ENERGIES = (
    ("translation", "kinetic energy of translations"),
    ("rotation", "kinetic energy of rotations"),
    ("stored", "energy that contacts and the load have gained"),
    ("lost", "energy lost by friction and dashpots"),
    ("supplied", "energy that impacts and drives have supplied"),
)
#: responses in frequency, with their units, and what they are
_RESPONSES = (
    ("receptance", "m/N", "displacement over the force"),
    ("mobility", "m/(N s)", "velocity over the force"),
    ("accelerance", "1/kg", "acceleration over the force"),
    ("force_transmissibility", "1", "force of contacts over that of the source"),
    ("transmissibility", "1", "displacement over that of a wall"),
    ("dynamic_stiffness", "N/m", "force of contacts over the displacement of a wall"),
)
#: parameters of packings over which sweeps run, each with its description; they are given, and need
#: no function
_PARAMETERS = {
    "young_modulus": "Young modulus of the material",
    "poisson_ratio": "Poisson ratio of the material",
    "density": "density of the material",
    "diameter": "mean diameter",
    "friction": "whether contacts resist shear",
    "spread": "distribution of diameters",
    "lattice": "lattice of the contacts",
    "motions": "motions of the balls",
    "torsion": "stiffness of a contact against twist, over k d^2",
    "bending": "stiffness of a contact against rolling, over k d^2",
    "on_site": "stiffness of springs to the ground",
    "damping": "viscosity of a contact over its stiffness",
    "loss_factor": "loss factor of a contact",
    "drag": "drag of balls",
    "dashpot": "viscosity of a contact",
    "restitution": "restitution of a collision",
    "tangential_damping": "viscosity over stiffness, but of normal motion",
    "tangential_loss_factor": "loss factor of a contact, but of normal motion",
    "rotational_drag": "drag of rotations",
    "tangential_dashpot": "viscosity of a contact in slip",
}
_OBSERVABLES = (
    _make_state_entry("force", "mean contact force", label="Contact force", told=True),
    _make_state_entry(
        "overlap",
        "mean overlap, d - a",
        meaning="mean overlap d - a, the state variable",
        told=True,
    ),
    _make_state_entry("normal_stiffness", "normal stiffness of a contact"),
    _make_state_entry("shear_stiffness", "shear stiffness of a contact"),
    Observable(
        "pressure",
        _STATE_UNITS["pressure"],
        "force per length of boundary",
        per_dimension="pressure",
        find=_suppress_input_error(lambda analysis: analysis.state.pressure),
    ),
    Observable(
        "stress",
        "N/m",
        "size of the stress: its largest component",
        per_dimension="pressure",
        cost="packing",
    ),
    Observable("strain", "1", "size of the strain: its largest component", cost="packing"),
    _make_state_entry("relative_overlap", "overlap over the mean diameter"),
    _make_state_entry("effective_density", f"density {_LAYER}", per_dimension="effective_density"),
    _make_state_entry(
        "reduced_force",
        "reduced force f*: the force over that at an overlap of the width",
        label="Force f*",
    ),
    _make_state_entry("reduced_spacing", "reduced spacing a* = (d + W/2 - a)/W"),
    _make_state_entry(
        "force_fluctuation",
        "rms over balls of the mean force of a ball's contacts, over the mean",
        label="Force fluctuation Δf/f",
    ),
    _make_state_entry(
        "contact_fraction",
        "fraction of contacts that carry load, in a simulation more than 1e-6 of the mean force",
        label="Fraction of contacts",
    ),
    _make_state_entry(
        "stiffness_ratio",
        "normal stiffness over that of the ideal lattice at the same force",
        label="k over the ideal lattice's",
    ),
    _make_state_entry("valid", "whether the load is within the range of the medium"),
    _make_state_entry(
        "contact_force_fluctuation",
        "rms difference of single contact forces from the mean, over the mean",
    ),
    _make_state_entry(
        "sliding_fraction",
        "part of the contacts that carry load which slide",
        label="Sliding contacts",
    ),
    _make_state_entry(
        "tangential_ratio",
        "mean tangential force over the mean normal force",
        label="Tangential over normal force",
    ),
    _make_state_entry(
        "work", "work of the load since the start of a history, a mean over contacts"
    ),
    _make_state_entry(
        "dissipated_energy", "energy lost since the start of a history, a mean over contacts"
    ),
    Observable(
        "regime", "", "pressure regime of Section III", find=lambda analysis: analysis.state.regime
    ),
    _make_load_error_entry("force", f"{_OVER_SAMPLES} force, at a given overlap"),
    _make_load_error_entry("overlap", f"{_OVER_SAMPLES} overlap, at a given force or pressure"),
    _of_packing(
        "width",
        "m",
        "width W of the distribution of diameters",
        find=lambda analysis: analysis.state.packing.width,
        meaning="width W: √12 times the standard deviation of the diameters",
    ),
    _of_packing(
        "mindlin_ratio",
        "1",
        "shear over normal stiffness η; 0 without friction",
        find=lambda analysis: analysis.state.packing.mindlin_ratio,
    ),
    _of_packing(
        "mass",
        "kg",
        "mass of a ball of the mean diameter",
        find=lambda analysis: analysis.state.packing.mass,
    ),
    _make_velocity_entry(
        "longitudinal", "longitudinal sound velocity", label="Longitudinal velocity", told=True
    ),
    _make_velocity_entry(
        "transverse", "transverse sound velocity", label="Transverse velocity", told=True
    ),
    _make_velocity_entry(
        "transverse_slow",
        "slow transverse sound velocity",
        label="Slow transverse velocity",
        told=True,
    ),
    _make_velocity_entry(
        "transverse_fast",
        "fast transverse sound velocity",
        label="Fast transverse velocity",
        told=True,
    ),
    _make_velocity_entry(
        "out_of_plane", "sound velocity across the plane of the balls, 0 of a flexural wave"
    ),
    _make_velocity_entry(
        "twist",
        "velocity of the twist wave of a chain",
        label="Twist velocity",
        told=True,
        meaning="velocity of the wave in which the balls of a chain turn about it",
    ),
    _make_modulus_entry("bulk", f"bulk modulus {_LAYER}", label="Bulk modulus", told=True),
    _make_modulus_entry("shear", f"shear modulus {_LAYER}", label="Shear modulus", told=True),
    Observable(
        "direction",
        "1",
        "Cartesian direction of propagation, if velocities depend on it or it is not x",
        find=_find_direction,
        cost="velocities",
        swept=False,
    ),
    _make_modulus_entry(
        "tensor", f"elastic tensor {_LAYER}, Voigt order", dims=("voigt_row", "voigt_column")
    ),
    *(
        _make_velocity_entry(
            f"{words.replace(' ', '_')}_error",
            f"{_OVER_SAMPLES} {title} sound velocity",
            sampled=True,
        )
        for words, title in (
            ("longitudinal", "longitudinal"),
            ("transverse", "transverse"),
            ("transverse slow", "slow transverse"),
            ("transverse fast", "fast transverse"),
        )
    ),
    _make_modulus_entry("bulk_error", f"{_OVER_SAMPLES} bulk modulus", sampled=True),
    _make_modulus_entry("shear_error", f"{_OVER_SAMPLES} shear modulus", sampled=True),
    _make_cubic_entry(
        "anisotropy",
        "anisotropy 2 C44/(C11 - C12) of a cubic lattice, 2 C33/(C11 - C12) of a square one",
    ),
    _make_cubic_entry("anisotropy_error", f"{_OVER_SAMPLES} anisotropy", sampled=True),
    _make_modulus_entry(
        "tensor_error",
        f"{_OVER_SAMPLES} entries of the elastic tensor",
        sampled=True,
        dims=("voigt_row", "voigt_column"),
    ),
    Observable(
        "exponent",
        "1",
        "local exponent of the sound velocities, d log v / d log P",
        label="d log $v_L$ / d log $P$",
        meaning="local exponent d log v_L / d log P",
        find=_suppress_input_error(_exclude_finite_overlap(local_exponent)),
        cost="exponent",
    ),
    Observable(
        "exponent_error",
        "1",
        f"{_OVER_SAMPLES} exponent",
        find=_exclude_finite_overlap(lambda state: state.exponent_error),
        cost="exponent",
        meaning=f"{_OVER_SAMPLES} exponent; 0 for media that do not sample, nan for one sample",
    ),
    Observable(
        "pulse_velocity",
        "m/s",
        "distance over the time of flight of a pulse",
        cost="pulse",
        told=True,
    ),
    Observable(
        "pulse_velocity_error",
        "m/s",
        f"{_OVER_SAMPLES} velocity of a pulse",
        cost="pulse",
        sampled=True,
    ),
    Observable(
        "pulse_distance",
        "m",
        "distance from the source of a pulse to where it is heard",
        cost="pulse",
        swept=False,
    ),
    Observable(
        "time_of_flight", "s", "time of flight of a pulse by its envelope", cost="pulse", told=True
    ),
    Observable(
        "coherent_fraction",
        "1",
        "part of the energy of a pulse that is coherent",
        cost="pulse",
        told=True,
    ),
    Observable(
        "path_corners",
        "1/m",
        "distances along the path of its corners",
        cost="spectrum",
        dims=("corner_of_path",),
    ),
    Observable(
        "path_distance",
        "1/m",
        "distance of a wave vector along the path",
        cost="spectrum",
        dims=("wavevector",),
    ),
    Observable(
        "wavenumber",
        "1/m",
        "length of a wave vector of the array",
        cost="spectrum",
        dims=("wavevector",),
    ),
    _of_line(
        "line_frequency",
        "Hz",
        "frequency of a plane wave in the array: the peak of its spectral function",
    ),
    _of_line(
        "line_frequency_error", "Hz", f"{_OVER_SAMPLES} frequency of a plane wave", sampled=True
    ),
    _of_line(
        "line_width",
        "Hz",
        "width of the line of a plane wave: full, at half maximum, without the kernel's",
    ),
    _of_line("line_width_error", "Hz", f"{_OVER_SAMPLES} width of a line", sampled=True),
    _of_line("line_resolved", "1", "part of the samples in which the width of a line is resolved"),
    _of_line("phase_velocity", "m/s", "phase velocity of a plane wave in the array"),
    _of_line("phase_velocity_error", "m/s", f"{_OVER_SAMPLES} phase velocity", sampled=True),
    _of_line(
        "mean_free_path",
        "m",
        "mean free path of the energy of a plane wave; infinite where its line has no width",
    ),
    _of_line("attenuation", "1/m", "attenuation of the amplitude of a plane wave"),
    _of_line("attenuation_error", "1/m", f"{_OVER_SAMPLES} attenuation", sampled=True),
    *(
        Observable(
            f"ioffe_regel_{name}{ending}",
            "Hz",
            f"{of}Ioffe-Regel frequency of {name} waves",
            cost="spectrum",
            sampled=bool(ending),
            told=not ending,
        )
        for name in ("longitudinal", "transverse", "rotational")
        for ending, of in (("", ""), ("_error", f"{_OVER_SAMPLES} "))
    ),
    _of_dos("dos_frequency", "Hz", "frequencies of the density of states of the array"),
    _of_dos("dos_total", "1/Hz", "density of states of the array, per ball that moves"),
    _of_dos("dos_translational", "1/Hz", "part of the density of states in translations"),
    _of_dos("dos_rotational", "1/Hz", "part of the density of states in rotations"),
    _of_dos(
        "dos_error",
        "1/Hz",
        f"{_OVER_SAMPLES} density of states; of one sample that of the random vectors",
    ),
    Observable(
        "surface_velocity",
        "m/s",
        "velocity of the long wave at the edge, along the first leg of the path",
        label="Surface velocity",
        cost="surface",
        told=True,
    ),
    Observable(
        "surface_distance",
        "1",
        "distance along the path of the edge over 2 pi, in units of 1/d",
        cost="surface",
        dims=("surface_point",),
    ),
    Observable(
        "surface_qpoint",
        "1",
        "wave vectors along the edge, fractions of the reciprocal cell of a layer",
        cost="surface",
        dims=("surface_point", "fraction"),
    ),
    Observable(
        "surface_frequency",
        "Hz",
        "frequencies of the undamped waves of the edge along the path, nan beyond these",
        cost="surface",
        dims=("surface_point", "surface_wave"),
    ),
    Observable(
        "surface_weight",
        "1",
        "part of the kinetic energy of each of these waves in the outer layers, nan beyond them",
        cost="surface",
        dims=("surface_point", "surface_wave"),
    ),
    *(
        _of_response(
            f"{name}{ending}", unit, f"{of}{title} at each frequency", sampled=bool(ending)
        )
        for name, unit, title in _RESPONSES
        for ending, of in (("", "magnitude of the "), ("_error", f"{_OVER_SAMPLES} "))
    ),
    _of_response(
        "response_phase", "rad", "phase of the response, below zero where the receiver lags"
    ),
    _of_peaks(
        "peaks_frequency",
        "Hz",
        "frequencies of the peaks of the response at each receiver, nan beyond these",
    ),
    *(
        _of_peaks(
            f"peaks_{name}",
            unit,
            f"{title} at these peaks, nan if narrower than the step of the frequencies",
        )
        for name, unit, title in _RESPONSES
    ),
    _of_peaks("peaks_quality", "1", "Q factors of these peaks; nan of those that are not resolved"),
    _of_peak(
        "peak_frequency",
        "Hz",
        "frequency of the highest peak of the response at the first receiver",
    ),
    *(
        _of_peak(f"peak_{name}", unit, f"{title} at its highest peak, at the first receiver")
        for name, unit, title in _RESPONSES
    ),
    _of_peak(
        "peak_quality",
        "1",
        "Q factor of that peak, of its width at half the square; nan if it does not fall so low",
        label="Q of the peak",
    ),
    _of_network(
        "front_velocity",
        "m/s",
        "velocity of the front of a motion, where forces have changed by half of what they ever do",
        told=True,
    ),
    _of_network(
        "peak_velocity",
        "m/s",
        "velocity of the greatest force of a motion between contacts",
        told=True,
    ),
    _of_network("greatest_force", "N", "greatest normal force of a contact in a motion", told=True),
    *(
        _of_network(
            f"{name}_error",
            unit,
            f"{_OVER_SAMPLES} {name.replace('_', ' ')} of a motion",
            sampled=True,
        )
        for name, unit in (
            ("front_velocity", "m/s"),
            ("peak_velocity", "m/s"),
            ("greatest_force", "N"),
        )
    ),
    *(
        _of_network(
            f"energy_{name}",
            "J",
            f"{title} at the end of a motion",
            label="Energy lost" if name == "lost" else "",
            told=name == "lost",
        )
        for name, title in _ENERGIES
    ),
    *(
        _of_network(f"motion_{name}", "J", f"{title} over time", dims=("motion_time",))
        for name, title in (("kinetic", "kinetic energy"), *_ENERGIES)
    ),
    _of_network(
        "motion_force", "N", "greatest normal force of a contact over time", dims=("motion_time",)
    ),
    _of_modes("mode_frequency", "Hz", "frequencies of the lowest modes that cost energy"),
    _of_modes(
        "mode_frequency_error", "Hz", f"{_OVER_SAMPLES} frequencies of these modes", sampled=True
    ),
    _of_modes(
        "mode_participation",
        "1",
        "participation ratio of these modes: part of the balls that move, of equal energies",
    ),
    _of_modes("mode_rotation", "1", "part of the kinetic energy of these modes in rotations"),
    Observable("choice", "", "medium that the automatic medium chose"),
    Observable("expected_error", "1", "expected relative error of velocities and frequencies"),
    Observable("truth", "", "simulated arrays that the expected error is relative to", swept=False),
    _of_bands("frequencies", "Hz", "frequencies of the branches, in ascending order"),
    _of_bands("damped_frequency", "Hz", "frequencies of the branches of contacts that lose energy"),
    _of_bands("damped_decay", "1/s", "rates at which the amplitudes of these branches decay"),
    _of_bands("damped_quality", "1", "Q factors of these branches, infinite without loss"),
    Observable(
        "gaps",
        "Hz",
        "intervals from zero to the top frequency without a branch",
        cost="bands",
        swept=False,
    ),
    *(
        Observable(
            f"cutoff_{edge}",
            "Hz",
            f"{which} frequencies of the branches in the whole zone",
            cost="cutoffs",
            dims=("branch",),
        )
        for edge, which in (("lower", "lowest"), ("upper", "highest"))
    ),
    Observable(
        "onset_frequency",
        "Hz",
        "cut-off frequencies at which the branches begin, at Gamma",
        cost="onsets",
        dims=("branch",),
    ),
    Observable(
        "onset_curvature",
        "m^2/s",
        "curvatures d^2 omega/dq^2 of the branches at Gamma",
        cost="onsets",
        dims=("branch",),
    ),
    Observable(
        "onset_gap",
        "Hz",
        "the lowest frequency of all branches, below which nothing passes; zero without a gap",
        label="Gap below all branches",
        cost="onsets",
        told=True,
        zero="none",
    ),
    *(
        Observable(
            f"gap_{edge}",
            "Hz",
            f"{edge} edges of the gaps by the number of branches below, nan where there is no gap",
            cost="gaps",
            dims=("gap",),
        )
        for edge in ("lower", "upper")
    ),
    Observable(
        "sensitivity",
        "1",
        "logarithmic derivatives of velocities, moduli, cut-off frequencies and waves of an edge by"
        " the parameters",
        cost="sensitivities",
        dims=("sensitivity_of", "sensitivity_to"),
    ),
    Observable(
        "top_frequency",
        "Hz",
        "the highest frequency of the bands",
        label="Top frequency",
        cost="gaps",
        told=True,
    ),
)
#: every observable and every parameter of a sweep by its name, in the order in which files store
#: them
CATALOGUE: Registry[Observable] = Registry("observable")
for _entry in (
    *_OBSERVABLES,
    *(Observable(name, SWEEP_PARAMETERS[name] or "", title) for name, title in _PARAMETERS.items()),
):
    CATALOGUE.own(_entry.name, _entry)


def register_observable(
    name: str,
    unit: str,
    words: str,
    find: Callable[[Analysis], Any],
    *,
    label: str = "",
    cost: Literal["state", "velocities", "exponent"] = "state",
    told: bool = True,
) -> Observable:
    """Make a quantity known by its name: to sweeps and their tables, summaries, figures, scenes,
    and the command line.

    Parameters
    ----------
    name : its name in files and data sets, a word of letters, digits and underscores that begins
        with no digit.
    unit : its SI unit; "1", or "", for a number without a unit.
    words : what it is, in a few words.
    find : function of an :class:`Analysis` that returns its value, a real number or truth value in
        SI, of the shape of the load; None where there is none.
    label : its name on axes and in the terminal; by default the name in words.
    cost : what ``find`` asks for: only the "state", the "velocities" or moduli, or an "exponent".
        It decides which runs have it: all, or those that find these.
    told : whether the command line prints it, and the summary of several states has its least and
        its greatest value.

    Returns
    -------
    The entry of the quantity. A scene that names the quantity in ``observe`` finds what ``cost``
    asks for. Where ``find`` fails, or returns what is no real number of the shape of the load, the
    result leaves the quantity out with a warning that names it; if a scene observes the quantity,
    the failure is an error.

    Raises
    ------
    InputError : a name that another ``find`` has, that data sets, summaries or scenes have for
        something else, or that is no such word; a unit that is not SI; ``words`` or a ``label``
        that are no text, or blank; another ``cost``; a ``find`` that cannot be called; a ``told``
        that is no truth value.
    """
    # of each text: its value, the condition that it meets, and that condition in words
    requirements: dict[str, tuple[Any, Callable[[str], bool], str]] = {
        "name": (
            name,
            lambda word: is_free(word) and word not in SUMMARY_KEYS,
            "a word of letters, digits and underscores that scenes, summaries and data sets do not"
            " have yet",
        ),
        "unit": (unit, is_si, 'a unit of SI without a factor, such as "N/m", or "1"'),
        "words": (words, _is_not_blank, "a text"),
    }
    if label != "":
        requirements["label"] = (label, _is_not_blank, "a text")
    for argument, (value, is_allowed, allowed) in requirements.items():
        if not (isinstance(value, str) and is_allowed(value)):
            raise InputError(
                f"an observable cannot have the {argument} {brief(value)}", mend=f"Give {allowed}"
            )
    one_of("cost", cost, ("state", "velocities", "exponent"))
    require("told", truth, told)
    if not callable(find):
        raise InputError(
            f"{brief(find)} finds no observable", mend="Give a function of an Analysis"
        )
    entry = Observable(name, unit, words, label, find=find, cost=cost, told=told)
    return CATALOGUE.add(name, entry, find)


def _is_not_blank(text: str) -> bool:
    """Return whether a text has more than white space."""
    return bool(text.strip())


def is_free(name: str) -> bool:
    """Return whether a new observable may have this name: it must be an identifier, and neither a
    dimension of data sets nor what a scene may ask for, such as "bands" or a motion, may have the
    name. Whether an observable has it already is not looked at.
    """
    # dimensions of every data set, and what a scene may ask for that is no cost of observables
    reserved = {"load", "medium", "response", "motion", "modes"}
    for entry in _OBSERVABLES:
        reserved |= {entry.cost, *entry.dims}
    return name.isidentifier() and name not in reserved


#: words of titles and meanings that belong to the plane, with those in their place on a line and in
#: space; a phrase stands before the phrases that it contains
_WORDS = {
    "force per length of boundary": ("force along the line", "force per area of boundary"),
    f"density {_LAYER}": ("mass per length", "density of the crystal"),
    f" {_LAYER}": ("", ""),
}


def entry_of(name: str, packing: Balls) -> Observable:
    """Return the entry of an observable with the unit, title and meaning that it has for a packing
    or crystal.

    The units of pressure, density and moduli depend on the number of periods of the lattice: 1, 2
    or 3. A parameter of a kind of ball, "A.diameter", has the entry of the parameter, with the kind
    in its title; the stiffness of springs to the ground of one motion, "on_site.x", has an entry
    of its own, with the unit of the motion. Raises KeyError for a name that the catalogue does not
    have.
    """
    kind, _, parameter = name.rpartition(".")
    if kind == ON_SITE:
        title = f"{CATALOGUE[ON_SITE].title}, {spell(parameter)}"
        return Observable(name, find_unit(parameter), title)
    entry = CATALOGUE[parameter]
    periods = packing.structure.periods
    if kind:
        title = f"{spell(parameter)} of {kind}"
        return replace(entry, name=name, title=title, meaning=title, label=_write_words(name))
    if periods == 2 or not entry.per_dimension:
        return entry
    title = entry.title
    meaning = entry.meaning
    for in_plane, (on_line, in_space) in _WORDS.items():
        replacement = in_space if periods == 3 else on_line
        title = title.replace(in_plane, replacement)
        meaning = meaning.replace(in_plane, replacement)
    units = packing.structure.units_of({entry.per_dimension})
    return replace(entry, unit=units[entry.per_dimension], title=title, meaning=meaning)


def find_all(
    analysis: Analysis,
    costs: Iterable[CostClass],
    swept: bool = False,
    observed: Container[str] = (),
) -> dict[str, Any]:
    """Return the observables of these ``costs`` that the state has, in the order of the costs:
    their values in SI units by name.

    With ``swept`` only those that sweeps store. A registered observable that fails is left out, and
    ``failed`` of the analysis says why; if its name is ``observed``, the failure is an
    :class:`~granphon.base.errors.InputError`. Raises what the velocities and moduli of the analysis
    raise, such as :class:`~granphon.base.errors.MechanismError`.
    """
    values = {}
    added = CATALOGUE.added
    for cost in costs:
        for name, entry in CATALOGUE.items():
            is_requested = entry.cost == cost and (entry.swept or not swept)
            if not is_requested or entry.find is None:
                continue
            if name in added:
                value = _find_registered_value(analysis, entry, observed)
            else:
                value = entry.find(analysis)
            if value is not None:
                values[name] = value
    return values


def _find_registered_value(analysis: Analysis, entry: Observable, observed: Container[str]) -> Any:
    """Return the value of a registered observable, a real number of the shape of the load; None
    where the state has no such value, or where its function fails.

    The failure is written into ``failed`` of the analysis, and so is at how many loads a value is
    nan; if the name is ``observed``, the failure is an :class:`InputError`. For an observable of
    sound, raises what the velocities of the analysis raise.
    """
    if entry.cost != "state":
        # the lattice may be a mechanism: its error is raised here, as an error of the lattice and
        # not of the observable
        _ = analysis.velocities
    assert entry.find is not None
    description = CATALOGUE.describe(entry.name)
    try:
        value = entry.find(analysis)
        if value is None:
            return None
        numbers = _read_numbers(value, np.shape(analysis.state.force))
    except Exception as error:  # the function is the user's, and may raise anything
        fault = f"{description} fails: {type(error).__name__}: {error}"
        if entry.name in observed:
            refusal = InputError(fault, mend="Mend its function, or do not observe it")
            refusal.block = ("observe",)
            raise refusal from error
        analysis.failed[entry.name] = one_line(f"{fault}; it is left out")
        return None
    n_unknown = np.count_nonzero(np.isnan(numbers))
    if n_unknown:
        analysis.failed[entry.name] = (
            f"{description} is not known (nan) at {n_unknown} of {np.size(numbers)} loads"
        )
    return numbers


def _read_numbers(value: Any, shape: tuple[int, ...]) -> Any:
    """Return the ``value`` of a registered observable: a float, or an array of the ``shape`` of the
    load if that is not (). Raises ValueError for another shape, and for what is neither a truth
    value nor what :func:`~granphon.base.validation.real_numbers` takes.
    """
    if np.shape(value) != shape:
        raise ValueError(f"it has the shape {np.shape(value)}, and the load {shape}")
    has_unit_or_mask = find_unit_of(value) is not None or np.ma.isMaskedArray(value)
    is_truth = not has_unit_or_mask and np.asarray(value).dtype == bool
    numbers = np.asarray(value, float) if is_truth else real_numbers(value)
    return numbers if shape else float(numbers)


def axis_label(name: str, unit: str | None = None) -> str:
    """Return the label of an axis: the quantity ``name`` in words, and in brackets its unit, unless
    the quantity has none.

    ``unit`` replaces the unit of the catalogue, as for a file that states its own. A quantity that
    the catalogue does not have has no unit by default.
    """
    entry = CATALOGUE.get(name)
    label = _write_words(name) if entry is None else entry.label
    if unit is None:
        unit = "" if entry is None else entry.unit
    has_unit = unit not in ("", "1")
    return f"{label} ({unit})" if has_unit else label


def explain_missing_error(observables: dict[str, Any]) -> tuple[str, ...]:
    """Return a sentence, for a warning, that the standard error of the exponent among
    ``observables``, values by name, is not known (nan); empty if it is known, or not among them.
    """
    exponent_error = observables.get("exponent_error", 0.0)
    if not np.any(np.isnan(exponent_error)):
        return ()
    return (
        "the standard error of the exponent is not known (nan) from one sample: take two or more",
    )
