"""Scenes of packings that another program has left: the block ``network``."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

import granphon as gp
from granphon.base.errors import InputError, SceneError
from granphon.cli.main import main
from granphon.figures.waves import plot_spectrum
from granphon.media.cells import QUICK_BALLS
from granphon.media.cost import Cost
from granphon.scene.scene import is_complete
from granphon.waves.settings import RESPONSES
from tests import packings
from tests.networks.test_readers import DAMAGES
from tests.scene.mistakes import NETWORK


def read_disks():
    files = (packings.FOLDER / f"disks_{part}.dump" for part in ("atoms", "pairs"))
    return gp.ContactNetwork.from_lammps(*files, packings.MATERIAL)


def make(text=NETWORK):
    return gp.Scene.from_text(text)


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("network")
    return make().run(folder, figures=False)


def test_numbers_of_a_run_are_those_of_the_network(result):
    network = read_disks()
    assert result.state.network == network
    velocities = gp.sound_velocities(network, (1, 0))
    assert result.velocities.longitudinal == velocities.longitudinal
    assert result.summary()["force"] == pytest.approx(np.mean(network.normal_force))
    waves = gp.Waves(network)
    np.testing.assert_array_equal(result["sample_dos"].total, waves.dos().total)
    modes = result.dataset["mode_frequency"].values.ravel()
    np.testing.assert_allclose(modes, waves.modes(3).frequencies, rtol=1e-12)
    response = waves.response([1e5, 1.5e5], (3, "x"), [(7, "x")], loss_factor=0.1)
    np.testing.assert_allclose(
        result.dataset[RESPONSES["displacement"]].values.ravel(), response.magnitude.ravel()
    )
    pulse = waves.transmit(9e4, (1, 0), 4e-3, 2.0)
    np.testing.assert_array_equal(result["pulse"].signals, pulse.signals)
    assert result.dos is None


def test_the_command_tells_what_contradicts_once(capsys, tmp_path):
    """Without rolling, disks that leave the plane have modes without energy; a check says so too."""
    scene = tmp_path / "scene.yaml"
    network = NETWORK.partition("observe")[0] + "  motions: out_of_plane\n"
    scene.write_text(network + "observe: [modes]\n")
    assert main(["check", str(scene)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert all(line.startswith("granphon: warning: ") for line in lines)
    assert len([line for line in lines if "isostatic" in line]) == 1
    scene.write_text(network + "observe: [spectrum]\n")
    assert main(["check", str(scene)]) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert f"{scene.name}:" in error
    assert "transverse" in error


def test_pressure_is_that_of_the_forces_on_the_cell(result):
    """Of an ideal lattice it is sqrt(3) f / d."""
    network = gp.AveragedLattice(gp.Packing(packings.MATERIAL, 2e-3)).at_force(5.0).network
    files = [result.folder / name for name in ("lattice_balls.csv", "lattice_contacts.csv")]
    network.write_tables(*files)
    packing = gp.NetworkFiles(format="tables", files=files)
    scene = gp.Scene(packing, packing.load, observe=("modes",))
    assert scene.state().pressure == pytest.approx(np.sqrt(3.0) * 5.0 / 2e-3)
    assert scene.load.values == pytest.approx((5.0,))
    with pytest.raises(InputError, match="the forces that the files hold"):
        replace(scene, load=gp.Load("force", 6.0))


@pytest.mark.parametrize("axis", [1, 2])
def test_a_packing_that_repeats_along_another_axis_than_x(tmp_path, axis):
    """A chain along y or z has the velocity d (k/M)^1/2 of the one along x."""
    steel = gp.Ball(packings.MATERIAL, 2e-3)
    network = gp.Crystal.on("chain", [steel, steel]).at_force(5.0).network
    turned = replace(
        network,
        cell=np.roll(network.cell, (axis, axis), (0, 1)),
        pbc=tuple(index == axis for index in range(3)),
        positions=np.roll(network.positions, axis, 1),
        normal=np.roll(network.normal, axis, 1),
        shift=np.roll(network.shift, axis, 1),
        dimension=axis + 1,
        motions="all" if axis == 2 else "in_plane",
    )
    files = [tmp_path / name for name in ("balls.csv", "contacts.csv")]
    turned.write_tables(*files)
    packing = gp.NetworkFiles(format="tables", files=files)
    np.testing.assert_allclose(packing.structure.vectors[0], np.eye(axis + 1)[0] * 2.0)
    scene = gp.Scene(packing, packing.load, observe=("velocities",))
    velocity = np.sqrt(network.normal_stiffness[0] / steel.mass) * 2e-3
    assert np.max(scene.state().long_waves([1.0])) == pytest.approx(velocity)


def test_a_run_keeps_its_packing_and_is_found_again(result):
    names = {path.name for path in result.files}
    assert {"balls.csv", "contacts.csv", "scene.yaml", "sample_dos.csv"} <= names
    again = gp.Scene.from_yaml(result.folder / "scene.yaml")
    assert again == make()
    assert again.packing.format == "tables"
    assert again.packing.network.left_out == 1
    assert is_complete(make(), result.folder)
    resumed = make().run(result.folder, resume=True)
    np.testing.assert_array_equal(resumed["sample_dos"].total, result["sample_dos"].total)
    other = make(NETWORK.replace("70 GPa", "71 GPa"))
    assert other != make()
    assert not is_complete(other, result.folder)


def test_a_run_without_a_pulse_that_it_observes_is_complete(tmp_path):
    """Planes of balls do not close across this cell, so that no pulse is sent."""
    packing = gp.Packing(packings.MATERIAL, 8e-3, spread=gp.Uniform(4e-6))
    sample = gp.DirectSimulation(packing, shape=(4, 6)).at_force(5.0).samples[0]
    files = [tmp_path / name for name in ("balls.csv", "contacts.csv")]
    sample.network.write_tables(*files)
    given = gp.NetworkFiles(format="tables", files=files)
    pulse = {"frequency": 2e4, "cycles": 1.5, "distance": 14e-3}
    scene = gp.Scene(given, given.load, observe=["pulse"], pulse=pulse)
    result = scene.run(tmp_path / "out", figures=False)
    assert result["pulse"] is None
    assert is_complete(scene, result.folder)
    assert scene.run(result.folder, resume=True)["pulse"] is None
    (result.folder / "sweep.csv").unlink()
    assert not is_complete(scene, result.folder)


def test_vectors_of_a_cell_may_point_backwards(tmp_path):
    """The second vector of a hexagonal cell has a component below zero."""
    ball = gp.Ball(packings.MATERIAL, 8e-3)
    network = gp.Crystal.on("triangular", [ball]).repeat((3, 3)).at_force(10.0).network
    network.write_tables(tmp_path / "balls.csv", tmp_path / "contacts.csv")
    height = 12.0 * 3.0**0.5
    text = f"""
