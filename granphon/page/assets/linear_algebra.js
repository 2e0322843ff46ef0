// Singular values and eigenvalues of small matrices. A matrix is {rows, cols, re, im}: its columns one after the other in
// Float64Arrays; im is null if it is real.

const EPSILON = Number.EPSILON;
const MOST_SWEEPS = 60;
// a column below this part of the largest is the rounding of a dependent one, and cannot be made orthogonal
const NO_COLUMN = 1e-100;

export function zeroMatrix(rows, cols, complex) {
  return { rows, cols, re: new Float64Array(rows * cols), im: complex ? new Float64Array(rows * cols) : null };
}

// Singular values (ascending) and right singular vectors of A, by one-sided Jacobi rotations of R^H, A P = Q R.
// Graded columns keep their digits: columns are taken in descending order, and rotations act on each pair by itself.
export function singularValues(a) {
  const n = a.cols;
  const order = sortColumns(a);
  const x = adjointOfTriangle(a, order);
  rotateColumns(x);
  const lengths = columnLengths(x);
  // a column of R^H that is left with rounding alone has no direction: its vector is completed below
  const values = new Float64Array(n);
  const right = zeroMatrix(n, n, x.im !== null);
  const places = [...lengths.keys()].sort((one, other) => lengths[one] - lengths[other]);
  const missing = n - places.length;
  const empty = [];
  for (let k = 0; k < missing; k++) empty.push(k);
  places.forEach((place, index) => {
    const to = index + missing;
    if (!(lengths[place] > 0)) {
      empty.push(to);
      return;
    }
    values[to] = lengths[place];
    for (let row = 0; row < n; row++) {
      right.re[to * n + order[row]] = x.re[place * n + row] / lengths[place];
      if (x.im) right.im[to * n + order[row]] = x.im[place * n + row] / lengths[place];
    }
  });
  if (empty.length) completeBasis(right, empty);
  return { values, right };
}

// Eigenvalues (ascending) and eigenvectors of a Hermitian matrix, by cyclic Jacobi rotations.
export function hermitianEigen(matrix) {
  const n = matrix.cols;
  const a = { rows: n, cols: n, re: matrix.re.slice(), im: matrix.im ? matrix.im.slice() : null };
  const v = zeroMatrix(n, n, a.im !== null);
  for (let k = 0; k < n; k++) v.re[k * n + k] = 1;
  for (let sweep = 0; sweep < MOST_SWEEPS; sweep++) {
    let turned = false;
    for (let p = 0; p < n - 1; p++) {
      for (let q = p + 1; q < n; q++) turned = rotateBoth(a, v, p, q) || turned;
    }
    if (!turned) break;
  }
  const diagonal = Float64Array.from({ length: n }, (_, k) => a.re[k * n + k]);
  const places = [...diagonal.keys()].sort((one, other) => diagonal[one] - diagonal[other]);
  const vectors = zeroMatrix(n, n, a.im !== null);
  places.forEach((place, to) => {
    vectors.re.set(v.re.subarray(place * n, place * n + n), to * n);
    if (v.im) vectors.im.set(v.im.subarray(place * n, place * n + n), to * n);
  });
  return { values: Float64Array.from(places, (place) => diagonal[place]), vectors };
}

// x^H y of two columns of `count` numbers that begin at `first` and at `second`; im is null if they are real
function innerProduct(re, im, first, second, count) {
  let dotRe = 0;
  let dotIm = 0;
  if (im) {
    for (let k = 0; k < count; k++) {
      dotRe += re[first + k] * re[second + k] + im[first + k] * im[second + k];
      dotIm += re[first + k] * im[second + k] - im[first + k] * re[second + k];
    }
  } else {
    for (let k = 0; k < count; k++) dotRe += re[first + k] * re[second + k];
  }
  return { re: dotRe, im: dotIm };
}

// A^H diag(sign) A of the rows of A, added to `into`
export function addGram(into, a, sign) {
  const { rows: m, cols: n } = a;
  for (let p = 0; p < n; p++) {
    for (let q = p; q < n; q++) {
      const { re, im } = innerProduct(a.re, a.im, p * m, q * m, m);
      into.re[q * n + p] += sign * re;
      if (q > p) into.re[p * n + q] += sign * re;
      if (a.im) {
        into.im[q * n + p] += sign * im;
        if (q > p) into.im[p * n + q] -= sign * im;
      }
    }
  }
}

