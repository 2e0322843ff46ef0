"""What others add: by a call, or by the entry points of a package that is installed; and what is
said when it fails.
"""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.balls.loads import Load
from granphon.base import registry
from granphon.base.errors import InputError
from granphon.base.registry import Registry
from granphon.cli.main import main
from granphon.observables.catalogue import CATALOGUE
from granphon.scene.outputs import Export
from granphon.scene.scene import Scene, is_complete

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3, spread=gp.Uniform(2e-6))


class Soft:
    """Hertz's law with another modulus."""

    def __init__(self, part, push=0.0):
        self.part = part
        self.push = push

    def between(self, ball, other):
        return gp.HertzLaw(self.part * gp.Hertz().between(ball, other).coefficient)


def test_an_observable_that_fails_is_named_and_breaks_nothing_else(tmp_path):
    def fails(of):
        raise ZeroDivisionError("no such thing")

    gp.register_observable("broken", "1", "what fails", fails)
    gp.register_observable("crooked", "1", "what has another shape", lambda of: np.zeros(7))
    gp.register_observable("absent", "1", "what no state has", lambda of: None)
    gp.register_observable("unknown", "1", "what is nan", lambda of: np.nan * of.state.force)
    gp.register_observable("twice", "N", "twice the force", lambda of: 2.0 * of.state.force)
    data = gp.sweep(PACKING, force=[2.0, 9.0], media=("ala", "afa"))
    assert not {"broken", "crooked", "absent"} & set(data)
    np.testing.assert_array_equal(
        data["twice"], 2.0 * np.tile(data["force"].values[:, None], (1, 2))
    )
    told = data.attrs["warnings"]
    assert "'broken' fails: ZeroDivisionError" in told
    assert "'unknown' is not known (nan)" in told
    assert "'crooked' fails: ValueError" in told
    bands = Scene(PACKING, Load("force", (9.0,)), media=("ala",), observe=("twice",))
    assert bands.run(tmp_path / "one", figures=False).summary()["twice"] == 18.0
    with pytest.raises(InputError, match="'broken' fails: ZeroDivisionError"):
        Scene(PACKING, Load("force", (9.0,)), media=("ala",), observe=("broken",)).run(
            tmp_path / "two"
        )
    blocks = (
        "material: {young_modulus: 200 GPa, poisson_ratio: 0.3, density: 7.8 g/cm^3}\npacking:"
        " {diameter: 8 mm}\n"
    )
    scene = Scene.from_text(f"{blocks}load: {{force: [1 N, 2 N]}}\nobserve: [velocities, broken]\n")
    with pytest.raises(InputError, match=r": observe: [^;]*'broken' fails"):
        scene.run(tmp_path / "three")


def test_a_scene_that_observes_one_pays_for_the_velocities_that_it_is_found_from(tmp_path):
    gp.register_observable(
        "ratio",
        "1",
        "of velocities",
        lambda of: of.velocities.transverse / of.velocities.longitudinal,
        cost="velocities",
    )
    scene = Scene(PACKING, Load("force", (9.0,)), media=("ala",), observe=("bands", "ratio"))
    assert scene.observe == ("velocities", "bands", "ratio")
    v = gp.sound_velocities(gp.AveragedLattice(PACKING).at_force(9.0))
    alone = Scene(PACKING, Load("force", (9.0,)), media=("ala",), observe=("ratio",))
    assert (
        alone.run(tmp_path / "out", figures=False).summary()["ratio"]
        == v.transverse / v.longitudinal
    )