network:
  format: tables
  files: [{tmp_path}/balls.csv, {tmp_path}/contacts.csv]
  cell: [[24 mm, 0], [-12 mm, {height!r} mm]]
observe: [modes]
"""
    scene = make(text)
    np.testing.assert_allclose(scene.state().network.cell, network.cell, atol=1e-15)
    assert gp.Scene.from_text(scene.to_yaml()) == scene


def test_a_scene_of_a_packing_is_written_as_it_was_read():
    scene = make()
    assert gp.Scene.from_text(scene.to_yaml()) == scene
    assert "of ball" in str(scene)
    rows = {name: value for name, value, _ in scene.describe()}
    assert (rows["balls"], rows["contacts"], rows["medium"]) == (29, 62, ["packing"])


def test_tables_of_yade_have_their_cell(capsys, tmp_path):
    text = """
network:
  format: tables
  files: [{folder}/yade_balls.csv, {folder}/yade_contacts.csv]
  cell: [5.5 mm, 5.5 mm, 5.5 mm]
observe: [modes]
"""
    path = tmp_path / "yade.yaml"
    path.write_text(text.format(folder=packings.FOLDER))
    assert main(["check", str(path)]) == 0
    assert "24" in capsys.readouterr().out
    network = gp.Scene.from_yaml(path).state().network
    assert network == gp.ContactNetwork.from_table(
        packings.FOLDER / "yade_balls.csv",
        packings.FOLDER / "yade_contacts.csv",
        cell=[5.5e-3] * 3,
    )


def test_dumps_of_liggghts_have_their_law_of_rolling():
    text = """
network:
  format: liggghts
  files: [{floor}_atoms.dump, {floor}_pairs.dump, {floor}_walls.dump]
  keywords: [pos, id, force, delta]
  material: {{young_modulus: 70 GPa, poisson_ratio: 0.2, density: 2500 kg/m^3}}
  rolling_stiffness: {rolling}
