// Long waves: the elastic tensor and the velocities of sound, with rotations and inner motions relaxed. Reduced units.

import { addGram, hermitianEigen, zeroMatrix } from "./linear_algebra.js";

// an inner motion whose effect on the contacts is this small beside that of its own column is one of those before
const DEPENDENT = 1e-9;
const VOIGT = { 1: [[0, 0]], 2: [[0, 0], [1, 1], [0, 1]], 3: [[0, 0], [1, 1], [2, 2], [1, 2], [0, 2], [0, 1]] };

export function voigtNames(periods) {
  return VOIGT[periods].map(([a, b]) => "xyz"[a] + "xyz"[b]);
}

// Velocities along a unit vector, ascending, d (k/M)^1/2, each with the parts of its displacement along the vector and across
// the periods; NaN where the static forces make a squared velocity negative
export function soundVelocities(lattice, direction, stiffness = gradientStiffness(lattice)) {
  const { translations, data } = lattice;
  const p = data.periods;
  const n = translations.length;
  const tensor = zeroMatrix(n, n, false);
  for (let i = 0; i < n; i++) {
    for (let k = 0; k < n; k++) {
      for (let j = 0; j < p; j++) {
        for (let l = 0; l < p; l++) {
          tensor.re[k * n + i] += (stiffness.re[(k * p + l) * n * p + i * p + j] * direction[j] * direction[l]) / lattice.mass;
        }
      }
    }
  }
  const { values, vectors } = hermitianEigen(tensor);
  const rounding = 1e-14 * Math.max(...Array.from(values, Math.abs));
  return [...values].map((square, wave) => {
    let along = 0;
    let across = 0;
    translations.forEach((axis, i) => {
      const one = vectors.re[wave * n + i];
      if (axis < p) along += one * direction[axis];
      else across += one * one;
    });
    return { velocity: Math.abs(square) <= rounding ? 0 : Math.sqrt(square), longitudinal: along * along, across };
  });
}

// Elastic tensor in Voigt order, an array of rows, in units of k d^(2-p); null if the balls do not move along the lattice.
// Under static forces these are the coefficients between Cauchy stress and strain.
export function elasticTensor(lattice, stiffness = gradientStiffness(lattice)) {
  const { translations, data, settings } = lattice;
  const p = data.periods;
  const own = Array.from({ length: p }, (_, axis) => translations.indexOf(axis));
  if (own.includes(-1)) return null;
  const measure = data.measure * settings.spacing ** p;
  const side = translations.length * p;
  const h = (i, j, k, l) => stiffness.re[(own[k] * p + l) * side + own[i] * p + j] / measure;
  const stress = (a, b) => (settings.push ? (-settings.push * pull(lattice, a, b)) / measure : 0);
  const one = (a, b) => (a === b ? 1 : 0);
  const c = (i, j, k, l) =>
    h(i, j, k, l) - 0.5 * stress(j, l) * one(i, k) +
    0.5 * (stress(i, k) * one(j, l) + stress(i, l) * one(j, k) + stress(j, k) * one(i, l)) - stress(i, j) * one(k, l);
  return VOIGT[p].map(([i, j]) =>
    VOIGT[p].map(([k, l]) => 0.25 * (c(i, j, k, l) + c(j, i, k, l) + c(i, j, l, k) + c(j, i, l, k))));
}

// Means over directions of the bulk and the shear modulus by Voigt, exact where sound is isotropic
export function voigtMeans(c) {
  if (c.length === 1) return { bulk: c[0][0], shear: null };
  if (c.length === 3) {
    return {
      bulk: (c[0][0] + c[1][1] + 2 * c[0][1]) / 4,
      shear: (c[0][0] + c[1][1] - 2 * c[0][1] + 4 * c[2][2]) / 8,
    };
  }
  const even = c[0][0] + c[1][1] + c[2][2];
  const mixed = c[0][1] + c[0][2] + c[1][2];
  return { bulk: (even + 2 * mixed) / 9, shear: (even - mixed + 3 * (c[3][3] + c[4][4] + c[5][5])) / 15 };
}

// Second derivative of the energy of a cell with respect to the displacement gradient u_i,j, with inner motions relaxed:
// a real symmetric matrix over pairs (i, j)
export function gradientStiffness(lattice) {
  const { translations, data } = lattice;
  const p = data.periods;
  const size = translations.length * p;
  const inner = lattice.branches - translations.length;
  const joined = uniformRows(lattice, lattice.deforming);
  if (!lattice.pushing) {
    relaxRows(joined, size);
    const found = zeroMatrix(size, size, false);
    const kept = { rows: joined.rows, cols: size, re: joined.re.subarray(0, joined.rows * size), im: null };
    addGram(found, kept, 1);
    return clearAcross(lattice, found);
  }
  const all = zeroMatrix(size + inner, size + inner, false);
  addGram(all, joined, 1);
  for (const { sign, pushes } of lattice.pushing) addGram(all, uniformRows(lattice, pushes), -sign);
  return clearAcross(lattice, eliminate(all, size));
}

