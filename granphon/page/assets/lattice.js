// The lattice of contacts: C(q) from the rows of its contacts, and the frequencies and motions that follow.
// Everything is in reduced units: length d, stiffness k, mass of a ball M. Wave vectors are fractions of the reciprocal cell.

import { addGram, columnLengths, hermitianEigen, singularValues, zeroMatrix } from "./linear_algebra.js";

// a frequency is zero if it is no larger than this multiple of the rounding of its own columns
const ROUNDING = 32 * Number.EPSILON;
const KINDS = ["elongation", "slip", "twist", "roll", "anchor", "anchored turn"];

// The lattice at some settings: {motions, eta, torsion, bending, spacing, push}. `spacing` a/d and `push` f/(k a) are 1 and 0
// without the terms of finite overlap.
export function makeLattice(data, settings) {
  const known = data.motions.find((one) => one.name === settings.motions);
  const present = [settings.eta, settings.torsion, settings.bending].map((one) => (one > 0 ? "1" : "0")).join("");
  const statement = known.statements[present];
  const columns = [...known.translations, ...(statement.rotate ? known.rotations.map((axis) => 3 + axis) : [])];
  const lattice = {
    data, settings, statement, waves: known.waves, twist: known.twist,
    columns, translations: known.translations, rotations: statement.rotate ? known.rotations : [],
    count: columns.length, balls: data.positions.length,
    half: data.contacts.vector.map((vector) => toFractions(data, vector)),
  };
  lattice.branches = lattice.count * lattice.balls;
  lattice.mass = data.masses ? data.masses.reduce((sum, one) => sum + one, 0) : lattice.balls;
  lattice.motion = makeMotion(lattice.balls, data.masses, lattice.mass);
  // one ball has real rows, unless something holds it, or its contacts have arms of two lengths
  lattice.complex = lattice.balls > 1 || data.complex === true;
  const stiffness = { elongation: 1, slip: settings.eta, twist: settings.torsion, roll: settings.bending, push: 1, anchor: 1, "anchored turn": 1 };
  lattice.deforming = weightRows(lattice, KINDS, stiffness);
  lattice.pushing = settings.push ? splitSigns(weightRows(lattice, ["push"], { push: settings.push })) : null;
  return lattice;
}

// Frequencies (ascending) and mass-weighted motions at a wave vector. `squares` has the squared frequencies, which static
// forces can make negative; the frequency is then NaN, and `buckles` says so.
export function solveModes(lattice, fractions) {
  const folded = fractions.slice(0, lattice.data.periods).map((one) => one - Math.round(one));
  if (!lattice.pushing) {
    const rows = computeRows(lattice, lattice.deforming, folded);
    const { values, right } = singularValues(rows);
    clearRounding(lattice, rows, values, right);
    return { values, vectors: right, folded, buckles: false };
  }
  const { stiffness } = makeStiffness(lattice, folded);
  const { values: squares, vectors } = hermitianEigen(stiffness);
  // squares are rounded as multiples of the largest
  const least = ROUNDING * Math.max(Math.abs(squares[0]), Math.abs(squares[squares.length - 1]));
  const values = squares.map((one) => (Math.abs(one) <= least ? 0 : Math.sqrt(one)));
  return { values, vectors, squares, folded, buckles: squares[0] < -least };
}

// The rows of C(q), and D(q) with static forces, of mass-weighted motions
export function makeStiffness(lattice, folded) {
  const rows = computeRows(lattice, lattice.deforming, folded);
  const stiffness = zeroMatrix(lattice.branches, lattice.branches, rows.im !== null);
  addGram(stiffness, rows, 1);
  for (const { sign, pushes } of lattice.pushing ?? []) addGram(stiffness, computeRows(lattice, pushes, folded), -sign);
  return { rows, stiffness };
}

// Part of the kinetic energy of mode `branch` that is rotation
export function rotationalPart(lattice, modes, branch) {
  const first = lattice.translations.length;
  let sum = 0;
  for (let row = 0; row < lattice.branches; row++) {
    if (row % lattice.count < first) continue;
    const at = branch * lattice.branches + row;
    sum += modes.vectors.re[at] ** 2 + (modes.vectors.im ? modes.vectors.im[at] ** 2 : 0);
  }
  return Math.min(sum, 1);
}