def test_a_law_has_a_name_and_numbers_in_scenes(tmp_path):
    gp.register_law("soft", Soft, part="", push="N/m")
    gp.register_law("half", Soft(0.5))
    ball = gp.Ball(STEEL, 8e-3, name="A")
    text = """
balls: {A: {material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}, diameter: 8 mm}}
crystal: {lattice: chain, kinds: [A], law: LAW}
load: {force: 10 N}
"""
    for law in ("half", "{soft: {part: 0.5, push: 1 kN/m}}"):
        (tmp_path / "scene.yaml").write_text(text.replace("LAW", law), encoding="utf-8")
        scene = Scene.from_yaml(tmp_path / "scene.yaml")
        found = scene.run(tmp_path / law[:4].strip("{"), figures=False)
        wanted = gp.Crystal.on("chain", [ball], law="half").at_force(10.0).overlap[0]
        assert found.summary()["overlap"] == pytest.approx(wanted, rel=1e-14)
        again = Scene.from_yaml(found.files[0].parent / "scene.yaml")
        assert (
            again.run(tmp_path / "again", True, figures=False).summary()["overlap"]
            == found.summary()["overlap"]
        )
    (tmp_path / "scene.yaml").write_text(
        text.replace("LAW", "{soft: {part: 0.5, push: 2 s}}"), encoding="utf-8"
    )
    with pytest.raises(InputError, match="push: found '2 s'"):
        Scene.from_yaml(tmp_path / "scene.yaml")
    (tmp_path / "scene.yaml").write_text(
        text.replace("LAW", "{soft: {part: 0.5 N, push: 2 N/m}}"), encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"part: found '0\.5 N'"):
        Scene.from_yaml(tmp_path / "scene.yaml")
    with pytest.raises(InputError, match=r"'jkr' .*adhesion"):
        gp.Crystal.on("chain", [ball], law="jkr")


def test_a_lattice_and_a_medium_are_known_to_sweeps():
    triangular = LATTICES["triangular"]
    gp.register_lattice(gp.Lattice("two rows", ((1, 0), (0, 3**0.5)), ((0, 0), (0.5, 0.5))))

    @gp.register_medium
    class Equal(gp.AveragedLattice):
        name = "equal"
        words = "equal balls"

    data = gp.sweep(
        PACKING, force=[3.0], media=("ala", "equal"), lattice=["triangular", "two rows"]
    )
    np.testing.assert_allclose(
        data["longitudinal"].values, data["longitudinal"].values.flat[0], rtol=1e-13
    )
    assert triangular is LATTICES["triangular"]
    with pytest.raises(InputError, match=r"'ema' exists .*granphon"):
        gp.register_medium(type("Other", (gp.AveragedLattice,), {"name": "ema"}))
    with pytest.raises(InputError, match=r"'equal' exists .*program"):
        gp.register_medium(type("Again", (Equal,), {"name": "equal"}))


class Scale:
    def find(self, of):
        return 1.0


def test_only_the_same_is_registered_twice():
    def reader(path):
        return path

    def second(path):
        return path

    reader.__qualname__ = second.__qualname__ = (
        "reader"  # as of a cell of a notebook that runs twice
    )
    gp.register_reader("mine", reader)
    gp.register_reader("mine", reader)
    gp.register_reader("mine", second)
    for lattice in (gp.Lattice("mine", ((1, 0), (0, 1)), ((0, 0),)) for _ in range(2)):
        gp.register_lattice(lattice)
    table = gp.TabulatedLaw([0.0, 1e-6, 2e-6, 3e-6], [0.0, 1.0, 3.0, 7.0])
    gp.register_law("mine", table)
    gp.register_law("mine", table)
    gp.register_observable("mine", "1", "one", first := lambda of: 1.0)
    gp.register_observable("mine", "1", "one", first)
    for _ in range(2):
        gp.register_observable("again", "1", "one", lambda of: np.ones_like(of.state.force))
    gp.register_observable("scaled", "1", "one", lambda of, scale=1.0: scale)
    scales = [Scale(), Scale()]
    gp.register_observable("bound", "1", "one", scales[0].find)
    gp.register_observable("bound", "1", "one", scales[0].find)
    for register in (
        lambda: gp.register_reader("mine", lambda path: path),
        lambda: gp.register_observable("scaled", "1", "one", lambda of, scale=2.0: scale),
        lambda: gp.register_observable("bound", "1", "one", scales[1].find),
        lambda: gp.register_law(
            "mine", gp.TabulatedLaw([0.0, 1e-6, 2e-6, 3e-6], [0.0, 1.0, 3.0, 8.0])
        ),
        lambda: gp.register_observable("mine", "1", "one", lambda of: 2.0),
    ):
        with pytest.raises(InputError, match=r"'(mine|scaled|bound)' exists .*program"):
            register()


def test_a_reader_that_fails_is_named():
    gp.register_reader("dem", lambda path: {"no": path})
    gp.register_reader("wrong", lambda path: path.nothing)
    with pytest.raises(InputError, match=r"'dem' .*ContactNetwork"):
        gp.ContactNetwork.read("dem", "file")
    with pytest.raises(InputError, match="'wrong' fails: AttributeError"):
        gp.ContactNetwork.read("wrong", __file__)
    with pytest.raises(InputError, match=r"'yade'.* dem, wrong"):
        gp.ContactNetwork.read("yade", "file")


