// The Brillouin zone with the path, its corners and the wave vector, as a drawing (SVG).

import { printLabel, toCartesian } from "./path.js";
import { themeColour } from "./theme.js";

// Azimuth and elevation, rad, from which a zone in space is seen
const VIEW = [0.42, 0.32];
const SIZE = 200;

export function drawZone(element, data, fractions) {
  const reach = Math.max(...data.zone.flat().map((one) => Math.hypot(...one)));
  const scale = (0.4 * SIZE) / reach;
  const project = (vector) => {
    const [x, y, z] = data.periods === 3 ? turn(vector) : vector;
    return [SIZE / 2 + scale * x, SIZE / 2 - scale * y, z];
  };
  const parts = [];
  if (data.periods === 1) parts.push(line(data.zone[0].map(project), "soft", 2));
  for (const face of data.periods > 1 ? data.zone : []) {
    const corners = face.map(project);
    const near = data.periods === 2 || area(corners) < 0;
    parts.push(`<polygon points="${corners.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ")}" fill="none"
      stroke="${themeColour(near ? "soft" : "line")}" stroke-width="${near ? 1.6 : 1}"/>`);
  }
  const seen = new Set();
  for (const piece of data.path) {
    const corners = piece.points.map((one) => project(toCartesian(data, one)));
    parts.push(line(corners, "accent", 2.2));
    corners.forEach(([x, y], n) => {
      const label = printLabel(piece.labels[n]);
      if (seen.has(label) || label.length > 3) return;
      seen.add(label);
      const [dx, dy] = [x - SIZE / 2, y - SIZE / 2];
      const far = Math.hypot(dx, dy) || 1;
      const out = label === "Γ" ? [-11, 13] : [(14 * dx) / far, (14 * dy) / far + 4];
      parts.push(`<text x="${x + out[0]}" y="${y + out[1]}" text-anchor="middle" font-size="13" fill="${themeColour("ink")}">${escapeText(label)}</text>`);
    });
  }
  const [x, y] = project(toCartesian(data, fractions));
  const c = SIZE / 2;
  parts.push(`<line x1="${c}" y1="${c}" x2="${x}" y2="${y}" stroke="${themeColour("turn")}" stroke-width="3"/>
    <circle cx="${x}" cy="${y}" r="5" fill="${themeColour("turn")}" stroke="${themeColour("card")}"/>`);
  const words = `Brillouin zone with the path and the wave vector ${fractions.slice(0, data.periods).map((one) => one.toFixed(3)).join(", ")}`;
  element.innerHTML = `<svg viewBox="0 0 ${SIZE} ${SIZE}" role="img" aria-label="${words}">${parts.join("")}</svg>`;
}

// Labels come from the scene: what they say is text
export function escapeText(text) {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
}

function turn([x, y, z]) {
  const [a, b] = VIEW;
  const across = Math.cos(a) * y - Math.sin(a) * x;
  const ahead = Math.cos(a) * x + Math.sin(a) * y;
  return [across, Math.cos(b) * z - Math.sin(b) * ahead, Math.cos(b) * ahead + Math.sin(b) * z];
}

function line(points, colour, width) {
  return `<polyline points="${points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ")}" fill="none"
    stroke="${themeColour(colour)}" stroke-width="${width}" stroke-linejoin="round"/>`;
}

// Twice the area of a polygon on the screen, below zero if its corners run anticlockwise as seen
function area(corners) {
  return corners.reduce((sum, [x, y], n) => {
    const [u, v] = corners[(n + 1) % corners.length];
    return sum + x * v - u * y;
  }, 0);
}
