// The page: settings in, pictures and numbers out. Each change asks for one redraw in the next frame; when the page has been
// still for a moment, the path is made finer and the density of states follows.

import { BandsView, drawVelocities } from "./bands_view.js";
import { makeList, makeSlider, makeSwitch } from "./controls.js";
import { findLosses, findQuality } from "./damping.js";
import { ballMotions, makeLattice, rotationalPart, solveModes } from "./lattice.js";
import { elasticTensor, soundVelocities } from "./long_waves.js";
import { findContact } from "./medium.js";
import { ModeView } from "./mode_view.js";
import { drawNumbers, findSound, followSound, printVelocity } from "./numbers_view.js";
import { makePath } from "./path.js";
import { computeBands, gatherStates } from "./spectrum.js";
import { readLink, solveState, startState, writeLink } from "./state.js";
import { setTheme } from "./theme.js";
import { choosePrefix, printNumber, printQuantity } from "./units.js";
import { drawZone } from "./zone_view.js";

// Points of the path while a slider moves, by the number of branches, and when the page is still
const QUICK = (branches) => Math.max(12, Math.min(150, Math.round(900 / branches)));
const FINE = (branches) => Math.max(40, Math.min(300, Math.round(6000 / branches)));
const REST = 180; // ms
const MOTIONS = { longitudinal: "along the line", in_plane: "in the plane", out_of_plane: "out of the plane", all: "all six" };

const byId = (id) => document.getElementById(id);
const data = JSON.parse(byId("data").textContent);
let state = readLink(data, location.hash);
let current = null;
let asked = false;
let rest = 0;
let cancelStates = () => {};

setTheme(state.theme);
const bandsView = new BandsView(byId("bands"), (point, branch) => {
  change({ place: current.path.places[point] / current.path.length, branch });
});
const modeView = new ModeView(byId("mode"), data.lattice, data.kinds ?? []);
for (const { name, colour } of data.kinds ?? []) {
  const mark = document.createElement("span");
  mark.className = "kind";
  mark.style.background = colour;
  byId("kinds").append(mark, name);
}
const controls = makeControls();
listen();
redraw();

function change(values) {
  Object.assign(state, values);
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    redraw();
  });
}

// Compute and draw everything that is quick; returns the time that it took, ms
function redraw(points = null) {
  const begun = performance.now();
  clearTimeout(rest);
  cancelStates();
  const { contact, lattice, problem } = solveState(data, state);
  showControls(lattice);
  state.branch = Math.min(state.branch, lattice.branches - 1);
  const path = makePath(data.lattice, points ?? QUICK(lattice.branches));
  const hertz = Math.sqrt(contact.stiffness / data.balls.mass) / (2 * Math.PI);
  let bands = { values: new Float64Array(0), turning: new Float64Array(0), branches: 0, buckles: -1 };
  if (!problem) bands = computeBands(lattice, path.points);
  const top = bands.values.reduce((most, one) => (one > most ? one : most), 0);
  const [prefix, size] = choosePrefix(top * hertz || hertz);
  const unit = { name: `${prefix}Hz`, scale: hertz / size, hertz };
  const selected = { point: nearestPoint(path), branch: state.branch };
  const byEdge = Boolean(state.edges && bands.edges);
  current = { contact, lattice, path, bands, unit, selected, top, byEdge, dos: null };
  bandsView.draw(current);
  if (!problem) drawMode();
  const sound = problem ? [] : findSound(data, contact, lattice);
  current.sound = sound;
  if (problem) byId("numbers").tBodies[0].innerHTML = "";
  else drawNumbers(byId("numbers"), data, state, contact, lattice, sound);
  showProblems(problem, bands, path, lattice);
  const taken = performance.now() - begun;
  rest = setTimeout(settle, REST);
  return taken;
}

// The page is still: a finer path, the density of states, velocities over load, the link, and words for a screen reader
function settle() {
  const { lattice, contact, unit, top, sound } = current;
  history.replaceState(null, "", `#${writeLink(data, state)}`);
  if (contact.problem) {
    drawVelocities(byId("velocities"), followSound(data, state), state.force, []);
    return;
  }
  current.path = makePath(data.lattice, FINE(lattice.branches));
  current.bands = computeBands(lattice, current.path.points);
  current.selected = { point: nearestPoint(current.path), branch: state.branch };
  bandsView.draw(current, true);
  drawMode();
  if (!data.fixed) drawVelocities(byId("velocities"), followSound(data, state), state.force, sound.map(([, value]) => value));
  byId("spoken").textContent = `${data.fixed ? "" : `Force ${printQuantity(state.force, "N")}. `}Top frequency ${printNumber(top * unit.scale)} ${unit.name}. ` +
    sound.map(([name, value]) => `${name} ${printVelocity(value)}`).join(". ") +
    `. ${byId("mode-words").textContent}`;
  cancelStates = gatherStates(lattice, top, (dos) => {
    current.dos = dos;
    bandsView.draw(current, true);
    byId("dos-help").textContent = `Right: states per ball and ${unit.name}, from ${dos.points} wave vectors` +
      (lattice.rotations.length ? ": displacement and rotation in the colours of the bands, and their sum in that of the text." : ".");
  });
}

