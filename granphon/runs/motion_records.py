"""Motions of scenes: how they are made of their settings, what a run keeps of them, and their files."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granphon.array.sample import standard_error
from granphon.base.errors import ConvergenceError, InputError, LimitWarning, StoppedEarlyWarning
from granphon.base.tables import Heading, table_text
from granphon.media.crystal import CrystalState
from granphon.media.state import NetworkState
from granphon.networks.network import ContactNetwork, given_network
from granphon.waves.motion import Motion
from granphon.waves.nonlinear import Drive, NonlinearWaves
from granphon.waves.pulses import read_balls, read_vector, require_moves
from granphon.waves.settings import MotionSettings

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: what is found of a motion, and over time, by the names of the catalogue; and what has standard errors over samples
NUMBERS = (
    "front_velocity", "peak_velocity", "greatest_force", "energy_translation", "energy_rotation", "energy_stored",
    "energy_lost", "energy_supplied",
)  # fmt: skip
OVER_TIME = tuple(f"motion_{name}" for name in ("translation", "rotation", "stored", "lost", "supplied", "force"))
_WITH_ERRORS = NUMBERS[:3]
#: part of the greatest change of a force below which nothing has come to a contact
_STILL = 1e-3
#: part of the greatest force at rest below which a change may be rounding
_ROUNDING = 1e-10
#: least number of steps in a period of a shaker
_PER_PERIOD = 10
#: parts of the greatest distance between which velocities are read, the least correlation of a line, and the greatest
#: change of its slope between a quarter and three quarters of them, over the slope: what diffuses, t ~ x^2, has a half
_BETWEEN, _STRAIGHT, _BENT = (0.25, 0.75), 0.9, 0.25


# -- how it is made ---------------------------------------------------------------------------------------------------


def make_waves(x: Any, network: ContactNetwork, settings: MotionSettings) -> NonlinearWaves:
    """Return the balls of a ``network``, made of the state, sample or network ``x``, with the law of its contacts."""
    state = x.source if isinstance(x, NetworkState) else x
    law = state.crystal.law if isinstance(state, CrystalState) else None
    mu = math.inf if settings.friction_coefficient is None else settings.friction_coefficient
    return NonlinearWaves(network, law, friction_coefficient=mu, damping=settings.damping, geometry=settings.geometry)


class PreparedMotion:
    """The balls of a state, or of a network, that move, and what drives them.

    Raises :class:`~granphon.base.errors.InputError` for what is known to be wrong before anything moves.

    Attributes
    ----------
    waves : the balls and their law.
    drives : :class:`~granphon.Drive`, in turn, without impacts.
    velocities : (n, 3) those that impacts give, m/s.
    notes : what the motion warned of, in sentences.
    """

    def __init__(self, x: Any, settings: MotionSettings) -> None:
        network = settings.shape(given_network(x))
        self.settings, self.notes = settings, list[str]()
        self.waves = make_waves(x, network, settings)
        self.drives, self.velocities = list[Drive](), np.zeros((network.n_balls, 3))
        for one in settings.drive:
            balls = read_balls("balls of the drive", one.find_balls(network), network)
            along = np.eye(network.dimension)[0] if one.direction is None else one.direction
            vector = read_vector("direction of the drive", along, network.dimension)
            require_moves("drive", vector, network)
            if one.impact is None:
                moved: Any = one.shaker or one.displacement
                self.drives.append(Drive(balls, vector, displacement=moved, force=one.force))
            else:
                self.velocities[balls] += one.impact * vector
        led = [np.flatnonzero(~network.moving), *(one.balls for one in self.drives if one.displacement is not None)]
        if np.any(self.velocities[np.concatenate(led)]):
            raise InputError("an impact on a body that is held or displaced", mend="Give it a shaker or a displacement")
        shaken = max((one.shaker.frequency for one in settings.drive if one.shaker is not None), default=0.0)
        if shaken:
            step = settings.step or self.waves.find_step(float(np.linalg.norm(self.velocities, axis=1).max()))
            if min(step, settings.duration / (settings.frames - 1)) * shaken * _PER_PERIOD > 1.0:
                what = f"a shaker has the frequency {shaken:.4g} Hz, and steps have {step:.3g} s"
                raise InputError(what, f"A period would have fewer than {_PER_PERIOD} steps", "Give a shorter step")

    def run(self) -> Motion:
        """Let the balls move; :class:`~granphon.base.errors.ConvergenceError` for a motion that ends before its time."""
        of = self.settings
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always", LimitWarning)
            # its frames would not be those of other loads and samples
            warnings.simplefilter("error", StoppedEarlyWarning)
            try:
                motion = self.waves.run(
                    of.duration, None, self.velocities, self.drives, frames=of.frames, step=of.step, scheme=of.scheme
                )
            except StoppedEarlyWarning as stopped:
                if stopped.interrupted:
                    raise KeyboardInterrupt from None
                raise ConvergenceError(str(stopped), mend="Give a shorter duration, or a weaker drive") from None
        self.notes = [str(one.message) for one in told]
        return motion


def find_source(settings: MotionSettings, network: ContactNetwork) -> Index:
    """Return the numbers of all balls of a shaped network that are driven."""
    return np.unique(np.concatenate([one.find_balls(network) for one in settings.drive]))


class Passage(NamedTuple):
    """When what a drive sends comes to each contact, and how fast it goes.

    Attributes
    ----------
    distances : (n_c,) of contacts from the nearest ball that is driven, or its nearest image, m.
    arrivals : (n_c,) times at which the force has changed by half of what it ever changes, s; nan where it hardly does.
    peaks, heights : (n_c,) times, s, and sizes, N, of the greatest force; a time is nan at the ends of the motion.
    front, peak : velocities of the arrivals and of the peaks, m/s: the slopes of the lines of least squares of distances
        over times, of contacts between a quarter and three quarters of the greatest distance. nan without such a line, as
        where dashpots are so strong that the force diffuses.
    """

    distances: Array
    arrivals: Array
    peaks: Array
    heights: Array
    front: float
    peak: float

    @classmethod
    def of(cls, motion: Motion, source: Index) -> Self:
        """Find what passes the contacts of a motion from the balls ``source``."""
        network, times = motion.network, motion.times
        cells = np.array(list(product(*([-1, 0, 1] if one else [0] for one in network.pbc))))
        images = (network.positions[source] + (cells @ network.cell)[:, None]).reshape(-1, 3)
        distances = np.asarray(cKDTree(images).query(motion.middles)[0])
        change = np.abs(motion.forces - motion.forces[0]).max(axis=0)
        least = _STILL * float(change.max(initial=0.0)), _ROUNDING * float(motion.forces[0].max(initial=0.0)), 1e-300
        moved = change > max(least)
        peaks, heights = motion.peaks()
        at = np.argmax(motion.forces, axis=0)
        arrivals = np.where(moved, motion.arrivals(), np.nan)
        peaks = np.where(moved & (at > 0) & (at < len(times) - 1), peaks, np.nan)
        return cls(distances, arrivals, peaks, heights, *(_fit_velocity(distances, one) for one in (arrivals, peaks)))


def _fit_velocity(distances: Array, times: Array) -> float:
    """Return the slope of the line of least squares of distances over times, m/s; nan where there is none."""
    known = np.isfinite(times)
    far = float(np.max(distances, initial=0.0, where=known))
    known &= (distances >= _BETWEEN[0] * far) & (distances <= _BETWEEN[1] * far)
    if np.count_nonzero(known) < 3:
        return math.nan
    x, t = distances[known], times[known]
    (a, b), (_, c) = np.cov(t, x)
    if not b > _STRAIGHT * math.sqrt(a * c):
        return math.nan
    curve, slope, _ = np.polyfit((x - np.mean(x)) / far, t, 2) if len(np.unique(x)) > 3 else (0.0, 1.0, 0.0)
    return float(b / a) if abs(curve) * np.ptp(x) / far <= _BENT * abs(slope) else math.nan


def record_motion(x: Any, settings: MotionSettings) -> tuple[dict[str, Array], dict[str, Callable[[], bytes]]]:
    """Let the array of a state, sample or network move; return what is kept of it, and what makes the bytes of its file."""
    prepared = PreparedMotion(x, settings)
    motion = prepared.run()
    passage = Passage.of(motion, find_source(settings, motion.network))
    supplied = motion.work + motion.energy[0]
    numbers = {
        "front_velocity": passage.front, "peak_velocity": passage.peak, "greatest_force": motion.forces.max(),
        "energy_translation": motion.translation[-1], "energy_rotation": motion.rotation[-1],
        "energy_stored": motion.stored[-1], "energy_lost": motion.lost[-1], "energy_supplied": supplied[-1],
    }  # fmt: skip
    over_time = (motion.translation, motion.rotation, motion.stored, motion.lost, supplied, motion.forces.max(axis=1))
    kept = {name: np.array(float(value)) for name, value in numbers.items()} | {"motion": np.array(over_time)}
    kept["motion_note"] = np.array(" ".join(prepared.notes))

    def write() -> bytes:
        stream = io.BytesIO()
        motion.write(stream)
        return stream.getvalue()

    return kept, {"motion": write}


def average_motions(records: Sequence[Mapping[str, Array]], _: MotionSettings) -> tuple[dict[str, Array], list[str]]:
    """Return means over samples of what :func:`record_motion` keeps, standard errors, and notes."""
    out = dict(zip(OVER_TIME, np.mean([one["motion"] for one in records], axis=0), strict=True))
    said = [str(one["motion_note"]) for one in records if str(one["motion_note"])]
    of = f"{len(said)} of {len(records)} samples, such as one: " if len(records) > 1 else ""
    notes = [of + one for one in said[:1]]
    for name in NUMBERS:
        every = np.array([float(one[name]) for one in records])
        known = every[np.isfinite(every)]
        if known.size:
            out[name] = np.array(np.mean(known))
        if known.size > 1 and name in _WITH_ERRORS:
            out[f"{name}_error"] = np.asarray(standard_error(known, axis=0))
        if known.size < every.size:
            where = f" in {every.size - known.size} of {every.size} samples" if every.size > 1 else ""
            notes.append(
                f"the {name.replace('_', ' ')} is not known{where}: distances of contacts over the times at which the wave"
                " comes are no straight line that rises; run for longer, or with more frames"
            )
    return out, notes


# -- files ------------------------------------------------------------------------------------------------------------


def write_contacts(motion: Motion, path: Path, settings: MotionSettings) -> None:
    """Write a table of the contacts: where they are, and when and how strongly they are pressed."""
    passage, network = Passage.of(motion, find_source(settings, motion.network)), motion.network
    ends = np.concatenate([np.column_stack([network.i, network.j]), motion.met])
    columns: list[tuple[str, str, Any]] = [("ball_i", "", ends[:, 0]), ("ball_j", "", ends[:, 1])]
    columns += [(axis, "m", one) for axis, one in zip("xyz", motion.middles.T, strict=True)]
    columns += [("distance", "m", passage.distances), ("arrival", "s", passage.arrivals), ("peak", "s", passage.peaks)]
    columns.append(("greatest_force", "N", passage.heights))
    rows = zip(*(values.tolist() for _, _, values in columns), strict=True)
    path.write_text(table_text([Heading(name, unit) for name, unit, _ in columns], rows), encoding="utf-8")
