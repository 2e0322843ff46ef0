"""The files in the hands of the real tools, each run as its own process in an empty folder, with no
option.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import granphon as gp
from granphon.base.errors import InputError, UnsupportedError
from granphon.base.scales import HertzPrefix
from granphon.phonons.phonopy_atoms import read_numbers
from granphon.phonons.phonopy_bridge import load_phonopy
from tests.dynamics.test_network_lattice import hold, random_network, ribbon, rock_salt
from tests.phonons.conftest import RESISTED, at_overlap, padded, phonons_of, random_points
from tests.phonons.test_kinds import salt
from tests.warm import Warm

TOOLS = Path(sys.executable).parent
LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def vacancy(state):
    balls = gp.atoms(state).repeat((3, 2, 1))
    balls.set_masses(np.linspace(1.0, 3.0, 6))
    del balls[3]
    return balls


CASES = {
    "rough": lambda: gp.Phonons(at_overlap(1e-3)),
    "smooth": lambda: gp.Phonons(at_overlap(1e-3, friction=False)),
    "finite overlap": lambda: gp.Phonons(at_overlap(finite_overlap=True)),
    "smooth finite overlap": lambda: gp.Phonons(at_overlap(friction=False, finite_overlap=True)),
    "micrometre balls": lambda: gp.Phonons(at_overlap(1e-3, diameter=1e-6)),
    "ten-metre balls": lambda: gp.Phonons(at_overlap(1e-9, diameter=10.0)),
    "hardly pressed": lambda: gp.Phonons(at_overlap(1e-20)),
    "vacancy": lambda: (lambda state: gp.Phonons(state, vacancy(state)))(at_overlap(1e-3)),
    "kagome": lambda: gp.Phonons(at_overlap(1e-3, lattice="kagome")),
    "row": lambda: phonons_of("chain", "longitudinal"),
    "membrane": lambda: phonons_of("triangular", "all", **RESISTED),
    "fcc": lambda: phonons_of("fcc", "all"),
    "finite fcc": lambda: phonons_of("fcc", "all", finite_overlap=True),
    "chain": lambda: phonons_of("chain", "all"),
    "out of plane": lambda: phonons_of("honeycomb", "out_of_plane"),
    "hcp": lambda: phonons_of("hcp", "all", **RESISTED),
    "smooth fcc": lambda: phonons_of("fcc", "all", friction=False),
    "rock salt": lambda: gp.Phonons(rock_salt(2.0, 1.4, (1.0, 3.0))),
    "ribbon of differing balls": lambda: gp.Phonons(
        ribbon(random_network("triangular", (2, 3)), 0)
    ),
    "held balls": lambda: gp.Phonons(hold(random_network("triangular", (2, 3)), [1])),
}
#: a path through the zone of one, two and three periods
LINE = {
    1: "0 0 0 1/2 0 0",
    2: "0 0 0 1/3 1/3 0 1/2 0 0 0.1 0.3 0",
    3: "0 0 0 1/2 0 1/2 1/2 1/4 3/4 0.1 0.2 0.35",
}


#: these take the same ways as the others
MANY = (
    "smooth finite overlap",
    "micrometre balls",
    "ten-metre balls",
    "membrane",
    "finite fcc",
    "chain",
    "out of plane",
    "hcp",
    "smooth fcc",
    "held balls",
    "hardly pressed",
    "finite overlap",
    "kagome",
    "row",
)


@pytest.fixture(
    scope="module",
    params=[pytest.param(one, marks=[pytest.mark.exhaustive] * (one in MANY)) for one in CASES],
)
def exported(request, tmp_path_factory):
    """The name of a case, its phonons, and a folder that holds nothing but their file."""
    ph = CASES[request.param]()
    folder = tmp_path_factory.mktemp("exported")
    ph.save(folder / "phonopy_params.yaml")
    return request.param, ph, folder


@pytest.fixture(scope="module", autouse=True)
def tools(tmp_path_factory):
    """What runs programs, each in a process of its own that does not have to load phonopy and
    Euphonic first.
    """
    warm = (
        Warm("phonopy", "phonopy.scripts.phonopy", "matplotlib.pyplot", "euphonic")
        if hasattr(os, "fork")
        else None
    )
    scratch = tmp_path_factory.mktemp("scratch")

    def carry_out(folder, *arguments, code="", cold=False):
        # with nothing in its environment that could help it
        environment = {
            "MPLBACKEND": "Agg",
            "HOME": str(folder),
            "MPLCONFIGDIR": str(folder / ".matplotlib"),
        }
        if warm is not None and not cold:
            return warm.run(scratch, folder, arguments, code, environment)
        done = subprocess.run(
            [sys.executable, *arguments, *([code] if code else [])],
            cwd=folder,
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        return done.returncode, done.stdout, done.stderr

    _TOOLS.append(carry_out)
    yield
    _TOOLS.clear()
    if warm is not None:
        warm.close()


_TOOLS = []


def run(folder, tool, *arguments, status=0, cold=False):
    """Run a tool in ``folder``, if cold as a shell does; its standard output."""
    code, out, err = _TOOLS[0](folder, str(TOOLS / tool), *map(str, arguments), cold=cold)
    assert code == status, out + err
    return out


def script(folder, text):
    """Run a Python script in ``folder``; what it prints, from JSON."""
    code, out, err = _TOOLS[0](folder, "-c", code=text)
    assert code == 0, out + err
    return json.loads(out.splitlines()[-1])


def head(path):
    return yaml.safe_load(path.read_text(encoding="utf-8").split("\nphonopy:", 1)[0])["granphon"]


def without_flat_bands(found, count):
    """Sorted frequencies without the ``count`` nearest to zero, and the greatest of those."""
    order = np.argsort(np.abs(found), axis=1, kind="stable")
    flat = np.take_along_axis(found, order[:, :count], axis=1)
    return np.sort(np.take_along_axis(found, order[:, count:], axis=1), axis=1), np.abs(flat).max()


# -- phonopy ---------------------------------------------------------------------------------------


@pytest.mark.claim("readme-exchange", "phonopy-frequencies", "flat-bands")
def test_the_phonopy_command_without_options(exported):
    case, ph, folder = exported
    assert [p.name for p in folder.iterdir()] == ["phonopy_params.yaml"]
    run(
        folder,
        "phonopy",
        "phonopy_params.yaml",
        "--band",
        LINE[ph.lattice.periods],
        cold=case == "rough",
    )
    own = head(folder / "phonopy_params.yaml")
    assert gp.Units.from_info(own) == ph.scales
    assert HertzPrefix.named(own["frequency_unit"]).hertz == own["hertz"]
    out = yaml.load((folder / "band.yaml").read_text(), Loader=LOADER)
    for path in folder.iterdir():
        if path.name != "phonopy_params.yaml":
            path.unlink() if path.is_file() else shutil.rmtree(path)
    q = np.array([point["q-position"] for point in out["phonon"]])
    found = np.array([[mode["frequency"] for mode in point["band"]] for point in out["phonon"]])
    expected = ph.frequencies(q) / own["hertz"]
    top = expected.max()
    assert 1.0 <= top < 1000.0
    found, flat = without_flat_bands(found, own["zero_bands"])
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * top)
    assert flat < 1e-6 * top


def test_phonopy_load(exported):
    _, ph, folder = exported
    q = padded(random_points(ph, 2))
    found = script(
        folder,
        f"import json, phonopy; ph = phonopy.load('phonopy_params.yaml', is_nac=False,"
        f" log_level=0);print(json.dumps(ph.run_qpoints({q.tolist()}).frequencies.tolist()))",
    )
    own = head(folder / "phonopy_params.yaml")
    found, _ = without_flat_bands(np.array(found), own["zero_bands"])
    expected = ph.frequencies(q) / own["hertz"]
    np.testing.assert_allclose(found**2, expected**2, atol=1e-10 * expected.max() ** 2)


def test_phonopy_mesh_and_density_of_states(tmp_path):
    # the command's own mesh and density of states: three branches, and three flat ones at zero
    ph = CASES["rough"]()
    ph.save(tmp_path / "phonopy_params.yaml")
    run(
        tmp_path,
        "phonopy",
        "phonopy_params.yaml",
        "--mesh",
        "16",
        "16",
        "1",
        "--gc",
        "--dos",
        "--fmin",
        "1",
    )
    own = head(tmp_path / "phonopy_params.yaml")
    frequency, total = np.loadtxt(tmp_path / "total_dos.dat").T
    top = ph.frequencies([[0, 0]]).max() / own["hertz"]
    assert frequency[np.flatnonzero(total > 1e-6)[-1]] == pytest.approx(top, rel=0.02)
    assert np.trapezoid(total, frequency) == pytest.approx(3.0, abs=0.15)


def test_phonopy_bandplot_prints_our_numbers(tmp_path):
    # its gnuplot output: distance and frequency, as we have them, also of a file with errors
    bands = CASES["rough"]().bands("GK,MG", npoints=11)
    bands.write(tmp_path / "band.yaml", errors=0.01 * bands.frequencies)
    # having printed them, phonopy-bandplot ends with status 1
    text = run(tmp_path, "phonopy-bandplot", "--gnuplot", "band.yaml", status=1)
    rows = np.array(
        [
            [float(x) for x in line.split()]
            for line in text.splitlines()
            if line.strip() and line[0] != "#"
        ]
    )
    kilohertz = bands.frequencies.transpose(2, 0, 1).ravel() / 1e3
    np.testing.assert_allclose(rows[:, 0], np.tile(bands.distances.ravel(), 3), atol=1e-6)
    np.testing.assert_allclose(rows[:, 1], kilohertz, atol=1e-6)


@pytest.mark.claim("phonopy-round-trip")
def test_load_phonopy_restores_force_constants(exported):
    _, ph, folder = exported
    bridge, scales = load_phonopy(folder / "phonopy_params.yaml")
    assert type(bridge) is type(ph.phonopy)
    assert scales == ph.scales
    assert bridge.unitcell.symbols == ph.phonopy.unitcell.symbols
    np.testing.assert_allclose(
        bridge.unitcell.positions, ph.phonopy.unitcell.positions, rtol=1e-14, atol=1e-14
    )
    # every number keeps all its digits; what is itself the rounding error of a zero is cut at 2^-30
    # of phonopy's 15 decimals
    np.testing.assert_allclose(
        bridge.force_constants, ph.phonopy.force_constants, rtol=0.0, atol=5.1e-16 / 2**30
    )
    big = np.abs(ph.phonopy.force_constants) > 1e-9
    np.testing.assert_array_equal(bridge.force_constants[big], ph.phonopy.force_constants[big])
    np.testing.assert_array_equal(bridge.masses, ph.phonopy.masses)
    np.testing.assert_array_equal(bridge.supercell_matrix, ph.phonopy.supercell_matrix)
    q = padded(random_points(ph, 2))
    np.testing.assert_allclose(
        bridge.run_qpoints(q).frequencies[:, -1],
        ph.frequencies(q)[:, -1] / ph.scales.frequency,
        rtol=1e-12,
    )
    with pytest.raises(UnsupportedError):
        bridge.symmetrize_force_constants()


def test_phonopys_own_file_would_not_do(tmp_path):
    # why Phonons.save is not Phonopy.save: the command symmetrises, and loses the rotation
    from phonopy import Phonopy

    ph = CASES["rough"]()
    bare = Phonopy(
        ph.phonopy.unitcell, ph.phonopy.supercell_matrix, primitive_matrix="P", is_symmetry=False
    )
    bare.unit_conversion_factor = 1.0
    bare.force_constants = ph.phonopy.force_constants
    bare.save(tmp_path / "phonopy_params.yaml", settings={"force_constants": True})
    run(tmp_path, "phonopy", "phonopy_params.yaml", "--band", LINE[2])
    out = yaml.load((tmp_path / "band.yaml").read_text(), Loader=LOADER)
    at_gamma = np.array([mode["frequency"] for mode in out["phonon"][0]["band"]])
    assert np.abs(at_gamma).max() < 1e-3, "the rotational branch has fallen to zero"


# -- Euphonic --------------------------------------------------------------------------------------

EUPHONIC = """
import json, warnings
# phonopy and numpy bring an OpenMP library each: Euphonic says that it will use one thread
warnings.simplefilter("ignore")
import numpy as np
import phonopy
from euphonic import {names}, ureg
def terahertz(data):
    return data.frequencies.to("THz", "spectroscopy").magnitude.tolist()