export function columnLengths(a) {
  const m = a.rows;
  const found = new Float64Array(a.cols);
  for (let k = 0; k < a.cols; k++) {
    let largest = 0;
    for (let row = k * m; row < k * m + m; row++) {
      largest = Math.max(largest, Math.abs(a.re[row]), a.im ? Math.abs(a.im[row]) : 0);
    }
    if (!largest) continue;
    // divided by the largest, so that squares neither underflow nor overflow
    let sum = 0;
    for (let row = k * m; row < k * m + m; row++) {
      sum += (a.re[row] / largest) ** 2;
      if (a.im) sum += (a.im[row] / largest) ** 2;
    }
    found[k] = largest * Math.sqrt(sum);
  }
  return found;
}

function sortColumns(a) {
  const lengths = columnLengths(a);
  return [...lengths.keys()].sort((one, other) => lengths[other] - lengths[one]);
}

// R^H (n x min(m, n)) of A P = Q R, by Householder reflections
function adjointOfTriangle(a, order) {
  const { rows: m, cols: n } = a;
  const steps = Math.min(m, n);
  const re = new Float64Array(m * n);
  const im = a.im ? new Float64Array(m * n) : null;
  order.forEach((from, to) => {
    re.set(a.re.subarray(from * m, from * m + m), to * m);
    if (im) im.set(a.im.subarray(from * m, from * m + m), to * m);
  });
  for (let k = 0; k < steps; k++) reflect(re, im, m, n, k);
  const x = zeroMatrix(n, steps, im !== null);
  for (let k = 0; k < steps; k++) {
    for (let col = k; col < n; col++) {
      x.re[k * n + col] = re[col * m + k];
      if (im) x.im[k * n + col] = -im[col * m + k];
    }
  }
  return x;
}

// Reflect the columns from k on, so that column k ends at row k
function reflect(re, im, m, n, k) {
  const start = k * m + k;
  const end = k * m + m;
  let scale = 0;
  for (let row = start; row < end; row++) scale = Math.max(scale, Math.abs(re[row]), im ? Math.abs(im[row]) : 0);
  if (!scale) return;
  let below = 0;
  for (let row = start; row < end; row++) {
    re[row] /= scale;
    if (im) im[row] /= scale;
    if (row > start) below += re[row] * re[row] + (im ? im[row] * im[row] : 0);
  }
  const headRe = re[start];
  const headIm = im ? im[start] : 0;
  const head = Math.hypot(headRe, headIm);
  const length = Math.sqrt(head * head + below);
  // v = x + phase |x| e_k, whose first component does not cancel
  const phaseRe = head ? headRe / head : 1;
  const phaseIm = head ? headIm / head : 0;
  re[start] += phaseRe * length;
  if (im) im[start] += phaseIm * length;
  const factor = 1 / (length * (length + head)); // 2 / |v|^2
  for (let col = k + 1; col < n; col++) {
    const shift = (col - k) * m;
    const dot = innerProduct(re, im, start, start + shift, end - start);
    const dotRe = factor * dot.re;
    const dotIm = factor * dot.im;
    for (let row = start; row < end; row++) {
      re[row + shift] -= dotRe * re[row] - (im ? dotIm * im[row] : 0);
      if (im) im[row + shift] -= dotRe * im[row] + dotIm * re[row];
    }
  }
  re[start] = -phaseRe * length * scale;
  if (im) im[start] = -phaseIm * length * scale;
}

function rotateColumns(x) {
  const { rows: m, cols: n } = x;
  if (n < 2) return;
  const least = (NO_COLUMN * Math.max(...columnLengths(x))) ** 2;
  const squares = new Float64Array(n);
  for (let sweep = 0; sweep < MOST_SWEEPS; sweep++) {
    for (let k = 0; k < n; k++) squares[k] = innerProduct(x.re, x.im, k * m, k * m, m).re;
    let turned = false;
    for (let p = 0; p < n - 1; p++) {
      for (let q = p + 1; q < n; q++) turned = rotatePair(x, m, p, q, squares, least) || turned;
    }
    if (!turned) return;
  }
}

function rotatePair(x, m, p, q, squares, least) {
  const { re, im } = x;
  const alpha = squares[p];
  const beta = squares[q];
  if (Math.min(alpha, beta) <= least) return false;
  const gamma = innerProduct(re, im, p * m, q * m, m);
  const size = im ? Math.hypot(gamma.re, gamma.im) : Math.abs(gamma.re);
  if (!(size > 4 * EPSILON * Math.sqrt(alpha) * Math.sqrt(beta))) return false;
  const tangent = findTangent(alpha, beta, size);
  rotate(x, p * m, q * m, 1, m, tangent, gamma.re / size, gamma.im / size);
  squares[p] = Math.max(alpha - tangent * size, 0);
  squares[q] = beta + tangent * size;
  return true;
}

