"""Hundreds of results over all features at full precision, to be compared before and after a
change of structure.

    python -m tests.record FILE.npz              writes them
    python -m tests.record FILE.npz --compare    computes them again, and lists what differs by more than it may

Arrays may differ by 1e-13 of their largest entry, frequencies near Gamma each by that of itself,
results of simulations by the residual of their equilibria. Eigenvectors are recorded as projectors
on each set of degenerate modes.
"""

from __future__ import annotations

import sys

if __name__ == "__main__" and sys.path[0] == __file__.rpartition("/")[0]:
    del sys.path[0]  # beside this file there are folders with names of modules, such as array

import argparse
import itertools
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import granphon as gp

#: by the first word of a result's name: how much it may differ, of the array's largest
ALLOWED = {"simulation": 1e-9, "fit": 1e-9}
EXACT = 1e-13

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
GLASS = gp.Material(70e9, 0.22, 2500.0)
FORCES = np.array([2.0, 5.0, 18.446])
PATH = "GKMG"


def packings() -> Iterator[tuple[str, gp.Packing]]:
    """Lattices with and without friction, equal balls."""
    for lattice, friction in itertools.product(("triangular", "square", "kagome"), (True, False)):
        if lattice == "triangular" or friction:
            yield (
                f"{lattice}, friction {friction}",
                gp.Packing(STEEL, 8e-3, lattice=lattice, friction=friction),
            )


def spreads() -> dict[str, Any]:
    """A distribution of each kind."""
    d = 8e-3
    return {
        "uniform": gp.Uniform(2.04e-6),
        "normal": gp.Normal(0.6e-6),
        "discrete": gp.Discrete(diameters=(d - 1e-6, d + 1e-6), fractions=(0.5, 0.5)),
    }


def projectors(modes: Any) -> np.ndarray:
    """(n_q, dofs, dofs): on the lowest set of modes at each q whose frequencies differ by less than
    1e-6 of the top.
    """
    values = modes.frequencies
    vectors = modes.eigenvectors
    out = []
    for w, v in zip(values, vectors, strict=True):
        few = v[:, w < w[0] + 1e-6 * values.max()]
        out.append(few @ few.conj().T)
    found = np.array(out)
    return np.stack([found.real, found.imag])


def states() -> Iterator[tuple[str, Any]]:
    """States of every medium that solves no array."""
    for name, packing in packings():
        for finite in (False, True):
            medium = gp.AveragedLattice(packing)
            yield f"ala, {name}, finite {finite}", medium.at_force(FORCES, finite_overlap=finite)
    for kind, spread in spreads().items():
        rough = gp.Packing(STEEL, 8e-3, spread=spread)
        for medium in (gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium):
            yield f"{medium.name}, {kind}", medium(rough).at_force(FORCES)
            yield (
                f"{medium.name}, {kind}, pressure",
                medium(rough).at_pressure([500.0, 4000.0], finite_overlap=True),
            )
    yield (
        "paper's local field",
        gp.EffectiveMedium(gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2.04e-6)), "paper").at_force(
            5.0
        ),
    )


def observed(name: str, state: Any) -> Iterator[tuple[str, Any]]:
    """What is found of a state."""
    for field in (
        "force",
        "overlap",
        "normal_stiffness",
        "shear_stiffness",
        "reduced_force",
        "contact_fraction",
        "force_fluctuation",
        "stiffness_ratio",
        "effective_density",
    ):
        yield f"{name}: {field}", getattr(state, field)
    v = gp.sound_velocities(state, (0.6, 0.8))
    yield f"{name}: velocities", np.stack([v.longitudinal, v.transverse])
    yield f"{name}: tensor", gp.moduli(state).tensor
    yield (
        f"{name}: validity",
        np.stack(
            [np.broadcast_to(check.value, state.shape) for check in gp.validity(state).checks]
        ),
    )
    if not state.finite_overlap:
        yield f"{name}: exponent", gp.local_exponent(state)


def spectra() -> Iterator[tuple[str, Any]]:
    """Bands, densities of states, modes, force constants, in SI and in reduced units."""
    generic = np.array([[0.11, 0.07], [0.31, -0.22], [1 / 3, 1 / 3], [0.5, 0.0]])
    for name, packing in packings():
        state = gp.AveragedLattice(packing).at_force(18.446)
        phonons = gp.Phonons(state)
        path = "GXMG" if "square" in name else PATH
        bands = phonons.bands(path, npoints=11)
        yield f"bands, {name}: frequencies", bands.frequencies
        yield f"bands, {name}: velocities", bands.group_velocities
        yield f"bands, {name}: rotation", bands.rotational_fraction
        yield f"bands, {name}: distances", bands.distances
        modes = phonons.modes(generic)
        yield f"modes, {name}: projectors", projectors(modes)
        yield (
            f"near gamma, {name}",
            np.log(phonons.frequencies([[1e-9, 2e-9], [1e-12, 0.0]])[:, :2]),
        )
        dos = phonons.dos(mesh=(12, 12), points=51)
        yield (
            f"dos, {name}",
            np.stack([dos.frequencies / dos.frequencies[-1], dos.translational, dos.rotational]),
        )
        atoms = gp.atoms(state).repeat((3, 3, 1))
        calc = gp.HertzMindlin(state)
        yield f"force constants, {name}", calc.get_force_constants(atoms)
        lattice = gp.ContactLattice.of(packing.structure, packing.mindlin_ratio)
        yield f"C(q), {name}", np.abs(lattice.compatibility(lattice.wavevectors(generic)))
        yield f"D(q), {name}", np.abs(lattice.dynamical_matrix(lattice.wavevectors(generic)))
    state = gp.AveragedLattice(gp.Packing(STEEL, 8e-3)).at_force(18.446)
    for frequency, direction in itertools.product((500.0, 6500.0), ((1, 0), (0, 1))):
        pulse = gp.pulse_velocities(state, frequency, direction=direction)
        yield f"pulses, {frequency} Hz along {direction}", np.stack([pulse.phase, pulse.group])


