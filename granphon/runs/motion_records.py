"""Motions of scenes: how they are made of their settings, what a run keeps of them, and their files."""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from granphon.base.errors import InputError
from granphon.base.results import Result, plain
from granphon.base.tables import Heading, table_text
from granphon.base.text import read_bytes
from granphon.networks.network import ContactNetwork, given_network
from granphon.runs.dataset import MAX_SWEEP, netcdf_bytes, open_bytes
from granphon.waves.motion import Motion
from granphon.waves.nonlinear import Drive, NonlinearWaves
from granphon.waves.pulses import read_balls, read_vector
from granphon.waves.settings import MotionSettings

Array = NDArray[np.float64]
Index = NDArray[np.intp]
#: dimensions of the arrays of a motion and of its network in a file, by the letters of their shapes
_DIMS = {"f": "frame", "n": "ball", "c": "contact", "3": "axis"}
#: files of tables of a motion
TABLES = ("motion.csv", "motion_contacts.csv")
#: part of the greatest change of a force below which nothing has come to a contact
_STILL = 1e-3
#: parts of the greatest distance between which velocities are read, and the least correlation of a line
_BETWEEN, _STRAIGHT = (0.25, 0.75), 0.9


# -- how it is made ---------------------------------------------------------------------------------------------------


class PreparedMotion:
    """The balls of a state that move, and what drives them: raises what is known to be wrong before anything moves.

    Attributes
    ----------
    waves : the balls and their law.
    drives : :class:`~granphon.Drive`, in turn, without impacts.
    velocities : (n, 3) those that impacts give, m/s.
    source : numbers of all balls that are driven.
    """

    def __init__(self, x: Any, settings: MotionSettings) -> None:
        law = getattr(getattr(getattr(x, "source", x), "crystal", None), "law", None)
        mu = math.inf if settings.friction_coefficient is None else settings.friction_coefficient
        network = settings.shape(given_network(x))
        self.settings = settings
        self.waves = NonlinearWaves(network, law, friction_coefficient=mu, damping=settings.damping)
        self.drives, self.velocities, sources = list[Drive](), np.zeros((network.n_balls, 3)), []
        for one in settings.drive:
            balls = read_balls("balls of the drive", one.find_balls(network), network)
            along = np.eye(network.dimension)[0] if one.direction is None else one.direction
            vector = read_vector("direction of the drive", along, network.dimension)
            sources.append(balls)
            if one.impact is None:
                moved: Any = one.shaker or one.displacement
                self.drives.append(Drive(balls, vector, displacement=moved, force=one.force))
            elif np.all(network.moving[balls]):
                self.velocities[balls] += one.impact * vector
            else:
                raise InputError("an impact on a body that is held", mend="Give it a shaker or a displacement")
        self.source = np.unique(np.concatenate(sources))

    def run(self) -> Motion:
        """Let the balls move."""
        settings, velocities = self.settings, self.velocities
        drive, frames, step = self.drives, settings.frames, settings.step
        return self.waves.run(settings.duration, velocities=velocities, drive=drive, frames=frames, step=step)


