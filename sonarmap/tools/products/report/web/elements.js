// Elements of the page and numbers in words. Every text, whatever file it comes from, becomes a text node: never markup.

/** An element with attributes, listeners (`onclick: function`) and children: elements, or texts. */
function make(tag, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "line", "text", "rect", "circle"].includes(tag);
  const element = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null).map((child) => (child instanceof Node ? child : String(child))));
  return element;
}

/** A button; `more` are further attributes. */
const button = (text, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, text);

/** A button that looks like a link. */
const link = (text, onclick) => button(text, onclick, { class: "link" });

/** A list to choose from, of [value, text]. */
const choice = (options, attributes, chosen) => make("select", attributes,
  ...options.map(([value, text]) => make("option", { value, selected: String(value) === String(chosen) }, text)));

/** A length with as many decimals as `step` [m] has use for. */
function meters(value, step = 0.01) {
  const decimals = Math.max(0, Math.min(4, Math.ceil(-Math.log10(step))));
  return `${value.toFixed(decimals)}\u202fm`;
}

/** A number with three valid digits, and its unit. */
function short(value, unit = "") {
  if (value === null || value === undefined) return "";
  const digits = Math.abs(value) >= 1000 ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(3)));
  return unit ? `${digits}\u202f${unit}` : digits;
}

/** A number of things, such as "1 loop". */
const counted = (count, what) => `${count.toLocaleString("en")} ${what}${count === 1 ? "" : "s"}`;

const percent = (share) => (share === null ? "" : `${Math.round(100 * share)}\u202f%`);

/** A row of a table, of texts or elements. */
const tableRow = (cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));

/** A table under these headings. */
function table(headings, rows, body = make("tbody", {}, ...rows.map(tableRow)), kind = "scroll") {
  const head = make("tr", {}, ...headings.map((heading) => make("th", { scope: "col" }, heading)));
  return make("div", { class: kind }, make("table", {}, make("thead", {}, head), body));
}

/** What is decided shows at once, and after every change of the decisions. */
function follow(decisions, update) {
  decisions.listeners.push(update);
  update();
}

/** Dark or light, as the system has it or the button `#theme` chose; `changed` is called when it changes. */
function followTheme(changed) {
  document.querySelector("#theme").addEventListener("click", () => {
    const root = document.documentElement;
    root.dataset.theme = getComputedStyle(root).colorScheme === "dark" ? "light" : "dark";
    changed();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", changed);
}
