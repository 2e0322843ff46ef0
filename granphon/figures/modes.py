"""Figures of single modes: balls with their displacements and rotations.

As in :mod:`granphon.figures.bands`, every function draws on an Axes and returns it.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from granphon.base.arguments import real_array

# before matplotlib, whose import this module guards
from granphon.figures.scales import hide_axes

# isort: split
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.patches import Circle
from numpy.typing import ArrayLike, NDArray

from granphon.base.errors import InputError, message
from granphon.base.scales import HertzPrefix
from granphon.figures.style import BLUE, VERMILION, print_hertz

if TYPE_CHECKING:
    from granphon.phonons.phonons import Phonons

__all__ = ["plot_mode"]

Array = NDArray[np.float64]
#: longest displacement in the drawing, in diameters; spins are drawn on the same scale
_LARGEST = 0.4
#: angle of the mark of a ball at rest, rad
_MARK = np.pi / 2.0


def plot_mode(
    phonons: Phonons,
    q: ArrayLike,
    branch: int,
    ax: Axes,
    *,
    cells: tuple[int, int] = (4, 4),
    phase: float = 0.0,
    direction: ArrayLike | None = None,
) -> Axes:
    """Draw the mode of branch ``branch`` at ``q`` on balls at their real size; axes in mean diameters, hidden.

    Each ball at r has the displacement Re(e M^-1/2 exp(i q.r + i phase)), an arrow from its centre, and is turned by the
    angle phi = w/R_g: the sector between the upright and its mark, in vermilion anticlockwise and in blue clockwise.
    Displacements and w have one scale, on which the largest of them in a period is 0.4 d. The free phase of the eigenvector
    is such that the largest of its components is real and positive, so that nothing stands still at phase 0.

    Parameters
    ----------
    q : (2,) or (3,), fractions of the reciprocal cell.
    branch : counted from 0, in ascending frequency.
    cells : number of cells to draw along each lattice vector.
    phase : phase of the motion, rad; at time t it is -omega t.
    direction : direction from which q is approached, as in ``Phonons.modes``: where branches touch, and (required) at Gamma.
    """
    modes = phonons.modes([real_array("q", q)], direction)
    count = modes.frequencies.shape[1]
    if not 0 <= branch < count:
        raise InputError(message(f"there is no branch {branch}", mend=f"Count from 0 to {count - 1}"))
    lattice = phonons.lattice
    n = lattice.n_balls
    motion = modes.eigenvectors[0, :, branch].reshape(n, -1) / np.sqrt(lattice.masses)[:, None]
    largest = motion.ravel()[np.argmax(np.round(np.abs(motion).ravel() / np.abs(motion).max(), 6))]
    motion = motion * (abs(largest) / largest) * _LARGEST / _find_amplitude(motion)
    steps = np.array(list(np.ndindex(*cells)))
    places = (steps @ lattice.cell)[:, None] + lattice.positions
    wave = np.exp(1j * (places @ (modes.wavevectors[0] * phonons.scales.length) + phase))
    now = (motion[None] * wave[..., None]).real.reshape(len(steps) * n, -1)
    centres = places.reshape(-1, 2)
    radius = np.tile(phonons.atoms.arrays.get("radius", np.full(n, 0.5)), len(steps))
    balls = [Circle((x, y), r) for (x, y), r in zip(centres, radius, strict=True)]
    ax.add_collection(PatchCollection(balls, facecolor="0.94", edgecolor="0.45", linewidth=0.6, zorder=1.0, gid="balls"))
    if lattice.motions.rotate:
        _draw_spins(ax, centres, radius, now[:, lattice.motions.turning][:, 0] / np.tile(lattice.gyration, len(steps)))
    ax.quiver(
        *centres.T, now[:, 0], now[:, 1], angles="xy", scale_units="xy", scale=1.0, units="xy", width=0.055, headwidth=3.6,
        headlength=4.0, headaxislength=3.6, minlength=0.0, minshaft=1.5, color="black", zorder=3.0, gid="displacements",
    )  # fmt: skip
    low, high = (centres - radius[:, None]).min(axis=0), (centres + radius[:, None]).max(axis=0)
    hide_axes(ax, low - 0.1, high + 0.1)
    hertz = float(modes.frequencies[0, branch])
    unit = HertzPrefix.for_top(hertz)
    near = [(float(x), Fraction(float(x)).limit_denominator(24)) for x in np.asarray(q, float)[:2]]
    fractions = ", ".join(str(ratio) if abs(x - ratio) < 1e-9 else f"{x:.4g}" for x, ratio in near)
    part = f", rotation {100.0 * float(modes.rotational_fraction[0, branch]):.0f} %" if lattice.motions.rotate else ""
    # rounding may leave this part of the highest frequency in place of zero
    zero = hertz <= count * np.finfo(float).eps * float(modes.frequencies.max())
    ax.set_title(f"q = ({fractions})\n{'zero frequency' if zero else f'{hertz / unit.hertz:.1f} {print_hertz(unit)}'}{part}")
    return ax


def _find_amplitude(motion: NDArray[Any]) -> float:
    """Return the largest displacement, or w, of any ball in a period; on an elliptic path, the longer half axis."""
    u = motion[:, :2]
    longest = np.sqrt(0.5 * (np.sum(np.abs(u) ** 2, axis=1) + np.abs(np.sum(u * u, axis=1))))
    return float(max(longest.max(), np.abs(motion[:, 2:]).max(initial=0.0)))


def _draw_spins(ax: Axes, centres: Array, radius: Array, angles: Array) -> None:
    """Draw for each ball the sector from the upright to its mark, its arc with an arrowhead, and the marked diameter."""

    def at(distance: Array, angle: Array) -> Array:
        arms = distance[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return np.asarray(centres[:, None] + arms)

    colours = [VERMILION if angle >= 0.0 else BLUE for angle in angles]  # anticlockwise, clockwise
    rim, end = 0.72 * radius, _MARK + angles[:, None]
    marks = at(radius, end + np.array([0.0, np.pi]))
    arcs = at(rim, _MARK + angles[:, None] * np.linspace(0.0, 1.0, 33))
    # a head as long as the arc allows, pointing along it
    head = np.sign(angles) * np.minimum(0.47, 0.8 * np.abs(angles))
    back = at(rim, end - head[:, None])
    wing = 0.5 * (arcs[:, -1:] - back) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    heads = np.concatenate([arcs[:, -1:], back + wing, back - wing], axis=1)
    sectors = np.concatenate([centres[:, None], arcs], axis=1)
    ax.add_collection(PolyCollection(list(sectors), facecolors=colours, alpha=0.25, linewidths=0.0, zorder=1.5))
    ax.add_collection(LineCollection(list(marks), colors="0.45", linewidths=0.6, gid="marks"))
    ax.add_collection(LineCollection(list(arcs), colors=colours, linewidths=1.0, gid="spins"))
    ax.add_collection(PolyCollection(list(heads), facecolors=colours, linewidths=0.0, zorder=2.1))