class Passage(NamedTuple):
    """When what a drive sends comes to each contact, and how fast it goes.

    Attributes
    ----------
    distances : (n_c,) of contacts from the nearest ball that is driven, or its nearest image, m.
    arrivals : (n_c,) times at which the force has changed by half of what it ever changes, s; nan where it hardly does.
    peaks, heights : (n_c,) times, s, and sizes, N, of the greatest force; a time is nan at the ends of the motion.
    front, peak : velocities of the arrivals and of the peaks, m/s: the slopes of the lines of least squares of distances
        over times, of contacts between a quarter and three quarters of the greatest distance. nan without such a line.
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
        distances = cKDTree(images).query(motion.middles)[0]
        change = np.abs(motion.forces - motion.forces[0]).max(axis=0)
        moved = change > _STILL * max(float(change.max(initial=0.0)), 1e-300)
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
    (a, b), (_, c) = np.cov(times[known], distances[known])
    return float(b / a) if b > _STRAIGHT * math.sqrt(a * c) else math.nan


def record_motion(x: Any, settings: MotionSettings) -> tuple[dict[str, Array], Motion]:
    """Let the array of a state, or of a network, move; return numbers by the names of the catalogue, and the motion."""
    prepared = PreparedMotion(x, settings)
    motion = prepared.run()
    passage = Passage.of(motion, prepared.source)
    numbers = {
        "front_velocity": passage.front, "peak_velocity": passage.peak, "greatest_force": motion.forces.max(),
        "energy_translation": motion.translation[-1], "energy_rotation": motion.rotation[-1],
        "energy_stored": motion.stored[-1], "energy_lost": motion.lost[-1],
        "energy_supplied": motion.work[-1] + motion.energy[0],
    }  # fmt: skip
    return {name: np.array(float(value)) for name, value in numbers.items()}, motion


# -- files ------------------------------------------------------------------------------------------------------------


def write_motion(motion: Motion, path: Path) -> None:
    """Write a motion and its network as a netCDF file, which :func:`read_motion` reads."""
    from xarray import Dataset

    variables, attrs = dict[str, Any](), dict[str, str]()
    for result, before in ((motion, ""), (motion.network, "network_")):
        rest = dict[str, Any]()
        for name, value in vars(result).items():
            dims = [_DIMS[letter] for letter in result._shapes.get(name, "").rstrip("?").split()]
            if isinstance(value, np.ndarray) and len(set(dims)) == value.ndim:
                about = {"units": result.units[name]} if name in result.units else {}
                variables[before + name] = (tuple(dims), value, about)
            elif not isinstance(value, Result):
                rest[name] = plain(value)
        attrs[before + "rest"] = json.dumps(rest)
    path.write_bytes(netcdf_bytes(Dataset(variables, attrs=attrs | {"format": "granphon motion"})))


def read_motion(path: Path) -> Motion:
    """Read the file of :func:`write_motion`; raises :class:`~granphon.base.errors.InputError` for another one."""
    try:
        data = open_bytes(read_bytes(path, MAX_SWEEP))
        if data.attrs.get("format") != "granphon motion":
            raise ValueError("it holds no motion")
        own, network = json.loads(data.attrs["rest"]), json.loads(data.attrs["network_rest"])
        for name, variable in data.data_vars.items():
            _, whole, last = str(name).partition("network_")
            (network if whole else own)[last or str(name)] = variable.values
        found = ContactNetwork.from_dict(network | {"class": "ContactNetwork"})
        return Motion.from_dict(own | {"class": "Motion", "network": found})
    except InputError:
        raise
    except Exception as error:  # whatever makes HDF5, h5netcdf or xarray fail is in the file
        raise InputError(f"{path} cannot be read", str(error), "Run the scene again") from None


def write_motion_table(motion: Motion, path: Path, source: Index) -> None:
    """Write the table of energies over time, or of contacts, by the name of the file."""
    columns: list[tuple[str, str, Any]]
    if path.name == TABLES[0]:
        energies = ("translation", "rotation", "stored", "lost", "work")
        columns = [("time", "s", motion.times), *((name, "J", getattr(motion, name)) for name in energies)]
        columns.append(("greatest_force", "N", motion.forces.max(axis=1)))
    else:
        passage = Passage.of(motion, source)
        columns = [("ball_i", "", motion.i), ("ball_j", "", motion.j)]
        columns += [(axis, "m", one) for axis, one in zip("xyz", motion.middles.T, strict=True)]
        columns += [("distance", "m", passage.distances), ("arrival", "s", passage.arrivals), ("peak", "s", passage.peaks)]
        columns.append(("greatest_force", "N", passage.heights))
    rows = zip(*(values.tolist() for _, _, values in columns), strict=True)
    path.write_text(table_text([Heading(name, unit) for name, unit, _ in columns], rows), encoding="utf-8")
