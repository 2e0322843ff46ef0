"""What granphon reads: nothing in a file runs, damage is found, and every failure is an error of
granphon's own.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import pickle
import random
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray
import yaml
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import granphon as gp
from granphon.base.errors import (
    GranphonError,
    InputError,
    MissingFileError,
    SceneError,
    UnverifiedFileWarning,
)
from granphon.base.tables import Table
from granphon.base.text import (
    canonical,
    digest,
    dump_yaml,
    parse_yaml,
    plain_yaml,
    read_bytes,
    read_sealed,
    seal,
)
from granphon.cli.main import main
from granphon.fits.measurements import Measurements
from granphon.runs import dataset
from granphon.runs.finished_tasks import Store, _seal, encode
from tests.conftest import one_error
from tests.waiting import HANGS

STEEL = gp.Material(young_modulus=211.65e9, poisson_ratio=0.276, density=7840.0)
PACKING = gp.Packing(STEEL, 8e-3)
SCENE = """\
material: {young_modulus: 211.65 GPa, poisson_ratio: 0.276, density: 7840 kg/m^3}
packing: {diameter: 8 mm}
load: {force: 1 N}
"""
TABLE = "force (N),velocity (m/s),diameter (mm)\n1,500,8.0\n2,550,8.1\n"

#: every way in: the file's name, and what reads it
LOADERS = {
    "scene": ("scene.yaml", gp.Scene.from_yaml),
    "table": ("table.csv", Table.read),
    "diameters": ("table.csv", gp.Measured.from_csv),
    "measurements": ("table.csv", Measurements.read),
    "phonopy file": ("phonopy_params.yaml", gp.load_phonopy),
    "bands": ("band.yaml", gp.Bands.read),
    "density of states": ("dos.csv", gp.DensityOfStates.read_csv),
    "sweep": ("sweep.nc", gp.load_sweep),
}
#: those that granphon writes with a digest
SEALED = ["phonopy file", "bands", "density of states"]


@pytest.fixture
def opened_here(monkeypatch):
    """Sound files without a digest, which this process opens without a trial in another one."""
    monkeypatch.setattr(dataset, "_require_openable", lambda *_: None)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with a good file for every loader."""
    folder = tmp_path_factory.mktemp("written")
    state = gp.AveragedLattice(PACKING).at_overlap(8e-6)
    phonons = gp.Phonons(state)
    phonons.save(folder / "phonopy_params.yaml")
    phonons.bands([[0, 0], [1 / 3, 1 / 3], [0.5, 0]], npoints=4).write(folder / "band.yaml")
    phonons.dos(mesh=(6, 6), points=24).write_csv(folder / "dos.csv")
    gp.sweep(PACKING, force=[1.0, 2.0, 3.0], media=["ala", "afa"], path=folder / "sweep.nc")
    (folder / "scene.yaml").write_text(SCENE)
    (folder / "table.csv").write_text(TABLE)
    return folder


def numbers(found):
    """What a loader found, as plain data that can be compared."""
    if isinstance(found, xarray.Dataset):
        return found.to_dict()
    if isinstance(found, tuple):  # phonopy's object and the scales
        bridge, scales = found
        cell = bridge.unitcell
        arrays = (
            bridge.force_constants,
            bridge.masses,
            bridge.supercell_matrix,
            cell.cell,
            cell.scaled_positions,
        )
        return [[array.tolist() for array in arrays], scales.to_info()]
    return found.to_dict() if hasattr(found, "to_dict") else found


def outcome(read, path):
    """What reading gave: "same numbers" is for the caller to say; errors of granphon by their
    kind.
    """
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            found = read(path)
        except GranphonError:
            return "error", None
    assert {one.category for one in told} <= {UnverifiedFileWarning}
    return ("unverified" if told else "read"), numbers(found)


# -- nothing runs ----------------------------------------------------------------------------------


