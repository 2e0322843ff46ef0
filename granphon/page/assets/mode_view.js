// The balls of the lattice, which move and spin in a mode, drawn by three.js.

import { themeColour } from "./theme.js";

// Radius, in diameters, within which balls are drawn, on a line, in a plane and in space
const REACH = { 1: 4.6, 2: 3.4, 3: 1.8 };
// Radius of the balls that are drawn: in space smaller than that of balls that touch, so that inner ones are seen
const RADIUS = { 1: 0.47, 2: 0.47, 3: 0.33 };
// Height of the picture over its width
const SHAPE = { 1: 0.4, 2: 1, 3: 1 };
// Largest displacement, and largest angle times the radius, in diameters
const LARGEST = 0.2;
const PERIOD = 2.4; // s

export class ModeView {
  // `kinds` are balls of several kinds: {colour, balls}, of which the sites are listed
  constructor(canvas, data, kinds) {
    this.canvas = canvas;
    this.data = data;
    this.kinds = kinds;
    canvas.style.aspectRatio = String(1 / SHAPE[data.periods]);
    this.balls = listBalls(data);
    this.time = 0;
    this.speed = 1;
    this.playing = true;
    this.angles = [0, 0];
    this.turned = false;
    this.motions = null;
    try {
      this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    } catch {
      this.renderer = null; // a browser without WebGL
      return;
    }
    this.build();
    this.listen();
    this.recolour();
    let last = performance.now();
    const step = (now) => {
      if (this.playing) this.time += ((now - last) / 1000) * this.speed;
      last = now;
      if (this.playing || this.stale) this.render();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  // Motions of the balls of a cell (of ballMotions()), and the wave vector in fractions. `across` says whether balls leave
  // their line or plane: it is then seen from the side, until somebody turns the view
  show(motions, fractions, across) {
    if (!this.turned) this.angles = this.data.periods === 3 ? [0.5, 0.35] : across ? [0.35, -1] : [0, 0];
    const sizes = motions.flatMap((ball) => [magnitude(ball.slice(0, 3)), 0.5 * magnitude(ball.slice(3))]);
    const largest = Math.max(...sizes);
    this.motions = motions;
    this.scale = largest > 0 ? LARGEST / largest : 0;
    this.phases = this.balls.map((ball) => 2 * Math.PI * ball.fractions.reduce((sum, one, a) => sum + one * fractions[a], 0));
    this.stale = true;
  }

  recolour() {
    if (!this.renderer) return;
    this.links.material.color.set(themeColour("soft"));
    // the colour of a kind multiplies those of the parts: half of each ball is darker
    const parts = this.kinds.length ? ["#ffffff", "#999999"] : [themeColour("ball"), themeColour("turn")];
    const [plain, marked] = parts.map((one) => new THREE.Color(one));
    const { position, color } = this.sphere.attributes;
    for (let at = 0; at < position.count; at += 3) {
      // the eight parts of a ball alternate, so that a spin about any axis is seen; each triangle has one colour
      let [x, y, z] = [0, 0, 0];
      for (let k = 0; k < 3; k++) {
        x += position.getX(at + k);
        y += position.getY(at + k);
        z += position.getZ(at + k);
      }
      const colour = x * y * z > 0 ? marked : plain;
      for (let k = 0; k < 3; k++) color.setXYZ(at + k, colour.r, colour.g, colour.b);
    }
    color.needsUpdate = true;
    this.stale = true;
  }

  build() {
    this.scene = new THREE.Scene();
    this.sphere = new THREE.SphereGeometry(RADIUS[this.data.periods], 24, 16).toNonIndexed();
    this.sphere.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * this.sphere.attributes.position.count), 3));
    const material = new THREE.MeshLambertMaterial({ vertexColors: true });
    this.mesh = new THREE.InstancedMesh(this.sphere, material, this.balls.length);
    this.mesh.frustumCulled = false;
    const colours = colourSites(this.kinds).map((one) => new THREE.Color(one));
    if (colours.length) this.balls.forEach((ball, n) => this.mesh.setColorAt(n, colours[ball.site]));
    this.pairs = listPairs(this.data, this.balls);
    const ends = new THREE.BufferGeometry();
    ends.setAttribute("position", new THREE.BufferAttribute(new Float32Array(6 * this.pairs.length), 3));
    this.links = new THREE.LineSegments(ends, new THREE.LineBasicMaterial());
    this.links.frustumCulled = false;
    this.group = new THREE.Group();
    this.group.add(this.mesh, this.links);
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-2, 3, 6);
    this.scene.add(this.group, new THREE.AmbientLight(0xffffff, 1.9), sun);
    this.reach = REACH[this.data.periods] + 0.75;
    this.camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 40);
    this.camera.position.set(0, 0, 20);
    new ResizeObserver(() => (this.stale = true)).observe(this.canvas);
  }

  listen() {
    let from = null;
    const turnBy = (x, y) => {
      this.turned = true;
      this.angles = [this.angles[0] + x, Math.min(Math.max(this.angles[1] + y, -1.5), 1.5)];
      this.stale = true;
    };
    this.canvas.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY];
      this.canvas.setPointerCapture(event.pointerId);
    });
    this.canvas.addEventListener("pointermove", (event) => {
      if (!from) return;
      turnBy((event.clientX - from[0]) / 120, (event.clientY - from[1]) / 120);
      from = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) this.canvas.addEventListener(name, () => (from = null));
    this.canvas.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.12], ArrowDown: [0, 0.12] }[event.key];
      if (!step) return;
      event.preventDefault();
      turnBy(...step);
    });
  }

  render() {
    const { clientWidth: size, clientHeight: height } = this.canvas;
    if (!size || !this.motions) return;
    this.stale = false;
    const ratio = Math.min(devicePixelRatio, 2);
    if (this.canvas.width !== Math.floor(size * ratio)) {
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(size, height, false);
      const half = this.reach;
      const tall = (half * height) / size;
      Object.assign(this.camera, { left: -half, right: half, top: tall, bottom: -tall });
      this.camera.updateProjectionMatrix();
    }
    this.group.rotation.set(this.angles[1] - (this.data.periods === 3 ? Math.PI / 2 - 0.2 : 0), 0, 0);
    this.group.rotation[this.data.periods === 3 ? "z" : "y"] = this.angles[0];
    const angle = (2 * Math.PI * this.time) / PERIOD;
    const matrix = new THREE.Matrix4();
    const spin = new THREE.Quaternion();
    const axis = new THREE.Vector3();
    const stretch = new THREE.Vector3();
    const places = this.balls.map((ball, n) => {
      const motion = this.motions[ball.site];
      const [cosine, sine] = [Math.cos(this.phases[n] - angle), Math.sin(this.phases[n] - angle)];
      const now = motion.map(([re, im]) => this.scale * (re * cosine - im * sine));
      const place = new THREE.Vector3(...ball.place.map((x, a) => x + now[a]));
      axis.set(now[3], now[4], now[5]);
      const turned = axis.length();
      spin.setFromAxisAngle(turned > 0 ? axis.divideScalar(turned) : axis.set(0, 0, 1), turned);
      this.mesh.setMatrixAt(n, matrix.compose(place, spin, stretch.setScalar(ball.size)));
      return place;
    });
    this.mesh.instanceMatrix.needsUpdate = true;
    const ends = this.links.geometry.attributes.position;
    this.pairs.forEach(([i, j], n) => {
      ends.setXYZ(2 * n, ...places[i].toArray());
      ends.setXYZ(2 * n + 1, ...places[j].toArray());
    });
    ends.needsUpdate = true;
    this.renderer.render(this.scene, this.camera);
  }
}