def simulations() -> Iterator[tuple[str, Any]]:
    """Direct simulation."""
    for friction in (True, False):
        packing = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2.04e-6), friction=friction)
        state = gp.DirectSimulation(packing, shape=(16, 16), seed=1, samples=2).at_force(
            [2.0, 18.446]
        )
        for field in (
            "overlap",
            "normal_stiffness",
            "force_fluctuation",
            "contact_fraction",
            "elastic_tensor",
        ):
            yield f"simulation, friction {friction}: {field}", getattr(state, field)
        v = gp.sound_velocities(state)
        yield (
            f"simulation, friction {friction}: velocities",
            np.stack([v.longitudinal, v.transverse]),
        )


def sweeps_and_fits() -> Iterator[tuple[str, Any]]:
    """Data sets, files and fits."""
    rough = gp.Packing(GLASS, 1e-3, spread=gp.Uniform(4e-6))
    data = gp.sweep(
        rough,
        force=[1.0, 5.0],
        media=("ala", "afa", "ema"),
        bands=PATH,
        npoints=5,
        width=[2e-6, 4e-6],
    )
    for name in ("longitudinal", "transverse", "bulk", "shear", "exponent", "frequencies"):
        yield f"sweep: {name}", data[name].values
    steel = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2.04e-6))
    force = np.geomspace(2.0, 20.0, 8)
    exact = gp.sound_velocities(gp.EffectiveMedium(steel).at_force(force)).longitudinal
    found = gp.fit_width(
        steel, force, exact * (1.0 + 1e-3 * np.cos(np.arange(8))), sigma=1e-3 * exact
    )
    yield "fit: values", np.array([found.width, found.stderr, found.chi2])
    with tempfile.TemporaryDirectory() as folder:
        state = gp.EffectiveMedium(steel).at_force(5.0)
        phonons = gp.Phonons(state)
        phonons.save(Path(folder) / "p.yaml")
        bridge, scales = gp.load_phonopy(Path(folder) / "p.yaml")
        yield "file: force constants", bridge.force_constants
        yield "file: scales", np.array([scales.length, scales.stiffness, scales.mass])
        bands = phonons.bands(PATH, npoints=5)
        bands.write(Path(folder) / "band.yaml")
        yield "file: bands", gp.Bands.read(Path(folder) / "band.yaml").frequencies


def results() -> dict[str, np.ndarray]:
    """Every result by its name."""
    found = [pair for name, state in states() for pair in observed(name, state)]
    found += [*spectra(), *simulations(), *sweeps_and_fits()]
    return {name: np.asarray(value, float) for name, value in found}


def differences(old: dict[str, np.ndarray], new: dict[str, np.ndarray]) -> list[str]:
    """A line for each result that differs by more than it may, or that only one of the two has."""
    lines = [f"only in one: {name}" for name in old.keys() ^ new.keys()]
    for name in old.keys() & new.keys():
        a = old[name]
        b = new[name]
        if a.shape != b.shape:
            lines.append(f"{name}: shape {a.shape}, now {b.shape}")
            continue
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        scale = np.max(np.abs(a[np.isfinite(a)]), initial=0.0)
        with np.errstate(invalid="ignore"):
            error = np.max(np.where(same, 0.0, np.abs(a - b)), initial=0.0) / (scale or 1.0)
        if not error <= ALLOWED.get(name.split()[0].rstrip(",:"), EXACT):
            lines.append(f"{name}: differs by {error:.2e} of its largest")
    return sorted(lines)


def main() -> int:
    """Record, or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--compare", action="store_true")
    given = parser.parse_args()
    new = results()
    if not given.compare:
        np.savez_compressed(
            given.file, **{name.replace("/", "|"): value for name, value in new.items()}
        )
        print(f"{len(new)} results written to {given.file}")
        return 0
    with np.load(given.file) as stored:
        old = {name.replace("|", "/"): stored[name] for name in stored.files}
    lines = differences(old, new)
    print("\n".join([*lines, f"{len(lines)} of {len(new)} results differ"]))
    return bool(lines)


if __name__ == "__main__":
    sys.exit(main())