@pytest.mark.parametrize(
    ("register", "told"),
    [
        (
            lambda: gp.register_observable("two words", "1", "x", len),
            "'two words'",
        ),
        (
            lambda: gp.register_observable("one", "furlongzz", "x", len),
            "'furlongzz'",
        ),
        (lambda: gp.register_observable("one", "km/s", "x", len), "'km/s'"),
        (lambda: gp.register_observable("one", "1", 7, len), "words 7"),
        (lambda: gp.register_observable("one", "1", "  ", len), "words '  '"),
        (lambda: gp.register_observable("one", "1", "x", len, label=5), "label 5"),
        (lambda: gp.register_observable("one", "1", "x", len, label=0), "label 0"),
        (lambda: gp.register_observable("one", "1", "x", len, told="no"), "told: found 'no'"),
        (lambda: gp.register_observable("one", "1", "x", 3), "3 finds no observable"),
        (lambda: gp.register_observable("one", "1", "x", len, cost="bands"), "cost: found 'bands'"),
        (
            lambda: gp.register_observable("force", "N", "x", len),
            "'force' exists",
        ),
        *(
            (
                lambda name=name: gp.register_observable(name, "1", "x", len),
                f"name {name!r}",
            )
            for name in ("load", "medium", "dos", "motion", "response_frequency")
        ),
        *(  # the summary would lose one of the two; without its schema it cannot be read
            (
                lambda name=name: gp.register_observable(name, "1", "x", len),
                f"name {name!r}.*summaries",
            )
            for name in ("schema", "files", "local_field")
        ),
        (lambda: gp.register_law("mine", object()), "is no contact law"),
        (lambda: gp.register_law("my law", Soft, part=""), "cannot have 'my law'"),
        (lambda: gp.register_law("mine", Soft, part="furlong"), "cannot have 'furlong'"),
        (lambda: gp.register_law("mine", Soft, part=1), "cannot have 1"),
        (lambda: gp.register_law("mine", Soft), "'mine' .*missing"),
        (lambda: gp.register_law("mine", Soft, other=""), "'mine' .*other"),
        (
            lambda: gp.register_lattice(gp.Lattice("nacl", ((1, 0), (0, 1)))),
            "'nacl' exists already",
        ),
        (lambda: gp.register_law("mine", Soft(1.0), part=""), "'mine' is made already"),
        (lambda: gp.register_lattice("fcc"), "'fcc' is no lattice"),
        (lambda: gp.register_medium(gp.Packing), "is no medium"),
        (lambda: gp.register_reader("x", "y"), "'y' reads no files"),
        (lambda: gp.register_reader("=x", len), "the name of a reader"),
    ],
)
def test_what_cannot_be_registered(register, told):
    with pytest.raises(InputError, match=told):
        register()


@pytest.fixture
def plug_ins(tmp_path, monkeypatch):
    """Two plug-ins of a package ``extra``, the second of which fails after it has added something;
    what this process has loaded is loaded anew.
    """
    (tmp_path / "good_plug_in.py").write_text(
        "import granphon as gp\n"
        "def register():\n"
        "    gp.register_lattice(gp.Lattice('rows', ((1, 0), (0, 3**0.5)), ((0, 0), (0.5, 0.5))))\n"
        "    gp.register_observable('twice', 'N', 'twice the force',"
        " lambda of: 2 * of.state.force)\n"
    )
    (tmp_path / "bad_plug_in.py").write_text(
        "import granphon as gp\n"
        "gp.register_law('half', gp.PowerLaw(2.0, 1e9))\n"
        "import no_such_module\n"
    )
    description = tmp_path / "extra-1.0.dist-info"
    description.mkdir()
    (description / "METADATA").write_text("Metadata-Version: 2.1\nName: extra\nVersion: 1.0\n")
    (description / "entry_points.txt").write_text(
        "[granphon.plugins]\ngood = good_plug_in:register\nbad = bad_plug_in\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_loaded", {})
    yield
    for name in ("good_plug_in", "bad_plug_in"):
        sys.modules.pop(name, None)