function nearestPoint(path) {
  const at = state.place * path.length;
  let best = 0;
  path.places.forEach((place, n) => (best = Math.abs(place - at) < Math.abs(path.places[best] - at) ? n : best));
  return best;
}

function drawMode() {
  const { lattice, path, selected, unit } = current;
  const q = path.points[selected.point];
  const modes = solveModes(lattice, q);
  modeView.show(ballMotions(lattice, modes, selected.branch), modes.folded,
    lattice.translations.some((axis) => axis >= data.lattice.periods));
  drawZone(byId("zone"), data.lattice, q);
  const value = modes.values[selected.branch] * unit.scale;
  const turning = Math.round(100 * rotationalPart(lattice, modes, selected.branch));
  byId("mode-words").textContent = `Branch ${selected.branch + 1} of ${lattice.branches} at q = (` +
    `${q.slice(0, data.lattice.periods).map((one) => one.toFixed(3)).join(", ")}): ` +
    (Number.isNaN(value) ? "it buckles" : `${printNumber(value)} ${unit.name}, ${turning} % of the energy in rotation`) +
    printQuality(modes, selected.branch) +
    (modeView.renderer ? "" : ". This browser has no WebGL, which the moving picture needs");
}

function printQuality(modes, branch) {
  const { contact, lattice, unit } = current;
  const losses = findLosses(data, contact.stiffness, lattice.settings.eta);
  if (!losses || !(modes.values[branch] > 0)) return "";
  const quality = findQuality(lattice, modes, branch, losses, 2 * Math.PI * unit.hertz);
  return `, Q ${Number.isFinite(quality) ? printNumber(quality, 3) : "∞"}`;
}

function showProblems(problem, bands, path, lattice) {
  const words = problem ? [problem] : [];
  if (!problem && lattice.statement.mechanism) {
    words.push(`At these settings the lattice is a mechanism, and has neither sound velocities nor moduli: ${lattice.statement.mechanism}.`);
  }
  if (!problem) words.push(...lattice.statement.warnings.map((one) => `${one}.`));
  if (bands.buckles >= 0) {
    const q = path.points[bands.buckles].slice(0, data.lattice.periods).map((one) => one.toFixed(3)).join(", ");
    words.push(`The lattice buckles: with finite overlap a squared frequency is negative, first at q = (${q}); it is not drawn.`);
  }
  const medium = data.media[state.medium];
  if (!problem && state.width > 0 && current.contact.reduced < medium.valid) {
    const least = (medium.valid / current.contact.reduced) * state.force;
    words.push(`The ${medium.words} is valid from ${printQuantity(least, "N", 3)} at this width; the load is ${printQuantity(state.force, "N", 3)}.`);
  }
  const said = words.join(" ");
  // written only when it changes, as a screen reader says what is written
  if (byId("problem").textContent !== said) byId("problem").textContent = said;
  byId("problem").hidden = !said;
}

function makeControls() {
  const form = byId("settings");
  const { limits, lattice } = data;
  const sliders = {
    force: { label: "Load: force of a contact", min: limits.force[0], max: limits.force[1], log: true, print: (x) => printQuantity(x, "N", 3) },
    width: { label: "Width of the spread, W", min: 0, max: limits.width, print: (x) => (x ? printQuantity(x, "m", 3) : "0, equal balls") },
    eta: { label: "Friction, η = κ/k", min: 0, max: limits.eta, print: (x) => printNumber(x, 3) },
    torsion: { label: "Torsion over k d²", min: 0, max: limits.rolling, print: (x) => printNumber(x, 3) },
    bending: { label: "Bending over k d²", min: 0, max: limits.rolling, print: (x) => printNumber(x, 3) },
  };
  const found = {};
  found.motions = makeList(form, "motions", "Motions of a ball", lattice.motions.map(({ name }) => [name, MOTIONS[name]]), (motions) => change({ motions }));
  found.medium = makeList(form, "medium", "Medium", data.media.map(({ words, name }, n) => [n, `${words} (${name})`]), (medium) => change({ medium: Number(medium) }));
  for (const [name, spec] of Object.entries(sliders)) {
    found[name] = makeSlider(form, { name, ...spec }, (value) => change({ [name]: value, ...(name === "torsion" ? { mindlin: false } : {}) }));
  }
  found.mindlin = makeSwitch(form, "mindlin", "Torsion of contacts that do not slip", (mindlin) => change({ mindlin }));
  found.overlap = makeSwitch(form, "overlap", "Finite overlap (spacing, lever arm, static forces)", (overlap) => change({ overlap }));
  const picker = byId("picker");
  found.edges = makeSwitch(picker, "edges", "Colour by edge, not by rotation", (edges) => change({ edges }));
  found.place = makeSlider(picker, { name: "place", label: "Wave vector along the path", min: 0, max: 1, print: printPlace }, (place) => change({ place }));
  const most = Math.max(...lattice.motions.map((one) => one.translations.length + one.rotations.length)) * lattice.positions.length;
  found.branch = makeSlider(picker, { name: "branch", label: "Branch", min: 0, max: most - 1, steps: most - 1, print: (x) => String(Math.round(x) + 1) },
    (branch) => change({ branch: Math.round(branch) }));
  return found;
}

