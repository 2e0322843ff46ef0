"""Balls of several kinds in files: symbols, masses and radii as ASE, phonopy, Euphonic and
phononwebsite read them.
"""

import json
import re
from dataclasses import replace

import ase.io
import numpy as np
import phonopy
import pytest
from numpy.testing import assert_allclose

import granphon as gp
from granphon.page.phononwebsite import write_phononwebsite
from granphon.phonons.phonopy_atoms import choose_symbols
from tests.networks.test_cuts import bulk

STEEL = gp.Material(193e9, 0.30, 8000.0)
LARGE = gp.Ball(STEEL, 8e-3, name="large")
SMALL = gp.Ball(STEEL, (np.sqrt(2.0) - 1.0) * 8e-3, name="Sn")


def square(**options):
    return gp.Crystal(
        [LARGE, SMALL], np.diag([8e-3, 8e-3]), [[0, 0], [4e-3, 4e-3]], **options
    ).at_pressure(10.0)


def salt(*names):
    balls = [
        gp.Ball(STEEL, 8e-3, mass=mass, name=name)
        for mass, name in zip((2e-3, 1e-3), names, strict=True)
    ]
    return gp.Crystal.on("NaCl", balls).at_pressure(1e5)


def test_names_that_are_symbols_stay_and_all_are_different():
    assert choose_symbols(["Na", "Cl", "Na"]) == {"Na": "Na", "Cl": "Cl"}
    assert choose_symbols(["steel", "Fe", "glass"]) == {"steel": "Al", "Fe": "Fe", "glass": "Cu"}
    assert choose_symbols(["steel", "Al6061", "Ti 6Al-4V"]) == {
        "steel": "Fe",
        "Al6061": "Al",
        "Ti 6Al-4V": "Ti",
    }
    assert choose_symbols(["Al 1", "Al 2", "Aluminium"]) == {
        "Al 1": "Al",
        "Al 2": "Fe",
        "Aluminium": "Cu",
    }
    assert choose_symbols(["Al 6061", "Al"]) == {"Al 6061": "Fe", "Al": "Al"}
    assert choose_symbols(["No"]) == {"No": "Fe"}  # YAML reads No as false
    many = choose_symbols([f"kind {n}" for n in range(100)])
    assert len(set(many.values())) == 100
    assert set(many.values()).isdisjoint({"Sn", "He", "No", "X"})
    assert set(choose_symbols([f"kind {n}" for n in range(200)]).values()) == {"Fe"}


def test_atoms_have_the_symbols_masses_and_radii_of_their_kinds(tmp_path):
    state = square()
    atoms = gp.atoms(state)
    gp.write_extxyz(tmp_path / "balls.extxyz", atoms)
    atoms.write(tmp_path / "own.extxyz")
    for again in (
        atoms,
        *(ase.io.read(tmp_path / name) for name in ("balls.extxyz", "own.extxyz")),
    ):
        assert again.get_chemical_symbols() == ["Fe", "Sn"]
        assert again.info["kinds"] == {"Fe": "large", "Sn": "Sn"}
        assert_allclose(
            again.get_masses() * again.info["granphon_mass_kg"], [LARGE.mass, SMALL.mass], rtol=1e-7
        )
        assert_allclose(
            again.arrays["radius"] * again.info["granphon_length_m"],
            [LARGE.radius, SMALL.radius],
            rtol=1e-7,
        )


def test_ovito_finds_species_radii_and_masses(tmp_path):
    """Its reader knows the columns species, pos, radius and mass by these names; seen in OVITO
    3.
    """
    path = tmp_path / "balls.extxyz"
    gp.write_extxyz(path, atoms := gp.atoms(square()))
    gp.write_extxyz(path, ase.io.read(path))  # of a file that has the columns already
    _, header, *lines = path.read_text().splitlines()
    columns = {}
    at = 0
    for name, _, count in re.findall(r"(\w+):([SRIL]):(\d+)", header):
        columns[name] = [line.split()[at : at + int(count)] for line in lines]
        at += int(count)
    assert at == len(lines[0].split())
    assert columns["species"] == [["Fe"], ["Sn"]]
    assert_allclose(np.array(columns["pos"], float), atoms.positions)
    assert_allclose(np.ravel(columns["radius"]).astype(float), atoms.arrays["radius"])
    assert_allclose(np.ravel(columns["mass"]).astype(float), atoms.get_masses())