@pytest.mark.usefixtures("plug_ins")
def test_packages_add_by_entry_points_and_one_that_fails_is_named(steel):
    gp.AveragedLattice(gp.Packing(steel, 8e-3)).at_force(1.0)
    assert "good_plug_in" not in sys.modules  # what is not asked for is not loaded
    packing = gp.Packing(steel, 8e-3, lattice="rows")
    data = gp.sweep(packing, force=[1.0, 2.0], media=("ala",))
    assert data["twice"].values.ravel().tolist() == [2.0, 4.0]
    failure = r"bad of extra .*no_such_module"
    with pytest.raises(InputError, match=f"'nothing'.*{failure}.*rows"):
        gp.Packing(steel, 8e-3, lattice="nothing")
    with pytest.raises(InputError, match="'half'") as caught:
        gp.Crystal.on("fcc", [gp.Ball(steel, 1e-3)], law="half")
    assert re.search(failure, str(caught.value))
    loaded = {name: why for name, why in registry.load_plugins().items() if "extra" in name}
    assert [why is None for why in loaded.values()] == [True, False]


def read_plug_in() -> str:
    """The plug-in of the page on extensions: an observable with a table and a figure."""
    page = Path(__file__).parents[1] / "docs" / "how-to" / "extend.md"
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = (block for block in blocks if "def register():" in block)
    return block


