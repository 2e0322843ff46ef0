// Frequencies and rotational parts along the path, and the density of states on a mesh.

import { rotationalPart, solveModes } from "./lattice.js";

// Points of the mesh along each period
const MESHES = { 1: 400, 2: 40, 3: 12 };
const BINS = 90;

// Values (points x branches) and rotational parts of all branches; `buckles` is the index of the first point where a squared
// frequency is negative, or -1
export function computeBands(lattice, points) {
  const n = lattice.branches;
  const values = new Float64Array(points.length * n);
  const turning = new Float64Array(points.length * n);
  let buckles = -1;
  points.forEach((q, at) => {
    const modes = solveModes(lattice, q);
    if (modes.buckles && buckles < 0) buckles = at;
    values.set(modes.values, at * n);
    for (let k = 0; k < n && lattice.rotations.length; k++) turning[at * n + k] = rotationalPart(lattice, modes, k);
  });
  return { values, turning, branches: n, buckles };
}

// Density of states per ball of the reduced frequency, gathered in slices of time so that the page stays quick:
// calls `done({frequencies, total, turning, points})` at the end, unless the returned function is called before.
export function gatherStates(lattice, top, done) {
  const p = lattice.data.periods;
  const side = Math.max(4, Math.round(MESHES[p] / (lattice.balls > 1 ? 1.4 : 1)));
  const count = side ** p;
  const total = new Float64Array(BINS);
  const turning = new Float64Array(BINS);
  const width = (1.02 * top) / BINS;
  let at = 0;
  let cancelled = false;
  const step = () => {
    if (cancelled) return;
    const end = performance.now() + 10;
    // q and -q have the same frequencies: half of the mesh is enough
    for (; at < count / 2 && performance.now() < end; at++) {
      const q = [];
      for (let rest = at, a = 0; a < p; a++, rest = Math.floor(rest / side)) q.unshift(((rest % side) + 0.5) / side);
      const modes = solveModes(lattice, q);
      modes.values.forEach((value, k) => {
        if (!(value >= 0)) return;
        const bin = Math.min(Math.floor(value / width), BINS - 1);
        total[bin] += 1;
        if (lattice.rotations.length) turning[bin] += rotationalPart(lattice, modes, k);
      });
    }
    if (at < count / 2) setTimeout(step, 0);
    else {
      const scale = 1 / (Math.ceil(count / 2) * lattice.balls * width);
      done({
        frequencies: Array.from({ length: BINS }, (_, bin) => (bin + 0.5) * width), points: count,
        total: Array.from(total, (one) => one * scale), turning: Array.from(turning, (one) => one * scale),
      });
    }
  };
  setTimeout(step, 0);
  return () => (cancelled = true);
}
