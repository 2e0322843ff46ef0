"""Band structures: shapes, limits, laws, files, errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError, PrecisionError
from tests.phonons.conftest import DIAMETER, ETA, STEEL, at_force

# -- bands --------------------------------------------------------------------------------------------------------------


def test_shapes_and_corners(phonons):
    b = phonons.lattice.n_branches
    bands = phonons.bands("GKMG", npoints=11)
    assert b == (3 if phonons.lattice.motions.rotate else 2)
    assert bands.n_branches == b
    assert bands.qpoints.shape == (3, 11, 3)
    assert bands.distances.shape == (3, 11)
    assert bands.frequencies.shape == (3, 11, b)
    assert bands.group_velocities.shape == (3, 11, b, 2)
    assert bands.eigenvectors.shape == (3, 11, b, b)
    assert bands.rotational_fraction.shape == bands.longitudinal_fraction.shape == (3, 11, b)
    assert bands.labels == ("G", "K", "M", "G")
    # ends are repeated
    np.testing.assert_array_equal(bands.qpoints[:-1, -1], bands.qpoints[1:, 0])
    np.testing.assert_array_equal(bands.distances[:-1, -1], bands.distances[1:, 0])
    np.testing.assert_allclose(bands.frequencies[:-1, -1], bands.frequencies[1:, 0], rtol=1e-12)
    np.testing.assert_array_equal(bands.qpoints[0, -1], [1 / 3, 1 / 3, 0])
    np.testing.assert_array_equal(bands.qpoints[1, -1], [1 / 2, 0, 0])
    # Gamma-K = 2/3, K-M = 1/3, M-Gamma = 1/sqrt(3), in 1/d without 2 pi
    np.testing.assert_allclose(bands.distances[:, -1], np.cumsum([2 / 3, 1 / 3, 1 / np.sqrt(3)]), rtol=1e-14)
    assert np.all(np.diff(bands.frequencies, axis=2) >= 0.0)
    np.testing.assert_allclose(
        bands.frequencies.reshape(-1, b), phonons.frequencies(bands.qpoints.reshape(-1, 3)), rtol=1e-13
    )
    assert all(not getattr(bands, f.name).flags.writeable for f in dataclasses.fields(bands) if f.name in bands.units)


def test_distances_and_frequencies_are_phonopys(phonons):
    bands = phonons.bands("GK,MG", npoints=7)
    theirs = phonons.phonopy.run_band_structure(list(bands.qpoints), path_connections=[False, False])
    np.testing.assert_allclose(bands.distances, theirs.distances, atol=1e-15)
    flat = 0 if phonons.lattice.motions.rotate else 1
    found = bands.frequencies / phonons.scales.frequency
    np.testing.assert_allclose(found, np.array(theirs.frequencies)[..., flat:], atol=1e-7)
    np.testing.assert_allclose(found[0, 1:], np.array(theirs.frequencies)[0, 1:, flat:], rtol=1e-12)


def test_jumps(rough):
    bands = rough.bands("GK,MG", npoints=5)
    assert bands.labels == ("G", "K|M", "G")
    np.testing.assert_array_equal(bands.qpoints[0, -1], [1 / 3, 1 / 3, 0])
    np.testing.assert_array_equal(bands.qpoints[1, 0], [1 / 2, 0, 0])
    assert bands.distances[0, -1] == bands.distances[1, 0]
    # numbers say the same as letters, with or without the third one, and pieces may differ in length
    same = rough.bands([[[0, 0], [1 / 3, 1 / 3]], [[0.5, 0], [0, 0]]], npoints=5, labels=["G", "K", "M", "G"])
    assert same.labels == bands.labels
    np.testing.assert_array_equal(same.frequencies, bands.frequencies)
    longer = rough.bands([[[0, 0, 0], [0.5, 0, 0]], [[1 / 3, 1 / 3, 0], [0, 0, 0], [0.1, 0, 0]]], npoints=3)
    assert longer.labels == ("(0 0)", "(0.5 0)|(0.333 0.333)", "(0 0)", "(0.1 0)")
    assert rough.bands("GK,KM", npoints=3).labels == ("G", "K", "M")


@pytest.mark.parametrize("lattice", ["square", "kagome"])
def test_other_lattices_have_their_own_letters(lattice):
    ph = gp.Phonons(at_force(lattice=lattice))
    path = {"square": "GXMG", "kagome": "GKMG"}[lattice]
    assert set(path) <= set(ph.special_points)
    bands = ph.bands(path, npoints=5)
    assert bands.n_branches == 3 * len(ph.atoms)
    top = bands.frequencies.max()
    np.testing.assert_allclose(bands.frequencies[0, 0, :2], 0.0, atol=1e-14 * top)
    with pytest.raises(InputError, match=r"no special point .*Use"):
        ph.bands({"square": "GK", "kagome": "GX"}[lattice])


def test_velocities_at_gamma_are_those_of_sound(phonons):
    sound = gp.sound_velocities(phonons.state)
    bands = phonons.bands("GKMG", npoints=41)
    for (segment, point), sign in (((0, 0), 1.0), ((2, -1), -1.0)):
        along = bands.qpoints[segment, -1] - bands.qpoints[segment, 0]
        direction = phonons.lattice.wavevectors(along)
        direction = direction / np.linalg.norm(direction)
        velocities = bands.group_velocities[segment, point, :2]
        # frequencies rise from Gamma at a segment's start, and fall towards it at its end
        np.testing.assert_allclose(
            velocities @ direction, sign * np.array([sound.transverse, sound.longitudinal]), rtol=1e-9
        )
        np.testing.assert_allclose(velocities @ [-direction[1], direction[0]], 0.0, atol=1e-9 * sound.longitudinal)
        # the polarisations too are the limit along the path
        np.testing.assert_allclose(bands.longitudinal_fraction[segment, point, :2], [0.0, 1.0], atol=1e-12)
        # and nothing jumps at the last step
        neighbour = bands.group_velocities[segment, 1 if point == 0 else -2, :2]
        np.testing.assert_allclose(velocities, neighbour, atol=0.02 * sound.longitudinal)


def test_velocities_at_the_end_of_a_segment_are_those_of_its_own_branches(phonons):
    """Where branches touch at K, the limits from either side are in different order."""
    bands = phonons.bands("GKM", npoints=401)
    for segment, point, near in ((0, -1, -2), (1, 0, 1)):
        here, there = bands.group_velocities[segment, [point, near]]
        np.testing.assert_allclose(here, there, atol=0.02 * np.abs(bands.group_velocities).max())


def test_group_velocities_are_the_slopes_of_the_bands(phonons):
    # second order in the step along the path, away from crossings
    def error(n):
        bands = phonons.bands([[0.02, 0.01], [0.14, 0.05]], npoints=n)
        direction = phonons.lattice.wavevectors([0.12, 0.04])
        step = np.linalg.norm(direction) / (n - 1) / DIAMETER
        slope = 2.0 * np.pi * (bands.frequencies[0, 2:] - bands.frequencies[0, :-2]) / (2.0 * step)
        along = bands.group_velocities[0] @ (direction / np.linalg.norm(direction))
        # the nineteen inner points that every n has
        every = (n - 1) // 20
        return np.abs(slope - along[1:-1])[every - 1 :: every].max() / np.abs(along).max()

    assert error(21) / error(41) == pytest.approx(4.0, rel=0.05)
    assert error(161) < 1e-4


def test_group_velocities_equal_phonopys_on_the_path(phonons):
    bands = phonons.bands([[0.07, 0.03], [0.31, 0.12]], npoints=9)
    run = phonons.phonopy.run_band_structure(list(bands.qpoints), with_group_velocities=True)
    theirs = np.array(run.group_velocities)[..., 0 if phonons.lattice.motions.rotate else 1 :, :2] / (2.0 * np.pi)
    np.testing.assert_allclose(bands.group_velocities / phonons.scales.velocity, theirs, atol=1e-6)


def test_pure_rotation_of_steel_is_on_top_at_m_and_at_the_bottom_at_k(rough):
    bands = rough.bands("GKMG", npoints=21)
    k, m = bands.rotational_fraction[0, -1], bands.rotational_fraction[1, -1]
    np.testing.assert_allclose(k, [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(m, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(bands.rotational_fraction[0, 0], [0.0, 0.0, 1.0], atol=1e-12)
    scale = rough.scales.frequency
    assert bands.frequencies[0, -1, 0] == pytest.approx(np.sqrt(7.5 * ETA) * scale, rel=1e-12)
    assert bands.frequencies[1, -1, 2] == pytest.approx(np.sqrt(10.0 * ETA) * scale, rel=1e-12)
    np.testing.assert_allclose(bands.rotational_fraction.sum(axis=2), 1.0, rtol=1e-12)


def test_without_friction_nothing_rotates(smooth):
    bands = smooth.bands(npoints=5)
    np.testing.assert_array_equal(bands.rotational_fraction, 0.0)
    # along Gamma-K motion is along or across q by symmetry
    np.testing.assert_allclose(bands.longitudinal_fraction[0] % 1.0 % 1.0, 0.0, atol=1.0)
    share = bands.longitudinal_fraction[0, 1:-1]
    np.testing.assert_allclose(share * (1.0 - share), 0.0, atol=1e-12)


def test_eigenvectors_solve_the_eigenproblem(phonons):
    bands = phonons.bands("GKM", npoints=9)
    q = phonons.lattice.wavevectors(bands.qpoints.reshape(-1, 3))
    matrices = phonons.lattice.dynamical_matrix(q)
    vectors = bands.eigenvectors.reshape(len(q), bands.n_branches, -1)
    squared = (bands.frequencies.reshape(len(q), -1) / phonons.scales.frequency) ** 2
    np.testing.assert_allclose(matrices @ vectors, vectors * squared[:, None], atol=1e-9 * squared.max())
    gram = vectors.conj().swapaxes(1, 2) @ vectors
    np.testing.assert_allclose(gram, np.broadcast_to(np.eye(bands.n_branches), gram.shape), atol=1e-12)


def test_connection_follows_branches_through_crossings(smooth):
    # Gamma-K of frictionless balls: the longitudinal and the transverse branch cross at K's neighbour; numbered in order
    # the branches have kinks, connected they have none, and the second difference falls with the square of the step
    path = [[0.05, 0.05], [0.62, 0.62]]

    def kink(n, connected):
        bands = smooth.bands(path, npoints=n)
        values = bands.connected_frequencies if connected else bands.frequencies
        return np.abs(np.diff(values[0], n=2, axis=0)).max() / bands.frequencies.max()

    assert kink(101, True) / kink(201, True) == pytest.approx(4.0, rel=0.1)
    assert kink(101, False) / kink(201, False) == pytest.approx(2.0, rel=0.5)
    assert kink(201, False) > 10.0 * kink(201, True)
    bands = smooth.bands(path, npoints=101)
    assert bands.connection.shape == (1, 101, 2)
    np.testing.assert_array_equal(bands.connection[0, 0], [0, 1])
    np.testing.assert_array_equal(np.sort(bands.connected_frequencies, axis=2), bands.frequencies)
    assert np.any(bands.connection[0] != [0, 1])


def test_warnings_travel_with_the_bands(rough):
    assert rough.bands(npoints=2).warnings == ()
    pressed = gp.Phonons(gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_overlap(0.05 * DIAMETER))
    assert pressed.bands(npoints=2).warnings == gp.validity(pressed.state).warnings != ()
    assert pressed.dos(mesh=(4, 4)).warnings == gp.validity(pressed.state).warnings


BAD_PATHS = {
    "unknown letter": ("GX", r"no special point X.*Use G, M, K"),
    "empty": ("", "at least two corners"),
    "one corner": ("G", "at least two corners"),
    "trailing comma": ("GKMG,", "at least two corners"),
    "same point": ("GG", "the same point"),
    "a number": (5, "a path is a list of corners"),
    "one number": ([[0.0], [0.5]], "a path is a list of corners"),
    "four numbers": ([[0, 0, 0, 0], [1, 0, 0, 0]], "a path is a list of corners"),
    "not finite": ([[0, 0], [np.nan, 0]], "a path is a list of corners"),
    "out of plane": ([[0, 0, 0], [0, 0, 0.5]], "leaves the plane"),
    "empty list": ([], "a path is a list of corners"),
    "lone corner after a jump": ([[[0, 0], [0.5, 0]], [[0, 0]]], "at least two corners"),
}


@pytest.mark.parametrize("case", BAD_PATHS)
def test_paths_that_cannot_be(rough, case):
    path, words = BAD_PATHS[case]
    with pytest.raises(InputError, match=words):
        rough.bands(path)


@pytest.mark.parametrize("npoints", [1, 0, -3, 2.5, True])
def test_numbers_of_points_that_cannot_be(rough, npoints):
    with pytest.raises(InputError, match="whole number from 2 to"):
        rough.bands("GK", npoints=npoints)


@pytest.mark.parametrize("labels", [["G"], ["G", "K", "M"], []])
def test_labels_must_be_one_a_corner(rough, labels):
    with pytest.raises(InputError, match=rf"{len(labels)} labels? for 2 corners"):
        rough.bands([[0, 0], [0.5, 0]], labels=labels)


NOT_NUMBERS = {
    "npoints='a'": lambda ph: ph.bands("GK", npoints="a"),
    "npoints=None": lambda ph: ph.bands("GK", npoints=None),
    "npoints=nan": lambda ph: ph.bands("GK", npoints=float("nan")),
    "path of words": lambda ph: ph.bands([["a", "b"], ["c", "d"]]),
    "mesh=8": lambda ph: ph.dos(mesh=8),
    "mesh=(8.7, 8)": lambda ph: ph.dos(mesh=(8.7, 8)),
    "mesh='88'": lambda ph: ph.dos(mesh="88"),
    "mesh=(True, 8)": lambda ph: ph.dos(mesh=(True, 8)),
    "points=2.5": lambda ph: ph.dos(mesh=(4, 4), points=2.5),
    "sigma='a'": lambda ph: ph.dos(mesh=(4, 4), method="smearing", sigma="a"),
    "sigma finer than the points": lambda ph: ph.dos(mesh=(4, 4), method="smearing", sigma=1e-9),
    "qpoints of words": lambda ph: ph.frequencies([["a", "b"]]),
    "no qpoints": lambda ph: ph.frequencies(np.zeros((0, 2))),
    "dim=3": lambda ph: gp.Phonons(ph.state, dim=3),
}


@pytest.mark.parametrize("case", NOT_NUMBERS)
def test_arguments_that_are_no_numbers_at_all(rough, case):
    with pytest.raises(InputError):
        NOT_NUMBERS[case](rough)


@pytest.mark.parametrize("sigma", [1e12, 1e160, 1e308])
def test_smearing_wider_than_all_frequencies_is_refused(rough, sigma):
    with pytest.raises(InputError, match=r"sigma .* times the top frequency"):
        rough.dos(mesh=(4, 4), method="smearing", sigma=sigma)


@pytest.mark.parametrize("far", [1.1e15, 1e200, -1.7e308])
def test_wave_vectors_so_far_out_that_no_digit_is_left_are_refused(rough, far):
    for find in (
        lambda q: rough.frequencies([q]), lambda q: rough.modes([q]), lambda q: rough.lattice.frequencies([q]),
        lambda q: rough.lattice.modes([q]), lambda q: rough.bands([[0.0, 0.0], q, [1e308, 0.0]], 5),
    ):  # fmt: skip
        with pytest.raises(PrecisionError, match="reciprocal vectors from Gamma"):
            find([far, 0.25])


def test_phonons_say_in_a_line_what_they_are(rough):
    assert repr(rough) == "Phonons(triangular, 1 ball in the cell, x, y, w of each ball, 3 branches; frequencies in Hz)"
    chain = gp.Phonons(gp.AveragedLattice(gp.Packing(STEEL, DIAMETER, lattice="chain", friction=False)).at_force(1.0))
    assert repr(chain) == "Phonons(chain, 1 ball in the cell, x of each ball, 1 branch; frequencies in Hz)"


# -- files --------------------------------------------------------------------------------------------------------------


def same_bands(one, other):
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        if isinstance(a, np.ndarray):
            # one rounding each way for what changes units
            np.testing.assert_allclose(b, a, rtol=5e-16, atol=0.0, err_msg=field.name)
            if field.name not in ("frequencies", "group_velocities"):
                np.testing.assert_array_equal(b, a, err_msg=field.name)
        else:
            assert a == b, field.name


@pytest.mark.claim("files-all-digits")
@pytest.mark.parametrize("kind", ["rough", "smooth", "kagome", "vacancy", "jump", "pressed"])
def test_bands_survive_their_file(tmp_path, kind):
    state = at_force(friction=kind != "smooth", lattice="kagome" if kind == "kagome" else "triangular")
    if kind == "pressed":
        state = gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_overlap(0.05 * DIAMETER)
    balls = None
    if kind == "vacancy":
        balls = gp.atoms(state).repeat((3, 3, 1))
        balls.set_masses(np.linspace(1.0, 2.0, 9))
        del balls[4]
    ph = gp.Phonons(state, balls)
    path = [[[0, 0], [1 / 3, 1 / 3]], [[0.5, 0], [0, 0]]] if kind == "jump" else [[0, 0], [1 / 3, 1 / 3], [0.5, 0]]
    bands = ph.bands(path, npoints=4)
    bands.write(tmp_path / "band.yaml")
    back = gp.Bands.read(tmp_path / "band.yaml")
    same_bands(bands, back)
    same_bands(bands, gp.Bands.from_dict({**bands.to_dict(), "scales": bands.scales}))
    # and the file of the copy is the same file
    back.write(tmp_path / "again.yaml")
    first, second = ((tmp_path / name).read_text() for name in ("band.yaml", "again.yaml"))
    assert len(first) == pytest.approx(len(second), rel=1e-3)


@pytest.mark.parametrize(
    "labels",
    [
        ["$\\Gamma$", "Γ", "1"],
        ["true", "null", "a: b # c"],
        ["G", "K'", 'M "x"'],
    ],
)
def test_labels_survive_the_file(rough, tmp_path, labels):
    bands = rough.bands([[0, 0], [1 / 3, 1 / 3], [0.5, 0]], npoints=2, labels=labels)
    bands.write(tmp_path / "band.yaml")
    assert gp.Bands.read(tmp_path / "band.yaml").labels == tuple(labels)


def test_the_file_names_its_unit(rough, tmp_path):
    bands = rough.bands(npoints=3)
    bands.write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text()
    assert "frequency_unit: kHz" in text
    assert "hertz: 1000.0" in text
    top = max(float(line.split(":")[1]) for line in text.splitlines() if line.startswith("    frequency:"))
    assert top == pytest.approx(bands.frequencies.max() / 1000.0, rel=1e-15)
    assert 1.0 <= top < 1000.0


@pytest.mark.parametrize("text", ["", "phonon: []\n", "granphon: 3\n", "[", "granphon: {hertz: x}\n", "\0\1"])
def test_band_files_of_others_are_refused(tmp_path, text):
    (tmp_path / "band.yaml").write_text(text)
    told = "found the byte 0x00 where text in UTF-8 is needed" if "\0" in text else r"not a band\.yaml written by granphon"
    with pytest.raises(InputError, match=told):
        gp.Bands.read(tmp_path / "band.yaml")


def test_damaged_band_files_are_refused(rough, tmp_path):
    rough.bands(npoints=3).write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text()
    for part in (0.2, 0.5, 0.9):
        (tmp_path / "cut.yaml").write_text(text[: int(part * len(text))])
        with pytest.raises(InputError, match="was damaged, or edited"):
            gp.Bands.read(tmp_path / "cut.yaml")
        (tmp_path / "cut.yaml").write_text(text[text.index("\n") + 1 : int(part * len(text))])
        with pytest.raises(InputError, match=r"not a band\.yaml written by granphon"):
            gp.Bands.read(tmp_path / "cut.yaml")
