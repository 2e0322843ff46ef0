// The sliders, switches and lists, each with its label and its value in words.

const STEPS = 400;

// A slider of `STEPS` places. spec: {name, label, min, max, log, print}; `change(value)` is called as it moves
export function makeSlider(form, spec, change) {
  const field = document.createElement("div");
  field.className = "field";
  field.innerHTML = `<label for="${spec.name}">${spec.label}</label><output for="${spec.name}"></output>
    <input type="range" id="${spec.name}" min="0" max="${spec.steps ?? STEPS}" step="1">`;
  form.append(field);
  const [input, output] = [field.querySelector("input"), field.querySelector("output")];
  const steps = spec.steps ?? STEPS;
  const toValue = (part) => (spec.log ? spec.min * (spec.max / spec.min) ** part : spec.min + part * (spec.max - spec.min));
  const toPart = (value) => (spec.log ? Math.log(value / spec.min) / Math.log(spec.max / spec.min) : (value - spec.min) / (spec.max - spec.min));
  input.addEventListener("input", () => change(toValue(Number(input.value) / steps)));
  return {
    field,
    show(value) {
      const part = spec.max > spec.min ? toPart(value) : 0;
      input.value = String(Math.round(steps * Math.min(Math.max(part, 0), 1)));
      const words = spec.print(value);
      output.textContent = words;
      input.setAttribute("aria-valuetext", words);
    },
  };
}

export function makeSwitch(form, name, label, change) {
  const field = document.createElement("label");
  field.className = "check";
  field.innerHTML = `<input type="checkbox" id="${name}"> <span>${label}</span>`;
  form.append(field);
  const input = field.querySelector("input");
  input.addEventListener("change", () => change(input.checked));
  return { field, show: (value) => (input.checked = value) };
}

// options: [[value, words]]
export function makeList(form, name, label, options, change) {
  const field = document.createElement("div");
  field.className = "field";
  field.innerHTML = `<label for="${name}">${label}</label><select id="${name}"></select>`;
  const select = field.querySelector("select");
  for (const [value, words] of options) select.add(new Option(words, value));
  field.hidden = options.length < 2;
  form.append(field);
  select.addEventListener("change", () => change(select.value));
  return { field, show: (value) => (select.value = String(value)) };
}