// One rotation of rows and columns p and q of a Hermitian matrix, and of the columns of the vectors
function rotateBoth(a, v, p, q) {
  const n = a.cols;
  const at = q * n + p;
  const offRe = a.re[at];
  const offIm = a.im ? a.im[at] : 0;
  const size = Math.hypot(offRe, offIm);
  const alpha = a.re[p * n + p];
  const beta = a.re[q * n + q];
  if (!(size > 0.5 * EPSILON * Math.sqrt(Math.abs(alpha)) * Math.sqrt(Math.abs(beta))) || size < Number.MIN_VALUE * 16) {
    return false;
  }
  const tangent = findTangent(alpha, beta, size);
  const phaseRe = offRe / size;
  const phaseIm = offIm / size;
  for (const one of [a, v]) rotate(one, p * n, q * n, 1, n, tangent, phaseRe, phaseIm);
  rotate(a, p, q, n, n, tangent, phaseRe, -phaseIm); // rows take the conjugate of the phase
  a.re[p * n + p] = alpha - tangent * size;
  a.re[q * n + q] = beta + tangent * size;
  a.re[at] = 0;
  a.re[p * n + q] = 0;
  if (a.im) {
    a.im[p * n + p] = 0;
    a.im[q * n + q] = 0;
    a.im[at] = 0;
    a.im[p * n + q] = 0;
  }
  return true;
}

// Tangent of the rotation that makes two columns orthogonal: alpha and beta are their squares, size is that of their product
function findTangent(alpha, beta, size) {
  const zeta = (beta - alpha) / (2 * size);
  return (zeta >= 0 ? 1 : -1) / (Math.abs(zeta) + Math.hypot(1, zeta));
}

// Rotate two columns or rows of `count` numbers, `step` apart, that begin at `first` and at `second`; the second is
// multiplied by the conjugate of the phase before
function rotate(a, first, second, step, count, tangent, phaseRe, phaseIm) {
  const { re, im } = a;
  const cosine = 1 / Math.hypot(1, tangent);
  const sine = cosine * tangent;
  for (let k = 0; k < count; k++) {
    const x = first + k * step;
    const y = second + k * step;
    const one = re[x];
    if (im) {
      const oneIm = im[x];
      const other = re[y] * phaseRe + im[y] * phaseIm;
      const otherIm = im[y] * phaseRe - re[y] * phaseIm;
      re[x] = cosine * one - sine * other;
      im[x] = cosine * oneIm - sine * otherIm;
      re[y] = sine * one + cosine * other;
      im[y] = sine * oneIm + cosine * otherIm;
    } else {
      const other = re[y] * phaseRe;
      re[x] = cosine * one - sine * other;
      re[y] = sine * one + cosine * other;
    }
  }
}

// Fill the columns `empty` of a matrix with unit vectors that are orthogonal to all others
function completeBasis(a, empty) {
  const n = a.rows;
  const done = [...Array(a.cols).keys()].filter((col) => !empty.includes(col));
  let axis = 0;
  for (const col of empty) {
    for (; axis < n; axis++) {
      const re = new Float64Array(n);
      const im = new Float64Array(n);
      re[axis] = 1;
      for (let twice = 0; twice < 2; twice++) for (const other of done) project(a, other, re, im);
      const length = Math.hypot(...re, ...im);
      if (length < 1e-3) continue;
      for (let k = 0; k < n; k++) {
        a.re[col * n + k] = re[k] / length;
        if (a.im) a.im[col * n + k] = im[k] / length;
      }
      done.push(col);
      axis++;
      break;
    }
  }
}

function project(a, col, re, im) {
  const n = a.rows;
  let dotRe = 0;
  let dotIm = 0;
  for (let k = 0; k < n; k++) {
    const x = a.re[col * n + k];
    const y = a.im ? a.im[col * n + k] : 0;
    dotRe += x * re[k] + y * im[k];
    dotIm += x * im[k] - y * re[k];
  }
  for (let k = 0; k < n; k++) {
    const x = a.re[col * n + k];
    const y = a.im ? a.im[col * n + k] : 0;
    re[k] -= dotRe * x - dotIm * y;
    im[k] -= dotRe * y + dotIm * x;
  }
}
