"""The pictures of the pages: ``python docs/_images.py`` draws them into docs/images, with names
only those.

Every file there has its entry here: a function that draws it, an example whose figure it is, or
what else makes it.
"""

from __future__ import annotations

import io
import runpy
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

from granphon.figures.scales import FORCES

import matplotlib.pyplot as plt
import numpy as np
from ase.optimize import BFGS
from matplotlib.collections import EllipseCollection, LineCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import FancyBboxPatch
from PIL import Image

import granphon as gp
from granphon.balls.loads import force_of_frame
from granphon.figures.bands import bands_figure, plot_bands, plot_dos
from granphon.figures.curves import fit_figure, plot_sweep
from granphon.figures.forces import forces_figure
from granphon.figures.modes import plot_mode
from granphon.figures.style import BLUE, GUIDE, STYLE, VERMILION
from granphon.figures.views import Painter, View
from granphon.figures.work_precision import plot_work_precision

HERE = Path(__file__).resolve().parent
EXAMPLES = HERE.parent / "examples"
#: greatest resolution of pictures, in dots per inch, and the greatest width, in dots: a page shows
#: it some 700 wide
_DPI = 300
_WIDTH = 1200
#: colours that are left of a picture: as many as leave its file below 100 kB
_COLOURS = 256, 128, 64, 32
MOST_BYTES = 100_000

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
GLASS = gp.Material(young_modulus=70e9, poisson_ratio=0.2, density=2500.0)
EQUAL = gp.Packing(STEEL, diameter=8e-3)
REAL = gp.Packing(STEEL, diameter=8e-3, spread=gp.Uniform(2.04e-6))


def panels(*ratios: float, height: float = 2.8) -> tuple[Any, Any]:
    """A figure as wide as a page, with panels side by side."""
    return plt.subplots(
        1, len(ratios), figsize=(6.4, height), width_ratios=ratios, layout="constrained"
    )


def draw_design() -> Any:
    """The design of a chain of two masses of given sum, of how-to/design.md."""
    ball = gp.Ball(STEEL, 19.05e-3)
    chain = gp.Crystal.on("chain", [ball, ball], friction=False).at_force(20.0).network
    mass = chain.masses[0]
    bounds = (0.3 * mass, 1.8 * mass)
    sums = {"mass": 2.0 * mass}
    return gp.plot(gp.design(chain, gp.WidestGap(), bounds=bounds, constraints=sums))


def draw_errors() -> Any:
    """Bands with their standard errors, and velocities over the load with theirs."""
    text = (
        "material: {young_modulus: 211.65 +- 10 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm, spread: {uniform: 2 um}}\n"
    )
    scenes = (
        "load: {force: 18.4 N +- 5 %}\nmedium: ala\nobserve: [bands]\n",
        "load: {force: {from: 5 N, to: 100 N, points: 12}}\nmedium: [ala, ema]\n",
    )
    with tempfile.TemporaryDirectory() as folder:
        one, many = (
            gp.Scene.from_text(text + scene).run(Path(folder) / str(number), figures=False)
            for number, scene in enumerate(scenes)
        )
    figure, (left, right) = panels(1.0, 1.2)
    plot_bands(one.bands, left, errors=one.dataset["frequencies_error"])
    plot_sweep(many.dataset, right)
    return figure