"""


def euphonic_terahertz(folder, qpoints):
    """Frequencies (n_q, branches), THz, that Euphonic finds from phonopy_params.yaml in a
    folder.
    """
    return script(
        folder,
        EUPHONIC.format(names="ForceConstants")
        + f"""
fc = ForceConstants.from_phonopy(path=".", summary_name="phonopy_params.yaml")
print(json.dumps(terahertz(fc.calculate_qpoint_phonon_modes(np.array({np.asarray(qpoints).tolist()}), asr=None))))
""",
    )


def constant_ratio(folder):
    """What (eV/A^2 amu)^1/2 / 2 pi is in THz to Euphonic, over what it is to phonopy: they hold
    different CODATA years.
    """
    return script(
        folder,
        EUPHONIC.format(names="ForceConstants")
        + """
from phonopy.physical_units import get_physical_units
theirs = (1 * ureg("eV/angstrom^2/unified_atomic_mass_unit")).to("1/s^2").magnitude ** 0.5 / (2 * np.pi) / 1e12
# Euphonic goes through energies, hbar omega and h nu, in atomic units
print(json.dumps(theirs / get_physical_units().DefaultToTHz))
""",
    )


@pytest.mark.claim("readme-exchange", "euphonic-constants")
def test_euphonic_reads_the_force_constants(exported):
    case, ph, folder = exported
    q = padded(random_points(ph, 3))
    own = head(folder / "phonopy_params.yaml")
    found, flat = without_flat_bands(np.array(euphonic_terahertz(folder, q)), own["zero_bands"])
    expected = ph.frequencies(q) / own["hertz"]
    # phonopy and Euphonic take eV, A and amu from different years' constants, 1.23e-7 apart in a
    # frequency
    np.testing.assert_allclose(found, expected, rtol=2e-7, atol=1e-6 * expected.max())
    assert flat < 1e-6 * expected.max()
    # and nothing but that: the ratio is the same for every mode
    if case in ("rough", "smooth", "finite overlap", "micrometre balls", "vacancy"):
        ratio = found / expected
        assert np.ptp(ratio) < 1e-9
        assert ratio.mean() - 1.0 == pytest.approx(1.2337e-7, rel=1e-3)


def test_euphonic_reads_the_kinds_of_a_file(tmp_path):
    gp.Phonons(salt("Na", "Cl")).save(tmp_path / "phonopy_params.yaml")
    types, masses = script(
        tmp_path,
        EUPHONIC.format(names="ForceConstants")
        + """
