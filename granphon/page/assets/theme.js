// Dark and light: by the system, or by the switch.

// kept until the theme changes, as each look at a style makes the browser work all of them out
const colours = new Map();

export function setTheme(choice) {
  colours.clear();
  const dark = choice ? choice === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = dark ? "dark" : "light";
}

export function themeColour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colours.get(name);
}

// Colour of a part from 0 (displacement, lower edge) to 1 (rotation, upper edge), as text, with the colour of the middle
export function partColour(part, between = "mix") {
  const [low, middle, high] = ["move", between, "turn"].map((name) => readHex(themeColour(name)));
  const [from, to, t] = part < 0.5 ? [low, middle, 2 * part] : [middle, high, 2 * part - 1];
  return `rgb(${from.map((one, n) => Math.round(one + t * (to[n] - one))).join(",")})`;
}

function readHex(text) {
  return [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16));
}