function magnitude(components) {
  return Math.sqrt(components.reduce((sum, [re, im]) => sum + re * re + im * im, 0));
}

// The colour of the balls at each site, in the order of the sites
export function colourSites(kinds) {
  const colours = [];
  for (const { colour, balls } of kinds) for (const site of balls) colours[site] = colour;
  return colours;
}

// Balls whose centres lie within reach of the middle: {site, shift, place, fractions, size}; the size is over the mean one
function listBalls(data) {
  const p = data.periods;
  const reach = REACH[p];
  const middle = [0, 1, 2].map((axis) => data.positions.reduce((sum, one) => sum + one[axis], 0) / data.positions.length);
  const most = data.cell.slice(0, p).map((_, a) => Math.ceil((Math.hypot(...data.reciprocal[a]) * (reach + 2)) / (2 * Math.PI)));
  const found = [];
  const add = (shift) => {
    data.positions.forEach((position, site) => {
      const place = position.map((x, axis) => x - middle[axis] + shift.reduce((sum, n, a) => sum + n * data.cell[a][axis], 0));
      if (Math.hypot(...place.slice(0, p)) > reach) return;
      const from = position.map((x, axis) => x + shift.reduce((sum, n, a) => sum + n * data.cell[a][axis], 0));
      const fractions = shift.map((_, a) => data.reciprocal[a].reduce((sum, g, axis) => sum + g * from[axis], 0) / (2 * Math.PI));
      found.push({ site, shift, place, fractions, size: 2 * (data.radii?.[site] ?? 0.5) });
    });
  };
  const walk = (shift) => {
    if (shift.length === p) return add(shift);
    for (let n = -most[shift.length]; n <= most[shift.length]; n++) walk([...shift, n]);
    return undefined;
  };
  walk([]);
  return found;
}

// Pairs of the listed balls that touch
function listPairs(data, balls) {
  const numbers = new Map(balls.map((ball, n) => [`${ball.site}:${ball.shift}`, n]));
  const { i, j, shift } = data.contacts;
  const found = [];
  balls.forEach((ball, n) => {
    i.forEach((site, c) => {
      if (site !== ball.site) return;
      const other = numbers.get(`${j[c]}:${ball.shift.map((one, a) => one + shift[c][a])}`);
      if (other !== undefined) found.push([n, other]);
    });
  });
  return found;
}
