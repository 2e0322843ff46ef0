// Frequencies and rotational parts along the path, and the density of states on a mesh.

import { edgeParts, rotationalPart, solveModes } from "./lattice.js";

// Wave vectors of the density of states: fewer for cells of many balls, which have as many frequencies
const COUNT = (branches) => Math.max(100, Math.min(1000, Math.round(20000 / branches)));
const BINS = 90;

// Values (points x branches) and rotational parts of all branches, and of a cut the parts at its edges, -1 to 1; `buckles` is the index of the first point where a squared
// frequency is negative, or -1
export function computeBands(lattice, points) {
  const n = lattice.branches;
  const values = new Float64Array(points.length * n);
  const turning = new Float64Array(points.length * n);
  const edges = lattice.data.sides ? new Float64Array(points.length * n) : null;
  let buckles = -1;
  points.forEach((q, at) => {
    const modes = solveModes(lattice, q);
    if (modes.buckles && buckles < 0) buckles = at;
    values.set(modes.values, at * n);
    for (let k = 0; k < n && lattice.rotations.length; k++) turning[at * n + k] = rotationalPart(lattice, modes, k);
    if (edges && !modes.buckles) edges.set(edgeParts(lattice, modes), at * n);
  });
  return { values, turning, edges, branches: n, buckles };
}

// Density of states per ball of the reduced frequency, gathered in slices of time so that the page stays quick:
// calls `done({frequencies, total, turning, points})` at the end, unless the returned function is called before.
// The wave vectors are a sequence that fills the zone evenly and has no two of one component, as those of a mesh do.
export function gatherStates(lattice, top, done) {
  const p = lattice.data.periods;
  const count = COUNT(lattice.branches);
  const steps = evenSteps(p);
  const total = new Float64Array(BINS);
  const turning = new Float64Array(BINS);
  const width = (1.02 * top) / BINS;
  let at = 0;
  let cancelled = false;
  const step = () => {
    if (cancelled) return;
    const end = performance.now() + 10;
    for (; at < count && performance.now() < end; at++) {
      const q = steps.map((step) => (0.5 + at * step) % 1);
      const modes = solveModes(lattice, q);
      modes.values.forEach((value, k) => {
        if (!(value >= 0)) return;
        const bin = Math.min(Math.floor(value / width), BINS - 1);
        total[bin] += 1;
        if (lattice.rotations.length) turning[bin] += rotationalPart(lattice, modes, k);
      });
    }
    if (at < count) setTimeout(step, 0);
    else {
      const scale = 1 / (count * lattice.balls * width);
      done({
        frequencies: Array.from({ length: BINS }, (_, bin) => (bin + 0.5) * width), points: count,
        total: Array.from(total, (one) => one * scale), turning: Array.from(turning, (one) => one * scale),
      });
    }
  };
  setTimeout(step, 0);
  return () => (cancelled = true);
}

// Powers of the root of x^(p+1) = x + 1 below one: multiples of them, less their whole parts, fill a cube evenly
function evenSteps(p) {
  let root = 1.5;
  for (let n = 0; n < 60; n++) root = (1 + root) ** (1 / (p + 1));
  return Array.from({ length: p }, (_, a) => root ** -(a + 1));
}
