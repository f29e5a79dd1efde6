"use strict";
// Makes every plot of a page interactive: values under the pointer, zoom by dragging (along x only,
// with Shift along both axes), curves
// switched by their entries in the legend, and download as SVG and CSV. A plot's SVG holds its data
// as JSON in <metadata>, see svg.drawing; data-curve is the name of an element's curve, data-axes the
// number of its axes. Zooming maps coordinates, which both linear and logarithmic axes permit.

const SVG = "http://www.w3.org/2000/svg";
const element = (tag, attributes = {}, text = "") => {
  const made = tag === "path" || tag === "text" || tag === "g" || tag === "rect"
    ? document.createElementNS(SVG, tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = text;
  return made;
};
const digits = (value) => {
  const size = Math.abs(value);
  if (value === 0) return "0";
  const text = size >= 1e-3 && size < 1e5 ? String(+value.toPrecision(4)) : value.toExponential(2);
  return text.replaceAll("-", "−");
};
const unit = (label) => (label.match(/\[([^\]–]+)\]$/) || ["", ""])[1];

class Axes {
  constructor(data, group) {
    Object.assign(this, data);
    this.group = group;
    this.whole = this.box;               // [left, top, right, bottom] in the drawing
    this.view = this.box;                // the part of it that is shown
    this.moved = [...group.querySelectorAll("[clip-path] use, use[clip-path], path[clip-path], [clip-path] > path")]
      .map((node) => ({ node, d: node.getAttribute("d"), x: +node.getAttribute("x"), y: +node.getAttribute("y") }));
  }
  contains(x, y) {
    return x >= this.box[0] && x <= this.box[2] && y >= this.box[1] && y <= this.box[3];
  }
  // From data to the drawing and back; side 0 is x, 1 is y, which points down in the drawing.
  place(value, side) {
    const { ends, log } = side ? this.y : this.x;
    const [low, high] = log ? ends.map(Math.log10) : ends;
    const share = ((log ? Math.log10(value) : value) - low) / (high - low);
    const at = side ? this.whole[3] + share * (this.whole[1] - this.whole[3])
      : this.whole[0] + share * (this.whole[2] - this.whole[0]);
    return this.shown(at, side);
  }
  value(at, side) {
    const { ends, log } = side ? this.y : this.x;
    const [low, high] = log ? ends.map(Math.log10) : ends;
    const share = side ? (this.whole[3] - at) / (this.whole[3] - this.whole[1])
      : (at - this.whole[0]) / (this.whole[2] - this.whole[0]);
    const found = low + share * (high - low);
    return log ? 10 ** found : found;
  }
  shown(at, side) {
    const [a, b] = [this.view[side], this.view[side + 2]];
    return this.box[side] + (at - a) / (b - a) * (this.box[side + 2] - this.box[side]);
  }
  hidden(at, side) {                     // the inverse of `shown`
    const [a, b] = [this.view[side], this.view[side + 2]];
    return a + (at - this.box[side]) / (this.box[side + 2] - this.box[side]) * (b - a);
  }
  show(view) {
    this.view = view;
    const zoomed = view.some((at, k) => at !== this.whole[k]);
    for (const { node, d, x, y } of this.moved) {
      let side = 1;
      if (d) node.setAttribute("d", d.replace(/-?[\d.]+/g, (at) => (side = 1 - side, this.shown(+at, side).toFixed(2))));
      else { node.setAttribute("x", this.shown(x, 0)); node.setAttribute("y", this.shown(y, 1)); }
    }
    for (const tick of this.group.querySelectorAll("[data-tick]")) tick.style.display = zoomed ? "none" : "";
    this.group.querySelector(".ticks")?.remove();
    if (zoomed) this.group.prepend(this.ticks());
  }
  ticks() {
    const made = element("g", { class: "ticks" });
    const [left, top, right, bottom] = this.box;
    for (const side of [0, 1]) {
      if ((side ? this.y : this.x).names) continue;
      const text = this.group.querySelector(`[data-tick=${side ? "y" : "x"}] text`);
      const ends = [this.view[side], this.view[side + 2]].map((at) => this.value(at, side));
      for (const value of round(Math.min(...ends), Math.max(...ends), (side ? this.y : this.x).log)) {
        const at = this.place(value, side);
        const line = side ? `M${left} ${at}H${right}` : `M${at} ${top}V${bottom}`;
        made.append(element("path", { d: line, fill: "none", style: "stroke: var(--grid); stroke-width: 0.6" }));
        if (!text) continue;
        const style = text.getAttribute("style");
        made.append(element("text", side ? { x: left - 5, y: at + 3, style } : { x: at, y: bottom + 11, style }, digits(value)));
      }
    }
    return made;
  }
}

