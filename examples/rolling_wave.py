"""Waves that roll
===============

With friction a transverse wave also turns the balls, and a rotational wave also displaces them. The
animation shows both waves at the same wave vector along a row of steel balls, four balls to a
wavelength. Colours and marks show how far a ball has turned: red anticlockwise, blue clockwise.
Both waves run to the right; the energy of the lower one runs to the left.
"""

import sys

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation
from matplotlib.collections import EllipseCollection, LineCollection

import granphon as gp
from granphon.figures.style import STYLE

steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
phonons = gp.Phonons(gp.AveragedLattice(gp.Packing(steel, diameter=8e-3)).at_force(18.446))
lattice = phonons.lattice
q = np.array([2.0 * np.pi / 4.0, 0.0])
modes = lattice.modes([q], direction=(1, 0))

# %% An eigenvector is (x, y, w), where :math:`w=R_g\phi` stands for the angle. A long transverse
# wave turns each ball exactly as much as it turns the medium, :math:`\frac12\partial u_y/\partial
# x`; the wave shown here turns it 8 % more. The rotational wave turns it the other way, and its
# group velocity is negative.

mixed = {"transverse": modes.eigenvectors[0, :, 0], "rotational": modes.eigenvectors[0, :, 2]}
turn = {name: (e[2] / lattice.gyration[0]) / (0.5j * q[0] * e[1]) for name, e in mixed.items()}
assert abs(turn["transverse"] - 1.077) < 1e-3
assert turn["rotational"].real < 0.0
assert np.allclose(np.imag(list(turn.values())), 0.0, atol=1e-12)
assert modes.group_velocities[0, 0, 0] > 0.0 > modes.group_velocities[0, 2, 0]

# %% At time t a ball at x has the phase :math:`qx-\omega t`. Both waves are drawn with the same
# period.

sites = np.array([[x + 0.5 * (y % 2), y * np.sqrt(0.75)] for x in range(-2, 11) for y in range(3)])


def motion(e, phase):
    """Displacements (balls, 2) and angles (balls,), both to the scale at which the larger is well
    seen.
    """
    wave = (
        min(0.16 / abs(e[1]), 0.2 / abs(e[2])) * e * np.exp(1j * (sites @ q - phase))[:, None]
    ).real
    return wave[:, :2], wave[:, 2] / lattice.gyration[0]


with matplotlib.rc_context(STYLE):
    figure, axes = plt.subplots(2, 1, figsize=(5.0, 3.2), dpi=90, layout="constrained")
    drawn = []
    for ax, (name, branch) in zip(axes, (("transverse", 0), ("rotational", 2)), strict=True):
        hertz = modes.frequencies[0, branch] * phonons.scales.frequency
        size = np.ones(len(sites))
        share = modes.rotational_fraction[0, branch]
        ax.set(
            title=f"{name}: {hertz / 1e3:.1f} kHz, {100.0 * share:.0f} % of the energy is rotation",
            aspect="equal",
        )
        ax.set(xlim=(-0.3, 9.3), ylim=(-0.7, 2.45))
        ax.set_axis_off()
        style = {"array": 0.0 * size, "cmap": "RdBu_r", "edgecolors": "0.4", "linewidths": 0.6}
        place = {"units": "xy", "offsets": sites, "offset_transform": ax.transData}
        balls = EllipseCollection(size, size, 0.0 * size, **style, **place)
        balls.set_clim(np.array([-1.6, 1.6]) * np.abs(motion(mixed[name], 0.0)[1]).max())
        marks = LineCollection([], colors="black", linewidths=1.0)
        ax.add_collection(balls)
        ax.add_collection(marks)
        drawn.append((mixed[name], balls, marks))


def draw(frame):
    for e, balls, marks in drawn:
        moved, angles = motion(e, 2.0 * np.pi * frame / 16)
        arms = 0.5 * np.stack([-np.sin(angles), np.cos(angles)], axis=1)
        balls.set(offsets=sites + moved, array=angles)
        marks.set_segments(list(np.stack([sites + moved - arms, sites + moved + arms], axis=1)))


animation = FuncAnimation(figure, draw, frames=16, interval=90)
if "-o" in sys.argv:
    animation.save(sys.argv[-1], writer="pillow")
else:
    figure.canvas.draw()  # the animation begins, also where no window can show it
    plt.show()
