"""Densities of states: integrals, limits, laws, files, errors."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.quantities import Quantity
from granphon.base.tables import Table
from granphon.phonons.zone_mesh import ZoneMesh
from tests.phonons.conftest import DIAMETER, ETA, RESISTED, at_force, every_case, phonons_of


class WholeMesh(gp.Phonons):
    """Phonons whose meshes are not reduced by symmetry."""

    def _make_mesh(self, numbers):
        return ZoneMesh.of(numbers)


@pytest.mark.claim("api-densities")
@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
def test_density_survives_its_file(phonons, tmp_path, method):
    dos = phonons.dos(mesh=(6, 4), method=method, points=51)
    dos.write_csv(tmp_path / "dos.csv")
    back = gp.DensityOfStates.read_csv(tmp_path / "dos.csv")
    for field in dataclasses.fields(dos):
        np.testing.assert_array_equal(
            getattr(back, field.name), getattr(dos, field.name), err_msg=field.name
        )
    again = gp.DensityOfStates.from_dict(dos.to_dict())
    np.testing.assert_array_equal(again.total, dos.total)
    table = np.genfromtxt(tmp_path / "dos.csv", delimiter=",", names=True)
    assert table.dtype.names == (
        "frequency_Hz",
        "total_per_Hz",
        "translational_per_Hz",
        "rotational_per_Hz",
    )
    np.testing.assert_array_equal(table["total_per_Hz"], dos.total)
    np.testing.assert_array_equal(table["frequency_Hz"], dos.frequencies)
    frequency = Quantity("frequency", "Hz", "1 kHz", "Hz, kHz", "zero or above")
    own = Table.read(tmp_path / "dos.csv")
    assert [heading.name for heading in own.headings] == list(table.dtype.names)
    np.testing.assert_array_equal(own.column("frequency_Hz (Hz)", frequency), dos.frequencies)


@pytest.mark.parametrize(
    ("comments", "fault"),
    [
        ("# granphon density of states, schema 1, per ball\n", "first comments"),
        (
            "# granphon density of states, schema 1, per ball\n# method foo, mesh 4 4\n",
            "the method is 'foo'",
        ),
    ],
)
def test_what_is_no_density_is_told(tmp_path, comments, fault):
    heading = "frequency_Hz,total_per_Hz,translational_per_Hz,rotational_per_Hz\n"
    (tmp_path / "dos.csv").write_text(f"{heading}{comments}1,2,1,1\n")
    with pytest.raises(InputError, match=fault):
        gp.DensityOfStates.read_csv(tmp_path / "dos.csv")


# -- densities of states ---------------------------------------------------------------------------


def integral(dos, part="total"):
    return np.trapezoid(getattr(dos, part), dos.frequencies)


@pytest.mark.claim("api-densities")
@pytest.mark.parametrize(
    ("mesh", "points"), [((1, 1), 501), ((2, 2), 12), ((7, 5), 501), ((16, 16), 13)]
)
def test_integral_is_the_number_of_branches_of_a_ball(phonons, mesh, points):
    rotations = 1.0 if phonons.lattice.motions.rotate else 0.0
    dos = phonons.dos(mesh=mesh, points=points)
    assert integral(dos, "translational") == pytest.approx(2.0, rel=1e-12)
    assert integral(dos, "rotational") == pytest.approx(rotations, rel=1e-12)
    np.testing.assert_array_equal(dos.total, dos.translational + dos.rotational)
    assert dos.translational.min() >= 0.0
    assert dos.rotational.min() >= 0.0


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
        distances.append(
            np.abs(np.interp(fine.frequencies, smeared.frequencies, cumulative) - reference).max()
            / total
        )
    assert distances[0] > 1.4 * distances[1] > 1.4**2 * distances[2]


def test_moments_are_traces(phonons):
    # the mean squared frequency is the trace of D(q) averaged over the zone: the force constants of
    # a ball on itself
    dos = phonons.dos(mesh=(64, 64), points=4001)
    own = np.einsum("aa->a", phonons.phonopy.force_constants[0, 0])
    unit = phonons.scales.frequency**2
    for part, expected in (("translational", own[:2].sum()), ("rotational", own[2])):
        second = np.trapezoid(getattr(dos, part) * dos.frequencies**2, dos.frequencies) / unit
        assert second == pytest.approx(expected, rel=2e-3, abs=1e-12)


@pytest.mark.claim("reduced-mesh")
@pytest.mark.parametrize("method", ["tetrahedron", "smearing"])
@pytest.mark.parametrize(
    "case",
    ["triangular", "smooth", "square", "kagome", "vacancy", "masses", "oblong", "fcc", "hcp"],
)
def test_reduced_mesh_equals_the_full_one(method, case):
    lattice = case if case in ("square", "kagome", "fcc", "hcp") else "triangular"
    state = at_force(friction=case != "smooth", lattice=lattice)
    balls = gp.atoms(state)
    if case in ("vacancy", "masses"):
        balls = balls.repeat((2, 2, 1))
    if case == "vacancy":
        del balls[3]
    if case == "masses":
        balls.set_masses([1.0, 2.0, 3.0, 5.0])
    mesh = {"oblong": (8, 6), "fcc": (5, 5, 5), "hcp": (4, 4, 2)}.get(case, (8, 8))
    ph = gp.Phonons(state, balls)
    small = ph._make_mesh(mesh)
    unreduced = WholeMesh(state, balls)
    full = unreduced._make_mesh(mesh)
    assert small.weights.sum() == full.weights.sum() == len(full.qpoints) == np.prod(mesh)
    reduced = ph.dos(mesh=mesh, method=method)
    whole = unreduced.dos(mesh=mesh, method=method)
    top = whole.total.max()
    np.testing.assert_allclose(reduced.frequencies, whole.frequencies, rtol=1e-12)
    if method == "tetrahedron" and case in ("square", "fcc", "hcp"):
        # the mesh is cut along one of several equal diagonals: see the next test
        return
    within = {"rtol": 1e-9, "atol": 1e-12 * top} if method == "smearing" else {"atol": 2e-6 * top}
    np.testing.assert_allclose(reduced.translational, whole.translational, **within)
    np.testing.assert_allclose(reduced.rotational, whole.rotational, **within)
    # 12 operations of the layer group on the triangular and kagome lattices, 8 on the square one
    if case in ("triangular", "smooth", "kagome"):
        assert len(small.qpoints) == 10
    if case == "square":
        assert len(small.qpoints) == 15
    # balls of four masses on a 2 x 2 cell have the half turn alone, which is time reversal
    if case == "masses":
        assert len(small.qpoints) == 8 * 8 // 2 + 2


@pytest.mark.claim("reduced-mesh")
def test_square_meshes_tend_to_the_same_density():
    # a mesh of squares cut along one diagonal has less symmetry than the lattice; the difference
    # falls with the mesh
    both = [kind(at_force(lattice="square")) for kind in (gp.Phonons, WholeMesh)]
    apart = []
    for n in (12, 24, 48):
        found = [ph.dos(mesh=(n, n)) for ph in both]
        counts = [cumulative_trapezoid(dos.total, dos.frequencies, initial=0.0) for dos in found]
        apart.append(np.abs(counts[0] - counts[1]).max())
    assert apart[0] > 2.0 * apart[1] > 4.0 * apart[2]
    assert apart[2] < 0.01


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
    # at the top, rotation alone, with the step of a parabolic maximum in two dimensions: omega^2 =
    # 30 eta (1 - q^2/10)
    just = (dos.frequencies > 0.97 * top) & (dos.frequencies < 0.99 * top)
    assert np.all(dos.rotational[just] > 20.0 * dos.translational[just])
    # omega = w0 (1 - q^2/20): g = A/(2 pi) q dq/domega = A/(2 pi) 10/w0 per angular frequency
    step = np.sqrt(3.0) / 2.0 / (2.0 * np.pi) * 10.0 / np.sqrt(30.0 * ETA) / scale
    assert np.mean(dos.total[just]) == pytest.approx(step, rel=0.1)


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
    one = rough.dos(mesh=(24, 20))
    other = rough.dos(mesh=(20, 24, 1))
    assert (one.mesh, other.mesh) == ((24, 20), (20, 24))
    np.testing.assert_allclose(one.total, other.total, atol=1e-9 * one.total.max())


@every_case
def test_a_density_of_states_counts_every_motion(lattice, motions, options):
    ph = phonons_of(lattice, motions, **options)
    mesh = {3: (3, 3, 2)}.get(ph.lattice.periods, (7, 5)[: ph.lattice.periods])
    count = ph.lattice.motions.count
    turns = len(ph.lattice.motions.rotations)
    for method, tolerance in (("tetrahedron", 1e-12), ("smearing", 1e-5)):
        dos = ph.dos(mesh, method=method)
        assert dos.mesh == mesh
        assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(count, abs=tolerance)
        assert np.trapezoid(dos.rotational, dos.frequencies) == pytest.approx(turns, abs=1e-5)


@pytest.mark.parametrize(
    ("lattice", "mesh", "points"),
    [
        ("chain", (40,), 5001),
        pytest.param("triangular", (12, 12), 20001, marks=pytest.mark.slow),
        pytest.param("fcc", (8, 8, 8), 20001, marks=pytest.mark.exhaustive),
        pytest.param("hcp", (6, 6, 4), 20001, marks=pytest.mark.exhaustive),
    ],
    ids=str,
)
def test_densities_are_phonopys(lattice, mesh, points):
    """Phonopy's density at a frequency is the limit of the mean over an interval, but for steps and
    poles.
    """
    ph = phonons_of(lattice, "all", **RESISTED)
    dos = WholeMesh(ph.state).dos(mesh, points=points)
    ph.phonopy.run_mesh([*mesh, 1, 1][:3], is_gamma_center=True, is_mesh_symmetry=False)
    at = dos.frequencies / ph.scales.frequency
    run = ph.phonopy.run_total_dos(freq_min=at[0], freq_max=at[-1], freq_pitch=at[1])
    np.testing.assert_allclose(run.frequency_points, at, atol=1e-9)
    away = np.trapezoid(np.abs(run.dos / len(ph.atoms) - dos.total * ph.scales.frequency), at)
    assert away < 5e-3 * np.trapezoid(dos.total, dos.frequencies)


def test_modes_of_a_linear_dispersion_in_closed_form():
    """On one cell of a mesh with corners 0 and 1, the lower corner has 2 x - x^2 of its half, the
    upper one x^2.
    """
    mesh = ZoneMesh.of((2,))
    limits = np.linspace(-0.5, 1.5, 9)
    x = np.clip(limits, 0.0, 1.0)
    parts = np.array([[[1.0], [0.0]], [[0.0], [1.0]]])
    counted = mesh.count_modes(np.eye(1), np.array([[0.0], [1.0]]), parts, limits)
    np.testing.assert_allclose(counted, np.stack([2.0 * x - x**2, x**2]) / 2.0, atol=1e-15)


def test_the_point_group_reduces_the_mesh():
    for lattice, mesh, order in (
        ("triangular", (24, 24), 12),
        ("fcc", (24, 24, 24), 48),
        ("hcp", (24, 24, 12), 24),
        ("chain", (24,), 2),
    ):
        ph = phonons_of(lattice, "all")
        full = np.prod(mesh)
        reduced = len(ph._make_mesh(mesh).qpoints)
        assert full / order <= reduced <= 2.6 * full / order
    # a mesh that a rotation does not map on itself is not reduced
    assert len(phonons_of("fcc")._make_mesh((4, 4, 6)).qpoints) == 96


def test_states_of_a_chain_in_closed_form():
    ph = phonons_of("chain")
    dos = ph.dos((4000,), points=201)
    x = dos.frequencies / ph.scales.frequency
    edges = np.clip(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]), 0.0, 2.0)
    expected = np.diff(2.0 / np.pi * np.arcsin(edges / 2.0))
    widths = np.diff(np.concatenate([x[:1], 0.5 * (x[1:] + x[:-1]), x[-1:]]))
    np.testing.assert_allclose(dos.total * ph.scales.frequency * widths, expected, atol=2e-5)
    assert not dos.rotational.any()


@pytest.mark.parametrize(
    ("mesh", "part"), [(30, 0.12), pytest.param(40, 0.1, marks=pytest.mark.slow)]
)
def test_low_states_of_a_crystal_are_those_of_sound(mesh, part):
    """Debye's law, N(omega) = V omega^3 / (6 pi^2) times the mean of 1/v^3 over directions and
    branches.
    """
    ph = phonons_of("fcc")
    dos = ph.dos((mesh, mesh, mesh))
    z, angle = np.meshgrid((np.arange(20) + 0.5) / 10.0 - 1.0, (np.arange(20) + 0.5) * np.pi / 10.0)
    rho = np.sqrt(1.0 - z**2)
    directions = np.stack([rho * np.cos(angle), rho * np.sin(angle), z], axis=-1).reshape(-1, 3)
    velocities, _ = ph.lattice.sound_velocities(directions)
    slow = float(np.sum(np.mean(velocities**-3.0, axis=0)))
    low = dos.frequencies < part * dos.frequencies[-1]
    counted = np.trapezoid(dos.total[low], dos.frequencies[low])
    top = dos.frequencies[low][-1] / ph.scales.frequency
    assert counted == pytest.approx(ph.lattice.measure * slow * top**3 / (6.0 * np.pi**2), rel=0.03)


def test_branches_that_cost_nothing_are_counted_at_zero():
    # three of the six motions of a chain: all in the first interval
    dos = phonons_of("chain", "all").dos((64,))
    first = 0.5 * dos.frequencies[1]
    assert dos.total[0] * first == pytest.approx(3.0, abs=0.02)
    assert np.trapezoid(dos.total, dos.frequencies) == pytest.approx(6.0, abs=1e-12)


BAD_DENSITIES = {
    "method": ({"method": "gauss"}, "allowed: tetrahedron, smearing"),
    "points": ({"points": 11}, "a whole number from 12 to"),
    "sigma without smearing": ({"sigma": 1.0}, "smearing method"),
    "negative sigma": ({"method": "smearing", "sigma": -1.0}, "finite number above zero"),
    "no sigma": ({"method": "smearing", "sigma": 0.0}, "finite number above zero"),
    "sigma not a number": (
        {"method": "smearing", "sigma": np.nan},
        "finite number above zero",
    ),
    "third of the mesh": (
        {"mesh": (8, 8, 2)},
        "third number is 2; .*two whole",
    ),
    "nothing of the mesh": ({"mesh": (0, 8)}, "allowed: two whole numbers from 1 to"),
    "sigma below the spacing": (
        {"method": "smearing", "sigma": 1.0, "points": 50},
        "50 points",
    ),
    "half a mesh": ({"mesh": (8,)}, "allowed: two whole numbers from 1 to"),
}


@pytest.mark.parametrize("case", BAD_DENSITIES)
def test_densities_that_cannot_be_are_refused_before_any_mode_is_found(rough, case, monkeypatch):
    options, words = BAD_DENSITIES[case]
    monkeypatch.setattr(type(rough), "_find_modes_on", lambda *_: pytest.fail("modes were found"))
    with pytest.raises(InputError, match=words):
        rough.dos(**{"mesh": (4, 4), **options})


@pytest.mark.parametrize("errors", [{"total": np.ones(3)}, {"whole": np.ones(20)}])
def test_standard_errors_of_another_length_or_name_are_refused(phonons, errors, tmp_path):
    dos = phonons.dos((8, 8), points=20)
    with pytest.raises(InputError, match="errors"):
        dos.write_csv(tmp_path / "dos.csv", errors=errors)
    assert not list(tmp_path.iterdir())
    dos.write_csv(tmp_path / "dos.csv", errors={"total": np.ones(20)})
    assert "total_error_per_Hz" in (tmp_path / "dos.csv").read_text().splitlines()[0]


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
    assert (
        1.0 < dos.total[np.searchsorted(dos.frequencies, 0.25 * top)] / (slope * 0.25 * top) < 1.3
    )


def test_mode_count_of_a_fine_mesh(phonons):
    # second engine: count modes below a frequency on a brute-force mesh, from C(q) alone
    n = 240
    grid = (np.stack(np.meshgrid(*[np.arange(n)] * 2), axis=-1).reshape(-1, 2) + 0.5) / n
    lattice = phonons.lattice
    values = np.sort(
        (lattice.frequencies(lattice.wavevectors(grid)) * phonons.scales.frequency).ravel()
    )
    dos = phonons.dos(mesh=(64, 64), points=2001)
    counted = np.searchsorted(values, dos.frequencies) / len(grid)
    cumulative = cumulative_trapezoid(dos.total, dos.frequencies, initial=0.0)
    np.testing.assert_allclose(cumulative, counted, atol=2e-3 * lattice.n_branches)


@pytest.mark.parametrize(
    ("lattice", "mesh"), [("chain", (16,)), ("fcc", (4, 4, 4)), ("hcp", (4, 4, 2))], ids=str
)
def test_tables_of_densities_of_states(lattice, mesh, tmp_path):
    dos = phonons_of(lattice, "all").dos(mesh)
    dos.write_csv(tmp_path / "dos.csv")
    assert gp.DensityOfStates.read_csv(tmp_path / "dos.csv") == dos
    assert gp.DensityOfStates.from_dict(json.loads(json.dumps(dos.to_dict()))) == dos
    assert f"mesh {' '.join(map(str, mesh))}\n" in (tmp_path / "dos.csv").read_text()