class Bomb:
    """Unpickled, it makes a folder."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


def test_the_bomb_is_live(tmp_path):
    # what these tests look for can happen
    import yaml

    pickle.loads(pickle.dumps(Bomb(tmp_path / "one")))
    yaml.load(f'!!python/object/apply:os.mkdir ["{tmp_path}/two"]', yaml.UnsafeLoader)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "two"]


TAGS = (
    '!!python/object/apply:os.mkdir ["{marker}"]',
    '!!python/object/new:os.mkdir ["{marker}"]',
    "!!python/name:os.mkdir",
    "!!python/module:os",
    '!<tag:yaml.org,2002:python/object/apply:os.mkdir> ["{marker}"]',
)


@pytest.mark.parametrize("kind", ["scene", "phonopy file", "bands"])
def test_tags_of_python_are_refused_in_yaml(written, tmp_path, kind):
    name, read = LOADERS[kind]
    marker = tmp_path / "ran"
    lines = (written / name).read_text().rstrip("\n").split("\n")
    unsealed = [line for line in lines if "sha256" not in line]
    for tag in (tag.format(marker=marker) for tag in TAGS):
        for text in (
            "\n".join([*lines, f"code: {tag}"]),  # the digest finds it
            "\n".join([*unsealed, f"code: {tag}"]),
            seal([*unsealed, f"code: {tag}"]) if name != "scene.yaml" else f"{tag}\n",
            "\n".join([f"code: {tag}", *unsealed]),
        ):
            (tmp_path / name).write_text(text)
            with pytest.raises(InputError):
                read(tmp_path / name)
    assert not marker.exists()


@pytest.mark.parametrize("kind", LOADERS)
def test_pickles_and_formulas_are_only_bytes(written, tmp_path, kind):
    name, read = LOADERS[kind]
    marker = tmp_path / "ran"
    stream = io.BytesIO()
    np.savez(stream, force=np.array([Bomb(marker)], dtype=object))
    for raw in (
        pickle.dumps(Bomb(marker)),
        stream.getvalue(),
        f'=SYSTEM("mkdir {marker}"),force (N)\n1,2\n'.encode(),
    ):
        (tmp_path / name).write_bytes(raw)
        if kind == "table" and raw.startswith(b"="):
            assert Table.read(tmp_path / name).headings[0].name.startswith("=SYSTEM")
            continue
        with pytest.raises(InputError):
            read(tmp_path / name)
    assert not marker.exists()


def test_a_pickle_inside_a_netcdf_file_stays_bytes(written, tmp_path, opened_here):
    marker = tmp_path / "ran"
    raw = np.frombuffer(pickle.dumps(Bomb(marker)), np.uint8)
    dataset = gp.load_sweep(written / "sweep.nc").assign(code=("byte", raw)).assign_attrs(code=raw)
    dataset.to_netcdf(tmp_path / "sweep.nc", engine="h5netcdf")
    with pytest.warns(UnverifiedFileWarning):
        assert_array_equal(gp.load_sweep(tmp_path / "sweep.nc")["code"], raw)
    assert not marker.exists()


@pytest.mark.parametrize(
    "how",
    [
        "external link",
        pytest.param("external storage", marks=pytest.mark.slow),
        pytest.param("virtual", marks=pytest.mark.slow),
    ],
)
def test_a_netcdf_file_reads_no_other_file(written, tmp_path, opened_here, how):
    import h5py

    gp.load_sweep(written / "sweep.nc").to_netcdf(tmp_path / "sweep.nc", engine="h5netcdf")
    (tmp_path / "secret").write_bytes(np.arange(3.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.arange(3.0)
    with h5py.File(tmp_path / "sweep.nc", "a") as file:
        if how == "external link":
            file["secret"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/secret")
        elif how == "external storage":
            place = [(str(tmp_path / "secret"), 0, 24)]
            file.create_dataset("secret", (3,), float, external=place).dims[0].attach_scale(
                file["load"]
            )
        else:
            layout = h5py.VirtualLayout((3,), float)
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "secret", (3,))
            file.create_virtual_dataset("secret", layout)
    with pytest.raises(InputError, match="another file"):
        gp.load_sweep(tmp_path / "sweep.nc")
    # nor one that whoever made it has given a digest
    raw = (tmp_path / "sweep.nc").read_bytes()
    (tmp_path / "sweep.nc").write_bytes(
        raw + dataset._TRAILER + hashlib.sha256(raw).hexdigest().encode()
    )
    with pytest.raises(InputError, match="another file"):
        gp.load_sweep(tmp_path / "sweep.nc")


def test_a_kept_part_of_a_sweep_is_never_unpickled(tmp_path):
    marker = tmp_path / "ran"
    store = Store(tmp_path / "parts")
    store.append("piece", encode("piece", {"x": np.arange(3.0)}))
    assert_array_equal(store.read("piece")["x"], np.arange(3.0))
    bomb = pickle.dumps(Bomb(marker))
    # with the right digest too
    for data in (
        b'[["x", "|O", [1]]]\n' + bytes(16),
        bomb,
        b'[["x", "|O", [1]]]\n' + bomb,
        b'[["x", "<f8", [2.0]]]\n' + bytes(16),
        b'[["x", [["y", "|O"]], [2]]]\n' + bytes(16),
        b"",
        b"[" * 100_000,
        b'[["x", "<f8", [9999999999999]]]\n' + bytes(16),
        b"1\n",
        b'[["x", "<f8"]]\n' + bytes(16),
    ):
        store.append("piece", _seal("piece", data))
        assert Store(tmp_path / "parts").read("piece") is None
    assert not marker.exists()


def test_plain_data_of_a_result_make_no_other_class(tmp_path):
    state = gp.AveragedLattice(PACKING).at_force(1.0)
    data = state.to_dict()
    del data["digest"]
    for name in ("Popen", "os.mkdir", "Path", "Result"):
        with pytest.raises(InputError):
            gp.ContactState.from_dict(
                data | {"packing": {"class": name, "args": [str(tmp_path / "ran")]}}
            )
    assert not (tmp_path / "ran").exists()


def test_only_the_named_file_is_read(written, tmp_path, monkeypatch):
    # phonopy's loader takes FORCE_CONSTANTS from the folder where one works, if the file has none
    monkeypatch.chdir(tmp_path)
    text = (written / "phonopy_params.yaml").read_text()
    lines = [line for line in text.split("\n") if "sha256" not in line]
    cut = lines[: lines.index("force_constants:")]
    (tmp_path / "phonopy_params.yaml").write_text("\n".join(cut))
    (tmp_path / "FORCE_CONSTANTS").write_text(
        "1 18\n" + "".join(f"1 {n}\n" + "1 2 3\n" * 3 for n in range(1, 19))
    )
    with pytest.raises(InputError, match="force_constants"):
        gp.load_phonopy("phonopy_params.yaml")


# -- files that are not there, and what is no file -------------------------------------------------


@pytest.mark.parametrize("kind", LOADERS)
def test_a_missing_file(tmp_path, kind):
    name, read = LOADERS[kind]
    with pytest.raises(FileNotFoundError, match="no such file") as caught:
        read(tmp_path / name)
    assert isinstance(caught.value, MissingFileError | InputError)
    assert isinstance(pickle.loads(pickle.dumps(caught.value)), MissingFileError)


@pytest.mark.parametrize("kind", LOADERS)
def test_only_regular_files_are_read(tmp_path, kind):
    _, read = LOADERS[kind]
    os.mkfifo(tmp_path / "pipe")
    for path, words in (
        (tmp_path / "pipe", "a device"),
        ("/dev/zero", "a device"),
        (tmp_path, "a folder"),
        (f"{tmp_path}/\0", "cannot be read"),
        (tmp_path / ("x" * 5000), "cannot be read"),
    ):
        with pytest.raises(InputError, match=words):
            read(path)


@pytest.mark.parametrize("kind", LOADERS)
def test_a_path_is_a_text_or_a_path(kind):
    # open() takes whole numbers, and True, for files that are open: it closed standard output
    out = os.fstat(1)
    for wrong in (None, 1.5, [], object(), True, 1, b"file", np.ma.masked):
        with pytest.raises(InputError, match="the path is"):
            LOADERS[kind][1](wrong)
    assert os.path.samestat(os.fstat(1), out)


@pytest.mark.parametrize(
    "rows",
    [
        [[3, 100000000, 0], [0, 3, 0], [0, 0, 1]],
        [[3, 0, 0], [0, 3, 0], [0, 1, 1]],
        [[0, 3, 0], [3, 0, 0], [0, 0, 1]],
        [[9, 0], [0, 1]],
        [[3.0, 0, 0]] * 3,
        [[2**62, 0, 0], [0, 2**62, 0], [0, 0, 1]],
        [[2**70, 0, 0]] * 3,
    ],
)
def test_supercells_that_granphon_does_not_write_are_refused(written, tmp_path, rows):
    # phonopy would build the first for ever: its determinant is that of the stored force constants
    lines = (written / "phonopy_params.yaml").read_text().split("\n")
    lines = [line for line in lines if "sha256" not in line]
    place = lines.index("supercell_matrix:")
    assert lines[place + 1 : place + 3] == ["- [   3,   0,   0 ]", "- [   0,   3,   0 ]"]
    path = tmp_path / "phonopy_params.yaml"
    path.write_text(
        "\n".join([*lines[: place + 1], *(f"- {row}" for row in rows), *lines[place + 4 :]])
    )
    with pytest.raises(InputError, match=r"supercell_matrix|force constants"):
        gp.load_phonopy(path)


# -- digests ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", SEALED)
def test_a_text_is_known_by_its_digest(written, tmp_path, kind):
    name, read = LOADERS[kind]
    good = (written / name).read_text()
    path = tmp_path / name
    expected = outcome(read, written / name)
    assert expected[0] == "read"
    assert sum("sha256" in line for line in good.split("\n")) == 1
    # line ends and a byte order mark are no damage
    path.write_bytes(b"\xef\xbb\xbf" + good.replace("\n", "\r\n").encode())
    assert outcome(read, path) == expected
    # another program's copy has no digest, and is told
    path.write_text(
        "".join(line for line in good.splitlines(keepends=True) if "sha256" not in line)
    )
    with pytest.warns(UnverifiedFileWarning, match=f"{name} .*digest") as caught:
        found = read(path)
    assert numbers(found) == expected[1]
    assert caught[0].filename == __file__
    # and one that was edited is refused
    digits = [
        n
        for n, c in enumerate(good)
        if c == "7" and "sha256" not in good[good.rfind("\n", 0, n) : n]
    ]
    path.write_text(good[: digits[-1]] + "8" + good[digits[-1] + 1 :])
    with pytest.raises(InputError, match="damaged"):
        read(path)
    path.write_text(good.replace("sha256 of all", "sha256 of  all"))
    with pytest.raises(InputError, match="damaged"):
        read(path)


@pytest.mark.parametrize("kind", SEALED)
@pytest.mark.parametrize("number", ["0", "2"])
def test_a_file_of_another_schema_is_refused(written, tmp_path, kind, number):
    (name, read), told = LOADERS[kind], "schema 1" if kind == "density of states" else "schema: 1"
    text, _ = read_sealed(written / name)
    assert text.count(told) == 1
    (tmp_path / name).write_text(seal(text.replace(told, told[:-1] + number).split("\n")[:-1]))
    with pytest.raises(InputError) as caught:
        read(tmp_path / name)
    assert f"{tmp_path / name} has the schema {number}. " in str(caught.value)
    assert "writes schema 1. " in str(caught.value)


def test_sealing_a_text(tmp_path):
    text = "first\nsecond\n"
    (tmp_path / "x").write_text(seal(text.splitlines(), 1))
    assert (tmp_path / "x").read_text().split("\n")[1].startswith("# sha256 of all other lines: ")
    assert read_sealed(tmp_path / "x") == (text, True)
    (tmp_path / "x").write_text(text)
    assert read_sealed(tmp_path / "x") == (text, False)


def test_a_digest_of_plain_data_survives_json_and_yaml():
    data = {
        "b": [1.0, 2, -0.0, 1e300, 5e-324, 0.1, 2**60 + 1, 10**400],
        "a": {"x": None, "y": True, 'é\n"': "ä: {"},
        "array": np.arange(3),
        "tuple": (1, (2.5,)),
        "z": 1 + 2j,
        "empty": [[], {}],
    }
    plain = json.loads(
        json.dumps(
            data,
            default=lambda x: x.tolist() if hasattr(x, "tolist") else {"imag": x.imag, "real": 1},
        )
    )
    assert digest(plain) == digest(data)
    del data["z"], data["b"][-1], data["empty"], data["a"]['é\n"']
    text = dump_yaml(data)
    assert digest(yaml.safe_load(text)) == digest(plain_yaml(text, "x")) == digest(data)
    assert canonical([1]) == canonical((1.0,)) == canonical(np.array([1]))
    with pytest.raises(InputError, match="too large"):
        digest([10**5000])
    different = [
        [0.0],
        [-0.0],
        [1],
        ["1"],
        [True],
        [None],
        [],
        [[1]],
        [math.nan],
        [math.inf],
        {"1": 1},
        [1, 1],
        "[]",
    ]
    assert len({digest(one) for one in different}) == len(different)
    with pytest.raises(InputError, match="object"):
        digest([object()])
    for long_double in (np.longdouble(1.0), np.ones(2, np.longdouble)):
        with pytest.raises(InputError, match="longdouble"):
            digest({"a": long_double})


@given(st.floats(1.0, allow_infinity=False).map(math.floor) | st.integers())
@example(2**1023)
@example(2**1024 - 2**971)
def test_a_whole_number_has_the_digest_of_the_float_that_equals_it(whole):
    for one in (whole, -whole):
        nearest = float(one)
        assert (canonical(one) == canonical(nearest)) == (one == nearest)
        assert canonical(one + 1) != canonical(one)


@pytest.mark.parametrize("read", [plain_yaml, parse_yaml])
def test_a_whole_number_of_more_digits_than_python_converts_is_refused(read):
    with pytest.raises(
        InputError,
        match=r"^file:2\b.*5000 digits.*640",
    ):
        read(f"y: 1\nx: -{'7' * 5000}", "file")


@pytest.mark.parametrize("digits", [310, 400, 641])
@pytest.mark.parametrize(
    "line",
    [
        "medium: {{simulation: {{seed: {}}}}}",
        "medium: {{simulation: {{shape: [{}, 8]}}}}",
        "sweep: {{spread: [{{normal: {{std: 1 um, cutoff: {}}}}}]}}",
    ],
)
def test_a_scene_refuses_a_whole_number_of_many_digits(digits, line):
    nines = "9" * digits
    with pytest.raises(SceneError, match=r"^x:4: .*(large|640)"):
        gp.Scene.from_text(SCENE + line.format(nines) + "\n", "x")


def test_a_sweep_is_known_by_two_digests(written, tmp_path, opened_here):
    path = tmp_path / "sweep.nc"
    # the library that writes the file anew keeps the digest of the numbers
    import netCDF4

    xarray.load_dataset(written / "sweep.nc", engine="netcdf4").to_netcdf(path, engine="netcdf4")
    with netCDF4.Dataset(path, "a") as file:
        file.history = "somebody looked at it"
    expected = gp.load_sweep(written / "sweep.nc").drop_attrs(deep=False)
    assert gp.load_sweep(path).drop_attrs(deep=False).identical(expected)
    with netCDF4.Dataset(path, "a") as file:
        file["longitudinal"][0] = file["longitudinal"][0] * 1.0000001
    with pytest.raises(InputError, match=r"damaged.*granphon_sha256"):
        gp.load_sweep(path)


def test_damage_is_found_before_hdf5_sees_a_sweep(written, tmp_path):
    path = tmp_path / "sweep.nc"
    whole = (written / "sweep.nc").read_bytes()
    for place in (100, len(whole) // 2, len(whole) - 200, len(whole) - 1):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(InputError, match=r"damaged.*at its end"):
            gp.load_sweep(path)


def test_a_sweep_without_a_digest_is_read_with_a_warning(written, tmp_path, opened_here):
    path = tmp_path / "sweep.nc"
    expected = gp.load_sweep(written / "sweep.nc")
    expected.to_netcdf(
        path,
        engine="h5netcdf",
        encoding={name: {"_FillValue": None} for name in expected.variables},
    )
    with pytest.warns(UnverifiedFileWarning, match=r"sweep\.nc .*digest"):
        assert gp.load_sweep(path).identical(expected)


#: a value in the place of the last of a variable, or of an attribute, and what is told of it
SENSELESS = [
    ("longitudinal", math.nan, "longitudinal"),
    ("longitudinal", 0.0, "longitudinal"),
    ("longitudinal", 1e305, "longitudinal"),
    ("force", -1.0, "force"),
    ("force", math.inf, "force"),
    ("contact_fraction", -0.1, "contact_fraction, .* -0.1"),
    ("overlap", math.nan, "overlap, .* nan"),
    ("transverse", "fast", "transverse, .*numbers"),
    ("media", "[[[", r"media .*'\[\[\['.* list"),
    ("packing", "[]", r"packing .*'\[\]'.* mapping"),
    ("exponent_error", math.nan, None),
    ("reduced_force", math.inf, None),
    ("overlap", -1e-7, None),
]


def spoil_sweep(sweep, name, value):
    """A sweep without its digest, with another value in one place."""
    sweep = sweep.copy(deep=True)
    sweep.attrs.pop(dataset.DIGEST, None)
    if name in sweep.attrs:
        sweep.attrs[name] = value
    elif isinstance(value, str):
        sweep[name] = sweep[name].dims, np.full(sweep[name].shape, value)
    else:
        values = sweep[name].values.copy()
        values[-1] = value
        sweep[name] = sweep[name].dims, values
    return sweep


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        pytest.param(*case, marks=[pytest.mark.slow] * (case not in (SENSELESS[0], SENSELESS[-1])))
        for case in SENSELESS
    ],
)
def test_a_sweep_without_a_digest_makes_sense(written, tmp_path, opened_here, name, value, told):
    path = tmp_path / "sweep.nc"
    sweep = xarray.load_dataset(written / "sweep.nc", engine="h5netcdf")
    path.write_bytes(dataset.netcdf_bytes(spoil_sweep(sweep, name, value)))
    if told is None:
        assert outcome(gp.load_sweep, path)[0] == "unverified"
    else:
        with pytest.raises(InputError, match=f"{path} .*damaged: .*{told}"):
            gp.load_sweep(path)


def test_numbers_and_attributes_of_a_sweep_make_sense(written):
    """As those of a file, which takes longer to write."""
    sweep = xarray.load_dataset(written / "sweep.nc", engine="h5netcdf")
    for name, value, told in SENSELESS:
        spoiled = spoil_sweep(sweep, name, value)
        if told is None:
            dataset._require_plausible("x.nc", spoiled)
        else:
            with pytest.raises(InputError, match=rf"x\.nc .*damaged: .*{told}"):
                dataset._require_plausible("x.nc", spoiled)


@pytest.mark.parametrize("name", ["format", dataset.DIGEST])
def test_an_attribute_of_a_sweep_that_should_be_a_text_and_is_an_array(
    written, tmp_path, opened_here, name
):
    path = tmp_path / "sweep.nc"
    sweep = xarray.load_dataset(written / "sweep.nc", engine="h5netcdf")
    path.write_bytes(dataset.netcdf_bytes(sweep.assign_attrs({name: [1, 2]})))
    with pytest.raises(InputError, match=f"{path} "):
        gp.load_sweep(path)


def test_a_sweep_without_a_digest_runs_nothing_that_stands_where_we_are(
    written, tmp_path, monkeypatch
):
    # without what ends it
    (tmp_path / "sweep.nc").write_bytes((written / "sweep.nc").read_bytes()[:-101])
    code = f"import pathlib; pathlib.Path({str(tmp_path / 'ran')!r}).touch()"
    for name in ("sitecustomize", "usercustomize", "h5netcdf", "granphon"):
        (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)  # as "python -m granphon" has it
    gp.load_sweep("sweep.nc")
    assert not (tmp_path / "ran").exists()


def test_a_sweep_without_a_digest_cannot_stop_us(written, tmp_path, monkeypatch):
    whole = (written / "sweep.nc").read_bytes()
    path = tmp_path / "sweep.nc"
    path.write_bytes(whole[:-101])  # HDF5's own part
    for trial, words in (
        ("import time; time.sleep(1000)", "1 seconds"),
        ("import os; os.kill(os.getpid(), 11)", "it crashes"),
        ("raise ValueError('tripped')", "HDF5.* tripped"),
        ("", "it crashes"),
    ):
        with monkeypatch.context() as patched:
            for name, value in (
                ("_TRIAL", trial),
                ("TRIAL_SECONDS", 1.0 if "sleep" in trial else HANGS),
            ):
                patched.setattr(dataset, name, value)
            with pytest.raises(InputError, match=words):
                gp.load_sweep(path)


@pytest.mark.claim("largest-files")
@pytest.mark.parametrize("kind", [*LOADERS, "table of a network", "dump"])
def test_the_largest_files_are_those_of_the_page(tmp_path, kind):
    sizes = {"scene": (100_000, "100 kB"), "sweep": (2_000_000_000, "2000 MB")}
    sizes |= dict.fromkeys(["table of a network", "dump"], (4_000_000_000, "4000 MB"))
    most, words = sizes.get(kind, (256_000_000, "256 MB"))
    networks = {
        "table of a network": ("balls.csv", lambda path: gp.ContactNetwork.from_table(path, {})),
        "dump": ("atoms.dump", lambda path: gp.ContactNetwork.from_lammps(path, path)),
    }
    name, read = (LOADERS | networks)[kind]
    with open(tmp_path / name, "wb") as stream:
        stream.truncate(most + 1)  # of zeros that take no place
    with pytest.raises(InputError, match=f"holds more than {words}"):
        read(tmp_path / name)
    (tmp_path / "small").write_bytes(b"12345")
    assert read_bytes(tmp_path / "small", 5) == b"12345"
    with pytest.raises(InputError, match="small holds more than"):
        read_bytes(tmp_path / "small", 4)


def test_the_command_line_tells_it_in_a_line(written, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (written / "dos.csv").read_text().splitlines(keepends=True)
    Path("dos.csv").write_text("".join(line for line in text if "sha256" not in line))
    assert main(["plot", "."]) == 0
    error = capsys.readouterr().err
    assert error.startswith("granphon: warning: dos.csv ")
    assert error.count("\n") == 1
    Path("dos.csv").write_text("".join(text).replace("0.0,", "0.1,", 1))
    assert main(["plot", ".", "--force"]) == 2
    assert "damaged" in one_error(capsys)


def edit_bands(change):
    """A change of the data of band.yaml, made in its text without a digest."""

    def edit(text):
        data = plain_yaml(text, "band.yaml")
        change(data)
        return json.dumps(data)

    return edit


def swap_rows(text):
    lines = text.splitlines()
    return "\n".join([*lines[:-2], lines[-1], lines[-2], ""])


def mode(data):
    return data["phonon"][2]["band"][1]


@pytest.mark.parametrize(
    ("kind", "edit", "told"),
    [
        (
            "bands",
            edit_bands(lambda data: mode(data).update(frequency=-1.0)),
            "below zero",
        ),
        ("bands", edit_bands(lambda data: mode(data).update(frequency=1e300)), "ascend"),
        (
            "bands",
            edit_bands(lambda data: data["phonon"][2]["band"][-1].update(frequency=1e300)),
            "far above",
        ),
        (
            "bands",
            edit_bands(lambda data: mode(data).update(frequency="hello")),
            "'hello' .*frequency",
        ),
        (
            "bands",
            edit_bands(lambda data: mode(data)["eigenvector"][0][0].__setitem__(0, 7.0)),
            "length",
        ),
        (
            "bands",
            edit_bands(lambda data: mode(data)["eigenvector"].pop()),
            "eigenvector",
        ),
        (
            "bands",
            edit_bands(lambda data: data.update(nqpoint=99999999999)),
            r"nqpoint \(99999999999\)",
        ),
        ("bands", edit_bands(lambda data: data.update(segment_nqpoint=[-7, 4])), "segment_nqpoint"),
        ("bands", edit_bands(lambda data: data.update(segment_nqpoint=[0, 8])), "segment_nqpoint"),
        ("bands", edit_bands(lambda data: data.update(npath=0)), "npath: found 0"),
        (
            "bands",
            edit_bands(lambda data: data["phonon"][3].update(distance=9.0)),
            "distances",
        ),
        (
            "bands",
            edit_bands(lambda data: data["reciprocal_lattice"][0].__setitem__(0, math.nan)),
            "reciprocal_lattice",
        ),
        (
            "bands",
            edit_bands(lambda data: data["granphon"].update(coordinates=["x"])),
            "coordinates",
        ),
        (
            "bands",
            edit_bands(lambda data: data["points"][0].update(coordinates=["x"])),
            "'x' .*coordinates",
        ),
        (
            "bands",
            edit_bands(lambda data: data.update(natom=2)),
            "natom .*2.* 1 ",
        ),
        ("bands", edit_bands(lambda data: data.pop("granphon")), "'granphon'"),
        (
            "bands",
            edit_bands(lambda data: data.update(phonon=3)),
            "a block",
        ),
        ("density of states", swap_rows, "ascend"),
        (
            "density of states",
            lambda text: text.replace("\n0.0,", "\n-1.0,", 1),
            "below zero",
        ),
        (
            "density of states",
            lambda text: text.replace("\n0.0,", "\nhello,", 1),
            "'hello'",
        ),
        (
            "phonopy file",
            lambda text: text.replace("granphon:", "granphone:", 1),
            "'granphon'",
        ),
    ],
)
def test_a_text_without_a_digest_makes_sense(written, tmp_path, kind, edit, told):
    name, read = LOADERS[kind]
    whole = read_sealed(written / name)[0]
    path = tmp_path / name
    path.write_text(edit(whole).replace("NaN", ".nan"))
    what = kind if kind == "density of states" else name
    with pytest.raises(InputError, match=f"{path} .*{what}.* granphon.*{told}"):
        read(path)


# -- damage ----------------------------------------------------------------------------------------


def damages(raw, rng):
    """A copy of ``raw`` with one thing wrong."""
    n = len(raw)
    start = rng.randrange(n)
    stop = min(n, start + rng.choice([1, 2, 8, 40, 300, 2000]))
    kind = rng.choice(["flip", "cut", "delete", "repeat", "zero", "swap"])
    if kind == "flip":
        return raw[:start] + bytes([raw[start] ^ 1 << rng.randrange(8)]) + raw[start + 1 :]
    if kind == "cut":
        return raw[:start]
    if kind == "delete":
        return raw[:start] + raw[stop:]
    if kind == "repeat":
        return raw[:stop] + raw[start:]
    if kind == "zero":
        return raw[:start] + bytes(stop - start) + raw[stop:]
    digits = [i for i, byte in enumerate(raw) if 48 <= byte < 58]
    one, two = (rng.choice(digits) for _ in range(2))
    swapped = bytearray(raw)
    swapped[one], swapped[two] = raw[two], raw[one]
    return bytes(swapped)


def after_damage(kind, written, tmp_path, seeds):
    """How often a damaged file gave an error, the same numbers, or these with a warning; never
    anything else.
    """
    name, read = LOADERS[kind]
    raw = (written / name).read_bytes()
    expected = numbers(read(written / name))
    counts = {"error": 0, "read": 0, "unverified": 0}
    for seed in seeds:
        rng = random.Random(seed)
        broken = damages(raw, rng)
        (tmp_path / name).write_bytes(broken)
        what, found = outcome(read, tmp_path / name)
        counts[what] += 1
        assert what == "error" or found == expected, f"other numbers after damage {seed}"
    return counts


@pytest.mark.parametrize("kind", SEALED)
def test_damaged_texts_never_give_other_numbers_and_without_a_digest_no_foreign_error(
    written, tmp_path, kind
):
    counts = after_damage(kind, written, tmp_path, range(60))
    assert counts["error"] > 40
    name, read = LOADERS[kind]
    raw = read_sealed(written / name)[0].encode()
    for seed in range(60):
        (tmp_path / name).write_bytes(damages(raw, random.Random(seed)))
        assert outcome(read, tmp_path / name)[0] in ("error", "unverified")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("has_trailer", "count"),
    # a file whose trailer is gone is tried in another process
    [(True, 60), pytest.param(False, 40, marks=pytest.mark.slow)],
)
def test_a_damaged_sweep_never_gives_other_numbers(written, tmp_path, has_trailer, count):
    whole = (written / "sweep.nc").read_bytes()
    seeds = [seed for seed in range(count) if keeps_trailer(whole, seed) == has_trailer]
    counts = after_damage("sweep", written, tmp_path, seeds)
    assert counts["error"] > 0.6 * len(seeds) > 0


def keeps_trailer(raw, seed):
    """Whether the trailer is still where it belongs after this damage."""
    return damages(raw, random.Random(seed))[-101:-64] == raw[-101:-64]


def test_a_failure_of_hdf5_is_one_line_of_the_command(written, tmp_path, monkeypatch, capsys):
    raw = bytearray((written / "sweep.nc").read_bytes()[:-101])
    raw[300:1200] = bytes(900)  # the head, behind which no trailer stands
    (tmp_path / "sweep.nc").write_bytes(raw)
    trial = "import io, sys, h5py; h5py.File(io.BytesIO(sys.stdin.buffer.read()))['force']"
    monkeypatch.setattr(dataset, "_TRIAL", trial)
    assert main(["plot", str(tmp_path)]) == 2
    assert "HDF5" in one_error(capsys)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "said", "seconds"),
    [
        (300, "HDF5 fails", dataset.TRIAL_SECONDS),
        # with these zeros HDF5 is busy for minutes, or until the process that tries it is stopped
        pytest.param(600, "cannot be read", 3.0, marks=pytest.mark.exhaustive),
    ],
)
def test_a_crash_inside_hdf5_is_not_ours(written, tmp_path, start, said, seconds):
    # zeros in the head of the file, behind which no trailer stands: one line, and no traceback of a
    # destructor
    raw = bytearray((written / "sweep.nc").read_bytes()[:-101])
    raw[start : start + 900] = bytes(900)
    (tmp_path / "sweep.nc").write_bytes(raw)
    command = "import sys; from granphon.cli.main import main; from granphon.runs import dataset; "
    command += f"dataset.TRIAL_SECONDS = {seconds}; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run(
        [sys.executable, "-c", command, "plot", str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=HANGS,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("granphon: error:")
    assert said in done.stderr
