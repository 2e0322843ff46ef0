// A mode of contacts and balls that lose energy: its complex frequency, from the one without losses.
//
// A motion exp(i omega t) obeys A x = 0, A = D + i H + i omega G - omega². H and G are made of the rows of contacts as D is, each
// with its loss factor or the time of its dashpots, and G has the drag of balls besides. Springs to the ground lose nothing.

import { makeStiffness } from "./lattice.js";
import { addGram, zeroMatrix } from "./linear_algebra.js";

const MOST_STEPS = 50;
// change of a frequency, over the frequency, at which it stands
const STANDS = 1e-12;
// rate of decay, over the angular frequency, that is rounding
const DECAY_ROUNDING = 1e-13;

// Loss factors and times, s, of contacts at a stiffness (N/m), each [of normal motion, of other motion], and the drag of balls,
// 1/s, [of displacements, of rotations]; null without losses. A dashpot has the viscosity c_0 + tsuji (m k/2)^(1/2).
export function findLosses(data, stiffness, eta) {
  if (!data.losses) return null;
  const { factors, damping, dashpot, tsuji, drag } = data.losses;
  const root = tsuji * Math.sqrt(0.5 * data.balls.mass * stiffness);
  const times = damping.map((ofContacts, part) => {
    const resisting = part ? eta * stiffness : stiffness;
    return ofContacts.map((tau) => tau + (resisting > 0 ? (dashpot[part] + root) / resisting : 0));
  });
  return { factors, times, drag };
}

// Q of mode `branch` with losses; `angular` is the unit of angular frequency, 1/s. Newton's method for A x = 0 begins at the mode
// without losses, at which the frequency is right where all motions lose alike.
export function findQuality(lattice, modes, branch, losses, angular) {
  const n = lattice.branches;
  const { rows, stiffness } = makeStiffness(lattice, modes.folded);
  const lossy = lattice.deforming.map((row) => (row.kind === "elongation" ? 0 : row.kind.startsWith("anchor") ? null : 1));
  const gram = (values, unit) => addLossy(lattice, rows, lossy.map((part, place) =>
    (part === null ? 0 : unit * pick(values[part], lattice.deforming[place].contact))));
  const hysteretic = gram(losses.factors, 1);
  const viscous = gram(losses.times, angular);
  for (let k = 0; k < n; k++) viscous.re[k * n + k] += losses.drag[lattice.columns[k % lattice.count] < 3 ? 0 : 1] / angular;
  let x = { re: modes.vectors.re.slice(branch * n, (branch + 1) * n), im: modes.vectors.im?.slice(branch * n, (branch + 1) * n) ?? new Float64Array(n) };
  const creep = 0.5 * average(viscous, x);
  const square = [average(stiffness, x) - creep * creep, average(hysteretic, x)];
  const size = Math.hypot(...square);
  const real = Math.sqrt(Math.max(0, 0.5 * (size + square[0])));
  let omega = [real, creep + (real ? square[1] / (2 * real) : Math.sqrt(size))];
  for (let step = 0; step < MOST_STEPS; step++) {
    const slope = applySlope(viscous, omega, x);
    const next = solve(makeMatrix(stiffness, hysteretic, viscous, omega), slope);
    if (!next) break;
    const length = dot(x, x)[0];
    const change = divide([length, 0], dot(x, next));
    if (!change.every(Number.isFinite)) break;
    omega = [omega[0] - change[0], omega[1] - change[1]];
    const norm = Math.sqrt(dot(next, next)[0]);
    x = { re: next.re.map((one) => one / norm), im: next.im.map((one) => one / norm) };
    if (Math.hypot(...change) <= STANDS * Math.hypot(...omega)) break;
  }
  return omega[1] > DECAY_ROUNDING * omega[0] ? omega[0] / (2 * omega[1]) : Infinity;
}

const pick = (values, contact) => values[values.length > 1 ? contact : 0];
const divide = ([a, b], [c, d]) => [(a * c + b * d) / (c * c + d * d), (b * c - a * d) / (c * c + d * d)];

