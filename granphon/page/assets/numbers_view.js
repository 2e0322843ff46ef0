// The table of the state, its sound and its moduli.

import { elasticTensor, gradientStiffness, soundVelocities, voigtMeans, voigtNames } from "./long_waves.js";
import { latticeSettings } from "./state.js";
import { findContact } from "./medium.js";
import { makeLattice } from "./lattice.js";
import { printNumber, printQuantity } from "./units.js";
import { escapeText } from "./zone_view.js";

const WAVES = {
  longitudinal: "longitudinal", transverse: "transverse", transverse_slow: "transverse, slow", transverse_fast: "transverse, fast",
  out_of_plane: "out of plane",
};

// Velocities, m/s, by the names of the waves: [[name, value]]; values are null where the lattice is a mechanism
export function findSound(data, contact, lattice) {
  const scale = data.balls.diameter * Math.sqrt(contact.stiffness / data.balls.mass);
  const found = lattice.statement.mechanism ? [] : soundVelocities(lattice, data.direction);
  const names = lattice.waves;
  if (!found.length) return names.map((name) => [WAVES[name] ?? name, null]);
  // the (quasi-)longitudinal wave has most of its displacement along the direction, that out of the plane most across it; the
  // others ascend
  const rest = [...found];
  const take = (part) => {
    let at = 0;
    rest.forEach((one, n) => (at = one[part] > rest[at][part] ? n : at));
    return rest.splice(at, 1)[0].velocity * scale;
  };
  const named = { longitudinal: "longitudinal", out_of_plane: "across" };
  const taken = new Map(names.filter((name) => named[name]).map((name) => [name, take(named[name])]));
  return names.map((name) => [WAVES[name] ?? name, taken.get(name) ?? rest.shift().velocity * scale]);
}

// Velocities over the force: {forces, lines: [{name, values}]}
export function followSound(data, state) {
  const [low, high] = data.limits.force;
  const forces = Array.from({ length: 41 }, (_, n) => low * (high / low) ** (n / 40));
  const lines = [];
  let reduced = null;
  const kept = [];
  for (const force of forces) {
    const now = { ...state, force };
    const contact = findContact(data, data.media[state.medium], force, state.width, state.eta);
    if (contact.problem) continue;
    // without finite overlap and the torsion of Hertz contacts, velocities follow the stiffness alone
    if (!reduced || state.overlap || state.mindlin) {
      reduced = { sound: findSound(data, contact, makeLattice(data.lattice, latticeSettings(data, now, contact))), contact };
    }
    const factor = Math.sqrt(contact.stiffness / reduced.contact.stiffness);
    kept.push(force);
    reduced.sound.forEach(([name, value], n) => {
      lines[n] ??= { name, values: [] };
      lines[n].values.push(value === null || Number.isNaN(value) || value === 0 ? null : value * factor);
    });
  }
  return { forces: kept, lines: lines.filter((line) => line.values.some((one) => one !== null)) };
}

export function drawNumbers(element, data, state, contact, lattice, sound) {
  const facts = data.facts?.map((pair) => pair.map(escapeText)) ?? listFacts(data, state, contact, lattice);
  const rows = [
    ["head", data.fixed ? "Network" : "State"],
    ...facts,
    ["head", `Sound along (${data.direction.map((one) => printNumber(one, 3)).join(", ")})`],
    ...sound.map(([name, value]) => [name, printVelocity(value)]),
    ...listModuli(data, contact, lattice),
  ];
  element.tBodies[0].innerHTML = rows.map(([name, value]) =>
    name === "head" ? `<tr class="head"><th colspan="2" scope="colgroup">${value}</th></tr>`
      : `<tr><th scope="row">${name}</th><td>${value}</td></tr>`).join("");
}

// What is said of the state of a contact
function listFacts(data, state, contact, lattice) {
  const { diameter } = data.balls;
  return [
    ["Force of a contact, f", printQuantity(state.force, "N")],
    ["Pressure, P", printPressure(data, state, lattice)],
    ["Overlap, δ", printQuantity(contact.overlap, "m")],
    ["Overlap over diameter, δ/d", printNumber(contact.overlap / diameter)],
    ["Normal stiffness, k", printQuantity(contact.stiffness, "N/m")],
    ["Shear stiffness, κ = ηk", printQuantity(state.eta * contact.stiffness, "N/m")],
    ["Torsion over k d²", printNumber(lattice.settings.torsion)],
    ["Reduced force, f*", Number.isFinite(contact.reduced) ? printNumber(contact.reduced) : "∞ (equal balls)"],
    ["Local exponent, d log v / d log P", state.overlap ? "left out with finite overlap" : printNumber(contact.exponent)],
  ];
}

export function printVelocity(value) {
  if (value === null) return "none: a mechanism";
  return Number.isNaN(value) ? "none: it buckles" : printQuantity(value, "m/s");
}

function printPressure(data, state, lattice) {
  if (data.pressure === null) return "the stress is not a pressure";
  const shrunk = lattice.settings.spacing ** (data.lattice.periods - 1);
  return printQuantity((data.pressure * state.force) / shrunk, data.units.pressure);
}

function listModuli(data, contact, lattice) {
  const c = lattice.statement.mechanism ? null : elasticTensor(lattice, gradientStiffness(lattice));
  if (!c) return [];
  const scale = contact.stiffness * data.balls.diameter ** { 1: 1, 2: -1, 3: -1 }[data.lattice.periods];
  const print = (value) => printQuantity(value * scale, data.units.modulus);
  const names = voigtNames(data.lattice.periods);
  const largest = Math.max(...c.flat().map(Math.abs));
  const means = voigtMeans(c);
  const rows = [["head", "Moduli"]];
  if (means.shear !== null) rows.push(["Bulk modulus (Voigt's mean)", print(means.bulk)], ["Shear modulus (Voigt's mean)", print(means.shear)]);
  const same = new Map();
  c.forEach((row, i) => row.forEach((value, j) => {
    if (j < i || Math.abs(value) < 1e-10 * largest) return;
    const key = value.toPrecision(9);
    same.set(key, [...(same.get(key) ?? []), `C<sub>${names[i]},${names[j]}</sub>`]);
  }));
  for (const [key, list] of same) rows.push([list.slice(0, 3).join(" = ") + (list.length > 3 ? " = …" : ""), print(Number(key))]);
  return rows;
}
