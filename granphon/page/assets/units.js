// Numbers with their units, as people read them.

const PREFIXES = [["G", 1e9], ["M", 1e6], ["k", 1e3], ["", 1], ["m", 1e-3], ["µ", 1e-6], ["n", 1e-9], ["p", 1e-12]];

// The prefix in which a number lies between 1 and 1000: [name, size]
export function choosePrefix(value) {
  if (!value) return ["", 1];
  return PREFIXES.find(([, size]) => Math.abs(value) >= size * 0.9999999) ?? PREFIXES[PREFIXES.length - 1];
}

export function printNumber(value, digits = 4) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e-3 && size < 1e5) return String(Number(value.toPrecision(digits)));
  const [number, power] = value.toExponential(digits - 1).split("e");
  return `${Number(number)}·10${[...String(Number(power))].map((one) => "⁰¹²³⁴⁵⁶⁷⁸⁹"["0123456789".indexOf(one)] ?? "⁻").join("")}`;
}

// A number with a unit that takes prefixes
export function printQuantity(value, unit, digits = 4) {
  const [prefix, size] = choosePrefix(value);
  return `${printNumber(value / size, digits)} ${prefix}${unit}`;
}