// C^H W C of the rows of contacts with weights w, zero or above
function addLossy(lattice, rows, weights) {
  const scaled = { ...rows, re: rows.re.slice(), im: rows.im?.slice() ?? null };
  for (const part of [scaled.re, scaled.im]) {
    part?.forEach((one, at) => (part[at] = one * Math.sqrt(weights[at % rows.rows] ?? 0)));
  }
  const found = zeroMatrix(lattice.branches, lattice.branches, rows.im !== null);
  addGram(found, scaled, 1);
  return found;
}

// x^H y of complex vectors
function dot(x, y) {
  let re = 0;
  let im = 0;
  for (let k = 0; k < x.re.length; k++) {
    re += x.re[k] * y.re[k] + x.im[k] * y.im[k];
    im += x.re[k] * y.im[k] - x.im[k] * y.re[k];
  }
  return [re, im];
}

function multiply(matrix, x) {
  const n = matrix.cols;
  const found = { re: new Float64Array(n), im: new Float64Array(n) };
  for (let col = 0; col < n; col++) {
    for (let row = 0; row < n; row++) {
      const re = matrix.re[col * n + row];
      const im = matrix.im ? matrix.im[col * n + row] : 0;
      found.re[row] += re * x.re[col] - im * x.im[col];
      found.im[row] += re * x.im[col] + im * x.re[col];
    }
  }
  return found;
}

// x^H M x of a Hermitian matrix and a vector of length one
const average = (matrix, x) => dot(x, multiply(matrix, x))[0];

// dA/domega x = (i G - 2 omega) x
function applySlope(viscous, omega, x) {
  const found = multiply(viscous, x);
  return {
    re: found.im.map((one, k) => -one - 2 * (omega[0] * x.re[k] - omega[1] * x.im[k])),
    im: found.re.map((one, k) => one - 2 * (omega[0] * x.im[k] + omega[1] * x.re[k])),
  };
}

// A = D + i H + i omega G - omega², its rows one after the other, complex
function makeMatrix(stiffness, hysteretic, viscous, [a, b]) {
  const n = stiffness.cols;
  return Array.from({ length: n }, (_, row) => {
    const re = new Float64Array(n);
    const im = new Float64Array(n);
    for (let col = 0; col < n; col++) {
      const at = col * n + row;
      const [d, h, g] = [stiffness, hysteretic, viscous].map((one) => [one.re[at], one.im ? one.im[at] : 0]);
      re[col] = d[0] - h[1] - b * g[0] - a * g[1];
      im[col] = d[1] + h[0] + a * g[0] - b * g[1];
    }
    re[row] -= a * a - b * b;
    im[row] -= 2 * a * b;
    return { re, im };
  });
}

// Solution of A x = y by elimination with pivots; null of a matrix that is singular to the last digit. A is overwritten.
function solve(rows, y) {
  const n = rows.length;
  const right = rows.map((row, k) => [y.re[k], y.im[k], row]);
  for (let k = 0; k < n; k++) {
    let best = k;
    for (let r = k + 1; r < n; r++) {
      if (Math.hypot(right[r][2].re[k], right[r][2].im[k]) > Math.hypot(right[best][2].re[k], right[best][2].im[k])) best = r;
    }
    [right[k], right[best]] = [right[best], right[k]];
    const [yRe, yIm, pivot] = right[k];
    if (!(Math.hypot(pivot.re[k], pivot.im[k]) > 0)) return null;
    for (let r = k + 1; r < n; r++) {
      const row = right[r][2];
      const [re, im] = divide([row.re[k], row.im[k]], [pivot.re[k], pivot.im[k]]);
      if (re === 0 && im === 0) continue;
      for (let col = k; col < n; col++) {
        row.re[col] -= re * pivot.re[col] - im * pivot.im[col];
        row.im[col] -= re * pivot.im[col] + im * pivot.re[col];
      }
      right[r][0] -= re * yRe - im * yIm;
      right[r][1] -= re * yIm + im * yRe;
    }
  }
  const x = { re: new Float64Array(n), im: new Float64Array(n) };
  for (let k = n - 1; k >= 0; k--) {
    let [re, im, row] = right[k];
    for (let col = k + 1; col < n; col++) {
      re -= row.re[col] * x.re[col] - row.im[col] * x.im[col];
      im -= row.re[col] * x.im[col] + row.im[col] * x.re[col];
    }
    [x.re[k], x.im[k]] = divide([re, im], [row.re[k], row.im[k]]);
  }
  return x;
}
