// Path of target and stage in space, turned by dragging or by the arrow keys.

import { STAGE, TARGET } from "./plots.js";

const STEP = 0.1;

export class Path {
  constructor(canvas) {
    this.canvas = canvas;
    this.turn = [-0.6, 0.5];
    this.samples = [];
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      this.rotate(0.01 * event.movementX, 0.01 * event.movementY);
    });
    canvas.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const by = way[event.key];
      if (!by) return;
      event.preventDefault();
      this.rotate(STEP * by[0], STEP * by[1]);
    });
    new ResizeObserver(() => this.draw()).observe(canvas);
  }

  rotate(about, over) {
    const limit = Math.PI / 2;
    this.turn = [this.turn[0] + about, Math.max(-limit, Math.min(limit, this.turn[1] + over))];
    this.draw();
  }

  show(samples) {
    this.samples = samples;
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();

    // The cube around all positions.
    const vector = (sample, at) => (sample[at] == null ? null : sample.slice(at, at + 3));
    const paths = [[TARGET, "y"], [STAGE, "x"]].map(([at, name]) =>
      [this.samples.map((sample) => vector(sample, at)), name]);
    const all = paths.flatMap(([path]) => path.filter(Boolean));
    const low = [0, 1, 2].map((i) => all.reduce((least, p) => Math.min(least, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => all.reduce((most, p) => Math.max(most, p[i]), -Infinity));
    const isKnown = all.length > 0;
    const middle = low.map((value, i) => (isKnown ? (value + high[i]) / 2 : 0));
    const half = isKnown ? Math.max(1, ...low.map((value, i) => (high[i] - value) / 2)) : 1;

    // Turned about y, then about x; y points down as in the images.
    const [about, over] = this.turn;
    const [ca, sa, co, so] = [Math.cos(about), Math.sin(about), Math.cos(over), Math.sin(over)];
    const scale = (0.5 * Math.min(width, height)) / (1.65 * half);
    const project = (p) => {
      const [x, y, z] = p.map((value, i) => value - middle[i]);
      const [right, deep] = [ca * x + sa * z, ca * z - sa * x];
      return [width / 2 + scale * right, height / 2 + scale * (co * y - so * deep)];
    };
    const segment = (from, to) => {
      context.moveTo(...project(from));
      context.lineTo(...project(to));
    };

    context.lineWidth = 1;
    context.strokeStyle = colour("line");
    context.beginPath();
    const corner = (signs) => middle.map((value, i) => value + half * signs[i]);
    for (let edge = 0; edge < 12; edge += 1) {
      const along = Math.floor(edge / 4);
      const signs = [0, 0, 0];
      const others = [0, 1, 2].filter((i) => i !== along);
      signs[others[0]] = edge & 1 ? 1 : -1;
      signs[others[1]] = edge & 2 ? 1 : -1;
      const ends = [-1, 1].map((end) => corner(signs.map((s, i) => (i === along ? end : s))));
      segment(...ends);
    }
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    ["x", "y", "z"].forEach((name, i) => {
      context.fillStyle = colour(name);
      const signs = i === 1 ? [-1, -1.25, 1] : [-1, 1, -1];
      if (i !== 1) signs[i] = 1.25;
      const [x, y] = project(corner(signs));
      context.fillText(name, x - 3, y + 4);
    });
    context.fillStyle = colour("dim");
    context.fillText(`cube of ${(2 * half).toFixed(1)} mm`, 4, height - 4);

    for (const [path, name] of paths) {
      context.strokeStyle = colour(name);
      context.lineWidth = name === "y" ? 3 : 1.4;
      context.globalAlpha = name === "y" ? 0.55 : 1;
      context.beginPath();
      let isDown = false;
      for (const p of path) {
        if (p && isDown) context.lineTo(...project(p));
        else if (p) context.moveTo(...project(p));
        isDown = Boolean(p);
      }
      context.stroke();
      context.globalAlpha = 1;
      const last = path.at(-1);
      if (last) {
        context.fillStyle = colour(name);
        context.beginPath();
        context.arc(...project(last), 4, 0, 7);
        context.fill();
      }
    }
  }
}
