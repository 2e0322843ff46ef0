"""Many states at once: loads, media and parameters of the packing, as one labelled data set.

The work is cut into tasks (:mod:`granphon.runs.tasks`), and the results are put in place by index.
With a path each finished task is kept beside the result until that is written, so that an
interrupted sweep goes on from what it has.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice, as_direction, find_lattice
from granphon.balls.loads import Load
from granphon.balls.on_site import HOLDING_PARAMETERS
from granphon.balls.packing import Axis, Packing, find_double
from granphon.base.errors import InputError, brief
from granphon.base.progress import Progress, silent
from granphon.base.settings import IN_PYTHON, make_rules, read_block
from granphon.base.validation import block, require, truth
from granphon.media.arrangement import Arrangement, find_kinds, given_balls
from granphon.media.choice import MediumChoice, default_medium, require_finite_overlap
from granphon.media.crystal import Crystal
from granphon.phonons.paths import BAND_POINTS, BandPath
from granphon.runs.dataset import Dataset
from granphon.runs.finished_tasks import Store
from granphon.runs.plan import Plan
from granphon.runs.tasks import OF_ZONE, Grid, Request, require_arrays
from granphon.waves.settings import (
    NETWORK_BLOCKS,
    ModesSettings,
    MotionSettings,
    PulseSettings,
    ResponseSettings,
    SpectrumSettings,
    WaveSettings,
    require_losses,
    require_walls,
)

Array = NDArray[Any]


def sweep(
    packing: Packing | Arrangement | Crystal,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    load: Load | None = None,
    media: Any = None,
    finite_overlap: bool = False,
    direction: ArrayLike | None = None,
    bands: str | ArrayLike | Sequence[ArrayLike] | None = None,
    npoints: int | None = None,
    labels: Sequence[str] | None = None,
    gaps: bool = False,
    cutoffs: bool = False,
    onsets: bool = False,
    dos: bool = False,
    spectrum: SpectrumSettings | Mapping[str, Any] | None = None,
    pulse: PulseSettings | Mapping[str, Any] | None = None,
    response: ResponseSettings | Mapping[str, Any] | None = None,
    motion: MotionSettings | Mapping[str, Any] | None = None,
    modes: ModesSettings | Mapping[str, Any] | None = None,
    executor: Executor | None = None,
    progress: Progress = silent,
    path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    store: Store | None = None,
    **parameters: Any,
) -> Dataset:
    """Return states, velocities and moduli over loads, media and parameters of the packing.

    Parameters
    ----------
    packing : the packing whose parameters are varied; a parameter that is not swept keeps its
        value. Or a crystal.
    force, pressure, overlap : the loads; one of the three, a number or a list of any order. A force
        is in N, an overlap in m, a pressure in N on a line, N/m in the plane and Pa in space; that
        on a cut of a crystal acts on its faces too, and has the unit of the crystal before the cut.
    load : the loads, in place of these; such as the stresses or strains of a crystal, or its
        pressure and gravity.
    media : for a crystal "crystal"; for a packing, by default "ala", one of "ala", "afa", "ema",
        "simulation", "auto", mappings with options such as {"ema": {"local_field": "paper"}},
        {"simulation": {"shape": (64, 64), "seed": 0, "samples": 4}} or {"auto": {"tolerance":
        1e-3}}, or a list of these, each once.
    finite_overlap : keep the terms of relative order delta/d. Media with a contact law then have no
        exponent.
    direction : Cartesian direction of sound, (p,) for lattices of p periods, or (n, p) for many; by
        default x. Many make one more dimension of the velocities, ``direction``.
    bands : a path as :meth:`granphon.phonons.phonons.Phonons.bands` takes it; the frequencies along
        it are added to the data set.
    npoints : number of points on each segment of that path, by default 101.
    labels : names of the corners of that path; by default the letters, or the coordinates.
    gaps : whether to find the gaps and the top frequency of each state, as
        :meth:`granphon.phonons.phonons.Phonons.find_gaps` does.
    cutoffs : whether to find the lowest and the highest frequency of each branch, as
        :meth:`granphon.phonons.phonons.Phonons.cutoffs` does.
    onsets : whether to find the frequency and the curvature of each branch at Gamma, as
        :meth:`granphon.phonons.phonons.Phonons.onset` does.
    dos, spectrum, pulse : the waves to find in each sample, where all media are simulations.
        ``dos`` says whether to find the density of states of the array. ``spectrum`` is a mapping
        for spectral functions, with the keys ``polarisation``, ``resolution`` (Hz), ``points`` of a
        leg and ``path``, such as "GM", by default that of the lattice. ``pulse`` is a mapping for a
        pulse along the direction, with the keys of :class:`~granphon.PulseSettings`, ``frequency``
        (Hz), ``distance`` (m), ``cycles``, ``polarisation``, ``source``, ``ends``, and the losses
        ``damping`` (s), ``drag`` (1/s), ``dashpot`` (N s/m) and ``restitution``.
    response, motion, modes : what to find of the network of each state, with the keys that
        :class:`~granphon.ResponseSettings`, :class:`~granphon.MotionSettings` and
        :class:`~granphon.ModesSettings` have, in SI units.
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, for work
        side by side; the numbers do not depend on it.
    progress : is told how many steps are done. A step is a medium at one combination of parameters,
        or one sample of a simulation at one load, with a history of friction at all loads.
    path : "out/sweep.nc", written whole or not at all, with the table "out/sweep.csv" beside it.
        Finished tasks are kept beside it until then: the same sweep to the same path continues from
        them, and gives the same numbers as an uninterrupted one.
    resume : if the sweep in ``path`` is complete, return it, and compute and write nothing; with
        ``overwrite`` it has no effect.
    overwrite : replace existing files, and discard the finished tasks of another sweep to ``path``.
    store : where finished tasks are kept, instead of beside ``path``. Results that it holds are
        used; the caller clears it.
    **parameters : values of any of :data:`~granphon.balls.packing.PARAMETERS`; of a crystal those
        of its kinds, as {"A.young_modulus": [...]}, any of
        :data:`~granphon.balls.packing.KIND_PARAMETERS` but the diameter, of its walls,
        {"wall.young_modulus": [...]}, and of springs to the ground, ``on_site`` of all
        displacements, N/m, {"on_site.rotation": [...]}, N m, and the like; a wall in a cut of the
        response, motion or modes has the name of the block before it,
        {"response.wall.young_modulus": [...]}. The losses ``damping``, s, ``loss_factor``,
        ``drag``, 1/s, ``dashpot``, N s/m, and ``restitution`` stand for those of the response,
        motion and pulse, which then do not give them; ``tangential_damping``,
        ``tangential_loss_factor``, ``rotational_drag`` and ``tangential_dashpot`` are the second of
        a pair. A ``width`` (W, m) scales the spread and keeps its shape, which is uniform if the
        packing has no spread; a ``diameter`` leaves the spread as it is. Lattices must have the
        same number of periods.

    Returns
    -------
    Dataset of dimensions load, medium, then the parameters in the order given, with ``units`` and
    ``long_name`` of each variable: the state's attributes, ``valid``, ``regime``, ``longitudinal``
    and ``transverse`` (m/s, along the direction; in space and on a chain that moves across itself
    ``transverse_slow`` and ``transverse_fast``, of a plane that moves out of itself
    ``out_of_plane``, of a chain that turns about itself ``twist``), ``bulk`` and ``shear`` (Pa; N
    on a line; the ``tensor`` in Voigt order if a lattice is not isotropic), ``exponent`` and its
    standard error over samples ``exponent_error``, zero for media that sample nothing and nan for
    one sample; if a simulation has several samples, ``longitudinal_error``, ``transverse_error``,
    ``bulk_error``, ``shear_error``, ``tensor_error``, zero for other media and nan for one sample;
    of square and cubic lattices the ``anisotropy``; if all media are simulations,
    ``contact_force_fluctuation``, and if all of them are loaded with friction,
    ``sliding_fraction``, ``tangential_ratio``, ``work`` and ``dissipated_energy``; if one is
    "auto", the ``choice`` at each load, and its ``expected_error`` (+inf where it is not known);
    velocities and moduli that balls with some of the swept motions do not have are nan there, and
    the warnings say which; with bands ``frequencies`` (..., segment, point, branch) in Hz; with
    gaps ``gap_lower`` and ``gap_upper`` (..., gap) in Hz by the number of branches below, nan where
    there is no gap, and ``top_frequency``; with cutoffs ``cutoff_lower`` and ``cutoff_upper`` (...,
    branch) in Hz; with onsets ``onset_frequency``, Hz, and ``onset_curvature``, m^2/s, (...,
    branch), and ``onset_gap``, Hz; of waves in simulated arrays means over samples with standard
    errors: ``dos_total`` (..., node) over ``dos_frequency``, ``line_frequency``, ``line_width``,
    ``phase_velocity``, ``mean_free_path`` and ``attenuation`` (..., polarisation, wavevector),
    ``ioffe_regel_longitudinal`` and the like, ``pulse_velocity``, ``time_of_flight``,
    ``coherent_fraction``, nan where a warning says why. Loads are a coordinate under their own
    name. ``attrs`` holds versions, packing, media and the warnings of validity, as JSON.

    Raises
    ------
    InputError : no load or several kinds, an unknown medium or parameter, a medium or a direction
        twice, a value that makes no packing, bands over parameters that change the number of
        branches, finite overlap of "auto" or of a simulation in the directions of the lattice,
        lattices of different dimension, waves of media that are no simulations or that an array
        does not have, a pulse or onsets in several directions, ``labels`` or ``npoints`` without
        bands, an executor without ``submit``, a ``progress`` without ``step``, a ``store`` of
        another class, a ``path`` that is no path or does not end in .nc, ``resume`` without a path,
        and a flag, such as ``gaps`` or ``overwrite``, that is no truth value.
    MechanismError : a lattice is a mechanism; raised before anything is computed. With bands, gaps,
        cutoffs, onsets, a response, a motion or modes, velocities and moduli are left out instead,
        with a warning.
    InstabilityError : with finite overlap, a lattice buckles.
    FileExistsInRunError : the files exist, or finished tasks of another sweep or version do, and
        ``overwrite`` is off; raised before anything is computed.
    OutputError : the files cannot be written; raised before anything is computed if that can be
        known by then.
    ConvergenceError : a path of loads with friction ends before its last load. When all other tasks
        are done, ``reached`` of the error is the data set at the loads that every medium has
        reached, and these are written beside ``path`` as sweep_incomplete.nc and
        sweep_incomplete.csv.
    GranphonError : a medium has no solution. The message names medium, parameters and load, and
        ``load_index`` is the index of the load; of one state that is not simulated the message is
        that of the medium alone, and there is no index. No result is written then.
    MissingPackageError : xarray is not installed, or with a ``path`` h5netcdf.
    """
    packing = given_balls(packing)
    media = default_medium(packing) if media is None else media
    load = _choose_load(load, force=force, pressure=pressure, overlap=overlap)
    axes = [Axis.of(name, values) for name, values in parameters.items()]
    # all lattices of a sweep have the same number of periods
    lattices = [axis.values[0] for axis in axes if axis.name == "lattice"]
    lattice = find_lattice(lattices[0] if lattices else packing.structure)
    choices = _read_media(media, lattice, packing)
    if require("finite_overlap", truth, finite_overlap):
        require_finite_overlap(choices)
    directions = None if direction is None else _read_directions(direction, lattice)

    networks = {"response": response, "motion": motion, "modes": modes}
    waves = _read_waves(dos, spectrum, pulse, networks, directions, lattice)
    settings_with_losses = [] if waves is None else [waves.pulse, *waves.of_networks]
    require_losses(parameters, settings_with_losses)
    require_walls(parameters, settings_with_losses, find_kinds(packing))
    path_of_bands = _read_bands(bands, npoints, labels)
    names_of_zone = _list_in_zone({"gaps": gaps, "cutoffs": cutoffs, "onsets": onsets})
    names_of_bands = [] if path_of_bands is None else ["bands"]
    names_of_arrays: Sequence[str] = () if waves is None else waves.names
    names_of_networks = [name for name, settings in networks.items() if settings is not None]
    observe = ["velocities", *names_of_bands, *names_of_zone, *names_of_arrays, *names_of_networks]
    # Velocities that cannot be found are an error only where nothing else is observed: balls that
    # are held have no sound, and a mechanism has bands and motions without velocities.
    is_held = packing.is_held or not HOLDING_PARAMETERS.isdisjoint(parameters)
    request = Request(
        finite_overlap=finite_overlap,
        path=path_of_bands,
        direction=directions,
        waves=waves,
        sound=packing.repeats and not is_held and observe == ["velocities", *names_of_arrays],
        observe=tuple(observe),
    )
    grid = Grid(packing, axes, choices, load, request)
    require_arrays(choices, lattice, parameters, names_of_arrays)
    return Plan(grid).sweep(
        progress,
        executor,
        path=path,
        resume=resume,
        overwrite=overwrite,
        store=store,
    )


def _list_in_zone(flags: Mapping[str, Any]) -> list[str]:
    """Return the names of the observables of :data:`~granphon.runs.tasks.OF_ZONE` whose arguments
    of :func:`sweep`, the ``flags`` by name, are true; InputError for one that is no truth value.
    """
    return [name for name in OF_ZONE if require(name, truth, flags[name])]


def _choose_load(load: Load | None, **loads: ArrayLike | None) -> Load:
    """Return the applied load, of one axis at most: ``load``, or, where that is None, the only one
    of ``loads``, values by kind, that is not None. InputError if both are given, none or several,
    for values that are no loads, and for a ``load`` that is no :class:`~granphon.Load`.
    """
    if load is None:
        return Load.only(**loads)
    if not isinstance(load, Load):
        raise InputError(f"load is {brief(load)}", mend="Give a granphon.Load")
    if any(values is not None for values in loads.values()):
        mend = "Give load alone, or one of force, pressure, overlap"
        raise InputError("a load is given twice", mend=mend)
    return load.applied.flat


def _read_media(media: Any, lattice: Lattice, packing: Packing | Arrangement) -> list[MediumChoice]:
    """Return the choices of media of a sweep from ``media``, a medium or a list of media as
    :func:`sweep` takes them; the ``lattice`` is that on which options are read. InputError for an
    empty list, for what is no medium, for one that is given twice, or for one that the ``packing``
    cannot have.
    """
    descriptions = media if isinstance(media, list | tuple) else [media]
    choices = [MediumChoice.parse(description, lattice) for description in descriptions]
    for choice in choices:
        choice.require_for(packing)
    if not choices:
        mend = "Give at least one, such as 'ala'"
        raise InputError("there is no medium to sweep over", mend=mend)
    for choice in choices:
        if choices.count(choice) > 1:
            problem = f"the medium {choice.label!r} is given twice"
            raise InputError(problem, mend="Give each once")
    return choices


def _read_directions(direction: ArrayLike, lattice: Lattice) -> tuple[Any, ...]:
    """Return the Cartesian components of the ``direction`` of sound (p,) as a tuple; of many
    directions (n, p) a tuple of such tuples. ``lattice`` has p periods. InputError for a direction
    of another shape, zero or not finite, and for one that is given twice.

    The components are those that were given, without a change to unit length: they name the
    direction.
    """
    unit_vectors = as_direction(direction, lattice.periods)
    components = np.asarray(direction, float).tolist()
    if unit_vectors.ndim == 1:
        return tuple(components)
    directions = tuple(map(tuple, components))
    index = find_double(unit_vectors.tolist())
    if index is not None:
        problem = f"the sweep has the direction {directions[index]} twice"
        raise InputError(problem, mend="Give each direction once")
    return directions


def _read_waves(
    dos: bool,
    spectrum: SpectrumSettings | Mapping[str, Any] | None,
    pulse: PulseSettings | Mapping[str, Any] | None,
    networks: Mapping[str, Any],
    directions: tuple[Any, ...] | None,
    lattice: Lattice,
) -> WaveSettings | None:
    """Return the settings of the waves in each sample and in the network of each state; None if no
    waves are requested.

    ``dos``, ``spectrum`` and ``pulse`` are those of :func:`sweep`, and ``networks`` holds its
    ``response``, ``motion`` and ``modes`` by name, None where they are not given. The ``lattice``
    gives the default path of spectra. InputError for values that these arguments cannot have, and
    for a pulse along several ``directions``.
    """
    has_dos = require("dos", truth, dos)
    spectrum_settings, corners, names = _read_spectrum(spectrum, lattice)
    read_pulse = partial(read_block, PulseSettings, context=IN_PYTHON)
    pulse_settings = None if pulse is None else require("pulse", read_pulse, pulse)
    has_several = isinstance(directions[0], tuple) if directions else False
    if pulse_settings is not None and has_several:
        raise InputError("a pulse goes along one direction, and there are several", mend="Give one")
    of_networks = tuple(
        require(name, partial(read_block, NETWORK_BLOCKS[name], context=IN_PYTHON), settings)
        for name, settings in networks.items()
        if settings is not None
    )
    if not (has_dos or spectrum_settings or pulse_settings or of_networks):
        return None
    pulse_direction = None if pulse_settings is None else directions
    return WaveSettings(
        dos=has_dos,
        spectrum=spectrum_settings,
        path=corners,
        labels=names,
        pulse=pulse_settings,
        direction=pulse_direction,
        of_networks=of_networks,
    )


def _read_bands(
    bands: Any, npoints: int | None, labels: Sequence[str] | None
) -> tuple[Any, int, Sequence[str] | None] | None:
    """Return the path of the bands, the number of points on each segment and the labels of the
    corners, from these arguments of :func:`sweep`; None without bands. InputError for points or
    labels without bands.
    """
    if bands is not None:
        return bands, BAND_POINTS if npoints is None else npoints, labels
    if labels is not None:
        raise InputError(
            "labels are given without bands", mend="Give bands, whose corners have them"
        )
    if npoints is not None:
        raise InputError(
            "npoints is given without bands", mend="Give bands, whose segments have points"
        )
    return None


def _read_spectrum(
    spectrum: SpectrumSettings | Mapping[str, Any] | None, lattice: Lattice
) -> tuple[SpectrumSettings | None, tuple[Any, ...], tuple[str, ...]]:
    """Return the settings of spectral functions, the pieces of their path as
    :class:`~granphon.phonons.paths.BandPath` has them, by default those of the ``lattice``, and the
    names of the corners; without ``spectrum`` None and empty tuples. InputError for what is neither
    settings nor a mapping of their keys.
    """
    if spectrum is None:
        return None, (), ()
    default = BandPath.default(lattice)
    if isinstance(spectrum, SpectrumSettings):
        return spectrum, default.paths, default.names
    rule_of_path = partial(BandPath.read, structure=lattice)
    rules = make_rules(SpectrumSettings, IN_PYTHON) | {"path": rule_of_path}
    settings = require("spectrum", partial(block, rules=rules), spectrum)
    path = settings.pop("path", default)
    return SpectrumSettings(**settings), path.paths, path.names