def draw_diameters() -> Any:
    """A list of six diameters, and a uniform spread of the same width: how many balls have which
    size, and the exponent.
    """
    lot = gp.Measured([8.0009e-3, 7.9988e-3, 7.9994e-3, 8.0001e-3, 8.0012e-3, 7.9996e-3])
    even = gp.Uniform(lot.width)
    force = np.geomspace(1.0, 60.0, 300)
    figure, (left, right) = panels(1.0, 1.6)
    edge = 0.5e6 * even.width
    left.fill_between([-edge, edge], 1.0, color=VERMILION, alpha=0.25, label="uniform")
    left.vlines(
        1e6 * (np.array(lot.diameters) - lot.mean), 0.0, 1.0, color=BLUE, label="list of six"
    )
    left.set(xlabel="Diameter - mean (µm)", yticks=[], ylim=(0.0, 1.6))
    left.legend(loc="upper center", ncols=2, columnspacing=1.0)
    for spread, colour, label in (
        (lot, BLUE, "list of six"),
        (even, VERMILION, "uniform, same width"),
    ):
        state = gp.EffectiveMedium(gp.Packing(STEEL, lot.mean, spread)).at_force(force)
        right.semilogx(
            force,
            gp.local_exponent(state),
            color=colour,
            label=label,
            zorder=3.0 if colour == VERMILION else 2.0,
        )
    right.axhline(1.0 / 6.0, color=GUIDE, linestyle="--", label="equal balls, 1/6")
    right.set(xlabel="Contact force (N)", ylabel="Local exponent")
    right.legend()
    return figure


def draw_fit() -> Any:
    """The times of flight of the page, and the fit."""
    sides = np.array([100.0, 200.0, 300.0, 400.0, 500.0, 700.0, 990.0])
    times = 1e-6 * np.array([913.3, 745.8, 670.7, 632.3, 607.8, 572.1, 537.1])
    velocity = 0.4157 / times
    return fit_figure(
        gp.fit_width(
            REAL, force_of_frame(sides, 31), velocity, np.full(7, 3.0), 6500.0, direction=(0, 1)
        )
    )


def draw_simulation() -> Any:
    """Force chains in an array of 24 x 24 balls, and how forces are distributed."""
    return forces_figure(gp.DirectSimulation(REAL, shape=(24, 24), seed=0, samples=2).at_force(2.0))


def draw_figure() -> Any:
    """Bands, a density of states and a mode, each on an Axes of its own."""
    state = gp.AveragedLattice(EQUAL).at_force(18.446)
    phonons = gp.Phonons(state)
    figure, axes = panels(1.4, 1.2, 1.0)
    plot_bands(phonons.bands("GKMG"), axes[0], asymptotes=gp.sound_velocities(state))
    plot_dos(phonons.dos(mesh=(64, 64)), axes[1]).legend()
    plot_mode(phonons, (1 / 3, 1 / 3), 0, axes[2])
    return figure


def draw_lattices() -> Any:
    """A piece of each lattice that is known by name; of crystals a cube, or two layers, with the
    contacts as lines.
    """
    figure, axes = plt.subplots(2, 5, figsize=(6.4, 3.0), layout="constrained")
    pieces = {
        "chain": [3.0], "triangular": [2.0, 1.8], "square": [2.0, 2.0],
        "honeycomb": [3.1, 2.7], "kagome": [3.1, 3.6], "sc": [1.0] * 3,
        "bcc": [2.0 / 3.0**0.5] * 3, "fcc": [2.0**0.5] * 3, "hcp": [2.1, 1.8, 1.7],
        "diamond": [4.0 / 3.0**0.5] * 3,
    }  # fmt: skip
    for ax, (name, box) in zip(axes.flat, pieces.items(), strict=True):
        lattice = gp.Packing(STEEL, 8e-3, lattice=name).structure
        cells = np.stack(
            np.meshgrid(*[np.arange(-5, 6)] * lattice.periods, indexing="ij"), axis=-1
        ).reshape(-1, lattice.periods)
        flat = (cells[:, None] @ lattice.vectors + lattice.positions).reshape(-1, lattice.dimension)
        flat = flat[np.all((flat > -1e-6) & (flat < np.array(box) + 1e-6), axis=1)]
        places = np.pad(flat, ((0, 0), (0, 3 - lattice.dimension)))
        space = lattice.dimension == 3
        painter = Painter(
            View(azimuth=-68.0, elevation=16.0) if space else View(azimuth=-90.0, elevation=90.0)
        )
        for i, place in enumerate(places):
            painter.add_sphere(place, 0.25 if space else 0.5, BLUE)
            for other in places[:i] if space else ():
                if abs(np.linalg.norm(other - place) - 1.0) < 1e-6:
                    painter.add_line(np.stack([place, other]), "0.45", 1.2)
        painter.draw(ax, name, fade=0.45 if space else 0.0)
        low, high = painter.extent
        middle = 0.5 * (low + high)
        half = 0.53 * max(float(np.max(high - low)), 2.0)
        ax.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half))
        ax.set(aspect="equal", title=name)
        ax.axis("off")
    return figure


