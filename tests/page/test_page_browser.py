"""The page in a real browser: its numbers in every lattice, and what people do with it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import granphon as gp
from granphon.balls.lattices import LATTICES
from granphon.media.choice import MediumChoice
from granphon.page.page import make_page
from granphon.waves.settings import BandsSettings
from tests.page import browser
from tests.page.test_page import BALLS, FORCE, SOLVE, check_agreement, draw_settings, lattice_data
from tests.waiting import HANGS

pytestmark = [
    pytest.mark.exhaustive,
    pytest.mark.skipif(
        bool(browser.explain_missing()), reason=browser.explain_missing() or "there is a browser"
    ),
]
#: what the page draws once it has rested for a moment after the last change is drawn: at its begin
#: the address takes up the link to the settings
SETTLED = "() => location.hash === `#${writeLink(data, granphon.state())}`"
#: some frames of a motion have been drawn
FRAMES = """(count) => new Promise((end) => {
    const next = () => (count-- > 0 ? requestAnimationFrame(next) : end());
    next(); })"""
#: a page is drawn, and its density of states too
DRAWN = "() => document.getElementById('dos-help').textContent !== ''"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Pages of a plane with a spread, of a crystal, of a chain and of a mechanism."""
    folder = tmp_path_factory.mktemp("pages")
    scenes: dict[str, tuple[dict[str, Any], list[str]]] = {
        "triangular": ({"spread": gp.Uniform(2e-6)}, ["ema", "afa"]),
        "square": ({"lattice": "square", "spread": gp.Uniform(2e-6)}, ["ema"]),
        "fcc": ({"lattice": "fcc", "torsion": 0.02}, ["afa"]),
        "chain": ({"lattice": "chain", "motions": "all", "bending": 0.02}, ["ala"]),
        "honeycomb": ({"lattice": "honeycomb"}, ["afa"]),
    }
    for name, (changes, media) in scenes.items():
        page = make_page(
            replace(BALLS, **changes), [MediumChoice(one) for one in media], FORCE, title=name
        )
        (folder / f"{name}.html").write_text(page, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser.open_browser() as found:
        yield found


class Visit:
    """An open page, with all that it asked the network for and all that went wrong in it."""

    def __init__(self, chromium: Any, path: Path, link: str = "", **options: Any) -> None:
        self.context = chromium.new_context(
            **{"viewport": {"width": 1280, "height": 900}} | options
        )
        self.page = self.context.new_page()
        self.page.set_default_timeout(1000.0 * HANGS)
        self.asked: list[str] = []
        self.wrong: list[str] = []
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on(
            "console", lambda said: self.wrong.append(said.text) if said.type == "error" else None
        )
        self.url = path.as_uri()
        self.page.goto(self.url + link)

    def __enter__(self) -> Any:
        return self.page

    def __exit__(self, *failed: object) -> None:
        self.context.close()
        if failed[0] is None:
            assert self.wrong == []
            assert {
                url.split("#")[0] for url in self.asked if not url.startswith(("blob:", "data:"))
            } == {self.url}


def state(page: Any) -> dict[str, Any]:
    return dict(page.evaluate("() => ({...granphon.state()})"))


# -- numbers ---------------------------------------------------------------------------------------


@pytest.mark.claim("page-agrees")
def test_the_browser_computes_what_the_library_computes(chromium, folder):
    cases = [draw_settings(name, seed) for name in LATTICES for seed in range(100, 108)]
    datas = {name: lattice_data(name) for name in LATTICES}
    with Visit(chromium, folder / "chain.html") as page:
        found = page.evaluate(
            f"([cases, datas]) => JSON.parse(JSON.stringify(({SOLVE})(cases, datas)))",
            [cases, datas],
        )
    for case, one in zip(cases, found, strict=True):
        check_agreement(case, one)


def test_what_the_page_shows_is_what_the_library_says(chromium, folder):
    """The drawn bands, in hertz, the velocities and the moduli of the state at the start."""
    packing = replace(BALLS, spread=gp.Uniform(2e-6))
    found = gp.EffectiveMedium(packing).at_force(18.446)
    with Visit(chromium, folder / "triangular.html") as page:
        page.wait_for_function(DRAWN)
        drawn = page.evaluate(
            "() => ({points: current.path.points, values: [...current.bands.values], unit:"
            " current.unit, sound: current.sound, stiffness: current.contact.stiffness})"
        )
        shown = page.inner_text("#numbers")
    assert drawn["unit"]["name"] == "kHz"
    assert drawn["stiffness"] == pytest.approx(found.normal_stiffness, rel=2e-6)
    kilohertz = np.reshape(drawn["values"], (-1, 3)) * drawn["unit"]["scale"]
    expected = gp.Phonons(found).frequencies(drawn["points"]) / 1e3
    assert np.allclose(kilohertz, expected, rtol=0.0, atol=2e-6 * expected.max())
    v = gp.sound_velocities(found)
    c = gp.moduli(found)
    assert dict(drawn["sound"]) == pytest.approx(
        {"longitudinal": v.longitudinal, "transverse": v.transverse}, rel=2e-6
    )
    assert re.search(rf"Bulk modulus.*\t{c.bulk / 1e9:.4g} GPa", shown)
    assert re.search(rf"Local exponent.*\t{found.exponent:.4g}", shown)


def test_the_page_of_a_crystal_of_two_kinds_has_its_bands_and_nothing_to_set(chromium, tmp_path):
    light = gp.Ball(gp.Material(73.5e9, 0.33, 2700.0), 19.05e-3, name="light")
    heavy = gp.Ball(gp.Material(193e9, 0.30, 8000.0), 19.05e-3, name="heavy")
    state = gp.Crystal.on("NaCl", [light, heavy]).at_pressure(1e5)
    path = tmp_path / "salt.html"
    path.write_text(make_page(state, title="salt"), encoding="utf-8")
    with Visit(chromium, path) as page:
        page.wait_for_function(DRAWN)
        drawn = page.evaluate(
            "() => ({points: current.path.points, values: [...current.bands.values], unit:"
            " current.unit})"
        )
        cards = page.evaluate(
            "() => [...document.querySelectorAll('.card')].filter(one =>"
            " one.offsetParent).map(one => one.innerText)"
        )
    found = np.reshape(drawn["values"], (-1, 12)) * drawn["unit"]["scale"]
    expected = gp.Phonons(state).frequencies(drawn["points"]) / 1e3
    assert np.allclose(found, expected, rtol=0.0, atol=1e-6 * expected.max())
    assert [one.split("\n")[0] for one in cards] == [
        "Bands and density of states",
        "Mode",
        "State, sound and moduli",
    ]
    assert "light" in cards[1]
    assert "heavy" in cards[1]


def test_the_density_of_states_counts_every_branch_once(chromium, folder):
    with Visit(chromium, folder / "fcc.html") as page:
        page.wait_for_function("() => current.dos")
        sums = "(name) => current.dos[name].reduce((sum, one) => sum + one, 0)"
        width = page.evaluate("() => current.dos.frequencies[1] - current.dos.frequencies[0]")
        total, turning = (width * page.evaluate(sums, name) for name in ("total", "turning"))
    assert total == pytest.approx(6.0, rel=1e-9)
    # at each wave vector the rotational parts add up to the rotations
    assert turning == pytest.approx(3.0, rel=1e-9)


# -- what people do --------------------------------------------------------------------------------


def test_sliders_move_by_the_keyboard_and_redraw(chromium, folder):
    with Visit(chromium, folder / "triangular.html") as page:
        page.wait_for_function(DRAWN)
        before = state(page)
        curve = page.get_attribute(".curves path", "d")
        for name in ("force", "width", "eta", "bending", "place", "branch"):
            page.focus(f"#{name}")
            page.keyboard.press("ArrowLeft" if name == "eta" else "ArrowRight")
        page.focus("#overlap")
        page.keyboard.press("Space")
        page.wait_for_function(SETTLED)
        after = state(page)
        changed = {name for name in after if after[name] != before[name]}
        assert changed == {"force", "width", "eta", "bending", "place", "branch", "overlap"}
        assert page.get_attribute(".curves path", "d") != curve
        spoken = page.get_attribute("#force", "aria-valuetext")
        assert spoken == page.inner_text("output[for=force]")
        assert page.inner_text("#spoken").startswith("Force ")
        link = page.evaluate("() => location.hash")
    with Visit(chromium, folder / "triangular.html", link) as page:
        assert state(page) == after


@pytest.mark.parametrize("lightest", [0.02, 0.3, 0.9])
def test_the_axis_of_frequencies_shrinks_with_the_load(chromium, folder, lightest):
    """At rest the highest frequency is always at the same height, whatever was shown before."""
    with Visit(chromium, folder / "fcc.html") as page:
        page.wait_for_function(DRAWN)
        for factor in (1.0, lightest):
            page.evaluate(
                "(factor) => granphon.change({ force: factor * data.limits.force[1] })", factor
            )
            page.wait_for_function(SETTLED)
        top, axis, drawn = page.evaluate(
            "() => [current.top * current.unit.scale, bandsView.axisTop,"
            " bandsView.element.layout.yaxis.range[1]]"
        )
    assert axis == drawn == pytest.approx(1.1 * top, rel=0.01)


def test_a_colour_means_the_same_in_bands_and_density_of_states(chromium, folder):
    with Visit(chromium, folder / "triangular.html") as page:
        page.wait_for_function("() => bandsView.element.data.length > 1")
        colours = page.evaluate(
            "() => Object.fromEntries(bandsView.element.data.slice(1).map((one) => [one.name,"
            " one.line.color]))"
        )
        ends = page.evaluate("() => [themeColour('move'), themeColour('turn'), themeColour('ink')]")
        sums = page.evaluate(
            "() => bandsView.element.data.slice(1).map((one) => one.x.reduce((sum, x) => sum"
            " + x, 0))"
        )
        assert colours == dict(zip(("moving", "turning", "total"), ends, strict=True))
        assert sums == pytest.approx([2.0 / 3.0 * sums[2], 1.0 / 3.0 * sums[2], sums[2]])
        page.evaluate("() => granphon.change({ eta: 0 })")
        page.wait_for_function(SETTLED)
        page.wait_for_function("() => bandsView.element.data.length > 1")
        left = page.evaluate(
            "() => bandsView.element.data.slice(1).map((one) => [one.name, one.line.color])"
        )
        assert left == [["total", ends[2]]]  # nothing rotates: no part has a line of its own


def test_a_click_on_a_branch_shows_its_mode(chromium, folder):
    with Visit(chromium, folder / "triangular.html") as page:
        page.wait_for_function(DRAWN)
        at = page.evaluate(
            """() => { const box = document.querySelector(".curves").getBoundingClientRect();
            const n = Math.floor(current.path.points.length / 5);
            const value = current.bands.values[3 * n + 2] * current.unit.scale;
            return [box.left + box.width * current.path.places[n] / current.path.length,
              box.top + box.height * (1 - value / bandsView.axisTop)]; }"""
        )
        page.mouse.click(*at)
        page.wait_for_function("() => granphon.state().branch === 2")
        assert state(page)["place"] == pytest.approx(
            page.evaluate(
                "() => current.path.places[Math.floor(0.2 * current.path.points.length)] /"
                " current.path.length"
            ),
            abs=0.02,
        )
        assert page.inner_text("#mode-words").startswith("Branch 3 of 3")


def test_a_mode_tells_the_q_factor_of_its_losses(chromium, tmp_path):
    losses = BandsSettings(damping=5e-7, loss_factor=0.02, drag=2e3, restitution=0.9)
    balls = replace(BALLS, lattice="square")
    (tmp_path / "losses.html").write_text(
        make_page(balls, (), FORCE, losses=losses), encoding="utf-8"
    )
    with Visit(chromium, tmp_path / "losses.html") as page:
        page.wait_for_function(DRAWN)
        page.evaluate("() => granphon.change({ branch: 2 })")
        page.wait_for_function(SETTLED)
        q = page.evaluate("() => current.path.points[current.selected.point].slice(0, 2)")
        told = [page.inner_text("#mode-words")]
        page.evaluate("() => granphon.change({ overlap: true })")
        page.wait_for_function(SETTLED)
        told.append(page.inner_text("#mode-words"))
    for text, overlap in zip(told, (False, True), strict=True):
        medium = gp.AveragedLattice(balls)
        state = medium.at_force(float(FORCE.array), finite_overlap=overlap)
        exact = gp.Phonons(state).damped([q], **losses.losses).quality[0, 2]
        shown = float(re.search(r", Q ([0-9.]+[0-9])", text)[1])
        assert shown == pytest.approx(exact, rel=6e-3)


def test_balls_move_until_they_are_stopped(chromium, folder):
    with Visit(chromium, folder / "fcc.html") as page:
        page.wait_for_function(DRAWN)
        assert page.evaluate("() => modeView.renderer !== null")
        seen = lambda: page.evaluate("() => [...modeView.mesh.instanceMatrix.array]")  # noqa: E731
        first = seen()
        page.wait_for_function(
            "(first) => modeView.mesh.instanceMatrix.array.some((x, n) => x !== first[n])",
            arg=first,
        )
        page.click("#play")
        page.evaluate(FRAMES, 2)
        stopped = seen()
        page.evaluate(FRAMES, 10)
        assert seen() == stopped
        angles = page.evaluate("() => [...modeView.angles]")
        page.focus("#mode")
        page.keyboard.press("ArrowLeft")
        assert page.evaluate("() => [...modeView.angles]") != angles
    with Visit(chromium, folder / "fcc.html", reduced_motion="reduce") as page:
        assert page.inner_text("#play") == "Move"


def test_every_control_has_a_name_and_the_keyboard_gets_past_all(chromium, folder):
    with Visit(chromium, folder / "triangular.html") as page:
        page.wait_for_function(DRAWN)
        unnamed = page.evaluate(
            """() => [...document.querySelectorAll("input, select, button")].filter((one) =>
            !(one.labels?.length || one.textContent.trim() || one.ariaLabel)).map((one) => one.id)"""
        )
        assert unnamed == []
        wanted = set(
            page.evaluate(
                """() => [...document.querySelectorAll("input, select, button, canvas")]
                .filter((one) => one.offsetParent !== null).map((one) => one.id)"""
            )
        )
        reached: list[str] = []
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.append(page.evaluate("() => document.activeElement.id"))
        assert wanted <= set(reached)
        assert reached.count("theme") >= 2  # it goes round: nothing holds the focus


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_follow_the_system_and_the_switch_and_are_legible(chromium, folder, scheme):
    other = {"light": "dark", "dark": "light"}[scheme]
    with Visit(chromium, folder / "triangular.html", color_scheme=scheme) as page:
        page.wait_for_function(DRAWN)
        theme = lambda: page.evaluate("() => document.documentElement.dataset.theme")  # noqa: E731
        assert theme() == scheme
        colours = page.evaluate(
            "() => Object.fromEntries(['ink', 'soft', 'card', 'accent', 'alarm', 'alarm-back']"
            ".map((name) => [name, themeColour(name)]))"
        )
        for text, back, least in (
            ("ink", "card", 7.0),
            ("soft", "card", 4.5),
            ("accent", "card", 3.0),
            ("alarm", "alarm-back", 4.5),
        ):
            assert contrast(colours[text], colours[back]) >= least, (text, back)
        page.click("#theme")
        assert theme() == other
        page.wait_for_function(SETTLED)
        link = page.evaluate("() => location.hash")
    with Visit(chromium, folder / "triangular.html", link, color_scheme=scheme) as page:
        assert page.evaluate("() => document.documentElement.dataset.theme") == other


def contrast(one: str, other: str) -> float:
    """Ratio of contrast of two colours, by the WCAG."""
    parts = (
        np.array([[int(colour[at : at + 2], 16) for at in (1, 3, 5)] for colour in (one, other)])
        / 255.0
    )
    linear = np.where(parts <= 0.03928, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [
        0.2126,
        0.7152,
        0.0722,
    ]
    return float((linear.max() + 0.05) / (linear.min() + 0.05))


@pytest.mark.parametrize("name", ["chain", "triangular", "fcc"])
def test_it_fits_on_a_telephone(chromium, folder, name):
    with Visit(chromium, folder / f"{name}.html", viewport={"width": 360, "height": 740}) as page:
        page.wait_for_function(DRAWN)
        assert page.evaluate("() => document.documentElement.scrollWidth") <= 360
        written = page.evaluate(
            """() => [...document.querySelectorAll("#bands .main-svg text")].filter((one) => one.textContent.trim())
            .map((one) => [one.textContent, one.getBoundingClientRect()])
            .map(([text, box]) => [text, box.left, box.right, box.top, box.bottom])"""
        )
        assert len(written) > 8
        for (one, *box), (other, *there) in itertools.combinations(written, 2):
            beside = (
                box[1] <= there[0] or there[1] <= box[0] or box[3] <= there[2] or there[3] <= box[2]
            )
            assert beside, f"{one} is written over {other}"
        small = page.evaluate(
            """() => [...document.querySelectorAll("body *")].filter((one) => one.offsetParent && !one.children.length &&
            one.textContent.trim() && parseFloat(getComputedStyle(one).fontSize) < 11).map((one) => one.textContent)"""
        )
        assert small == []
        assert (
            page.evaluate("() => document.getElementById('bands').getBoundingClientRect().width")
            > 280
        )


@pytest.mark.parametrize(
    ("name", "link", "said"),
    [
        ("square", "#eta=0&w=0", "a mechanism"),
        ("square", "#eta=0.01&w=2e-6", "without friction"),
        ("triangular", "#f=0.2&w=1e-5", "is valid from f*"),
        ("chain", "#o=1", "buckles"),
        ("honeycomb", "#eta=0&w=0", "every wave vector"),
    ],
)
def test_a_state_that_cannot_be_is_said(chromium, folder, name, link, said):
    with Visit(chromium, folder / f"{name}.html", link) as page:
        page.wait_for_function(SETTLED)
        assert said in page.inner_text("#problem")
        assert "NaN" not in page.inner_text("body")
        assert "NaN" not in page.inner_html(".curves")
