// The state of a contact under load: its overlap, stiffness and exponent, from the table of a medium.

import { printQuantity } from "./units.js";

// Overlap (m), stiffness k (N/m), exponent of the velocity, at a force (N), a width (m) and eta; `problem` says, in words, why
// there is no such state. `data` is that of the page, `medium` one of its media.
export function findContact(data, medium, force, width, eta) {
  if (data.fixed) return { stiffness: data.balls.stiffness, reduced: Infinity, problem: "" }; // a network is as it is
  const { coefficient: c, power } = data.balls; // of the law f = c delta^power
  const delta = (force / c) ** (1 / power);
  const equal = {
    overlap: delta, stiffness: power * c * delta ** (power - 1), exponent: (power - 1) / (2 * power), reduced: Infinity,
    problem: "",
  };
  if (!(width > 0) || data.lattice.periods === 1) return equal;
  const reduced = force / (c * width ** power);
  if (medium.refusal) return { ...equal, reduced, problem: medium.refusal };
  if (!medium.table) return { ...equal, reduced };
  const { log_force: nodes, roots } = medium.table;
  const x = Math.log(reduced);
  if (x > nodes[nodes.length - 1]) return { ...equal, reduced };
  if (x < nodes[0] - 1e-9) {
    const least = printQuantity((Math.exp(nodes[0]) / reduced) * force, "N", 3);
    return { ...equal, reduced, problem: `The ${medium.words} has no solution below ${least} at this width: ` +
      "raise the force, or lower the width of the spread." };
  }
  const root = Math.sqrt(eta);
  if (roots.length > 1 && root < roots[0] - 1e-9) {
    return { ...equal, reduced, problem: `The ${medium.words} has no solution here without friction: raise η to ` +
      `${(roots[0] ** 2).toPrecision(2)}, or set the width of the spread to zero.` };
  }
  const weights = polynomialWeights(roots, root);
  const found = { overlap: 0, log: 0, slope: 0 };
  weights.forEach((weight, n) => {
    const one = interpolateCurve(medium.table, n, Math.max(x, nodes[0]));
    for (const name of Object.keys(found)) found[name] += weight * one[name];
  });
  return {
    overlap: found.overlap * width, stiffness: c * width ** (power - 1) * Math.exp(found.log), exponent: 0.5 * found.slope,
    reduced, problem: "",
  };
}

// Stiffness of a contact against twist, over k d^2, that does not slip, of equal balls at the force
export function mindlinTorsion(data, force, stiffness) {
  const { diameter, coefficient, power, shear_modulus: modulus } = data.balls;
  const overlap = (force / coefficient) ** (1 / power); // the radius of the contact is (diameter overlap)^(1/2) / 2
  return ((modulus / 3) * diameter * (overlap / diameter) ** 1.5) / stiffness;
}

// Cubic of Hermite between the nodes of curve n at ln f* = x
function interpolateCurve(table, n, x) {
  const nodes = table.log_force;
  let low = 0;
  let high = nodes.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (nodes[middle] <= x) low = middle;
    else high = middle;
  }
  const h = nodes[high] - nodes[low];
  const t = (x - nodes[low]) / h;
  const hermite = (values, slopes) => {
    const rise = values[high] - values[low];
    const [a, b] = [slopes(low) * h, slopes(high) * h];
    const bent = 3 * rise - 2 * a - b;
    const twisted = a + b - 2 * rise;
    return { value: values[low] + t * (a + t * (bent + t * twisted)), slope: (a + t * (2 * bent + 3 * t * twisted)) / h };
  };
  const logs = table.log_stiffness[n];
  const log = hermite(logs, (at) => table.slope[n][at]);
  // d y / d ln f* = f* / k*
  const overlap = hermite(table.overlap[n], (at) => Math.exp(nodes[at] - logs[at]));
  return { overlap: overlap.value, log: log.value, slope: log.slope };
}

// Weights of the values at nodes in the polynomial through all of them, at another place
function polynomialWeights(nodes, at) {
  if (nodes.length === 1) return [1];
  return nodes.map((node, k) =>
    nodes.reduce((product, other, l) => (l === k ? product : (product * (at - other)) / (node - other)), 1));
}
