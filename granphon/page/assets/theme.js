// Dark and light: by the system, or by the switch.

export function setTheme(choice) {
  const dark = choice ? choice === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
}

export function themeColour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// Colour of a part from 0 (displacement) to 1 (rotation), as text
export function partColour(part) {
  const [low, middle, high] = ["move", "mix", "turn"].map((name) => readHex(themeColour(name)));
  const [from, to, t] = part < 0.5 ? [low, middle, 2 * part] : [middle, high, 2 * part - 1];
  return `rgb(${from.map((one, n) => Math.round(one + t * (to[n] - one))).join(",")})`;
}

function readHex(text) {
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));
}