// Round numbers within two ends: decades, or multiples of 1, 2 or 5 times a power of ten.
function round(low, high, log) {
  const found = [];
  if (log && high / low > 30) {
    const step = Math.ceil(Math.log10(high / low) / 8);
    for (let k = Math.ceil(Math.log10(low)); k <= Math.log10(high); k += step) found.push(10 ** k);
    return found;
  }
  const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((times) => times * power >= rough);
  for (let k = Math.ceil(low / step); k * step <= high; k++) found.push(+(k * step).toPrecision(12));
  return found;
}

class Plot {
  constructor(figure, svg, data) {
    Object.assign(this, { figure, svg, off: new Set() });
    this.title = figure.querySelector("h3")?.textContent || svg.getAttribute("aria-label");
    this.axes = data.map((axes, k) => new Axes(axes, svg.querySelector(`[data-axes="${k}"]`)));
    this.tip = element("div", { class: "tip", role: "status" });
    this.cursor = element("path", { fill: "none", style: "stroke: var(--soft); stroke-width: 0.6" });
    this.frame = element("rect", { style: "fill: var(--accent); fill-opacity: 0.15" });
    svg.append(this.cursor, this.frame);
    figure.append(this.tip, this.tools());
    const shared = figure.parentElement.previousElementSibling;
    this.legend = figure.querySelector(".legend") || (shared?.matches(".shared") ? shared : figure);
    for (const entry of this.legend.querySelectorAll("li")) this.toggle(entry);
    svg.addEventListener("pointermove", (event) => this.move(event));
    svg.addEventListener("pointerleave", () => this.leave());
    svg.addEventListener("pointerdown", (event) => this.press(event));
    svg.addEventListener("pointerup", (event) => this.release(event));
    svg.addEventListener("dblclick", () => this.reset());
  }
  tools() {
    const bar = element("div", { class: "tools" });
    const button = (text, title, action) => {
      const made = element("button", { type: "button", title }, text);
      made.addEventListener("click", action);
      bar.append(made);
      return made;
    };
    this.back = button("Reset zoom", "Show the whole plot again (or double-click it)", () => this.reset());
    this.back.hidden = true;
    button("SVG", "Download the plot as SVG", () => this.save("svg", "image/svg+xml", this.drawing()));
    if (this.axes.some((axes) => axes.curves.length)) button("CSV", "Download the curves as CSV", () => this.save("csv", "text/csv", this.table()));
    return bar;
  }
  toggle(entry) {
    const name = entry.textContent.trim();
    const nodes = [...this.svg.querySelectorAll("[data-curve]")].filter((node) => node.dataset.curve === name);
    if (!nodes.length) return;
    const button = entry.querySelector("button") || element("button", { type: "button", "aria-pressed": "true", title: "Show or hide" });
    if (!button.isConnected) {
      button.append(...entry.childNodes);
      entry.append(button);
    }
    this.switches = [...(this.switches || []), (on) => {
      button.setAttribute("aria-pressed", on);
      for (const node of nodes) node.style.display = on ? "" : "none";
      this.off[on ? "delete" : "add"](name);
    }];
    const flip = this.switches.at(-1);
    button.addEventListener("click", () => flip(this.off.has(name)));
  }
  at(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
    return [point.x, point.y, this.axes.find((axes) => axes.contains(point.x, point.y))];
  }
  move(event) {
    const [x, y, axes] = this.at(event);
    if (this.start) {
      const [x0, y0, of] = this.start, [left, top, right, bottom] = of.box;
      const box = [Math.max(left, Math.min(x0, x)), top, Math.min(right, Math.max(x0, x)), bottom];
      if (event.shiftKey) [box[1], box[3]] = [Math.max(top, Math.min(y0, y)), Math.min(bottom, Math.max(y0, y))];
      this.dragged = box;
      ["x", "y"].forEach((name, k) => this.frame.setAttribute(name, box[k]));
      this.frame.setAttribute("width", Math.max(0, box[2] - box[0]));
      this.frame.setAttribute("height", Math.max(0, box[3] - box[1]));
      return;
    }
    const found = axes && this.under(axes, x, y);
    if (!found) return this.leave();
    const [at, lines] = found;
    this.cursor.setAttribute("d", axes.cursor ? `M${at} ${axes.box[1]}V${axes.box[3]}` : "");
    this.tip.replaceChildren(...lines.map((line) => element("div", {}, line)));
    this.tip.classList.add("on");
    const all = this.figure.getBoundingClientRect();
    const left = event.clientX - all.left, wide = this.tip.offsetWidth;
    this.tip.style.left = `${Math.max(0, left + 14 + wide > all.width ? left - 14 - wide : left + 14)}px`;
    this.tip.style.top = `${event.clientY - all.top + 14}px`;
  }
  // Where the cursor stands, and what is written beside it: all curves at the nearest time, or the
  // nearest point.
  under(axes, x, y) {
    const off = [...this.off];           // the ends of a curve's intervals are called "curve, low"
    const shown = axes.curves.filter(({ name }) => !off.some((one) => name === one || name.includes(`${one}, `)));
    let best, least = Infinity;
    for (const curve of shown) {
      const xs = axes.xs[curve.x];
      for (let k = 0; k < xs.length; k++) {
        if (xs[k] === null || curve.y[k] === null) continue;
        const dx = axes.place(xs[k], 0) - x, dy = axes.cursor ? 0 : axes.place(curve.y[k], 1) - y;
        if (dx * dx + dy * dy < least) [best, least] = [{ curve, k, x: xs[k] }, dx * dx + dy * dy];
      }
    }
    if (!best || (!axes.cursor && least > 400)) return null;
    const at = axes.place(best.x, 0);
    const named = (curve, k) => [curve.name, axes.y.names && axes.y.names[Math.round(curve.y[k])]].filter(Boolean).join(": ");
    const told = (label, value) => `${digits(value)}${unit(label) ? ` ${unit(label)}` : ""}`;
    if (!axes.cursor) {
      const { curve, k } = best, lines = [named(curve, k)];
      const across = axes.x.names ? axes.x.names[Math.round(best.x)] : told(axes.x.label, best.x);
      if (axes.x.label) lines.push(`${axes.x.label.replace(/ \[.*/, "")}: ${across}`);
      if (axes.y.label && !axes.y.names) lines.push(`${axes.y.label.replace(/ \[.*/, "")}: ${told(axes.y.label, curve.y[k])}`);
      return [at, lines];
    }
    const lines = [`t = ${told(axes.x.label, best.x)}`];
    for (const curve of shown) {
      const k = nearest(axes.xs[curve.x], best.x);
      if (curve.y[k] !== null) lines.push(`${curve.name ? `${curve.name}: ` : ""}${told(axes.y.label, curve.y[k])}`);
    }
    return [at, lines];
  }
  leave() {
    this.tip.classList.remove("on");
    this.cursor.setAttribute("d", "");
  }
  press(event) {
    const [x, y, axes] = this.at(event);
    if (event.pointerType !== "mouse" || event.button !== 0 || !axes) return;
    event.preventDefault();
    this.svg.setPointerCapture(event.pointerId);
    this.leave();
    this.start = [x, y, axes];
  }
  release() {
    const of = this.start?.[2], box = this.dragged;
    this.start = this.dragged = null;
    this.frame.setAttribute("width", 0);
    if (!box || box[2] - box[0] < 4 || box[3] - box[1] < 4) return;
    const view = box.map((at, k) => of.hidden(at, k % 2));
    for (const axes of this.axes) {       // those above one another share their time
      const [left, , right] = view, [, top, , bottom] = axes === of ? view : axes.view;
      axes.show([left, top, right, bottom]);
    }
    this.back.hidden = false;
  }
  reset() {
    for (const axes of this.axes) axes.show(axes.whole);
    this.back.hidden = true;
  }
  drawing() {
    const copy = this.svg.cloneNode(true), [, , width, height] = this.svg.getAttribute("viewBox").split(" ").map(Number);
    const entries = [...this.legend.querySelectorAll("li")].map((entry) =>
      [entry.textContent.trim(), entry.querySelector("path").getAttribute("style")]);
    const text = (words, x, y, size) => element("text", { x, y, style: `font: ${size}px sans-serif; fill: var(--ink)` }, words);
    copy.append(text(this.title, 4, -8, 10));
    entries.forEach(([words, style], k) => {
      const y = height + 12 * (k + 1);
      copy.append(element("path", { d: `M4 ${y - 3}h18`, style: style.replace("fill:", "stroke:"), "stroke-width": 2 }), text(words, 28, y, 8));
    });
    copy.setAttribute("viewBox", `0 -22 ${width} ${height + 22 + 12 * entries.length + 6}`);
    copy.setAttribute("xmlns", SVG);
    const page = getComputedStyle(document.documentElement);
    return new XMLSerializer().serializeToString(copy)
      .replace(/var\((--\w+)(?:, #\w+)?\)/g, (_, name) => page.getPropertyValue(name).trim());
  }
  table() {
    const quoted = (cell) => cell === null || cell === undefined ? "" : /[",\n]/.test(cell) ? `"${String(cell).replaceAll('"', '""')}"` : String(cell);
    const lines = [];
    for (const axes of this.axes) {
      const { x, y } = { x: axes.x.label || "x", y: axes.y.label || "y" };
      if (axes.y.names) {
        lines.push([x, ...axes.curves.map((curve) => curve.name)]);
        axes.y.names.forEach((name, k) => lines.push([name, ...axes.curves.map((curve) => axes.xs[curve.x][curve.y.indexOf(k)])]));
        continue;
      }
      axes.xs.forEach((xs, number) => {  // curves at the same places share their lines
        const curves = axes.curves.filter((curve) => curve.x === number);
        if (!curves.length) return;
        const name = (curve) => [curve.name, y].filter(Boolean).join(": ");
        lines.push([x, ...curves.map(name)]);
        xs.forEach((at, k) => lines.push([axes.x.names ? axes.x.names[Math.round(at)] : at, ...curves.map((curve) => curve.y[k])]));
        lines.push([]);
      });
    }
    return lines.map((line) => line.map(quoted).join(",")).join("\n").trimEnd() + "\n";
  }
  save(kind, type, text) {
    const link = element("a", { download: `${this.title.replace(/[^\p{L}\d]+/gu, "-").toLowerCase()}.${kind}` });
    link.href = URL.createObjectURL(new Blob([text], { type }));
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}

function nearest(sorted, value) {
  let best = 0;
  for (let k = 1; k < sorted.length; k++) if (Math.abs(sorted[k] - value) < Math.abs(sorted[best] - value)) best = k;
  return best;
}

const plots = [];
for (const figure of document.querySelectorAll("figure")) {
  const svg = figure.querySelector("svg[role=img]"), data = svg?.querySelector("metadata");
  if (data) plots.push(new Plot(figure, svg, JSON.parse(data.textContent)));
}
addEventListener("beforeprint", () => {   // paper shows everything
  for (const plot of plots) { plot.reset(); plot.switches?.forEach((flip) => flip(true)); }
});
