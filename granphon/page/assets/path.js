// The path through the zone: its points, their places on the axis, and the names of its corners.

// About `total` points, divided among the stretches between corners by their lengths. `starts` are the first points of the
// pieces between jumps.
export function makePath(data, total) {
  const stretches = [];
  data.path.forEach((piece, number) => {
    for (let n = 0; n + 1 < piece.points.length; n++) {
      const ends = [piece.points[n], piece.points[n + 1]];
      const length = Math.hypot(...toCartesian(data, ends[1].map((one, a) => one - ends[0][a])));
      stretches.push({ ends, length, labels: [piece.labels[n], piece.labels[n + 1]], piece: number });
    }
  });
  const sum = stretches.reduce((all, one) => all + one.length, 0);
  const points = [];
  const places = [];
  const starts = [];
  const ticks = [];
  let at = 0;
  stretches.forEach((stretch, n) => {
    const count = Math.max(4, Math.round((total * stretch.length) / sum));
    const joined = n > 0 && stretches[n - 1].piece === stretch.piece;
    const label = printLabel(stretch.labels[0]);
    if (!joined) starts.push(points.length);
    if (n === 0) ticks.push({ at, label });
    else if (!joined && ticks[ticks.length - 1].label !== label) ticks[ticks.length - 1].label += `|${label}`;
    for (let k = joined ? 1 : 0; k <= count; k++) {
      const part = k / count;
      points.push(stretch.ends[0].map((one, a) => (k === count ? stretch.ends[1][a] : one + part * (stretch.ends[1][a] - one))));
      places.push(at + part * stretch.length);
    }
    at += stretch.length;
    ticks.push({ at, label: printLabel(stretch.labels[1]) });
  });
  return { points, places, starts, ticks, length: at };
}

export function toCartesian(data, fractions) {
  const found = [0, 0, 0];
  data.reciprocal.forEach((vector, a) => vector.forEach((one, axis) => (found[axis] += fractions[a] * one)));
  return found;
}

export function printLabel(label) {
  return label === "G" || label === "Gamma" ? "Γ" : label;
}
