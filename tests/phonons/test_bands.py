"""Band structures: shapes, limits, laws, files, errors."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError, PrecisionError
from granphon.media.cost import Cost
from granphon.phonons.paths import BandPath, special_points
from tests.phonons.conftest import DIAMETER, ETA, STEEL, at_force, at_overlap, phonons_of

# -- bands -----------------------------------------------------------------------------------------


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
    np.testing.assert_allclose(
        bands.distances[:, -1], np.cumsum([2 / 3, 1 / 3, 1 / np.sqrt(3)]), rtol=1e-14
    )
    assert np.all(np.diff(bands.frequencies, axis=2) >= 0.0)
    np.testing.assert_allclose(
        bands.frequencies.reshape(-1, b),
        phonons.frequencies(bands.qpoints.reshape(-1, 3)),
        rtol=1e-13,
    )
    assert all(
        not getattr(bands, f.name).flags.writeable
        for f in dataclasses.fields(bands)
        if f.name in bands.units
    )


def test_distances_and_frequencies_are_phonopys(phonons):
    bands = phonons.bands("GK,MG", npoints=7)
    theirs = phonons.phonopy.run_band_structure(
        list(bands.qpoints), path_connections=[False, False]
    )
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
    # numbers say the same as letters, with or without the third one, and pieces may differ in
    # length
    same = rough.bands(
        [[[0, 0], [1 / 3, 1 / 3]], [[0.5, 0], [0, 0]]], npoints=5, labels=["G", "K", "M", "G"]
    )
    assert same.labels == bands.labels
    np.testing.assert_array_equal(same.frequencies, bands.frequencies)
    longer = rough.bands(
        [[[0, 0, 0], [0.5, 0, 0]], [[1 / 3, 1 / 3, 0], [0, 0, 0], [0.1, 0, 0]]], npoints=3
    )
    assert longer.labels == ("(0 0)", "(0.5 0)|(0.333 0.333)", "(0 0)", "(0.1 0)")
    assert rough.bands("GK,KM", npoints=3).labels == ("G", "K", "M")


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
            velocities @ direction,
            sign * np.array([sound.transverse, sound.longitudinal]),
            rtol=1e-9,
        )
        np.testing.assert_allclose(
            velocities @ [-direction[1], direction[0]], 0.0, atol=1e-9 * sound.longitudinal
        )
        # the polarisations too are the limit along the path
        np.testing.assert_allclose(
            bands.longitudinal_fraction[segment, point, :2], [0.0, 1.0], atol=1e-12
        )
        # and nothing jumps at the last step
        neighbour = bands.group_velocities[segment, 1 if point == 0 else -2, :2]
        np.testing.assert_allclose(velocities, neighbour, atol=0.02 * sound.longitudinal)


def test_velocities_at_the_end_of_a_segment_are_those_of_its_own_branches(phonons):
    """Where branches touch at K, the limits from either side are in different order."""
    bands = phonons.bands("GKM", npoints=401)
    for segment, point, near in ((0, -1, -2), (1, 0, 1)):
        here, there = bands.group_velocities[segment, [point, near]]
        np.testing.assert_allclose(here, there, atol=0.02 * np.abs(bands.group_velocities).max())


def test_connection_follows_branches_through_crossings(smooth):
    # Gamma-K of frictionless balls: the longitudinal and the transverse branch cross at K's
    # neighbour; numbered in order the branches have kinks, connected they have none, and the second
    # difference falls with the square of the step
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


PATHS = {
    "chain": ("G", "X"),
    "square": ("G", "X", "M", "G"),
    "triangular": ("G", "K", "M", "G"),
    "kagome": ("G", "K", "M", "G"),
    "sc": ("G", "X", "M", "G", "R", "X|M", "R"),
    "bcc": ("G", "H", "N", "G", "P", "H|P", "N"),
    "fcc": ("G", "X", "W", "K", "G", "L"),
    "diamond": ("G", "X", "W", "K", "G", "L"),
    "hcp": ("G", "M", "K", "G", "A", "L", "H", "A|L", "M|K", "H"),
}


@pytest.mark.parametrize("lattice", PATHS)
def test_each_lattice_has_a_path(lattice):
    ph = phonons_of(lattice, "all")
    bands = ph.bands(npoints=4)
    s = len(bands.labels) - 1
    b = ph.lattice.n_branches
    p = ph.lattice.periods
    assert bands.labels == PATHS[lattice]
    assert bands.frequencies.shape == (s, 4, b)
    assert bands.group_velocities.shape == (s, 4, b, p)
    assert bands.periods == p
    for name in ("rotational", "longitudinal", "transverse", "out_of_plane"):
        part = getattr(bands, f"{name}_fraction")
        assert part.shape == (s, 4, b)
        assert part.min() >= 0.0
        assert part.max() <= 1.0 + 1e-12
    total = (
        bands.rotational_fraction
        + bands.longitudinal_fraction
        + bands.out_of_plane_fraction
        + bands.transverse_fraction
    )
    np.testing.assert_allclose(total, 1.0, rtol=1e-12)
    np.testing.assert_allclose(
        bands.frequencies[0], ph.frequencies(bands.qpoints[0]), atol=1e-12 * bands.frequencies.max()
    )


def test_cells_of_the_plane_that_are_neither_square_nor_hexagonal_have_ases_path():
    oblong = gp.Lattice("oblong", ((1.0, 0.0), (0.0, np.sqrt(3.0))), ((0.0, 0.0), (0.5, 0.5)))
    assert phonons_of(oblong).bands(npoints=2).labels == ("G", "X", "S", "Y", "G", "S")
    assert BandPath.default(oblong).names == ("G", "X", "S", "Y", "G", "S")  # that of a scene


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [0.78, 1.39])
def test_corners_of_the_zone_of_an_oblique_cell_and_of_its_mirror_image(size, sign):
    """Three vectors of the reciprocal lattice are as near to a corner, and two to the middle of an
    edge.
    """
    cell = np.array([[1.0, 0.0], [0.22 * sign * size, np.sqrt(1.0 - 0.22**2) * size]])
    back = np.linalg.inv(cell).T
    every = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 2), axis=-1).reshape(-1, 2) @ back
    points = special_points(cell)
    # and of a slab whose periods are its first and its last vector
    vectors = np.eye(3)
    vectors[np.ix_([0, 2], [0, 2])] = cell
    of_slab = special_points(vectors, (True, False, True))
    assert set(points) == set(of_slab) > {"H", "H1"}
    for name in points:
        assert of_slab[name][1] == 0.0
        for point in (points[name][:2], of_slab[name][[0, 2]]):
            away = np.linalg.norm(every - point @ back, axis=1)
            near = np.count_nonzero(away < away.min() + 1e-9)
            assert near == {"G": 1, "H": 3, "H1": 3}.get(name, 2)


def test_polarisation_along_a_cube_axis():
    # along [100] of fcc: a longitudinal branch without rotation, and waves of transverse
    # displacements and spins
    bands = phonons_of("fcc").bands("GX", 9)
    inside = slice(1, 8)
    along = bands.longitudinal_fraction[0, inside]
    np.testing.assert_allclose(np.sort(along, axis=1)[:, -1], 1.0, rtol=1e-10)
    np.testing.assert_allclose(np.sort(along, axis=1)[:, :-1], 0.0, atol=1e-10)
    np.testing.assert_allclose(bands.rotational_fraction[0, inside].sum(axis=1), 3.0, rtol=1e-10)
    assert not bands.out_of_plane_fraction.any()


def test_waves_out_of_a_plane():
    bands = phonons_of("triangular", "all").bands(npoints=9)
    out = bands.out_of_plane_fraction
    apart = phonons_of("triangular", "out_of_plane").bands(npoints=9)
    np.testing.assert_allclose(out.sum(axis=2), 1.0, rtol=1e-10)
    np.testing.assert_array_equal(apart.longitudinal_fraction, 0.0)
    np.testing.assert_allclose(
        apart.out_of_plane_fraction + apart.rotational_fraction, 1.0, rtol=1e-12
    )
    inside = phonons_of("triangular", "in_plane").bands(npoints=9)
    assert not inside.out_of_plane_fraction.any()
    both = np.sort(np.concatenate([inside.frequencies, apart.frequencies], axis=2), axis=2)
    np.testing.assert_allclose(bands.frequencies, both, atol=1e-7 * both.max())


def test_warnings_of_what_costs_nothing():
    ph = phonons_of("sc")
    assert ph.bands("GX", 2).warnings == gp.validity(ph.state).warnings
    (soft,) = ph.bands("GM", 2).warnings[len(gp.validity(ph.state).warnings) :]
    assert soft.startswith("1 mode vanishes at 1 of 2")
    free = phonons_of("chain", "all")
    for found in (free.bands("GX", 2), free.dos((4,))):
        assert any(one.startswith("3 of 6 branches") for one in found.warnings)


def test_warnings_travel_with_the_bands(rough):
    assert rough.bands(npoints=2).warnings == ()
    pressed = gp.Phonons(at_overlap(0.05))
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
    with pytest.raises(InputError, match=r"sigma .*top"):
        rough.dos(mesh=(4, 4), method="smearing", sigma=sigma)


def test_polarisations_at_a_copy_of_gamma_are_those_at_gamma(rough):
    """Of sound along the path, not along the reciprocal vector that leads to the copy."""
    home, copy = (rough.bands([[first, 0.0], [first, 0.4]], 5) for first in (0.0, 1.0))
    for name in ("longitudinal_fraction", "transverse_fraction"):
        np.testing.assert_allclose(getattr(copy, name)[:, 0], getattr(home, name)[:, 0], atol=1e-12)
    assert sorted(home.longitudinal_fraction[0, 0].round(12)) == [0.0, 0.0, 1.0]


@pytest.mark.parametrize("far", [1.1e15, 1e200, -1.7e308])
def test_wave_vectors_so_far_out_that_no_digit_is_left_are_refused(rough, far):
    for find in (
        lambda q: rough.frequencies([q]),
        lambda q: rough.modes([q]),
        lambda q: rough.bands([[0.0, 0.0], q, [1e308, 0.0]], 5),
    ):
        with pytest.raises(PrecisionError, match="from Gamma"):
            find([far, 0.25])
    at = np.clip(8.0 * far, -1e308, 1e308)  # 1/d, in which reciprocal vectors are 7.3 long
    for find in (rough.lattice.frequencies, rough.lattice.modes):
        with pytest.raises(PrecisionError, match="from Gamma"):
            find([[at, 0.25]])


def test_phonons_say_in_a_line_what_they_are(rough):
    assert (
        repr(rough) == "Phonons(triangular, 1 ball in the cell, x, y, w of each ball, 3 branches;"
        " frequencies in Hz)"
    )
    chain = gp.Phonons(
        gp.AveragedLattice(gp.Packing(STEEL, DIAMETER, lattice="chain", friction=False)).at_force(
            1.0
        )
    )
    assert (
        repr(chain)
        == "Phonons(chain, 1 ball in the cell, x of each ball, 1 branch; frequencies in Hz)"
    )


# -- files -----------------------------------------------------------------------------------------


def same_bands(one, other):
    for field in dataclasses.fields(one):
        a = getattr(one, field.name)
        b = getattr(other, field.name)
        if isinstance(a, np.ndarray):
            # one rounding each way for what changes units
            np.testing.assert_allclose(b, a, rtol=5e-16, atol=0.0, err_msg=field.name)
            if field.name not in ("frequencies", "group_velocities"):
                np.testing.assert_array_equal(b, a, err_msg=field.name)
        else:
            assert a == b, field.name


@pytest.mark.claim("files-all-digits")
@pytest.mark.parametrize("kind", ["smooth", "kagome", "vacancy", "jump", "pressed"])
def test_bands_survive_their_file(tmp_path, kind):
    state = at_force(
        friction=kind != "smooth", lattice="kagome" if kind == "kagome" else "triangular"
    )
    if kind == "pressed":
        state = at_overlap(0.05)
    balls = None
    if kind == "vacancy":
        balls = gp.atoms(state).repeat((3, 3, 1))
        balls.set_masses(np.linspace(1.0, 2.0, 9))
        del balls[4]
    ph = gp.Phonons(state, balls)
    path = (
        [[[0, 0], [1 / 3, 1 / 3]], [[0.5, 0], [0, 0]]]
        if kind == "jump"
        else [[0, 0], [1 / 3, 1 / 3], [0.5, 0]]
    )
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


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("motions: all", "motions: some"),
        ("periods: 3", "periods: 4"),
        ("rotations: true", "rotations: 1"),
        ("rotations: true", "rotations: false"),
        ("symbol: Sn", "symbol: Fe"),
    ],
)
def test_bands_that_were_edited_are_refused(old, new, tmp_path):
    phonons_of("fcc").bands("GX", 2).write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text()
    # without the digest, which would be the first to notice
    lines = [
        line
        for line in text.replace(old, new).splitlines()
        if "digest" not in line and "sha256" not in line
    ]
    assert "\n".join(lines) != text
    (tmp_path / "band.yaml").write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError):
        gp.Bands.read(tmp_path / "band.yaml")


@pytest.mark.parametrize(
    ("lattice", "path", "periods", "said"),
    [
        ("fcc", "GX", 2, "a group_velocity across its 2 periods"),
        ("fcc", "XW", 1, "a group_velocity across its 1 period"),
        ("sc", [[0, 0, 0.1], [0, 0, 0.5]], 2, "a group_velocity across its 2 periods"),
        ("sc", [[0.5, 0, 0], [0.5, 0.5, 0]], 1, "a group_velocity across its 1 period"),
    ],
)
def test_bands_with_fewer_periods_than_their_lattice_are_refused(
    lattice, path, periods, said, tmp_path
):
    phonons_of(lattice).bands(path, 2).write(tmp_path / "band.yaml")
    text = (tmp_path / "band.yaml").read_text().replace("periods: 3", f"periods: {periods}")
    (tmp_path / "band.yaml").write_text(text.partition("\n")[2])
    with pytest.raises(InputError, match=said):
        gp.Bands.read(tmp_path / "band.yaml")
    # of numbers in memory, velocities along the periods alone are left
    bands = phonons_of(lattice).bands(path, 2)
    with pytest.raises(InputError, match=f"leaves .* {periods} period"):
        dataclasses.replace(bands, group_velocities=bands.group_velocities[..., :periods])._check()


@pytest.mark.parametrize("name", ["triangular", "fcc"])
def test_bands_without_eigenvectors_are_the_same_and_say_what_they_lack(name, tmp_path):
    ph = phonons_of(name)
    whole = ph.bands(npoints=4)
    bands = ph.bands(npoints=4, eigenvectors=False)
    np.testing.assert_allclose(
        bands.frequencies, whole.frequencies, rtol=1e-12, atol=1e-14 * whole.frequencies.max()
    )
    assert (bands.eigenvectors, bands.group_velocities) == (None, None)
    assert (bands.labels, bands.periods, bands.warnings) == (
        whole.labels,
        whole.periods,
        whole.warnings,
    )
    for what in ("rotational_fraction", "connected_frequencies", "longitudinal_fraction", "motion"):
        with pytest.raises(InputError, match="eigenvectors=True"):
            getattr(bands, what)
    bands.write(tmp_path / "band.yaml")
    assert "eigenvector" not in (tmp_path / "band.yaml").read_text()
    assert gp.Bands.read(tmp_path / "band.yaml") == bands
    assert len(gp.plot(bands).axes[0].collections) == len(gp.plot(whole).axes[0].collections)


def test_an_estimate_grows_with_the_work():
    ph = phonons_of("fcc")
    one = ph.estimate(10)
    many = ph.estimate(1000)
    alone = ph.estimate(1000, eigenvectors=False)
    assert one.seconds < many.seconds
    assert one.memory < many.memory
    assert alone.seconds < many.seconds
    assert alone.memory < many.memory
    assert many.text.startswith("bands at 1,000 ")
    with pytest.raises(InputError, match="points"):
        ph.estimate(0)


def test_pure_rotation_of_steel_is_on_top_at_m_and_at_the_bottom_at_k(rough):
    bands = rough.bands("GKMG", npoints=21)
    k = bands.rotational_fraction[0, -1]
    m = bands.rotational_fraction[1, -1]
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
    share = bands.longitudinal_fraction[0, 1:-1]
    np.testing.assert_allclose(share * (1.0 - share), 0.0, atol=1e-12)


def test_standard_errors_of_another_shape_are_refused(phonons, tmp_path):
    bands = phonons.bands("GK", npoints=3)
    with pytest.raises(InputError, match="errors"):
        bands.write(tmp_path / "band.yaml", errors=np.ones(3))
    assert not list(tmp_path.iterdir())


def test_flags_and_labels_of_another_kind_are_named(phonons, tmp_path):
    with pytest.raises(InputError, match="eigenvectors"):
        phonons.bands("GK", 2, eigenvectors="no")
    with pytest.raises(InputError, match="pad"):
        phonons.bands("GK", 2).write(tmp_path / "band.yaml", pad="yes")
    with pytest.raises(InputError, match="labels"):
        BandPath([[[0, 0, 0], [0, 0, 1]]], 5)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("cost", "eigenvectors", "said"),
    [
        (Cost(working=1e30), False, "at one wave vector take .* fewer balls$"),
        (Cost(working=1e30), True, "fewer balls, or eigenvectors=False"),
        (Cost(kept=1e30), False, "fewer npoints or segments$"),
        (Cost(kept=1e30), True, "segments, or eigenvectors=False"),
    ],
)
def test_bands_beyond_the_memory_are_told_what_helps(cost, eigenvectors, said, memory, monkeypatch):
    memory(1e9)
    monkeypatch.setattr("granphon.media.cost.bands", lambda *arguments, **options: cost)
    with pytest.raises(InputError) as error:
        phonons_of("triangular").bands(npoints=2, eigenvectors=eigenvectors)
    assert re.search(said, str(error.value).removesuffix("."))