@pytest.mark.parametrize(
    "state", [square(), salt("Na", "grün, 2"), salt("Sn", "He"), square(friction=False)]
)
def test_band_files_keep_kinds_and_gyration(state, tmp_path):
    bands = gp.Phonons(state).bands(npoints=4)
    bands.write(tmp_path / "band.yaml")
    again = gp.Bands.read(tmp_path / "band.yaml")
    assert again.kinds == state.network.kinds
    assert_allclose(
        again.gyration * again.scales.length,
        np.sqrt(state.network.inertias / state.network.masses),
        rtol=1e-14,
    )
    assert_allclose(again.masses * again.scales.mass, state.network.masses, rtol=1e-14)
    assert_allclose(again.frequencies, bands.frequencies, rtol=1e-14)
    assert gp.Bands.from_dict(bands.to_dict()) == bands


@pytest.mark.parametrize(
    ("names", "symbols"),
    [
        (("Na", "grün, 2"), ["Na", "Sn", "Fe", "Sn", "He"]),
        (("Sn", "He"), ["Sn", "Fe", "He", "Fe", "Al"]),
    ],
)
def test_phonopy_reads_the_symbols_masses_and_frequencies_of_kinds(names, symbols, tmp_path):
    ph, path, q = (
        gp.Phonons(salt(*names)),
        tmp_path / "phonopy_params.yaml",
        np.array([0.1, 0.3, -0.2]),
    )
    ph.save(path)
    loaded = phonopy.load(path, produce_fc=False, log_level=0)
    assert loaded.unitcell.symbols == symbols
    masses = loaded.unitcell.masses[:4]
    assert_allclose(masses / masses[0], [1.0, 1.0, 0.5, 0.5], rtol=1e-12)
    assert (
        f'kinds: {{"{symbols[0]}": "{names[0]}", "{symbols[2]}": "{names[1]}"}}'
        in path.read_text("utf-8")
    )
    loaded.run_qpoints([q])
    found = loaded.qpoints.frequencies[0, 3:]
    wanted = ph.frequencies([q])[0]
    assert_allclose(found / found[-1], wanted / wanted[-1], rtol=1e-6)
    bridge, scales = gp.load_phonopy(path)
    assert bridge.unitcell.symbols == symbols[:4]
    assert scales == ph.scales


def test_phononwebsite_has_each_balls_own_symbol_and_gyration():
    """Kinetic energies of u and of the spin of the marks, with the inertia of each ball, add up to
    one.
    """
    state = square()
    bands = gp.Phonons(state).bands(npoints=5)
    data = json.loads(write_phononwebsite(bands, "square"))
    assert data["atom_types"] == ["Fe", "H", "H", "Sn", "H", "H"]
    assert data["atom_numbers"] == [26, 1, 1, 50, 1, 1]
    places = np.array(data["atom_pos_car"]).reshape(2, 3, 3) / 2.5 * bands.scales.length
    vectors = np.array(data["vectors"]) @ [1.0, 1j]
    u = vectors.reshape(len(vectors), -1, 2, 3, 3)
    energy = 0.0
    for ball, kind in enumerate((LARGE, SMALL)):
        arm = np.linalg.norm(places[ball, 1:] - places[ball, 0], axis=1)
        assert_allclose(arm, 0.7 * kind.radius, rtol=1e-9)  # the marks are on their ball
        phi = (u[:, :, ball, 1] - u[:, :, ball, 0])[..., 1] / (arm[0] / bands.scales.length)
        shift = kind.mass * np.sum(np.abs(u[:, :, ball, 0]) ** 2, axis=-1)
        energy = (
            energy
            + (shift + kind.inertia / bands.scales.length**2 * np.abs(phi) ** 2) / bands.scales.mass
        )
    assert_allclose(energy, 1.0, rtol=1e-9)


def test_more_kinds_than_symbols_are_not_taken_for_one(tmp_path):
    base = bulk("triangular").repeat((12, 11))
    network = replace(base, kinds=tuple(f"sort {n}" for n in range(base.n_balls)))
    assert "kinds" not in gp.atoms(network).info
    bands = gp.Phonons(network).bands([[0.0, 0.0], [0.5, 0.0]], 2, eigenvectors=False)
    bands.write(tmp_path / "band.yaml")
    assert gp.Bands.read(tmp_path / "band.yaml").kinds == ()
