"""The core runs on numpy and scipy; what needs another package says which, and how to install it."""

from __future__ import annotations

import subprocess
import sys

#: what hides packages in a process of its own, as if they were not installed
HIDE = """
import sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hidden())
import tempfile
import numpy as np
import granphon as gp
steel = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
packing = gp.Packing(steel, 8e-3, spread=gp.Uniform(2e-6))

def told(call):
    try:
        call()
    except gp.GranphonError as error:
        assert isinstance(error, ImportError) or type(error).__name__ == "FigureError", type(error)
        print(error)
    else:
        print("no error")
"""
#: what the core is, each line with numbers to compare
CORE = """
lattice = gp.ContactLattice.of(packing.structure, packing.mindlin_ratio)
print(lattice.frequencies([[0.1, 0.2]]).tolist(), lattice.elastic_tensor().tolist())
for medium in (gp.AveragedLattice, gp.AveragedForce, gp.EffectiveMedium):
    state = medium(packing).at_force([2.0, 20.0])
    v, w = gp.sound_velocities(state), gp.pulse_velocities(state, frequency=6500.0)
    print(v.longitudinal, gp.moduli(state).bulk, gp.local_exponent(state), w.group, gp.validity(state).ok)
simulated = gp.DirectSimulation(packing, (8, 8), seed=0).at_force(20.0)
print(gp.sound_velocities(simulated).longitudinal, simulated.sample.network.n_contacts)
crystal = gp.Crystal.on("fcc", [gp.Ball(steel, 8e-3)], law=gp.JKR(0.1)).at_pressure(1e4)
print(gp.sound_velocities(crystal, (1, 1, 0)).velocities, crystal.network.n_contacts)
chain = gp.Crystal.on("chain", [gp.Ball(steel, 8e-3)]).repeat((30,)).at_force(5.0).network
waves = gp.Waves(chain)
disordered = gp.Waves(simulated.sample)
q = disordered.nearest_wavevectors([[100.0, 0.0]])
print(disordered.spectral_function(q, resolution=2000.0).values.tolist())
print(waves.modes(4).frequencies, waves.response([900.0], (0, "x"), (9, "x"), loss_factor=0.1).values)
motion = gp.NonlinearWaves(chain).run(1e-4, velocities=1e-3 * np.eye(30)[3][:, None], frames=3)
print(motion.displacements[-1, :, 0].tolist())
"""
#: what needs other packages
REST = """
told(lambda: gp.sweep(packing, force=[1.0, 2.0], media=("ala",)))
told(lambda: gp.plot(crystal))
told(lambda: simulated.sample.atoms())
told(lambda: gp.Phonons(simulated))
folder = tempfile.mkdtemp()
open(folder + "/scene.yaml", "w").write("schema: 1\\n")
told(lambda: gp.Scene.from_yaml(folder + "/scene.yaml"))
chain.write_tables(folder + "/balls.csv", folder + "/contacts.csv")
print(gp.ContactNetwork.from_table(folder + "/balls.csv", folder + "/contacts.csv").n_balls)
from granphon.__main__ import main
print(main())
"""


def run(hidden, *parts):
    code = f"HIDDEN = {hidden!r}" + "".join((HIDE, *parts))
    found = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, check=False)
    assert found.returncode == 0, found.stderr
    return found.stdout, found.stderr


def test_the_core_needs_numpy_and_scipy_alone_and_the_rest_says_what_it_needs():
    optional = {"ase", "phonopy", "matplotlib", "typer", "rich", "yaml", "xarray", "pandas", "h5netcdf",
                "h5py", "threadpoolctl", "dask", "distributed"}  # fmt: skip
    whole, _ = run(set(), CORE)
    found, err = run(optional, CORE, REST)
    lines = found.splitlines()
    assert lines[: len(whole.splitlines())] == whole.splitlines()
    sweep, figure, atoms, phonons, scene, table, code = lines[len(whole.splitlines()) :]
    assert sweep == "xarray is not installed. A data set needs it. Install it: pip install xarray."
    assert figure.startswith("matplotlib cannot be imported")
    assert figure.endswith("Install it: pip install matplotlib.")
    assert atoms == "ase is not installed. A sample of Atoms needs it. Install it: pip install ase."
    assert phonons == "ase is not installed. granphon.Phonons needs it. Install it: pip install ase."
    assert scene == "yaml is not installed. A YAML file needs it. Install it: pip install PyYAML."
    assert table == "30"
    assert code == "2"
    assert err.strip() == (
        "granphon: error: typer is not installed. The command granphon needs it. Install it: pip install typer."
    )


def test_sweeps_and_tables_need_neither_ase_nor_phonopy():
    code = """
print(gp.sweep(packing, force=[1.0, 2.0], media=("ala", "ema"), direction=(1, 0))["longitudinal"].values.shape)
told(lambda: gp.atoms(gp.AveragedLattice(packing).at_force(1.0)))
told(lambda: gp.Phonons)
"""
    shape, atoms, phonons = run({"ase", "phonopy", "matplotlib", "typer", "rich"}, code)[0].splitlines()
    assert shape == "(2, 2)"
    assert atoms == "ase is not installed. granphon.atoms needs it. Install it: pip install ase."
    assert "ase is not installed. granphon.Phonons needs it." in phonons
