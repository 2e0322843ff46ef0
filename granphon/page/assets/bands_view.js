// The picture of the bands, coloured by their rotational part or by the edge of a cut that moves, with the density of states beside them.
// plotly draws the axes and the density of states, anew when they change. The curves move with every slider: they are paths
// of their own above plotly's picture, which take a hundredth of the time.

import { partColour, themeColour } from "./theme.js";

// Colours between displacement and rotation, or lower and upper edge: one path for each
const SHADES = 9;
const QUIET = { displayModeBar: false, responsive: true, scrollZoom: false, doubleClick: false, showTips: false };
const SVG = "http://www.w3.org/2000/svg";

export class BandsView {
  // `pick(point, branch)` is called for a click beside a branch
  constructor(element, pick) {
    this.element = element;
    this.axisTop = 0;
    this.axes = "";
    this.overlay = document.createElementNS(SVG, "svg");
    this.overlay.setAttribute("aria-hidden", "true");
    this.overlay.classList.add("curves");
    this.paths = Array.from({ length: SHADES + 1 }, () => this.overlay.appendChild(document.createElementNS(SVG, "path")));
    this.mark = this.overlay.appendChild(document.createElementNS(SVG, "circle"));
    this.mark.setAttribute("r", "7");
    element.addEventListener("click", (event) => {
      const found = this.findNearest(event);
      if (found) pick(...found);
    });
  }

  // bands: {values, turning, branches}; path; dos or null; unit: {name, scale}, reduced frequencies times scale are in it.
  // The axis fits the frequencies when the page is `still`; while a slider moves it stays as long as they are well inside it
  draw({ bands, path, dos, unit, selected, byEdge }, still = false) {
    this.drawn = { bands, path, unit, selected, byEdge };
    const top = bands.values.reduce((most, one) => (one > most ? one : most), 0) * unit.scale;
    if (still || this.unit !== unit.name || top > this.axisTop || top < 0.4 * this.axisTop) this.axisTop = 1.1 * top || 1;
    this.unit = unit.name;
    const axes = [this.axisTop, unit.name, path.length, themeColour("ink"), dos ? [unit.scale, dos.total, dos.turning] : ""].join();
    if (axes !== this.axes) {
      this.axes = axes;
      Plotly.react(this.element, this.makeStates(dos, unit), this.makeLayout(path, unit, dos), QUIET);
      if (!this.overlay.parentNode) {
        this.element.append(this.overlay);
        this.element.on("plotly_afterplot", () => this.drawCurves());
      }
    }
    this.drawCurves();
  }

  makeStates(dos, unit) {
    const empty = { x: [], y: [], xaxis: "x", hoverinfo: "skip" };
    const parts = dos ? { moving: dos.total.map((one, bin) => one - dos.turning[bin]), turning: dos.turning, total: dos.total } : {};
    // the colours of the bands for the parts, that of the text for their sum
    const shown = [["moving", "move"], ["turning", "turn"], ["total", "ink"]].slice(dos?.turning.some((one) => one > 0) ? 0 : 2);
    return [empty, ...(dos ? shown : []).map(([name, colour]) => ({
      x: parts[name].map((one) => one / unit.scale), y: dos.frequencies.map((one) => one * unit.scale), mode: "lines", name,
      xaxis: "x2", hoverinfo: "skip", line: { color: themeColour(colour), width: name === "total" ? 1.1 : 1.6, shape: "hvh" },
    }))];
  }

  // One path for each shade: the stretches between neighbouring points whose branch has it
  drawCurves() {
    const layout = this.element._fullLayout;
    if (!layout?._size) return;
    const { l: left, t: top, h: height } = layout._size;
    const { bands, path, unit, selected, byEdge } = this.drawn;
    const parts = byEdge ? bands.edges.map((one) => 0.5 + 0.5 * one) : bands.turning;
    const width = layout.xaxis._length;
    Object.assign(this.overlay.style, { left: `${left}px`, top: `${top}px`, width: `${width}px`, height: `${height}px` });
    const n = bands.branches;
    const x = path.places.map((place) => ((place / path.length) * width).toFixed(1));
    const y = Array.from(bands.values, (value) => (height * (1 - (value * unit.scale) / this.axisTop)).toFixed(2));
    const starts = new Set(path.starts);
    const curves = Array.from({ length: SHADES + 1 }, () => []);
    for (let k = 0; k < n; k++) {
      let last = -1;
      for (let at = 1; at < path.points.length; at++) {
        const [from, to] = [(at - 1) * n + k, at * n + k];
        // a piece of the path begins, or static forces leave no frequency
        if (starts.has(at) || y[from] === "NaN" || y[to] === "NaN") {
          last = -1;
          continue;
        }
        const both = Math.max(parts[from], parts[to]) > 1.2; // one of both edges
        const shade = both ? SHADES : Math.min(Math.floor(0.5 * (parts[from] + parts[to]) * SHADES), SHADES - 1);
        if (shade !== last) curves[shade].push(`M${x[at - 1]},${y[from]}`);
        curves[shade].push(`L${x[at]},${y[to]}`);
        last = shade;
      }
    }
    curves.forEach((curve, shade) => {
      this.paths[shade].setAttribute("d", curve.join(""));
      this.paths[shade].setAttribute("stroke", shade < SHADES ? partColour(shade / (SHADES - 1), byEdge ? "line" : "mix") : themeColour("ink"));
    });
    const level = y[selected.point * n + selected.branch];
    this.mark.setAttribute("visibility", level === undefined || level === "NaN" ? "hidden" : "visible");
    if (level === undefined || level === "NaN") return;
    this.mark.setAttribute("cx", x[selected.point]);
    this.mark.setAttribute("cy", level);
  }