crystal = ForceConstants.from_phonopy(path=".", summary_name="phonopy_params.yaml").crystal
print(json.dumps([crystal.atom_type.tolist(), crystal.atom_mass.magnitude.tolist()]))
""",
    )
    assert types == ["Na", "Sn", "Cl", "Sn", "He"]
    np.testing.assert_allclose(np.array(masses[:4]) / masses[0], [1.0, 1.0, 0.5, 0.5], rtol=1e-9)


@pytest.mark.claim("euphonic-constants")
def test_the_difference_of_constants_is_as_said(tmp_path):
    assert abs(constant_ratio(tmp_path) - 1.0) < 2e-7


#: of Euphonic, the modes of a file of bands: frequencies, wave vectors, eigenvectors and masses
READ_MODES = (
    EUPHONIC.format(names="QpointPhononModes")
    + """
modes = QpointPhononModes.from_phonopy(path=".", phonon_name="band.yaml")
print(json.dumps([terahertz(modes), modes.qpts.tolist(), modes.eigenvectors.real.tolist(), modes.eigenvectors.imag.tolist(),
                  modes.crystal.atom_mass.to("unified_atomic_mass_unit").magnitude.tolist()]))
"""
)


@pytest.mark.claim("euphonic-bands")
@pytest.mark.parametrize(
    "case",
    [
        "rough",
        "vacancy",
        "held balls",
        *(pytest.param(case, marks=pytest.mark.slow) for case in ("finite overlap", "kagome")),
    ],
)
def test_euphonic_reads_bands_with_eigenvectors(case, tmp_path):
    bands = CASES[case]().bands([[0, 0], [1 / 3, 1 / 3], [0.5, 0]], npoints=5)
    bands.write(tmp_path / "band.yaml", errors=0.01 * bands.frequencies)
    found = script(tmp_path, READ_MODES)
    top = HertzPrefix.for_top(bands.frequencies.max()).hertz
    s, p, b = bands.frequencies.shape
    np.testing.assert_allclose(
        found[0], bands.frequencies.reshape(-1, b) / top, rtol=1e-13, atol=1e-13
    )
    np.testing.assert_allclose(found[1], bands.qpoints.reshape(-1, 3), atol=1e-15)
    vectors = np.array(found[2]) + 1j * np.array(found[3])  # (q, branch, ball, 3)
    # ours, as phonopy's, go with the phase exp(i q.r) of each ball's own place; Euphonic's with
    # that of the cell, and a phase of the whole mode (the place of ball mode // 3)
    ours = bands.eigenvectors.reshape(s * p, -1, 3, b).transpose(0, 3, 1, 2)
    # (branch, ball, 3)
    apart = bands.positions[None, :] - bands.positions[np.arange(b) // 3][:, None]
    turn = np.exp(2j * np.pi * np.einsum("qa,bia->qbi", bands.qpoints.reshape(-1, 3), apart))
    np.testing.assert_allclose(vectors, ours * turn[..., None], atol=1e-14)
    np.testing.assert_allclose(found[4], bands.masses, rtol=1e-12)


def test_bands_go_through_their_file(exported, tmp_path):
    case, ph, _ = exported
    bands = ph.bands(npoints=2)
    bands.write(tmp_path / "band.yaml")
    again = gp.Bands.read(tmp_path / "band.yaml")
    assert again.motions == bands.motions
    assert (again.labels, again.scales, again.warnings) == (
        bands.labels,
        bands.scales,
        bands.warnings,
    )
    for name in ("qpoints", "distances", "cell", "positions", "masses"):
        np.testing.assert_array_equal(getattr(again, name), getattr(bands, name))
    for name in ("frequencies", "group_velocities", "eigenvectors"):
        ours = getattr(bands, name)
        np.testing.assert_allclose(
            getattr(again, name), ours, rtol=1e-14, atol=1e-15 * np.abs(ours).max()
        )
    if case == "rough":
        run(tmp_path, "phonopy-bandplot", "band.yaml", "-o", "x.png")
        assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")
    # what another program sees: the modes of phonopy's own matrix, with the phases of the places of
    # its atoms
    out = yaml.load((tmp_path / "band.yaml").read_text(), Loader=LOADER)
    q = bands.qpoints.reshape(-1, 3)
    vectors = np.array([[mode["eigenvector"] for mode in point["band"]] for point in out["phonon"]])
    vectors = (vectors[..., 0] + 1j * vectors[..., 1]).reshape(len(q), bands.n_branches, -1)
    matrices = ph.phonopy.run_qpoints(q, with_dynamical_matrices=True).dynamical_matrices
    squares = (bands.frequencies.reshape(len(q), -1, 1) / bands.scales.frequency) ** 2
    np.testing.assert_allclose(
        np.einsum("qab,qkb->qka", matrices, vectors), squares * vectors, atol=1e-12
    )
    assert out["natom"] == len(ph.phonopy.unitcell)
    assert [point["symbol"] for point in out["points"]] == ph.phonopy.unitcell.symbols
    assert gp.Bands.from_dict(json.loads(json.dumps(bands.to_dict()))) == bands


def test_euphonic_reads_bands_with_two_atoms_a_ball(tmp_path):
    bands = phonons_of("fcc").bands([[0.1, 0.0, 0.0], [0.3, 0.2, 0.4]], npoints=4)
    bands.write(tmp_path / "band.yaml")
    found = script(tmp_path, READ_MODES)
    vectors = np.array(found[2]) + 1j * np.array(found[3])  # (q, branch, atom, 3)
    hertz = (
        head(tmp_path / "band.yaml")["hertz"]
        if "\nphonopy:" in (tmp_path / "band.yaml").read_text()
        else 1e3
    )
    np.testing.assert_allclose(found[0], bands.frequencies[0] / hertz, rtol=1e-13, atol=1e-13)
    spins = np.sum(np.abs(vectors[:, :, 1]) ** 2, axis=2)
    np.testing.assert_allclose(spins, bands.rotational_fraction[0], atol=1e-12)
    # Euphonic's phases are those of the cell: the displacement and the spin of a ball then have the
    # phase of the ball
    ours = bands.eigenvectors[0].reshape(4, 2, 3, 6).transpose(0, 3, 1, 2)
    apart = np.einsum("qmai,qmai->qm", vectors.conj(), ours)
    np.testing.assert_allclose(np.abs(apart), 1.0, rtol=1e-2)


def test_euphonic_reads_frictionless_bands(tmp_path):
    # two branches a ball: there is no third for Euphonic's modes, its frequencies are right
    bands = CASES["smooth"]().bands("GKMG", npoints=5)
    bands.write(tmp_path / "band.yaml")
    found = script(
        tmp_path,
        EUPHONIC.format(names="QpointFrequencies, QpointPhononModes")
        + """
