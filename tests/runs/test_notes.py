"""Warnings of sweeps: one for each limit, with the worst value, the number of states, and where they
lie. The numbers are held against the data set.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import granphon as gp
from granphon.base.errors import InputError
from granphon.base.quantities import find_written_unit
from granphon.base.scales import write_in
from granphon.media.limits import check_limit
from granphon.runs.notes import CaseNotes, tell_notes
from granphon.scene.scene import Scene

SCENE = """\
material: {young_modulus: 70 GPa, poisson_ratio: 0.22, density: 2500 kg/m^3}
packing: {diameter: 1 mm}
load: {force: {from: 0.05 N, to: 10 N, points: 5, scale: log}}
medium: [ala, ema]
sweep: {width: [1 um, 4 um], diameter: [0.5 mm, 2 mm]}
"""


def list_warnings(text):
    data = Scene.from_text(text).sweep()
    return data, json.loads(data.attrs["warnings"])


def test_a_limit_has_one_line_with_its_states_and_where_they_lie():
    data, warnings = list_warnings(SCENE)
    assert len(warnings) == 4
    of_medium = {}
    for text in warnings:
        found = re.match(r"(\w+) is not reliable at (\d+) of (\d+) states", text)
        if found:
            of_medium[found[1]] = (int(found[2]), int(found[3]), text)
    assert of_medium.keys() == {"ala", "ema"}
    for medium, (failing, states, text) in of_medium.items():
        valid = data["valid"].sel(medium=medium)
        assert failing == int((~valid).sum())
        assert states == valid.size
        # from the least load on, in the units of the scene
        fails_somewhere = (~valid).any(("width", "diameter"))
        greatest = float(data["force"][fails_somewhere.values].max())
        assert f"(force 0.05 N to {greatest:.5g} N)" in text
        # the worst of all is the smallest overlap over the width
        assert "width 4 um, diameter 2 mm, force 0.05 N" in text
    # the contact radius over that of a ball, which exceeds a tenth at the same loads in both media
    overlaps = data["overlap"].sel(medium="ala")
    ratio = np.sqrt(overlaps / data["diameter"])
    (text,) = [text for text in warnings if "radius of a contact" in text]
    assert "diameter 0.5 mm" in text
    assert "force 10 N" in text
    assert text.startswith("At 4 of 40 states")
    assert int((ratio > 0.1).sum()) == 2


def test_a_load_is_told_as_the_user_wrote_it():
    pressed = SCENE.replace(
        "force: {from: 0.05 N, to: 10 N", "pressure: {from: 0.1 kN/m, to: 40 kN/m"
    )
    _, warnings = list_warnings(pressed)
    assert "pressure 0.1 kN/m to" in warnings[0]
    frame = SCENE.replace(
        "force: {from: 0.05 N, to: 10 N", "balls_per_side: 31, side_force: {from: 3 N, to: 0.5 kN"
    )
    _, warnings = list_warnings(frame)
    assert "side_force 3 N to" in warnings[0]
    # a single case needs no name, and tells the loads where it does not tell forces
    alone = frame.replace("medium: [ala, ema]\nsweep", "packing: {diameter: 1 mm}\n#")
    alone = alone.replace("packing: {diameter: 1 mm}\n", "", 1).replace(
        "diameter: 1 mm", "diameter: 1 mm, spread: {uniform: 4 um}"
    )
    _, (text, *_) = list_warnings(alone + "\nmedium: ala\n")
    assert re.search(r"4 of the 5 .* \(side_force 3 N to ", text)


def test_the_check_of_a_scene_tells_the_same(tmp_path, capsys):
    from granphon.cli.main import main

    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    assert main(["check", str(tmp_path / "scene.yaml")]) == 0
    told = [
        line.removeprefix("granphon: warning: ") for line in capsys.readouterr().err.splitlines()
    ]
    _, warnings = list_warnings(SCENE)
    assert sorted(told) == sorted(warnings)


def test_sentences_of_several_cases_are_told_once_with_their_cases():
    scene = Scene.from_text(SCENE)
    cases = scene.plan.grid.cases
    check = check_limit("contact_radius", np.full(5, 0.05))
    entries = [
        CaseNotes(case, [check, *["it rains"] * (n in (1, 3))]) for n, case in enumerate(cases)
    ]
    assert tell_notes(entries) == ["ema, width 1 um: it rains"]
    assert tell_notes([CaseNotes(case, ["it rains"]) for case in cases]) == ["it rains"]
    many = [CaseNotes(case, ["it rains"] * (n != 7)) for n, case in enumerate(cases)]
    assert tell_notes(many) == ["it rains"]


@pytest.mark.parametrize(
    ("value", "unit", "written", "text"),
    [
        (5e-4, "m", "mm", "0.5 mm"),
        (5e-4, "m", "", "500 um"),
        (5e-4, "m", "N", "500 um"),
        (0.0254, "m", "inch", "1 inch"),
        (2000.0, "N/m", "N/mm", "2 N/mm"),
        (7840.0, "kg/m^3", "g/cm^3", "7.84 g/cm^3"),
        (0.25, "1", "", "0.25"),
    ],
)
def test_values_are_written_in_the_units_of_the_user(value, unit, written, text):
    assert write_in(value, unit, written) == text
    assert find_written_unit(text) == (written or text.partition(" ")[2]) or written == "N"


@pytest.mark.parametrize(
    ("forces", "unit", "told"),
    [
        ("[5 mN, 1000 mN, 20000 mN]", "mN", "force 5 mN to 1000 mN"),
        ("[5 mN, 1 N, 20 N]", "", "force 5 mN to 1 N"),
        ("{from: 5 mN, to: 20 N, points: 3}", "", "force 5 mN to 316.23 mN"),
    ],
)
def test_values_in_several_units_have_decimal_prefixes(forces, unit, told):
    earlier = SCENE.partition("load: ")[2].partition("\n")[0]
    text = SCENE.replace(earlier, f"{{force: {forces}}}")
    scene = Scene.from_text(text)
    assert scene.origin.written_units["force"] == unit
    # the averaged lattice is not reliable at the first loads
    texts, _ = scene.plan.foresee_warnings()
    assert [words for words in texts if f"({told})" in words], texts


def test_values_of_a_sweep_from_python_have_decimal_prefixes():
    steel = gp.Material(211.65e9, 0.276, 7840.0)
    data = gp.sweep(gp.Packing(steel, 8e-3), force=[0.5, 1.0, 50.0], width=[1e-6, 2e-6, 3e-6])
    (text,) = json.loads(data.attrs["warnings"])
    assert "(force 500 mN to 1 N)" in text
    assert "width 3 um" in text


def test_forces_of_a_limit_have_the_unit_in_which_the_user_wrote_them():
    text = SCENE.split("medium")[0].replace(
        "diameter: 1 mm", "diameter: 1 mm, spread: {uniform: 4 um}"
    )
    for written, least in (("[10 mN, 20 mN]", "10 mN"), ("[0.01 N, 0.02 N]", "0.01 N")):
        loads = re.sub("force: .*", f"force: {written}}}", text)
        for media in ("afa", "[afa, ema]"):
            _, warnings = list_warnings(f"{loads}medium: {media}\n")
            assert warnings[0].startswith("afa")
            assert warnings[0].endswith(f" {least}.")


def test_a_pressure_on_a_strip_is_a_force_over_a_length():
    crystal = gp.Crystal.on("triangular", [gp.Ball(gp.Material(70e9, 0.22, 2500.0), 1e-3)])
    strip = crystal.cut(1, 3, "free")
    data = gp.sweep(strip, pressure=[10.0, 1e6])
    assert data["pressure"].attrs["units"] == "N/m"
    (text,) = json.loads(data.attrs["warnings"])
    assert "(pressure 1 MN/m)" in text
    with pytest.raises(InputError, match=r"pressure = [0-9.]+ N/m: "):
        gp.sweep(strip, pressure=[10.0, 1e12])