def draw_crystal() -> Any:
    """Bands of fcc with its Brillouin zone."""
    phonons = gp.Phonons(
        gp.AveragedLattice(gp.Packing(STEEL, 8e-3, lattice="fcc")).at_force(18.446)
    )
    return bands_figure(phonons.bands("GXWKGL", npoints=41), asymptotes=phonons.lattice)


def draw_vacancy() -> Any:
    """Where balls without friction move when one of them is taken out, and the array relaxes."""
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3, friction=False)).at_force(18.446)
    balls = gp.atoms(state).repeat((8, 8, 1))
    del balls[35]
    balls.calc = gp.HertzMindlin(state)
    sites = balls.positions[:, :2].copy()
    BFGS(balls, alpha=6.0, logfile=None).run(fmax=1e-6 * state.force / state.scales.force)
    moved = balls.positions[:, :2] - sites
    nanometres = 1e9 * state.scales.length * np.linalg.norm(moved, axis=1)
    figure, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    discs = EllipseCollection(
        0.98,
        0.98,
        0.0,
        units="xy",
        offsets=sites,
        offset_transform=ax.transData,
        array=nanometres,
        cmap="cividis_r",
    )
    ax.add_collection(discs)
    ax.quiver(
        *sites.T,
        *(moved / np.max(np.linalg.norm(moved, axis=1))).T,
        color=VERMILION,
        scale=1.0,
        scale_units="xy",
        width=0.006,
    )
    figure.colorbar(discs, label="Displacement (nm)")
    ax.set(xlim=(-4.2, 7.7), ylim=(-0.7, 6.8), aspect="equal")
    ax.axis("off")
    return figure


def draw_phonopy() -> Any:
    """Bands of granphon, and the frequencies that phonopy finds from the force constants."""
    phonons = gp.Phonons(gp.AveragedLattice(EQUAL).at_force(18.446))
    bands = phonons.bands("GKMG")
    figure, ax = plt.subplots(figsize=(6.4, 3.0), layout="constrained")
    plot_bands(bands, ax)
    start = np.concatenate([[0.0], np.cumsum([piece[-1] - piece[0] for piece in bands.distances])])
    for qpoints, along, distance_at_start in zip(
        bands.qpoints, bands.distances, start, strict=False
    ):
        frequencies = (
            phonons.phonopy.run_qpoints(qpoints[::10]).frequencies * phonons.scales.frequency / 1e3
        )
        ax.plot(
            distance_at_start + along[::10] - along[0],
            frequencies,
            "o",
            color="none",
            markeredgecolor="black",
            markersize=4.0,
        )
    ax.plot([], [], "o", color="none", markeredgecolor="black", markersize=4.0, label="phonopy")
    ax.legend(loc="lower center")
    return figure