frequencies = QpointFrequencies.from_phonopy(path=".", phonon_name="band.yaml")
try:
    QpointPhononModes.from_phonopy(path=".", phonon_name="band.yaml")
    refused = False
except ValueError:
    refused = True
print(json.dumps([terahertz(frequencies), refused]))
""",
    )
    np.testing.assert_allclose(
        found[0], bands.frequencies.reshape(-1, 2) / 1e3, rtol=1e-13, atol=1e-13
    )
    assert found[1] is True


# -- the file --------------------------------------------------------------------------------------


def test_the_file_says_what_it_is(tmp_path):
    ph = CASES["vacancy"]()
    path = tmp_path / "phonopy_params.yaml"
    ph.save(path)
    own = head(path)
    assert (own["schema"], own["version"]) == (1, gp.__version__)
    assert own["masses"] == ph.atoms.get_masses().tolist()
    # besides the auxiliary atom's three bands at zero, one for each coordinate of a ball without a
    # motion
    spins = [f"w_{x} = R_g phi_{x}" for x in "xyz"]
    for case, bands, coordinates, motions, rotations, periods in (
        ("vacancy", 3, ["x", "y", "w = R_g phi"], "in_plane", True, 2),
        ("smooth", 4, ["x", "y", 0], "in_plane", False, 2),
        ("fcc", 3, ["x", "y", "z", *spins], "all", True, 3),
        ("row", 5, ["x", 0, 0], "longitudinal", False, 1),
        ("out of plane", 3, [*spins[:2], "z"], "out_of_plane", True, 2),
    ):
        CASES[case]().save(path)
        own = head(path)
        assert (own["zero_bands"], own["coordinates"]) == (bands, coordinates)
        assert (own["motions"], own["rotations"], own["periods"]) == (motions, rotations, periods)


@pytest.mark.claim("phonopy-thresholds")
@pytest.mark.parametrize("diameter", [1e-8, 1e-6, 1e-3, 100.0])
def test_the_unit_is_chosen_for_the_top(diameter, tmp_path):
    ph = gp.Phonons(at_overlap(1e-6, diameter=diameter))
    ph.save(tmp_path / "phonopy_params.yaml")
    ph.bands("GK", npoints=3).write(tmp_path / "band.yaml")
    one, other = (
        yaml.safe_load((tmp_path / n).read_text())["granphon"]
        for n in ("phonopy_params.yaml", "band.yaml")
    )
    assert one["frequency_unit"] == other["frequency_unit"]
    assert 1.0 <= ph.frequencies([[0, 0]]).max() / one["hertz"] < 1000.0


@pytest.mark.parametrize("balls", [1, 2])
def test_euphonic_reads_padded_bands_with_eigenvectors(balls, tmp_path):
    """Three branches a ball: below the two of a frictionless one its rotation, which nothing
    resists.
    """
    smooth = CASES["smooth"]()
    if balls > 1:
        smooth = gp.Phonons(smooth.state, gp.atoms(smooth.state).repeat((balls, 1, 1)))
    bands = smooth.bands([[0, 0], [1 / 3, 1 / 3], [0.5, 0]], npoints=3)
    bands.write(tmp_path / "band.yaml", pad=True)
    found = script(
        tmp_path,
        EUPHONIC.format(names="QpointPhononModes")
        + """