// Kinetic energy of each mode at the upper edge of a cut less that at the lower one, -1 to 1. Modes whose frequencies differ by
// less than a ten-thousandth of the highest are those that are most at one edge. In a narrow ribbon waves of the two edges feel
// each other: 2 stands for a mode that has more than four fifths of its energy at both.
export function edgeParts(lattice, modes) {
  const { sides, masses, gyration } = lattice.data;
  const n = lattice.branches;
  const found = new Float64Array(n);
  const motions = Array.from({ length: n }, (_, k) => ballMotions(lattice, modes, k));
  const weight = (ball, axis) => sides[ball] * masses[ball] * (axis < 3 ? 1 : (gyration[ball] ?? gyration) ** 2);
  for (let first = 0; first < n; ) {
    let end = first + 1;
    while (end < n && modes.values[end] - modes.values[end - 1] <= 1e-4 * modes.values[n - 1]) end++;
    const count = end - first;
    const matrix = zeroMatrix(count, count, true);
    for (let a = 0; a < count; a++) {
      for (let b = 0; b < count; b++) {
        sides.forEach((side, ball) => {
          if (!side) return;
          for (let axis = 0; axis < 6; axis++) {
            const [xRe, xIm] = motions[first + a][ball][axis];
            const [yRe, yIm] = motions[first + b][ball][axis];
            matrix.re[b * count + a] += weight(ball, axis) * (xRe * yRe + xIm * yIm);
            matrix.im[b * count + a] += weight(ball, axis) * (xRe * yIm - xIm * yRe);
          }
        });
      }
    }
    found.set(hermitianEigen(matrix).values, first);
    for (let k = first; k < end; k++) {
      const outer = sides.reduce((sum, side, ball) => sum + (side ? motions[k][ball].reduce((all, [re, im], axis) =>
        all + side * weight(ball, axis) * (re * re + im * im), 0) : 0), 0);
      if (outer > 0.8 && Math.abs(found[k]) < 0.6) found[k] = 2;
    }
    first = end;
  }
  return found;
}

// Motion of each ball in mode `branch`: complex u (diameters) and phi (rad) along x, y, z, before the factor exp(i q.r)
export function ballMotions(lattice, modes, branch) {
  const found = [];
  const vector = (row) => {
    const at = branch * lattice.branches + row;
    return [modes.vectors.re[at], modes.vectors.im ? modes.vectors.im[at] : 0];
  };
  for (let ball = 0; ball < lattice.balls; ball++) {
    const motion = Array.from({ length: 6 }, () => [0, 0]);
    lattice.columns.forEach((axis, m) => {
      for (let b = 0; b < lattice.balls; b++) {
        const [re, im] = vector(b * lattice.count + m);
        const weight = lattice.motion[ball][b];
        // rotations are kept divided by i
        motion[axis][0] += weight * (axis < 3 ? re : -im);
        motion[axis][1] += weight * (axis < 3 ? im : re);
      }
    });
    for (let axis = 3; axis < 6; axis++) motion[axis] = motion[axis].map((one) => one / (lattice.data.gyration[ball] ?? lattice.data.gyration));
    found.push(motion);
  }
  return found;
}

// Vector in space (spacings) as multiples of the lattice vectors
function toFractions(data, vector) {
  return Array.from({ length: data.periods }, (_, a) =>
    data.reciprocal[a].reduce((sum, g, axis) => sum + g * vector[axis], 0) / (2 * Math.PI));
}

// Motion of each ball [ball][b] in an orthonormal set of mass-weighted motions, the first of which moves all balls alike.
// Without masses all are one.
function makeMotion(n, masses, total) {
  if (!masses) return makeFrame(n);
  const weights = masses.map((mass) => Math.sqrt(mass / total));
  // the reflection that carries the first axis to the weights
  const normal = weights.map((one, ball) => (ball ? 0 : 1) - one);
  const square = normal.reduce((sum, one) => sum + one * one, 0);
  return masses.map((mass, ball) => Float64Array.from(masses, (_, b) => {
    if (b === 0) return 1 / Math.sqrt(total);
    const reflected = square > 0 ? (2 * normal[ball] * normal[b]) / square : 0;
    return ((ball === b ? 1 : 0) - reflected) / Math.sqrt(mass);
  }));
}