  makeLayout(path, unit, dos) {
    const most = dos ? dos.total.reduce((high, one) => (one > high ? one : high), 0) / unit.scale || 1 : 1;
    const [ink, grid] = [themeColour("ink"), themeColour("grid")];
    const axis = { color: ink, gridcolor: grid, zeroline: false, fixedrange: true, ticklabelstandoff: 4 };
    return {
      margin: { l: 60, r: 8, t: 8, b: 42 }, showlegend: false, dragmode: false, paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 13 }, hovermode: false,
      xaxis: {
        ...axis, domain: [0, 0.78], range: [0, path.length], tickvals: path.ticks.map((one) => one.at),
        ticktext: path.ticks.map((one) => one.label), gridcolor: themeColour("line"),
      },
      // one number, as there is room for no more on a telephone; zero is at the left end
      xaxis2: {
        ...axis, domain: [0.81, 1], range: [0, 1.05 * most], tickvals: [findRound(0.8 * most)], tickangle: 0,
        title: { text: `1/${unit.name}`, font: { size: 11 } },
      },
      yaxis: { ...axis, range: [0, this.axisTop], title: { text: `Frequency (${unit.name})` } },
    };
  }

  // The point of the path and the branch nearest to a click, in pixels; null beside the bands
  findNearest(event) {
    const layout = this.element._fullLayout;
    if (!layout || !this.drawn) return null;
    const box = this.element.getBoundingClientRect();
    const x = event.clientX - box.left - layout._size.l;
    const y = event.clientY - box.top - layout._size.t;
    const { bands, path, unit } = this.drawn;
    let best = null;
    let least = 40 ** 2;
    path.places.forEach((place, at) => {
      for (let k = 0; k < bands.branches; k++) {
        const dx = (place / path.length) * layout.xaxis._length - x;
        const dy = layout._size.h * (1 - (bands.values[at * bands.branches + k] * unit.scale) / this.axisTop) - y;
        if (dx * dx + dy * dy < least) {
          least = dx * dx + dy * dy;
          best = [at, k];
        }
      }
    });
    return best;
  }
}

// The largest number 1, 2 or 5 times a power of ten that is not above a value
function findRound(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const times = [5, 2].find((one) => one * power <= value) ?? 1;
  return Number((times * power).toPrecision(3));
}

// Velocities over the force, with the state marked
export function drawVelocities(element, curves, force, velocities) {
  const [ink, grid] = [themeColour("ink"), themeColour("grid")];
  const axis = { color: ink, gridcolor: grid, type: "log", fixedrange: true };
  const colours = ["move", "turn", "soft"];
  const traces = curves.lines.map((line, n) => ({
    x: curves.forces, y: line.values, name: line.name, mode: "lines", hoverinfo: "skip",
    line: { color: themeColour(colours[n % 3]), width: 2.2, dash: ["solid", "dash", "dot"][n % 3] },
  }));
  traces.push({
    x: velocities.map(() => force), y: velocities, mode: "markers", hoverinfo: "skip", showlegend: false,
    marker: { size: 10, color: ink },
  });
  Plotly.react(element, traces, {
    margin: { l: 62, r: 10, t: 6, b: 46 }, dragmode: false, hovermode: false, paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)", font: { color: ink, size: 13 }, legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 }, showlegend: true,
    xaxis: { ...axis, title: { text: "Force of a contact (N)" }, dtick: 1, exponentformat: "power" }, yaxis: { ...axis, title: { text: "Velocity (m/s)" }, dtick: "D2", tickformat: ".4~g" },
  }, QUIET);
}