modes = QpointPhononModes.from_phonopy(path=".", phonon_name="band.yaml")
print(json.dumps([terahertz(modes), modes.eigenvectors.real.tolist(), modes.eigenvectors.imag.tolist()]))
""",
    )
    frequencies = np.array(found[0])
    vectors = np.array(found[1]) + 1j * np.array(found[2])
    assert frequencies.shape == (6, 3 * balls)
    np.testing.assert_allclose(
        frequencies[:, balls:], bands.frequencies.reshape(6, -1) / 1e3, rtol=1e-13, atol=1e-13
    )
    assert not frequencies[:, :balls].any()
    # orthonormal, and the first ones pure rotations
    flat = vectors.reshape(6, 3 * balls, 3 * balls)
    np.testing.assert_allclose(
        flat @ flat.conj().swapaxes(1, 2), np.tile(np.eye(3 * balls), (6, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(
        np.sum(np.abs(vectors[:, :balls, :, 2]) ** 2, axis=2), 1.0, rtol=1e-12
    )
    # what is read again is what there was
    again = gp.Bands.read(tmp_path / "band.yaml")
    bands.write(tmp_path / "plain.yaml")
    plain = gp.Bands.read(tmp_path / "plain.yaml")
    assert again.n_branches == 2 * balls
    for name in ("frequencies", "group_velocities", "eigenvectors", "qpoints", "distances"):
        np.testing.assert_array_equal(getattr(again, name), getattr(plain, name))
    np.testing.assert_allclose(again.frequencies, bands.frequencies, rtol=1e-15)


def test_nothing_pads_bands_that_are_whole(tmp_path):
    bands = CASES["rough"]().bands("GK", npoints=3)
    for name, pad in (("plain", False), ("padded", True)):
        bands.write(tmp_path / name, pad=pad)
    assert (tmp_path / "plain").read_bytes() == (tmp_path / "padded").read_bytes()


# -- what phonopy makes of the export without complaint, and what a reader is told of it -----------


def test_what_phonopys_moments_and_own_path_are_worth(tmp_path):
    """As docs/how-to/phonopy.md says: the first moment depends on the mesh, a path of its own has
    neither K nor M.
    """
    ph = CASES["rough"]()
    ph.save(tmp_path / "phonopy_params.yaml")
    found = script(
        tmp_path,
        """