// Orthogonal matrix [ball][b] whose first column moves all balls alike
function makeFrame(n) {
  const frame = Array.from({ length: n }, () => new Float64Array(n));
  for (let ball = 0; ball < n; ball++) {
    frame[ball][0] = 1 / Math.sqrt(n);
    for (let b = 1; b < n; b++) {
      frame[ball][b] = ball < b ? 1 / Math.sqrt(b * (b + 1)) : ball === b ? -b / Math.sqrt(b * (b + 1)) : 0;
    }
  }
  return frame;
}

// Rows of the contacts that static forces press (sign 1), and of those that they pull (-1), each with its sign
function splitSigns(rows) {
  const parts = [1, -1].map((sign) => ({ sign, pushes: rows.filter((row) => row.sign === sign) }));
  return parts.filter((part) => part.pushes.length);
}

// Rows of C(q) of some kinds, times the root of the size of their stiffness, with its sign apart: coefficients of the sine
// and cosine of the half angle.
// Rotations and rows are divided by i, rows of rotations alone and of springs to the ground against displacements once more: then
// those of one ball in the cell are real.
function weightRows(lattice, kinds, stiffness) {
  const { data, settings, motion, count, balls, branches } = lattice;
  const at = (ball, b) => (ball < balls ? motion[ball][b] : 0); // a body that does not move is none of the balls
  const found = [];
  for (const row of data.rows) {
    const weight = stiffness[row.kind];
    if (!kinds.includes(row.kind) || !(Math.abs(weight) > 0)) continue;
    const ofTurns = ["twist", "roll", "anchor"].includes(row.kind);
    data.contacts.i.forEach((i, contact) => {
      const signed = weight * (row.weights ? row.weights[contact] : 1);
      const root = Math.sqrt(Math.abs(signed));
      if (!(root > 0)) return;
      const j = data.contacts.j[contact];
      const gap = new Float64Array(branches);
      const total = new Float64Array(branches);
      lattice.columns.forEach((axis, m) => {
        // the arm of a slip is half the spacing
        const factor = root * (row.kind === "slip" && axis >= 3 ? settings.spacing : 1);
        for (let b = 0; b < balls; b++) {
          const head = factor * row.head[contact][axis] * at(j, b);
          const tail = factor * row.tail[contact][axis] * at(i, b);
          gap[b * count + m] = head - tail;
          total[b * count + m] = head + tail;
        }
      });
      if (gap.some((one) => one !== 0) || total.some((one) => one !== 0)) {
        const real = Uint8Array.from(gap, (_, place) => (lattice.columns[place % count] >= 3) === ofTurns);
        found.push({ contact, gap, total, real, kind: row.kind, row, root, sign: Math.sign(signed) });
      }
    });
  }
  return found;
}

function computeRows(lattice, rows, folded) {
  const m = Math.max(rows.length, 1);
  const n = lattice.branches;
  const found = zeroMatrix(m, n, lattice.complex);
  const sines = lattice.half.map((vector) => Math.PI * vector.reduce((sum, one, a) => sum + one * folded[a], 0));
  const cosines = sines.map(Math.cos);
  sines.forEach((angle, c) => (sines[c] = Math.sin(angle)));
  rows.forEach((row, place) => {
    const sine = sines[row.contact];
    const cosine = cosines[row.contact];
    for (let col = 0; col < n; col++) {
      const at = col * m + place;
      if (row.real[col]) {
        found.re[at] = row.total[col] * sine;
        if (found.im) found.im[at] = -row.gap[col] * cosine;
      } else {
        found.re[at] = row.gap[col] * cosine;
        if (found.im) found.im[at] = row.total[col] * sine;
      }
    }
  });
  return found;
}

// Set to zero the frequencies that are the rounding of their own columns
function clearRounding(lattice, rows, values, right) {
  const n = values.length;
  let lengths = null;
  for (let k = 0; k < n; k++) {
    if (k < lattice.statement.free) {
      values[k] = 0;
      continue;
    }
    if (values[k] === 0 || values[k] > 1e-10 * values[n - 1]) continue;
    lengths ??= columnLengths(rows);
    let sum = 0;
    for (let row = 0; row < n; row++) {
      const size = right.re[k * n + row] ** 2 + (right.im ? right.im[k * n + row] ** 2 : 0);
      sum += lengths[row] ** 2 * size;
    }
    if (values[k] <= ROUNDING * Math.sqrt(sum)) values[k] = 0;
  }
}