observe: [modes]
"""
    floor = packings.FOLDER / "liggghts_floor"
    scene = gp.Scene.from_text(text.format(floor=floor, rolling="epsd2"))
    assert gp.Scene.from_text(scene.to_yaml()) == scene
    files = [f"{floor}_{part}.dump" for part in ("atoms", "pairs", "walls")]
    read = gp.ContactNetwork.from_liggghts(
        *files[:2], packings.MATERIAL, walls=files[2], keywords="pos id force delta",
        rolling_stiffness="epsd2",
    )  # fmt: skip
    assert scene.state().network == read
    named = text.replace(", {floor}_walls.dump]", "]\n  walls: {floor}_walls.dump")
    with pytest.raises(SceneError, match=r"third.*files: \[.*_walls\.dump\]"):
        gp.Scene.from_text(named.format(floor=floor, rolling="epsd2"))
    with pytest.raises(gp.GranphonError, match=r"network\.rolling_stiffness"):
        gp.Scene.from_text(text.format(floor=floor, rolling="epsd"))


def test_names_in_one_text_are_read_as_those_in_a_list():
    for names in ("floor lid\0", ["floor", "lid\0"]):
        with pytest.raises(gp.GranphonError, match=r"walls\.1: found 'lid.+x00'; allowed: a name"):
            gp.NetworkFiles(format="lammps", files="atoms.dump", walls=names)


def cut(folder):
    raw = (packings.FOLDER / "disks_pairs.dump").read_bytes()
    (folder / "cut.dump").write_bytes(raw[:3000])


def test_a_file_that_is_cut_is_told_at_the_block(tmp_path):
    raw = (packings.FOLDER / "disks_pairs.dump").read_bytes()
    (tmp_path / "cut.dump").write_bytes(raw[:3000])
    text = NETWORK.replace(f"{packings.FOLDER}/disks_pairs.dump", f"{tmp_path}/cut.dump")
    with pytest.raises(SceneError, match=r":2: network: .*cut\.dump .*64 .*56 ") as error:
        gp.Scene.from_text(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("damage", DAMAGES)
def test_the_command_tells_a_damaged_file_in_one_line(damage, tmp_path, capsys):
    pairs = tmp_path / "pairs.dump"
    pairs.write_bytes(DAMAGES[damage]((packings.FOLDER / "disks_pairs.dump").read_bytes()))
    scene = tmp_path / "scene.yaml"
    text = NETWORK.replace(f"{packings.FOLDER}/disks_pairs.dump", str(pairs))
    scene.write_text(text)
    code = main(["check", str(scene)])
    told = capsys.readouterr()
    assert code in (0, 2)
    if code:
        assert not told.out
        assert re.fullmatch(
            r"granphon: error: .*scene\.yaml:\d+: network: .*pairs\.dump.*\n", told.err
        )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["pairs.dump", "scene.yaml"]


def test_check_counts_the_waves_of_a_packing():
    """Density of states, spectral functions and a pulse cost what the estimates of the network
    say, and nothing that is not observed costs anything.
    """
    network = read_disks()
    periods = network.cell[:2, :2]
    q = 2.0 * np.pi * np.linalg.inv(periods).T[0] * np.arange(1, 9)[:, None]
    polarisations = ("longitudinal", "transverse")
    waves = gp.Waves(network)
    works = {
        "dos": [waves.estimate("dos")],
        "spectrum": [waves.estimate("spectral_function", q, name, 3e3) for name in polarisations],
        "pulse": [waves.estimate("transmit", 9e4, (1, 0), 4e-3, 2.0)],
    }
    head = NETWORK.split("observe:")[0]
    blocks = {
        "dos": "",
        "spectrum": "spectrum: {polarisation: [longitudinal, transverse], resolution: 3 kHz}\n"
        "phonopy: {band: 0 0 0 8 0 0}\n",
        "pulse": "pulse: {frequency: 90 kHz, distance: 4 mm, cycles: 2}\ndirection: [1, 0]\n",
        "modes": "",
    }
    for names in (["dos"], ["spectrum"], ["pulse"], ["dos", "spectrum", "pulse"], ["modes"]):
        text = f"{head}observe: [{', '.join(names)}]\n" + "".join(blocks[name] for name in names)
        parts = make(text).plan.parts
        told = sum((cost for place, _, cost in parts if place == ("observe",)), Cost())
        expected = sum((work for name in names for work in works.get(name, [])), Cost())
        numbers = [[unit.number for unit in cost.units] for cost in (told, expected)]
        assert numbers[0] == pytest.approx(numbers[1])
        assert told.memory == pytest.approx(expected.memory)
        assert len(numbers[0]) == len(names) + ("spectrum" in names) - ("modes" in names)


def test_check_counts_the_sound_of_a_packing(tmp_path):
    """Its velocities and moduli are found once; no packing in files is too large to be looked at."""
    network = read_disks().repeat((5, 4))
    assert network.n_balls > QUICK_BALLS
    tables = tmp_path / "balls.csv", tmp_path / "contacts.csv"
    network.write_tables(*tables)
    head = f"network:\n  format: tables\n  files: [{tables[0]}, {tables[1]}]\n"
    material = "  material: {young_modulus: 70 GPa, poisson_ratio: 0.2, density: 2500 kg/m^3}\n"
    for observed, results in (("velocities", ["moduli"]), ("velocities, dos", ["moduli", "dos"])):
        parts = make(f"{head}{material}observe: [{observed}]\n").plan.parts
        told = sum((cost for place, _, cost in parts if place == ("observe",)), Cost())
        expected = sum((gp.Waves(network).estimate(name) for name in results), Cost())
        numbers = [[unit.number for unit in cost.units] for cost in (told, expected)]
        assert numbers[0] == pytest.approx(numbers[1])
        assert told.memory == pytest.approx(expected.memory)


def observe_spectrum(more=""):
    before, _, _ = NETWORK.partition("observe:")
    text = before + "observe: [spectrum]\nspectrum: {polarisation: [longitudinal, transverse]}\n"
    return gp.Scene.from_text(text + more)


def test_spectra_of_a_packing_are_those_of_its_waves(tmp_path):
    """Along its first period up to half a wave for each mean diameter, or along a path."""
    network = read_disks()
    result = observe_spectrum().run(tmp_path, figures=False)
    spectra = result["spectrum"]
    period = network.cell[0, 0]
    numbers = np.arange(1, round(period / (4.0 * np.mean(network.radii))) + 1)
    q = np.column_stack([2.0 * np.pi * numbers / period, 0.0 * numbers])
    waves = gp.Waves(network)
    for found, polarisation in zip(spectra.spectra, ("longitudinal", "transverse"), strict=True):
        np.testing.assert_allclose(found.q, q, rtol=1e-12)
        wanted = waves.spectral_function(q, polarisation)
        np.testing.assert_allclose(found.values, wanted.values, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(spectra.distances, q[:, 0], rtol=1e-12)
    assert spectra.bands.size == 0
    names = {path.name for path in result.files}
    assert {"spectrum.json", "spectrum.csv"} <= names
    ax = plot_spectrum(spectra, Figure().subplots())  # up to the highest frequency, without bands
    assert ax.get_ylim()[1] * 1e3 == pytest.approx(spectra.spectra[0].frequencies[-1], rel=1e-6)
    assert not ax.get_legend_handles_labels()[1][1:]
    again = gp.Scene.from_yaml(tmp_path / "scene.yaml")
    assert again == observe_spectrum()
    assert gp.PathSpectra.from_dict(spectra.to_dict()) == spectra


def test_a_path_of_spectra_may_turn_and_must_have_a_wave():
    turned = observe_spectrum("phonopy: {band: 0 0 0 2 0 0 2 2 0, band_labels: G A B}")
    assert turned.path.labels == ("G", "A", "B")
    with pytest.raises(InputError, match=r"no wave vector of the packing but zero.*longer"):
        observe_spectrum("phonopy: {band: 0 0 0 1/3 0 0}")


def test_files_have_no_parameters():
    packing = make().packing
    assert packing.change({}) is packing
    with pytest.raises(InputError, match=r"ball\.diameter"):
        packing.change({"ball.diameter": 1e-3})
    with pytest.raises(InputError, match="network"):
        gp.Scene(packing, packing.load, media=("ala",))
    for given, word in ((packing, r"disks_pairs\.dump.*one load"), (packing.network, "Packing")):
        with pytest.raises(InputError, match=word) as error:
            gp.sweep(given, force=2.0)
        assert len(str(error.value)) < 300


def test_a_scene_of_files_with_static_forces_is_that_of_its_own_text():
    # from Python the scene takes from the files whether static forces act, as from a text
    text = """
network:
  format: lammps
  files: [{folder}/disks_atoms.dump, {folder}/disks_pairs.dump]
  material: {{young_modulus: 70 GPa, poisson_ratio: 0.2, density: 2500 kg/m^3}}
  friction: false
  prestress: {prestress}
observe: [modes]
"""
    for prestress in (True, False):
        written = str(prestress).lower()
        scene = gp.Scene.from_text(text.format(folder=packings.FOLDER, prestress=written))
        made = gp.Scene(scene.packing, scene.load, observe=["modes"])
        assert made.finite_overlap is prestress
        assert made == scene == gp.Scene.from_text(made.to_yaml())