// Deformations at q = 0 under each displacement gradient, and under each inner motion
function uniformRows(lattice, rows) {
  const { translations, data, settings } = lattice;
  const p = data.periods;
  const size = translations.length * p;
  const first = translations.length;
  const inner = lattice.branches - first;
  const found = zeroMatrix(Math.max(rows.length, 1), size + inner, false);
  rows.forEach((row, place) => {
    const vector = data.contacts.vector[row.contact];
    translations.forEach((axis, i) => {
      for (let j = 0; j < p; j++) {
        found.re[(i * p + j) * found.rows + place] = row.root * row.row.head[row.contact][axis] * vector[j] * settings.spacing;
      }
    });
    for (let k = 0; k < inner; k++) found.re[(size + k) * found.rows + place] = row.gap[first + k];
  });
  return found;
}

// Take from the first `size` columns, in place, what the others can take up
function relaxRows(a, size) {
  const m = a.rows;
  const dot = (x, y) => {
    let sum = 0;
    for (let k = 0; k < m; k++) sum += a.re[x * m + k] * a.re[y * m + k];
    return sum;
  };
  const subtract = (x, y, factor) => {
    for (let k = 0; k < m; k++) a.re[x * m + k] -= factor * a.re[y * m + k];
  };
  const basis = [];
  const rest = [];
  let largest = 0;
  for (let col = size; col < a.cols; col++) {
    const length = Math.sqrt(dot(col, col));
    largest = Math.max(largest, length);
    rest.push({ col, length });
  }
  for (const { col, length } of rest) {
    if (!(length > 1e-12 * largest)) continue;
    for (let twice = 0; twice < 2; twice++) for (const other of basis) subtract(col, other, dot(other, col));
    const left = Math.sqrt(dot(col, col));
    if (left <= DEPENDENT * length) continue;
    for (let k = 0; k < m; k++) a.re[col * m + k] /= left;
    basis.push(col);
  }
  for (let col = 0; col < size; col++) {
    for (let twice = 0; twice < 2; twice++) for (const other of basis) subtract(col, other, dot(other, col));
  }
}

// Schur complement of a symmetric matrix: its first `size` rows and columns, the others relaxed
function eliminate(all, size) {
  const n = all.cols;
  const inner = n - size;
  const found = zeroMatrix(size, size, false);
  for (let x = 0; x < size; x++) for (let y = 0; y < size; y++) found.re[y * size + x] = all.re[y * n + x];
  if (!inner) return found;
  const block = zeroMatrix(inner, inner, false);
  for (let x = 0; x < inner; x++) for (let y = 0; y < inner; y++) block.re[y * inner + x] = all.re[(size + y) * n + size + x];
  const { values, vectors } = hermitianEigen(block);
  const least = 1e-13 * Math.max(...Array.from(values, Math.abs));
  for (let k = 0; k < inner; k++) {
    if (Math.abs(values[k]) <= least) continue;
    const part = new Float64Array(size);
    for (let x = 0; x < size; x++) {
      for (let y = 0; y < inner; y++) part[x] += vectors.re[k * inner + y] * all.re[x * n + size + y];
    }
    for (let x = 0; x < size; x++) for (let y = 0; y < size; y++) found.re[y * size + x] -= (part[x] * part[y]) / values[k];
  }
  return found;
}

// A gradient of a displacement across the periods turns the whole lattice: it costs the work of the static stress alone
function clearAcross(lattice, found) {
  const { translations, data, settings } = lattice;
  const p = data.periods;
  const size = translations.length * p;
  translations.forEach((axis, i) => {
    if (axis < p) return;
    for (let j = 0; j < p; j++) {
      for (let other = 0; other < size; other++) {
        found.re[other * size + i * p + j] = 0;
        found.re[(i * p + j) * size + other] = 0;
      }
    }
    for (let j = 0; j < p && settings.push; j++) {
      for (let l = 0; l < p; l++) found.re[(i * p + l) * size + i * p + j] = -settings.push * pull(lattice, j, l);
    }
  });
  return found;
}

// Sum over the contacts of a cell of the product of two components of their vectors
function pull(lattice, a, b) {
  const square = lattice.settings.spacing ** 2;
  const weights = lattice.data.rows.find((row) => row.kind === "push")?.weights;
  return lattice.data.contacts.vector.reduce((sum, vector, c) => sum + vector[a] * vector[b] * square * (weights ? weights[c] : 1), 0);
}