def draw_cluster() -> Any:
    """All frequencies of seven balls, and the highest mode."""
    state = gp.AveragedLattice(EQUAL).at_force(18.446)
    sheet = gp.atoms(state).repeat((9, 9, 1))
    balls = sheet[np.linalg.norm(sheet.positions - sheet.positions[40], axis=1) < 1.1]
    balls.pbc = False
    balls.center(vacuum=2.0, axis=(0, 1))
    balls.calc = gp.HertzMindlin(state)
    constants = balls.calc.get_force_constants(balls).transpose(0, 2, 1, 3).reshape(21, 21)
    squared, modes = np.linalg.eigh(constants)
    modes = modes.reshape(7, 3, 21)
    rotation = np.sum(modes[:, 2] ** 2, axis=0)
    figure, (left, right) = panels(1.5, 1.0)
    levels = left.scatter(
        np.arange(1, 22),
        np.sqrt(np.maximum(squared, 0.0)) * state.scales.frequency / 1e3,
        c=rotation,
        cmap="plasma",
        vmin=0.0,
        vmax=1.0,
    )
    levels.set_edgecolor("0.3")
    left.set(xlabel="Mode", ylabel="Frequency (kHz)", xticks=[1, 4, 10, 16, 21])
    figure.colorbar(levels, ax=left, label="Rotational part", ticks=[0.0, 0.5, 1.0])
    sites = balls.positions[:, :2] - balls.positions[:, :2].mean(axis=0)
    turns = modes[:, 2, -1]
    right.add_collection(
        EllipseCollection(
            1.0,
            1.0,
            0.0,
            units="xy",
            offsets=sites,
            offset_transform=right.transData,
            facecolors="0.9",
            edgecolors="0.3",
        )
    )
    for site, turn in zip(sites, turns, strict=True):
        angle = np.linspace(0.0, 2.6 * np.pi * turn / np.max(np.abs(turns)) * 0.6, 40)
        arc = site + 0.3 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        right.plot(*arc[:-3].T, color=VERMILION)
        right.annotate("", arc[-1], arc[-6], arrowprops={"arrowstyle": "-|>", "color": VERMILION})
    right.set(
        xlim=(-1.6, 1.6),
        ylim=(-1.6, 1.6),
        aspect="equal",
        title="The highest mode: all turn one way",
    )
    right.axis("off")
    return figure


def draw_network() -> Any:
    """Balls of three sizes and their contacts as LAMMPS wrote them, and the lowest mode."""
    files = EXAMPLES / "packings" / "disks_atoms.dump", EXAMPLES / "packings" / "disks_pairs.dump"
    network = gp.ContactNetwork.from_lammps(*files, GLASS)
    every = gp.ContactNetwork.from_lammps(*files, GLASS, keep_rattlers=True)
    lowest = gp.Waves(network).modes(3)
    moved = np.real(lowest.vectors[0]).reshape(network.n_balls, -1)[:, :2]
    figure, axes = panels(1.0, 1.0, height=3.2)
    for ax in axes:
        ax.add_collection(
            EllipseCollection(
                2e3 * every.radii,
                2e3 * every.radii,
                0.0 * every.radii,
                units="xy",
                offsets=1e3 * every.positions[:, :2],
                offset_transform=ax.transData,
                facecolors="0.93",
                edgecolors="0.5",
            ),
            autolim=False,
        )
        ax.set(
            xlim=(0.0, 1e3 * network.cell[0, 0]),
            ylim=(0.0, 1e3 * network.cell[1, 1]),
            aspect="equal",
            xlabel="x (mm)",
        )
    start = network.positions[network.i]
    strength = network.normal_force / network.normal_force.mean()
    lines = LineCollection(
        list(1e3 * np.stack([start, start + network.vector], axis=1)[:, :, :2]),
        linewidths=2.0 * strength,
        array=strength,
        cmap=FORCES,
    )
    axes[0].add_collection(lines, autolim=False)
    axes[0].set(ylabel="y (mm)", title="Contacts, as wide as their force")
    axes[1].quiver(*1e3 * network.positions[:, :2].T, *moved.T, color=VERMILION, width=0.008)
    axes[1].set(title=f"The lowest mode, {lowest.frequencies[0] / 1e3:.1f} kHz", yticks=[])
    return figure


def draw_tradeoff() -> Any:
    """Error over time of the media."""
    result = gp.tradeoff(REAL, force=19.9, budget=45.0)
    figure, ax = plt.subplots(figsize=(6.4, 3.4), layout="constrained")
    plot_work_precision(result, "media", ax)
    return figure