import json, warnings
warnings.simplefilter("ignore")
import numpy as np
import phonopy
loaded = phonopy.load("phonopy_params.yaml", is_nac=False, log_level=0)
moments = []
for n in (8, 9):
    loaded.run_mesh([n, n, 1], with_eigenvectors=True, is_mesh_symmetry=False)
    moments.append(float(loaded.run_moment(order=1).moment))
from phonopy.phonon.band_structure import get_band_qpoints_by_seekpath
bands, labels, _ = get_band_qpoints_by_seekpath(loaded.primitive, 3)
print(json.dumps([moments, [np.asarray(band).tolist() for band in bands], labels]))
""",
    )
    moments, path, labels = found
    mesh = (np.arange(64) + 0.5) / 64
    mean = ph.frequencies([(a, b, 0.0) for a in mesh for b in mesh]).mean() / 1e3
    assert abs(moments[1] / mean - 1.0) > 0.02
    assert not {"K", "M"} & {label.strip("$") for label in labels}
    corners = np.array([point for band in path for point in (band[0], band[-1])])
    assert not np.any(np.all(np.isclose(np.abs(corners % 1.0 - 0.5), 1 / 6), axis=1))
    assert np.any(corners[:, 2])  # and it leaves the plane


def test_a_file_of_phonopy_is_not_replaced(tmp_path):
    phonons = gp.Phonons(
        gp.AveragedLattice(gp.Packing(gp.Material(211.65e9, 0.276, 7840.0), 8e-3)).at_force(18.446)
    )
    for write, name in (
        (phonons.save, "phonopy_params.yaml"),
        (phonons.bands(npoints=3).write, "band.yaml"),
    ):
        write(tmp_path / name)
        write(tmp_path / name)  # its own
        (tmp_path / name).write_text("phonopy:\n  version: 4.8.2\n")
        with pytest.raises(OSError, match="another kind of file"):
            write(tmp_path / name)
        assert (tmp_path / name).read_text() == "phonopy:\n  version: 4.8.2\n"


@pytest.mark.parametrize("number", [2**63, 10**30])
def test_whole_numbers_of_files_may_have_more_than_64_bits(number):
    assert read_numbers("mass", [number]).tolist() == [float(number)]


@pytest.mark.parametrize("value", [10**400, True, "a"])
def test_values_of_files_that_are_no_numbers_are_named(value):
    with pytest.raises(InputError, match="mass"):
        read_numbers("mass", [value])
