"""Many states at once: loads, media and parameters of the packing, as one labelled data set.

The work is cut into tasks (:mod:`granphon.sweeps.jobs`), and the results are put in place by index. With a path each
finished task is kept beside the result until that is written, so that an interrupted sweep goes on from what it has.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granphon.balls.lattices import Lattice, as_direction, find_lattice
from granphon.balls.loads import Load
from granphon.balls.packing import Packing
from granphon.balls.parameters import Axis, find_double
from granphon.base.errors import ConvergenceError, GranphonError, InputError, InstabilityError, MechanismError, message
from granphon.base.progress import Progress, silent
from granphon.base.staging import ResultFiles, is_whole
from granphon.base.validation import block, require, truth
from granphon.dynamics.contact_lattice import ContactLattice
from granphon.media.cases import Case, Grid, require_arrays
from granphon.media.choice import MediumChoice, no_simulation
from granphon.observables.catalogue import Analysis
from granphon.phonons.paths import BandPath
from granphon.sweeps.archive import file_names, load_sweep, write_sweep
from granphon.sweeps.dataset import Way, collect_identity, fill, make_frame
from granphon.sweeps.jobs import Asked, Job, Work, to_json
from granphon.sweeps.records import SampleRecord
from granphon.sweeps.store import Store, TaskResult, open_store
from granphon.sweeps.tasks import solve_all
from granphon.sweeps.unfinished import incomplete_files, keep_incomplete, require_complete, strip
from granphon.waves.settings import PulseSettings, SpectrumSettings, WaveSettings, pulse_rules, spectrum_rules

if TYPE_CHECKING:
    from xarray import Dataset


Array = NDArray[Any]
#: a prestress f/(k a) so small that a lattice which buckles under it does so under any
_LEAST_PUSH = 1e-30


# -- the sweep ------------------------------------------------------------------------------------------------------


def sweep(
    packing: Packing,
    *,
    force: ArrayLike | None = None,
    pressure: ArrayLike | None = None,
    overlap: ArrayLike | None = None,
    media: Any = ("ala",),
    finite_overlap: bool = False,
    direction: ArrayLike | None = None,
    bands: str | ArrayLike | Sequence[ArrayLike] | None = None,
    npoints: int = 101,
    labels: Sequence[str] | None = None,
    dos: bool = False,
    spectrum: SpectrumSettings | Mapping[str, Any] | None = None,
    pulse: PulseSettings | Mapping[str, Any] | None = None,
    executor: Executor | None = None,
    progress: Progress = silent,
    path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    store: Store | None = None,
    **parameters: Any,
) -> Dataset:
    """States, velocities and moduli over loads, media and parameters of the packing.

    Parameters
    ----------
    packing : the packing whose parameters are varied; those that are not swept keep its values.
    force, pressure, overlap : the loads; one of the three, a number or a list of any order. A force is in N, an overlap in
        m, a pressure in N on a line, N/m in the plane and Pa in space.
    media : "ala", "afa", "ema", "simulation", "auto", mappings with options such as {"ema": {"local_field": "paper"}},
        {"simulation": {"shape": (64, 64), "seed": 0, "samples": 4}} or {"auto": {"tolerance": 1e-3}}, or a list of these,
        each once.
    finite_overlap : keep the terms of relative order delta/d. Media with a contact law then have no exponent.
    direction : Cartesian direction of sound, (p,) for lattices of p periods, or (n, p) for many; by default x. Many make one
        more dimension of the velocities, ``direction``.
    bands : a path as :meth:`granphon.phonons.phonons.Phonons.bands` takes it; the frequencies along it are added to the
        data set.
    npoints : number of points on each segment of that path.
    labels : names of the corners of that path; by default the letters, or the coordinates.
    dos, spectrum, pulse : what of the waves in each sample to find, where all media are simulations: the density of states
        of the array; spectral functions, as the keys ``polarisation``, ``resolution`` (Hz), ``points`` of a leg and
        ``path``, such as "GM", by default that of the lattice, of a mapping say; and a pulse along the direction, with the
        keys ``frequency`` (Hz), ``distance`` (m), ``cycles``, ``polarisation``, ``source``, ``ends``, ``damping`` (s).
    executor : any executor with the interface of :class:`concurrent.futures.Executor`, for work side by side; the numbers
        do not depend on it.
    progress : is told how many steps are done. A step is a medium at one combination of parameters, or one sample of a
        simulation at one load.
    path : "out/sweep.nc", written whole or not at all, with the table "out/sweep.csv" beside it. Finished tasks are kept
        beside it until then: the same sweep to the same path continues from them, and gives the same numbers as an
        uninterrupted one.
    resume : if the sweep in ``path`` is complete, return it, and compute and write nothing.
    overwrite : replace existing files, and discard the finished tasks of another sweep to ``path``.
    store : where finished tasks are kept, instead of beside ``path``. Results that it holds are used; the caller clears it.
    **parameters : values of any of :data:`~granphon.balls.parameters.PARAMETERS`. A ``width`` (W, m) scales the spread
        and keeps its shape, which is uniform if the packing has no spread; a ``diameter`` leaves the spread as it is.
        Lattices must have the same number of periods.

    Returns
    -------
    Dataset of dimensions load, medium, then the parameters in the order given, with ``units`` and ``long_name`` of each
    variable: the state's attributes, ``valid``, ``regime``, ``longitudinal`` and ``transverse`` (m/s, along the direction;
    in space and on a chain that moves across itself ``transverse_slow`` and ``transverse_fast``), ``bulk``
    and ``shear`` (Pa; N on a line; the ``tensor`` in Voigt order if a lattice is not isotropic), ``exponent`` and its
    standard error over samples ``exponent_error``, zero for media that sample nothing and nan for one
    sample; if a simulation has several samples, ``longitudinal_error``, ``transverse_error``, ``bulk_error``,
    ``shear_error``, ``tensor_error``, zero for other media and nan for one sample; of square and cubic lattices the
    ``anisotropy``; if all media are simulations, ``contact_force_fluctuation``, and if all of them are loaded with friction,
    ``sliding_fraction``, ``tangential_ratio``, ``work`` and ``dissipated_energy``;
    if one is "auto", the ``choice`` at each load, and its ``expected_error`` (+inf where it is not known);
    velocities and moduli that balls with some of the swept motions do not have are nan there, and the warnings say which;
    with bands ``frequencies`` (..., segment, point, branch) in Hz; of waves in simulated arrays means over samples with
    standard errors: ``dos_total`` (..., node) over ``dos_frequency``, ``line_frequency``, ``line_width``,
    ``phase_velocity``, ``mean_free_path`` and ``attenuation`` (..., polarisation, wavevector), ``ioffe_regel_longitudinal``
    and the like, ``pulse_velocity``, ``time_of_flight``, ``coherent_fraction``, nan where a warning says why.
    Loads are a coordinate under their own name.
    ``attrs`` holds versions, packing, media and the warnings of validity, as JSON.

    Raises
    ------
    InputError : no load or several kinds, an unknown medium or parameter, a medium twice, a value that makes no packing,
        bands over parameters that change the number of branches, a simulation with finite overlap, lattices of different
        dimension.
    MechanismError : a lattice is a mechanism; raised before anything is computed. With bands, velocities and moduli are left
        out instead, with a warning.
    InstabilityError : with finite overlap, a lattice buckles.
    FileExistsInRunError : the files exist, or finished tasks of another sweep or version do, and ``overwrite`` is off;
        raised before anything is computed.
    OutputError : the files cannot be written; raised before anything is computed if that can be known by then.
    ConvergenceError : a path of loads with friction ends before its last load. When all other tasks are done, ``reached`` of
        the error is the data set at the loads that every medium has reached, and these are written beside ``path`` as
        sweep_incomplete.nc and sweep_incomplete.csv.
    GranphonError : a medium has no solution. The message names medium, parameters and load, and ``load_index`` is the index
        of that load. No result is written then.
    """
    load = Load.only(force=force, pressure=pressure, overlap=overlap)
    axes = [Axis.of(name, given) for name, given in parameters.items()]
    # all lattices of a sweep have the same number of periods
    lattice = find_lattice(next((axis.values[0] for axis in axes if axis.name == "lattice"), packing.structure))
    choices = _parse_media(media, lattice)
    if require("finite_overlap", truth, finite_overlap):
        no_simulation(choices)
    along = _parse_direction(lattice, direction)
    waves = _parse_waves(dos, spectrum, pulse, lattice, along)
    # bands are those of a mechanism too
    grid = Grid(packing, axes, choices, load, finite_overlap, along, waves, sound=bands is None)
    if waves is not None:
        require_arrays(choices, parameters, waves.names)
        for case in grid.cases:
            _require_waves(case, waves)
    return sweep_grid(
        grid, bands=bands, npoints=npoints, labels=labels,
        executor=executor, progress=progress, path=path, resume=resume, overwrite=overwrite, store=store,
    )  # fmt: skip


def sweep_grid(
    grid: Grid,
    *,
    bands: str | ArrayLike | Sequence[ArrayLike] | None = None,
    npoints: int = 101,
    labels: Sequence[str] | None = None,
    executor: Executor | None = None,
    progress: Progress = silent,
    path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    overwrite: bool = False,
    store: Store | None = None,
) -> Dataset:
    """Carry out :func:`sweep` for the cases of a grid; what is known of them, such as a choice of media, is not found again.

    Arguments, the data set and errors are those of :func:`sweep`. The load is an applied one, of at most one dimension.
    """
    run = SweepRun.of(grid, bands, npoints, labels)
    target = _choose_target(path, resume)
    if target is not None and resume and not overwrite and (there := _load_complete(target, run.frame)) is not None:
        return there
    files = (
        None
        if target is None
        else ResultFiles(target.parent, file_names(target), overwrite, earlier=incomplete_files(target.name))
    )
    folder = nullcontext() if files is None else files.open()
    own = open_store(None if target is None else target.with_name(f".{target.name}.partial"), overwrite)
    with folder as locked, own if store is None else nullcontext(store) as place:
        try:
            dataset = run.join(run.do(executor, progress, place))
        except ConvergenceError as error:
            if locked is None or target is None or error.reached is None:
                raise
            raise keep_incomplete(error, locked, target.name, place) from None
        if locked is not None and target is not None:
            with locked.staging() as stage:
                write_sweep(dataset, stage / target.name)
    return dataset


@dataclass(frozen=True, eq=False)
class SweepRun:
    """The work of a sweep: its frame, and the work on each case."""

    grid: Grid
    frame: Dataset
    works: tuple[Work, ...]

    @classmethod
    def of(cls, grid: Grid, bands: Any = None, npoints: int = 101, labels: Sequence[str] | None = None) -> Self:
        """Lay out the work; raises what :func:`sweep` raises before anything is computed."""
        cases = grid.cases
        way = None if bands is None else Way.of([case.packing for case in cases], bands, npoints, labels)
        frame = make_frame(grid, way)
        if grid.sound:
            _require_sound(cases)
        asked = Asked(
            grid.finite_overlap, None if way is None else way.qpoints, grid.direction, grid.waves, grid.exponents,
            grid.sound, grid.alone,
        )  # fmt: skip
        return cls(grid, frame, tuple(Work(case, asked) for case in cases))

    @property
    def pieces(self) -> list[Job]:
        """The tasks, in the order of the cases."""
        return [piece for work in self.works for piece in work.pieces]

    def do(
        self, executor: Executor | None = None, progress: Progress = silent, store: Store | None = None
    ) -> list[TaskResult]:
        """Do all :attr:`pieces`, whose results the ``store`` keeps, and return these."""
        place, pieces = store or Store(), self.pieces
        place.claim(collect_identity(self.frame), lambda: [piece.name for piece in pieces])
        return solve_all("simulation" if self.grid.alone else "sweep", pieces, executor, progress, place)

    def join(self, found: Sequence[TaskResult]) -> Dataset:
        """Return the data set from the results of the :attr:`pieces`.

        :class:`~granphon.base.errors.ConvergenceError` if a path of loads ends early; its ``reached`` is the data set of the
        loads before.
        """
        ends = accumulate((len(work.pieces) for work in self.works), initial=0)
        parts = [work.join(found[a:b]) for work, (a, b) in zip(self.works, pairwise(ends), strict=True)]
        dataset = fill(self.frame, self.grid, self.works, [strip(part) for part in parts])
        require_complete(parts, dataset)
        return dataset

    def join_alone(self, analysis: Analysis, records: Sequence[SampleRecord]) -> Dataset:
        """Return the data set of a single state that has been found, with the records of its samples; see :meth:`join`."""
        return fill(self.frame, self.grid, self.works, [self.works[0].observe_alone(analysis, records)])


def _parse_media(given: Any, lattice: Lattice) -> list[MediumChoice]:
    """Parse the media; :class:`InputError` if there is none, or one is given twice, or has options of another lattice."""
    choices = [MediumChoice.parse(one, lattice) for one in (given if isinstance(given, list | tuple) else [given])]
    if not choices:
        raise InputError(message("there is no medium to sweep over", mend="Give at least one, such as 'ala'"))
    double = [choice.label for choice in choices if choices.count(choice) > 1]
    if double:
        raise InputError(message(f"the medium {double[0]!r} is given twice", mend="Give each once"))
    return choices


def _parse_waves(
    dos: bool, spectrum: Any, pulse: Any, lattice: Lattice, direction: tuple[Any, ...] | None
) -> WaveSettings | None:
    """Return what is asked of the waves in samples; None for nothing."""
    wanted = require("dos", truth, dos)
    if not wanted and spectrum is None and pulse is None:
        return None
    path = BandPath.default(lattice) if spectrum is not None else None
    if spectrum is not None and not isinstance(spectrum, SpectrumSettings):
        rules = spectrum_rules(read=False) | {"path": partial(BandPath.read, structure=lattice)}
        given = require("spectrum", partial(block, rules=rules), spectrum)
        path = given.pop("path", path)
        spectrum = SpectrumSettings(**given)
    if pulse is not None and not isinstance(pulse, PulseSettings):
        rules = pulse_rules(read=False)
        pulse = PulseSettings(**require("pulse", partial(block, rules=rules, needed=("frequency",)), pulse))
    if pulse is not None and direction and isinstance(direction[0], tuple):
        raise InputError(message("a pulse is asked for in several directions", mend="Give one direction"))
    way = (path.paths, path.names) if path is not None else ((), ())
    return WaveSettings(wanted, spectrum, *way, pulse, direction if pulse is not None else None)


def _parse_direction(lattice: Lattice, direction: ArrayLike | None) -> tuple[Any, ...] | None:
    """Return one direction as its numbers, or many as a tuple of these; :class:`InputError` if the lattice has none such."""
    if direction is None:
        return None
    along = as_direction(direction, lattice.periods)
    numbers = np.asarray(direction, float).tolist()
    if along.ndim == 1:
        return tuple(numbers)
    if (double := find_double(along.tolist())) is not None:
        what = f"the sweep has the direction {tuple(numbers[double])} twice"
        raise InputError(message(what, mend="Give each direction once"))
    return tuple(map(tuple, numbers))


def _require_sound(cases: Sequence[Case]) -> None:
    """Raise if a lattice has no sound, before anything is computed: a mechanism, or one that buckles under any load.

    Of the stiffnesses of contacts it matters only which of them there are.
    """
    known: set[tuple[Any, ...]] = set()
    for case in cases:
        packing = case.packing
        present = tuple(float(bool(one)) for one in (packing.mindlin_ratio, packing.torsion, packing.bending))
        pushed = case.finite_overlap and not case.medium.is_exact  # an array is not the lattice, and has its own forces
        kind = (packing.structure, present, packing.ball_motions, pushed)
        if kind in known:
            continue
        known.add(kind)
        eta, torsion, bending = present
        lattice = ContactLattice.of(packing.structure, eta, torsion=torsion, bending=bending, motions=packing.ball_motions)
        try:
            lattice.sound_velocities(np.eye(lattice.periods), _LEAST_PUSH if pushed else None)
        except (MechanismError, InstabilityError) as error:
            raise type(error)(f"{case.label}: {error}") from None


def _require_waves(case: Case, wanted: WaveSettings) -> None:
    """Raise, with the case in front, if it is known that its arrays do not have the waves that are wanted."""
    from granphon.sweeps.wave_checks import require_waves  # imported here: a sweep without waves does not need it

    try:
        require_waves(case.serving_media, wanted)
    except GranphonError as error:
        raise type(error)(f"{case.label}: {error}") from None


def _choose_target(path: str | os.PathLike[str] | None, resume: bool) -> Path | None:
    if path is None:
        if resume:
            raise InputError(
                message(
                    "a sweep without a path cannot be resumed", "Its finished parts are kept beside its file", "Give path"
                )
            )
        return None
    target = Path(path)
    if target.suffix != ".nc":
        raise InputError(message(f"{target} does not end in .nc", "It is a netCDF file, with a .csv beside it"))
    return target


def _load_complete(target: Path, frame: Dataset) -> Dataset | None:
    """Return the sweep in ``target`` if it is complete and is the one that ``frame`` describes; otherwise None."""
    if not is_whole(target.parent, file_names(target)):
        return None
    there = load_sweep(target)
    return there if collect_identity(there) == json.loads(to_json(collect_identity(frame))) else None