def draw_machines() -> Any:
    """The way of tasks and results between the command, a scheduler and workers on other machines,
    and the store.
    """
    figure, ax = plt.subplots(figsize=(6.4, 2.7), layout="constrained")
    ax.set(xlim=(0.0, 12.8), ylim=(0.3, 5.3))
    ax.set_axis_off()
    boxes = {
        "granphon run\ncuts the sweep into tasks": (0.1, 3.5, 3.6, 1.4, BLUE),
        "store, one file:\nresults of finished tasks": (0.1, 0.5, 3.6, 1.4, "0.25"),
        "scheduler of dask\ngives tasks to\nworkers that are free": (5.4, 0.5, 2.8, 4.4, BLUE),
        "worker on machine 1": (9.8, 3.9, 2.9, 1.0, VERMILION),
        "worker on machine 2": (9.8, 2.2, 2.9, 1.0, VERMILION),
        "worker on machine 3": (9.8, 0.5, 2.9, 1.0, VERMILION),
    }
    for words, (x, y, width, height, colour) in boxes.items():
        style = {
            "boxstyle": "round,pad=0,rounding_size=0.15",
            "edgecolor": colour,
            "linewidth": 1.2,
        }
        ax.add_patch(
            FancyBboxPatch((x, y), width, height, facecolor=(*to_rgb(colour), 0.12), **style)
        )
        ax.text(x + width / 2.0, y + height / 2.0, words, ha="center", va="center", fontsize=7.5)

    def arrow(start: tuple[float, float], end: tuple[float, float], colour: str) -> None:
        ax.annotate(
            "", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.0}
        )

    for (left, right), y in (((3.75, 5.35), 4.2), *(((8.25, 9.75), y) for y in (4.4, 2.7, 1.0))):
        arrow((left, y + 0.2), (right, y + 0.2), BLUE)
        arrow((right, y - 0.2), (left, y - 0.2), VERMILION)
    arrow((1.6, 3.45), (1.6, 1.95), VERMILION)
    arrow((2.2, 1.95), (2.2, 3.45), "0.25")
    for x, y, words, colour in (
        (4.55, 4.75, "tasks,\nin batches", BLUE),
        (9.0, 4.9, "tasks", BLUE),
        (4.55, 3.6, "results", VERMILION),
        (9.0, 3.8, "results", VERMILION),
        (0.75, 2.7, "results", VERMILION),
        (3.75, 2.7, "when the sweep\nis continued", "0.25"),
    ):
        ax.text(x, y, words, ha="center", va="center", color=colour, fontsize=7.0)
    return figure


def draw_laws() -> Any:
    """Force and stiffness over the overlap of laws for the same two balls, and for two of rubber
    that adhere.
    """
    ball = gp.Ball(STEEL, 8e-3)
    rubber = gp.Ball(gp.Material(5e6, 0.49, 1100.0), 8e-3)
    figure, axes = panels(1.0, 1.0, height=2.4)
    laws = (
        ("Hertz", gp.Hertz()),
        ("power 1", gp.PowerLaw(1.0, 1e7)),
        ("power 2", gp.PowerLaw(2.0, 5e12)),
    )
    adhesive = (("Hertz", gp.Hertz()), ("DMT", gp.DMT(0.1)), ("JKR", gp.JKR(0.1)))
    for ax, body, several, reach in (
        (axes[0], ball, laws, (-0.5, 2.0)),
        (axes[1], rubber, adhesive, (-4.0, 8.0)),
    ):
        overlap = np.linspace(*reach, 400)
        for name, law in several:
            force = law.between(body, body).force(overlap * 1e-6)
            ax.plot(overlap, force if body is ball else 1e3 * force, label=name)
        ax.axhline(0.0, color=GUIDE, linewidth=0.5)
        ax.set(xlabel="Overlap (µm)", ylabel="Force (N)" if body is ball else "Force (mN)")
        ax.legend()
    return figure


def draw_run() -> Any:
    """What ``granphon run`` draws of the array of the first page."""
    with tempfile.TemporaryDirectory() as folder:
        return (
            gp.Scene.from_yaml(EXAMPLES / "steel_hexagon.yaml")
            .run(folder, figures=False, force=True)
            .figure("bands.png")
        )