function printPlace(place) {
  const path = makePath(data.lattice, 40);
  const after = path.ticks.findIndex((one) => one.at >= place * path.length - 1e-9);
  const at = path.ticks[Math.max(after, 0)];
  if (Math.abs(at.at - place * path.length) < 0.004 * path.length) return at.label;
  return `${path.ticks[after - 1].label} to ${at.label}`;
}

function showControls(lattice) {
  if (data.fixed) { // there is nothing to set but the mode
    for (const [name, control] of Object.entries(controls)) {
      control.show(state[name]);
      control.field.hidden = !["place", "branch", ...(data.lattice.sides ? ["edges"] : [])].includes(name);
    }
    const byEdge = Boolean(data.lattice.sides && state.edges);
    const [low, scale, high] = byId("legend").children;
    [low.textContent, high.textContent] = byEdge ? ["lower edge", "upper edge, dark: both"] : ["displacement", "rotation"];
    scale.classList.toggle("edges", byEdge);
    byId("legend").hidden = !lattice.rotations.length && !byEdge;
    document.querySelector("main").classList.add("fixed");
    for (const part of ["settings", "velocities"]) byId(part).closest(".card").hidden = true;
    return;
  }
  for (const [name, control] of Object.entries(controls)) control.show(state[name]);
  controls.edges.field.hidden = true;
  const known = data.lattice.motions.find((one) => one.name === state.motions);
  const medium = data.media[state.medium];
  const spreads = data.lattice.periods > 1 && !medium.refusal && (medium.table || data.start.width > 0);
  controls.width.field.hidden = !spreads;
  controls.medium.field.hidden = data.media.length < 2;
  controls.torsion.field.hidden = !known.twist;
  controls.mindlin.field.hidden = !known.twist;
  controls.bending.field.hidden = !known.rotations.length;
  byId("legend").hidden = !lattice.rotations.length;
  const notes = [];
  if (medium.refusal) notes.push(`There is no slider for the width: ${medium.refusal}`);
  else if (medium.table) {
    notes.push(`Balls that differ: ${medium.words}, ${data.balls.spread} distribution, computed beforehand. Interpolated stiffnesses are` +
      ` right to ${printNumber(medium.error, 2)} at the scene's friction` + (medium.friction_error > medium.error
      ? `, and to ${printNumber(medium.friction_error, 2)} at others.` : "."), medium.note);
  } else if (medium.note) notes.push(medium.note);
  byId("notes").textContent = notes.join(" ");
}

function listen() {
  byId("remarks").append(...data.remarks.map((text) => Object.assign(document.createElement("p"), { textContent: text, className: "small" })));
  const theme = byId("theme");
  const showTheme = () => (theme.textContent = document.documentElement.dataset.theme === "dark" ? "Light colours" : "Dark colours");
  const applyTheme = () => {
    setTheme(state.theme);
    showTheme();
    modeView.recolour();
    redraw();
  };
  theme.addEventListener("click", () => {
    state.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    applyTheme();
  });
  showTheme();
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", applyTheme);
  byId("copy").addEventListener("click", async () => {
    history.replaceState(null, "", `#${writeLink(data, state)}`);
    let said = "The link is in the address line";
    try {
      await navigator.clipboard.writeText(location.href);
      said = "Link copied";
    } catch {
      // a page from a file may not write to the clipboard: the address line has the link
    }
    byId("copy").textContent = said;
    byId("spoken").textContent = said;
    setTimeout(() => (byId("copy").textContent = "Copy link"), 2500);
  });
  byId("reset").addEventListener("click", () => change({ ...startState(data), theme: state.theme }));
  addEventListener("hashchange", () => {
    const text = location.hash.slice(1);
    if (text === writeLink(data, state)) return;
    state = readLink(data, text);
    applyTheme();
  });
  const play = byId("play");
  const setPlaying = (playing) => {
    modeView.playing = playing;
    play.textContent = playing ? "Stop" : "Move";
  };
  play.addEventListener("click", () => setPlaying(!modeView.playing));
  setPlaying(!matchMedia("(prefers-reduced-motion: reduce)").matches);
  byId("speed").addEventListener("input", (event) => (modeView.speed = 0.1 * 100 ** (event.target.value / 100)));
  for (const form of document.forms) form.addEventListener("submit", (event) => event.preventDefault());
}

// What tests and curious readers may call: the same functions as the page
globalThis.granphon = { data, makeLattice, solveModes, soundVelocities, elasticTensor, findContact, change, redraw, state: () => state };
