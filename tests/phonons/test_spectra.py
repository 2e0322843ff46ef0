"""Band structures and densities of states: shapes, limits, laws, files, errors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import granphon as gp
from granphon.base.errors import InputError, PrecisionError
from granphon.base.quantities import Quantity
from granphon.base.tables import Table

DIAMETER = 8e-3
STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
ETA = 2.0 * (1.0 - 0.276) / (2.0 - 0.276)


def at_force(force=18.446, friction=True, lattice="triangular"):
    packing = gp.Packing(STEEL, DIAMETER, lattice=lattice, friction=friction)
    return gp.AveragedLattice(packing).at_force(force)


@pytest.fixture(scope="module")
def rough():
    return gp.Phonons(at_force())


@pytest.fixture(scope="module")
def smooth():
    return gp.Phonons(at_force(friction=False))


@pytest.fixture(params=["rough", "smooth"])
def phonons(request):
    return request.getfixturevalue(request.param)


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


@pytest.mark.claim("api-densities")
@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
def test_density_survives_its_file(phonons, tmp_path, method):
    dos = phonons.dos(mesh=(6, 4), method=method, points=51)
    dos.write_csv(tmp_path / "dos.csv")
    back = gp.DensityOfStates.read_csv(tmp_path / "dos.csv")
    for field in dataclasses.fields(dos):
        np.testing.assert_array_equal(getattr(back, field.name), getattr(dos, field.name), err_msg=field.name)
    again = gp.DensityOfStates.from_dict(dos.to_dict())
    np.testing.assert_array_equal(again.total, dos.total)
    table = np.genfromtxt(tmp_path / "dos.csv", delimiter=",", names=True)
    assert table.dtype.names == ("frequency_Hz", "total_per_Hz", "translational_per_Hz", "rotational_per_Hz")
    np.testing.assert_array_equal(table["total_per_Hz"], dos.total)
    np.testing.assert_array_equal(table["frequency_Hz"], dos.frequencies)
    frequency = Quantity("frequency", "Hz", "1 kHz", "Hz, kHz", "zero or above")
    own = Table.read(tmp_path / "dos.csv")
    assert [heading.name for heading in own.headings] == list(table.dtype.names)
    np.testing.assert_array_equal(own.column("frequency_Hz (Hz)", frequency), dos.frequencies)


def test_density_with_warnings_survives_its_file(tmp_path):
    state = gp.AveragedLattice(gp.Packing(STEEL, DIAMETER)).at_overlap(0.05 * DIAMETER)
    dos = gp.Phonons(state).dos(mesh=(4, 4), points=12)
    assert dos.warnings
    dos.write_csv(tmp_path / "dos.csv")
    assert gp.DensityOfStates.read_csv(tmp_path / "dos.csv").warnings == dos.warnings


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "# x\n# method t, mesh a b\nh\n1,2,3,4\n"])
def test_density_files_of_others_are_refused(tmp_path, text):
    (tmp_path / "dos.csv").write_text(text)
    with pytest.raises(InputError, match="not a density of states written by granphon"):
        gp.DensityOfStates.read_csv(tmp_path / "dos.csv")


# -- densities of states ------------------------------------------------------------------------------------------------


def integral(dos, part="total"):
    return np.trapezoid(getattr(dos, part), dos.frequencies)


@pytest.mark.claim("api-densities")
@pytest.mark.parametrize(("mesh", "points"), [((2, 2), 12), ((7, 5), 501), ((16, 16), 13), ((32, 32), 501)])
def test_integral_is_the_number_of_branches_of_a_ball(phonons, mesh, points):
    rotations = 1.0 if phonons.lattice.motions.rotate else 0.0
    dos = phonons.dos(mesh=mesh, points=points)
    assert integral(dos, "translational") == pytest.approx(2.0, rel=1e-12)
    assert integral(dos, "rotational") == pytest.approx(rotations, rel=1e-12)
    np.testing.assert_array_equal(dos.total, dos.translational + dos.rotational)
    assert dos.translational.min() >= 0.0
    assert dos.rotational.min() >= 0.0


def test_density_converges_with_the_mesh(phonons):
    # the number of modes below a frequency, against a mesh five times finer than the finest
    def count(n):
        dos = phonons.dos(mesh=(n, n), points=201)
        return cumulative_trapezoid(dos.total, dos.frequencies, initial=0.0)

    reference = count(240)
    errors = [np.abs(count(n) - reference).mean() for n in (12, 24, 48)]
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2], "linear interpolation is of second order"
    assert errors[2] < 1e-3 * phonons.lattice.n_branches


def test_smearing_integral_is_the_number_of_branches(phonons):
    dos = phonons.dos(mesh=(32, 32), method="smearing", points=4001)
    assert integral(dos) == pytest.approx(phonons.lattice.n_branches, abs=1e-6)


def test_smearing_tends_to_the_tetrahedra(rough):
    fine = rough.dos(mesh=(96, 96), points=1001)
    total = integral(fine)
    distances = []
    for part in (0.04, 0.02, 0.01):
        sigma = part * fine.frequencies[-1]
        smeared = rough.dos(mesh=(96, 96), method="smearing", sigma=sigma, points=1001)
        assert smeared.method == "smearing"
        cumulative = cumulative_trapezoid(smeared.total, smeared.frequencies, initial=0.0)
        reference = cumulative_trapezoid(fine.total, fine.frequencies, initial=0.0)
        distances.append(np.abs(np.interp(fine.frequencies, smeared.frequencies, cumulative) - reference).max() / total)
    assert distances[0] > 1.4 * distances[1] > 1.4**2 * distances[2]


def test_mode_count_of_a_fine_mesh(phonons):
    # second engine: count modes below a frequency on a brute-force mesh, from C(q) alone
    n = 240
    grid = (np.stack(np.meshgrid(*[np.arange(n)] * 2), axis=-1).reshape(-1, 2) + 0.5) / n
    lattice = phonons.lattice
    values = np.sort((lattice.frequencies(lattice.wavevectors(grid)) * phonons.scales.frequency).ravel())
    dos = phonons.dos(mesh=(64, 64), points=2001)
    counted = np.searchsorted(values, dos.frequencies) / len(grid)
    cumulative = cumulative_trapezoid(dos.total, dos.frequencies, initial=0.0)
    np.testing.assert_allclose(cumulative, counted, atol=2e-3 * lattice.n_branches)


def test_moments_are_traces(phonons):
    # the mean squared frequency is the trace of D(q) averaged over the zone: the force constants of a ball on itself
    dos = phonons.dos(mesh=(64, 64), points=4001)
    own = np.einsum("aa->a", phonons.phonopy.force_constants[0, 0])
    unit = phonons.scales.frequency**2
    for part, expected in (("translational", own[:2].sum()), ("rotational", own[2])):
        second = np.trapezoid(getattr(dos, part) * dos.frequencies**2, dos.frequencies) / unit
        assert second == pytest.approx(expected, rel=2e-3, abs=1e-12)


@pytest.mark.claim("reduced-mesh")
@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
@pytest.mark.parametrize("case", ["triangular", "smooth", "square", "kagome", "vacancy", "masses", "oblong"])
def test_reduced_mesh_equals_the_full_one(method, case, monkeypatch):
    lattice = case if case in ("square", "kagome") else "triangular"
    state = at_force(friction=case != "smooth", lattice=lattice)
    balls = gp.atoms(state)
    if case in ("vacancy", "masses"):
        balls = balls.repeat((2, 2, 1))
    if case == "vacancy":
        del balls[3]
    if case == "masses":
        balls.set_masses([1.0, 2.0, 3.0, 5.0])
    mesh = (8, 6) if case == "oblong" else (8, 8)
    ph = gp.Phonons(state, balls)
    small = ph._make_mesh(mesh)
    full = ph._make_mesh(mesh, reduce=False)
    assert small.weights.sum() == full.weights.sum() == mesh[0] * mesh[1]
    reduced = ph.dos(mesh=mesh, method=method)
    whole_mesh = gp.Phonons._make_mesh
    monkeypatch.setattr(gp.Phonons, "_make_mesh", lambda self, numbers, reduce=True: whole_mesh(self, numbers, reduce=False))
    whole = ph.dos(mesh=mesh, method=method)
    top = whole.total.max()
    np.testing.assert_allclose(reduced.frequencies, whole.frequencies, rtol=1e-12)
    if (case, method) == ("square", "tetrahedron"):
        # the squares of the mesh are cut along one of two equal diagonals: see the next test
        return
    np.testing.assert_allclose(reduced.translational, whole.translational, atol=2e-6 * top)
    np.testing.assert_allclose(reduced.rotational, whole.rotational, atol=2e-6 * top)
    # 12 operations of the layer group on the triangular and kagome lattices, 8 on the square one
    if case in ("triangular", "smooth", "kagome"):
        assert len(small.qpoints) == 10
    if case == "square":
        assert len(small.qpoints) == 15
    # balls of four masses on a 2 x 2 cell have the half turn alone, which is time reversal
    if case == "masses":
        assert len(small.qpoints) == 8 * 8 // 2 + 2


@pytest.mark.claim("reduced-mesh")
def test_square_meshes_tend_to_the_same_density(monkeypatch):
    # a mesh of squares cut along one diagonal has less symmetry than the lattice; the difference falls with the mesh
    ph = gp.Phonons(at_force(lattice="square"))
    whole_mesh = gp.Phonons._make_mesh
    apart = []
    for n in (12, 24, 48):
        counts = []
        for reduce in (True, False):
            with monkeypatch.context() as patch:
                patch.setattr(gp.Phonons, "_make_mesh", lambda self, m, reduce=reduce: whole_mesh(self, m, reduce=reduce))
                dos = ph.dos(mesh=(n, n))
            counts.append(cumulative_trapezoid(dos.total, dos.frequencies, initial=0.0))
        apart.append(np.abs(counts[0] - counts[1]).max())
    assert apart[0] > 2.0 * apart[1] > 4.0 * apart[2]
    assert apart[2] < 0.01


def test_reduction_of_a_large_mesh(rough):
    full, reduced = (len(rough._make_mesh((48, 48), reduce=r).qpoints) for r in (False, True))
    assert 6 * reduced <= 48 * 48
    assert 12 * reduced >= 48 * 48
    assert full in (48 * 48, 48 * 48 // 2 + 2)


@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
def test_low_frequencies_follow_debye(phonons, method):
    # g(f) = 2 pi f A (v_L^-2 + v_T^-2) a ball in two dimensions
    sound = gp.sound_velocities(phonons.state)
    area = np.sqrt(3.0) / 2.0 * DIAMETER**2
    slope = 2.0 * np.pi * area * (sound.longitudinal**-2 + sound.transverse**-2)
    top = phonons.frequencies([[0, 0], [0.5, 0]]).max()
    sigma = {"sigma": 0.01 * top} if method == "smearing" else {}
    dos = phonons.dos(mesh=(160, 160), method=method, points=1001, **sigma)
    low = (dos.frequencies > 0.06 * top) & (dos.frequencies < 0.12 * top)
    ratio = dos.total[low] / (slope * dos.frequencies[low])
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.02)
    # quadratic beyond: dispersion bends the branches down, so the density rises above the law
    assert 1.0 < dos.total[np.searchsorted(dos.frequencies, 0.25 * top)] / (slope * 0.25 * top) < 1.3


def test_edges(rough):
    scale = rough.scales.frequency
    dos = rough.dos(mesh=(48, 48), points=2001)
    top = np.sqrt(30.0 * ETA) * scale
    assert dos.frequencies[0] == 0.0
    assert dos.frequencies[-1] == pytest.approx(1.02 * top, rel=1e-9)
    # a value is the mean over its interval
    above = dos.frequencies > top + 0.51 * dos.frequencies[1]
    assert above.sum() > 10
    np.testing.assert_allclose(dos.total[above], 0.0, atol=1e-12 * dos.total.max())
    # at the top, rotation alone, with the step of a parabolic maximum in two dimensions: omega^2 = 30 eta (1 - q^2/10)
    just = (dos.frequencies > 0.97 * top) & (dos.frequencies < 0.99 * top)
    assert np.all(dos.rotational[just] > 20.0 * dos.translational[just])
    # omega = w0 (1 - q^2/20): g = A/(2 pi) q dq/domega = A/(2 pi) 10/w0 per angular frequency
    step = np.sqrt(3.0) / 2.0 / (2.0 * np.pi) * 10.0 / np.sqrt(30.0 * ETA) / scale
    assert np.mean(dos.total[just]) == pytest.approx(step, rel=0.1)


def test_without_friction_the_top_is_at_m(smooth):
    top = np.sqrt(6.0) * smooth.scales.frequency
    dos = smooth.dos(mesh=(48, 48), points=2001)
    assert dos.frequencies[-1] == pytest.approx(1.02 * top, rel=1e-9)
    np.testing.assert_array_equal(dos.rotational, 0.0)
    # a value is the mean over its interval
    above = dos.frequencies > top + 0.51 * dos.frequencies[1]
    assert above.sum() > 10
    np.testing.assert_allclose(dos.total[above], 0.0, atol=1e-12 * dos.total.max())
    assert dos.total[(dos.frequencies > 0.99 * top) & (dos.frequencies < top)].min() > 0.0


def test_a_supercell_has_the_density_of_its_balls(rough):
    balls = gp.atoms(rough.state).repeat((2, 2, 1))
    big = gp.Phonons(rough.state, balls)
    small = rough.dos(mesh=(24, 24), method="smearing", points=201)
    folded = big.dos(mesh=(12, 12), method="smearing", points=201)
    np.testing.assert_allclose(folded.frequencies, small.frequencies, rtol=1e-12)
    np.testing.assert_allclose(folded.total, small.total, atol=1e-9 * small.total.max())
    np.testing.assert_allclose(folded.rotational, small.rotational, atol=1e-6 * small.total.max())


def test_density_is_per_ball_with_a_vacancy_and_unequal_masses(rough):
    balls = gp.atoms(rough.state).repeat((3, 3, 1))
    del balls[4]
    balls.set_masses(np.linspace(0.5, 4.0, 8))
    dos = gp.Phonons(rough.state, balls).dos(mesh=(12, 12), points=1001)
    assert integral(dos, "translational") == pytest.approx(2.0, abs=0.02)
    assert integral(dos, "rotational") == pytest.approx(1.0, abs=0.02)


def test_unequal_mesh(rough):
    # the two are mirror images, on a lattice that has the mirror
    one, other = rough.dos(mesh=(24, 20)), rough.dos(mesh=(20, 24, 1))
    assert (one.mesh, other.mesh) == ((24, 20), (20, 24))
    np.testing.assert_allclose(one.total, other.total, atol=1e-9 * one.total.max())
    # and tend to the same density as equal meshes do
    fine = cumulative_trapezoid(*(getattr(rough.dos(mesh=(48, 48)), name) for name in ("total", "frequencies")))
    apart = []
    for n in (1, 2, 4):
        dos = rough.dos(mesh=(6 * n, 5 * n))
        apart.append(np.abs(cumulative_trapezoid(dos.total, dos.frequencies) - fine).mean())
    assert apart[0] > 3.0 * apart[1] > 9.0 * apart[2]


def test_density_against_phonopys_own(rough):
    # the same mesh through Phonopy.run_total_dos, whose values are at points, summed finely over our intervals
    dos = rough.dos(mesh=(12, 12), points=51)
    at = dos.frequencies / rough.scales.frequency
    step = (at[1] - at[0]) / 200.0
    rough.phonopy.run_mesh([12, 12, 1], is_gamma_center=True, is_mesh_symmetry=False)
    theirs = rough.phonopy.run_total_dos(freq_min=0.0, freq_max=at[-1] + step, freq_pitch=step)
    middle = 0.5 * (at[1:] + at[:-1])
    expected = np.interp(
        middle, theirs.frequency_points, cumulative_trapezoid(theirs.dos, theirs.frequency_points, initial=0.0)
    )
    widths = np.diff(np.concatenate([[0.0], middle]))
    found = np.cumsum(dos.total[:-1] * widths) * rough.scales.frequency
    np.testing.assert_allclose(found, expected, atol=1e-3 * 3)


BAD_DENSITIES = {
    "method": ({"method": "gauss"}, "Use tetrahedron or smearing"),
    "points": ({"points": 11}, "a whole number from 12 to"),
    "sigma without smearing": ({"sigma": 1.0}, "is for the smearing method only"),
    "negative sigma": ({"method": "smearing", "sigma": -1.0}, "finite number above zero"),
    "no sigma": ({"method": "smearing", "sigma": 0.0}, "finite number above zero"),
    "sigma not a number": ({"method": "smearing", "sigma": np.nan}, "finite number above zero"),
    "third of the mesh": ({"mesh": (8, 8, 2)}, "whose third number is 2; allowed: two whole numbers"),
    "nothing of the mesh": ({"mesh": (0, 8)}, "allowed: two whole numbers from 1 to"),
    "half a mesh": ({"mesh": (8,)}, "allowed: two whole numbers from 1 to"),
}


@pytest.mark.parametrize("case", BAD_DENSITIES)
def test_densities_that_cannot_be(rough, case):
    options, words = BAD_DENSITIES[case]
    with pytest.raises(InputError, match=words):
        rough.dos(**{"mesh": (4, 4), **options})