@pytest.fixture
def slowness(tmp_path, monkeypatch):
    """The plug-in of the page, in a package that is installed, and a scene that observes it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "granphon_slowness.py").write_text(read_plug_in(), encoding="utf-8")
    description = tmp_path / "slowness-1.0.dist-info"
    description.mkdir()
    (description / "METADATA").write_text("Metadata-Version: 2.1\nName: slowness\nVersion: 1.0\n")
    (description / "entry_points.txt").write_text(
        "[granphon.plugins]\nslowness = granphon_slowness:register\n"
    )
    (tmp_path / "scene.yaml").write_text(
        "material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}\n"
        "packing: {diameter: 8 mm}\nload: {force: [2 N, 20 N]}\nobserve: [slowness]\n",
        encoding="utf-8",
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_loaded", {})
    yield tmp_path
    sys.modules.pop("granphon_slowness", None)


def test_an_output_of_thirty_lines_is_in_every_place_that_has_those_of_granphon(slowness, capsys):
    lines = [line for line in read_plug_in().splitlines() if line.strip()]
    assert len(lines) <= 30
    assert main(["check", "scene.yaml"]) == 0
    assert "slowness.csv, sweep.png, slowness.png" in capsys.readouterr().out
    assert main(["run", "scene.yaml", "-o", "out", "-q", "--no-figures"]) == 0
    table = np.loadtxt("out/slowness.csv", delimiter=",", skiprows=1)
    data = gp.load_sweep("out/sweep.nc")
    np.testing.assert_array_equal(table[:, 0], data["force"].values)
    np.testing.assert_array_equal(table[:, 1], data["slowness"].values[:, 0])
    np.testing.assert_allclose(table[:, 1], 1.0 / data["longitudinal"].values[:, 0])
    # resumed: it is whole
    assert main(["run", "scene.yaml", "-o", "out", "--resume", "--no-figures"]) == 0
    assert "Nothing was computed" in capsys.readouterr().out
    result = Scene.from_yaml("scene.yaml").run("out", resume=True)
    np.testing.assert_array_equal(result["slowness"], table)
    # drawn from the table, and on the page about the folder, with its words
    assert main(["plot", "out", "-o", "out/slowness.png"]) == 0
    assert Path("out/slowness.png").read_bytes().startswith(b"\x89PNG")
    assert main(["report", "out"]) == 0
    assert "slowness.png)" in Path("out/report.md").read_text()
    # it is not whole without the table
    Path("out/slowness.csv").unlink()
    capsys.readouterr()
    assert main(["plot", "out", "-o", "slowness.pdf"]) == 2
    assert "holds no slowness" in capsys.readouterr().err
    assert not is_complete(Scene.from_yaml("scene.yaml"), "out")


def test_a_draw_that_returns_no_figure_is_named():
    row = Export("nothing", ("nothing.csv", "nothing.png"), draw=lambda results: None)
    with pytest.raises(InputError, match=r"draw of .*nothing.* returns a NoneType"):
        row.make_figure({})


@pytest.mark.slow
def test_the_figure_of_a_plug_in_is_drawn_again_and_its_files_are_documented(slowness):
    assert main(["run", "scene.yaml", "-o", "out", "-q"]) == 0
    figure = Path("out/slowness.png")
    drawn = figure.read_bytes()
    assert main(["report", "out"]) == 0
    assert "![slowness of longitudinal waves](slowness.png)" in Path("out/report.md").read_text()
    assert main(["plot", "out", "-o", "out/slowness.png", "--force"]) == 0
    assert figure.read_bytes() == drawn
    sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))
    try:
        import _generate
    finally:
        sys.path.pop(0)
    row = "| `slowness.csv`, `.png` | `slowness` | slowness of longitudinal waves |"
    assert row in _generate.files()


def test_a_single_state_has_the_output_of_a_plug_in_too(slowness):
    text = (slowness / "scene.yaml").read_text(encoding="utf-8").replace("[2 N, 20 N]", "2 N")
    result = Scene.from_text(text).run("out")
    assert result["slowness"][0, 1] == result.summary()["slowness"]
    assert Path("out/slowness.png").exists()


def write_nothing(run, folder):
    pass


def fail(*arguments):
    raise ZeroDivisionError("no such thing")


@pytest.mark.parametrize(
    ("functions", "told"),
    [
        ({"write": fail}, "'mine' fails: ZeroDivisionError"),
        ({"write": write_nothing}, "'mine' .*mine.csv"),
        ({"write": write_nothing, "find": fail}, "'mine' fails: ZeroDivisionError"),
        ({"write": write_nothing, "when": fail}, "'mine' fails: ZeroDivisionError"),
    ],
)
def test_an_output_that_fails_is_named_and_nothing_is_written(functions, told, tmp_path):
    gp.register_output("mine", ["mine.csv"], "numbers", **functions)
    scene = Scene(PACKING, Load("force", (9.0,)), observe=("mine",))
    assert scene.observe == ("mine",)
    with pytest.raises(InputError, match=told):
        scene.run(tmp_path / "out", figures=False)
    assert not (tmp_path / "out").exists()


def test_a_figure_that_fails_is_a_warning_and_a_value_of_none_writes_nothing(tmp_path):
    gp.register_output("mine", ["mine.png"], "a figure", draw=fail)
    gp.register_output("absent", ["absent.csv"], "numbers", find=lambda run: None, write=fail)
    scene = Scene(PACKING, Load("force", (9.0,)), observe=("mine", "absent"))
    result = scene.run(tmp_path / "out")
    (warning,) = result.failures
    assert "mine.png" in warning
    assert not {"mine.png", "absent.csv"} & {path.name for path in result.files}


@pytest.mark.parametrize(
    ("name", "files", "functions", "told"),
    [
        ("two words", ["a.csv"], {"write": fail}, "'two words'"),
        ("velocities", ["a.csv"], {"write": fail}, "'velocities'"),
        ("force", ["a.csv"], {"write": fail}, "'force'"),
        ("states", ["a.csv"], {"write": fail}, "'states' exists"),
        ("mine", [], {}, "no files"),
        ("mine", None, {"write": fail}, "files .*None"),
        ("mine", [1], {"write": fail}, "files"),
        ("mine", ["a.png", "b.png"], {"draw": fail}, "2 figures"),
        ("mine", ["../a.csv"], {"write": fail}, "no file"),
        ("mine", [".a.csv"], {"write": fail}, "no file"),
        ("mine", ["dos.csv"], {"write": fail}, "'dos'"),
        ("mine", ["a.csv"], {}, "no function write"),
        ("mine", ["a.png"], {}, "no function draw"),
        ("mine", ["a.csv"], {"write": 3}, "write .*3"),
        ("mine", ["a.csv"], {"write": fail, "find": "a"}, "find .*'a'"),
        ("mine", ["a.csv"], {"write": fail, "when": True}, "when .*True"),
    ],
)
def test_an_output_that_cannot_be_registered(name, files, functions, told):
    with pytest.raises(InputError, match=told):
        gp.register_output(name, files, "words", **functions)


def test_every_table_is_a_registry():
    assert {"lattice", "contact law", "medium", "observable", "reader", "output"} <= set(
        Registry.every
    )
    for table in Registry.every.values():
        assert not any(table.is_added(name) for name in table)
        assert list(table) == list(table.keys())
    assert replace(CATALOGUE["force"]) == CATALOGUE["force"]


def test_an_entry_for_later_makes_way_for_one_that_is_there():
    table = Registry("thing for later")
    try:
        table.own("pi", registry.Later("math", "pi"))
        table.own("pi", 3)
        assert table["pi"] == 3
        assert dict(table.items()) == {"pi": 3}
    finally:
        del Registry.every["thing for later"]