def draw_rest() -> Any:
    """Steps of Newton's method, and iterations in all, until an array is at rest, over its load."""
    reduced_force = np.geomspace(1e-3, 5.0, 20)
    force = reduced_force * REAL.width_units.force
    figure, axes = panels(1.0, 1.0, height=2.4)
    colours = {"lattice": BLUE, "exact": VERMILION}
    for geometry, colour in colours.items():
        medium = gp.DirectSimulation(REAL, (32, 32), seed=0, geometry=geometry)
        rests = [state.equilibrium for state in medium.at_force(force).samples]
        for axis, counts in zip(axes, ("newton", "conjugate"), strict=True):
            numbers = [getattr(rest, counts) for rest in rests]
            axis.loglog(reduced_force, numbers, ".-", color=colour, label=f"{geometry} directions")
    for axis, label in zip(axes, ("steps of Newton's method", "iterations, in all"), strict=True):
        axis.set(xlabel="reduced force f*", ylabel=label)
    axes[0].set(yscale="linear", ylim=(0.0, None))
    axes[0].legend()
    return figure


def of_example(name: str) -> Callable[[], Any]:
    """The figure of an example."""
    return lambda: runpy.run_path(str(EXAMPLES / f"{name}.py"))["figure"]


#: how each picture is made: by a function, or as the text says
IMAGES: dict[str, Callable[[], Any] | str] = {
    "bands": draw_run,
    "long_waves": of_example("steel_bands"),
    "conjecture": of_example("conjecture"),
    "disorder_in_space": of_example("disorder_in_space"),
    "force_chains": of_example("force_chains"),
    "hexagon_pulse": of_example("hexagon_pulse"),
    "diameters": draw_diameters,
    "velocities": draw_fit,
    "simulation": draw_simulation,
    "tradeoff": draw_tradeoff,
    "machines": draw_machines,
    "python": of_example("pulse_dispersion"),
    "figure": draw_figure,
    "rest": draw_rest,
    "several_runs": of_example("several_runs"),
    "lattices": draw_lattices,
    "crystal": draw_crystal,
    "vacancy": draw_vacancy,
    "phonopy": draw_phonopy,
    "cluster": draw_cluster,
    "network": draw_network,
    "kinds": of_example("diatomic_chain"),
    "loads": of_example("pressed_along_one_axis"),
    "law": draw_laws,
    "losses": of_example("losses"),
    "errors": draw_errors,
    "design": draw_design,
    "edges": of_example("zigzag_edge"),
    "response": of_example("transfer_function"),
    "traces": of_example("time_of_flight"),
    "walls": of_example("magnetic_chain"),
    "transmission": of_example("transmission"),
    "impact": of_example("solitary_wave"),
    "paper": of_example("paper_figure5"),
    "beads": "the command of how-to/material.md",
    "fit": "the command of tutorial/steel.md",
    "tutorial_sweep": "the command of tutorial/steel.md",
    "sweep": "granphon run examples/steel_spread.yaml",
    "spectrum": "the command of how-to/waves.md",
    "page": "a browser that shows the page of how-to/page.md",
    "friction_forces": "python tests/benchmarks/study_friction.py",
    "friction_sound": "python tests/benchmarks/study_friction.py",
}


def save(figure: Any, path: Path) -> None:
    """Write a figure as a small file of few colours."""
    held = io.BytesIO()
    figure.savefig(held, dpi=min(_DPI, _WIDTH / figure.get_figwidth()), format="png")
    plt.close(figure)
    reduce(Image.open(held), path)


def reduce(picture: Any, path: Path) -> None:
    """Write a picture in few colours, no wider than the pages show it sharply."""
    if picture.width > _WIDTH:
        picture = picture.resize(
            (_WIDTH, round(picture.height * _WIDTH / picture.width)), Image.Resampling.LANCZOS
        )
    for colours in _COLOURS:
        picture.convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(path, optimize=True)
        if path.stat().st_size < MOST_BYTES:
            return


def main(names: list[str]) -> None:
    """Draw the pictures with these names, or all that this script draws."""
    for name, source in IMAGES.items():
        if (not names or name in names) and callable(source):
            with matplotlib.rc_context(STYLE):
                save(source(), HERE / "images" / f"{name}.png")
            print(f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
