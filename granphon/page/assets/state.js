// The settings of the page: where they begin, how they are written into the link, and the lattice that they make.

import { makeLattice } from "./lattice.js";
import { findContact, mindlinTorsion } from "./medium.js";

const NUMBERS = { force: "f", width: "w", eta: "eta", torsion: "t", bending: "b", place: "q", branch: "n" };
const SWITCHES = { overlap: "o", mindlin: "m", edges: "e" };

export function startState(data) {
  return { ...data.start, medium: 0, place: 0.3, branch: 0, theme: "", edges: Boolean(data.lattice.sides) };
}

// The part of the link after "#"
export function writeLink(data, state) {
  const query = new URLSearchParams();
  for (const [name, key] of Object.entries(NUMBERS)) query.set(key, String(state[name]));
  for (const [name, key] of Object.entries(SWITCHES)) query.set(key, state[name] ? "1" : "0");
  query.set("motions", state.motions);
  query.set("medium", data.media[state.medium].name);
  if (state.theme) query.set("theme", state.theme);
  return query.toString();
}

// The settings that a link says; what it does not say, or says wrongly, is as at the start
export function readLink(data, text) {
  const state = startState(data);
  const query = new URLSearchParams(text.replace(/^#/, ""));
  for (const [name, key] of Object.entries(NUMBERS)) {
    const value = Number(query.get(key));
    if (query.get(key) !== null && query.get(key) !== "" && Number.isFinite(value)) state[name] = clamp(data, name, value);
  }
  for (const [name, key] of Object.entries(SWITCHES)) if (query.has(key)) state[name] = query.get(key) === "1";
  const motions = data.lattice.motions.find((one) => one.name === query.get("motions"));
  if (motions) state.motions = motions.name;
  const medium = data.media.findIndex((one) => one.name === query.get("medium"));
  if (medium >= 0) state.medium = medium;
  if (["light", "dark"].includes(query.get("theme"))) state.theme = query.get("theme");
  return state;
}

function clamp(data, name, value) {
  const { force, width, eta, rolling } = data.limits;
  const ends = {
    force, width: [0, width], eta: [0, eta], torsion: [0, rolling], bending: [0, rolling], place: [0, 1], branch: [0, 10000],
  }[name];
  const inside = Math.min(Math.max(value, ends[0]), ends[1]);
  return name === "branch" ? Math.round(inside) : inside;
}

// The contact and the lattice at the settings; `problem` is why there are none
export function solveState(data, state) {
  const contact = findContact(data, data.media[state.medium], state.force, state.width, state.eta);
  return { contact, lattice: makeLattice(data.lattice, latticeSettings(data, state, contact)), problem: contact.problem };
}

// What makeLattice() takes, for a contact of findContact()
export function latticeSettings(data, state, contact) {
  if (data.fixed) return { motions: state.motions, ...data.fixed };
  const known = data.lattice.motions.find((one) => one.name === state.motions);
  const { diameter } = data.balls;
  const spacing = state.overlap ? 1 - contact.overlap / diameter : 1;
  const torsion = state.mindlin ? mindlinTorsion(data, state.force, contact.stiffness) : state.torsion;
  return {
    motions: state.motions, eta: state.eta, torsion: known.twist ? torsion : 0,
    bending: known.rotations.length ? state.bending : 0, spacing,
    push: state.overlap ? state.force / (contact.stiffness * diameter * spacing) : 0,
  };
}
