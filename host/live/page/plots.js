// Plots of the last seconds. Columns of a sample: see `Sample` in the program.

export const AT = 0, DISPLACEMENT = 1, SIGMA = 4, ERROR = 7, STAGE = 10, TARGET = 13, LATENCY = 16;
const SECONDS = 30;
const AXES = ["x", "y", "z"];

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function axis(size) {
  const grid = { stroke: () => colour("grid"), width: 1 };
  return { stroke: () => colour("dim"), grid, ticks: { show: false }, size,
    font: "11px system-ui, sans-serif" };
}

// The range of the values with a margin, at least `least` wide.
function range(least) {
  return (_, low, high) => {
    if (low == null || high == null) return [-least / 2, least / 2];
    const pad = Math.max(0.08 * (high - low), (least - (high - low)) / 2, 0);
    return [low - pad, high + pad];
  };
}

function line(name, label) {
  return { label, stroke: () => colour(name), width: 1.4, points: { show: false },
    spanGaps: false };
}

function plot(id, series, least, extra = {}) {
  const parent = document.getElementById(id);
  const options = {
    width: parent.clientWidth, height: parent.clientHeight,
    cursor: { drag: { x: false, y: false }, points: { show: false } },
    legend: { show: false },
    scales: { x: { time: false }, y: { range: range(least) } },
    axes: [{ ...axis(22), values: (_, ticks) => ticks.map((t) => `${t} s`) }, axis(52)],
    series: [{}, ...series],
    ...extra,
  };
  const made = new uPlot(options, [[], ...series.map(() => [])], parent);
  new ResizeObserver(() => {
    made.setSize({ width: parent.clientWidth, height: parent.clientHeight });
  }).observe(parent);
  return made;
}

// A line between two invisible ones, with the band filled.
function band(id, name) {
  const edge = { stroke: "transparent", width: 0, points: { show: false } };
  const fill = () => `${colour(name)}4d`;
  return plot(id, [{ ...edge, label: "high" }, { ...edge, label: "low" }, line(name, name)], 0.02,
    { bands: [{ series: [1, 2], fill }] });
}

// A pause between two samples is a gap if it is longer than this, s, and than this many usual ones.
const GAP_S = 0.5, USUAL_PAUSES = 2.5;

// Puts an empty sample into every pause, so that no line leads across it.
export function withGaps(samples) {
  const recent = samples.slice(-101);
  const pauses = recent.slice(1).map((sample, index) => sample[AT] - recent[index][AT]);
  const usual = pauses.sort((a, b) => a - b)[pauses.length >> 1] ?? 0;
  const longest = Math.max(GAP_S, USUAL_PAUSES * usual);
  return samples.flatMap((sample, index) => {
    const before = samples[index - 1]?.[AT];
    if (before === undefined || sample[AT] - before <= longest) return [sample];
    const empty = new Array(sample.length).fill(null);
    empty[AT] = (before + sample[AT]) / 2;
    return [empty, sample];
  });
}

export class Plots {
  constructor() {
    const xyz = () => AXES.map((name) => line(name, name));
    this.bands = AXES.map((name) => band(`plot-${name}`, name));
    this.error = plot("plot-error", xyz(), 20);
    this.stage = plot("plot-stage", xyz(), 1);
    this.latency = plot("plot-latency", [line("x", "latency")], 5);
    this.samples = [];
    this.isPaused = false;
    this.isDue = false;
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }

  clear() {
    this.samples = [];
  }

  add(samples) {
    this.samples.push(...samples);
    const latest = this.samples.at(-1)?.[AT] ?? 0;
    let first = 0;
    while (first < this.samples.length && this.samples[first][AT] < latest - SECONDS) first += 1;
    this.samples.splice(0, first);
    if (!this.isPaused && !this.isDue && samples.length) {
      this.isDue = true;
      requestAnimationFrame(() => {
        this.isDue = false;
        this.draw();
      });
    }
  }

  draw() {
    if (document.hidden) return;
    const samples = withGaps(this.samples);
    const column = (index) => samples.map((sample) => sample[index]);
    const at = column(AT);
    this.bands.forEach((made, k) => {
      const middle = column(DISPLACEMENT + k), sigma = column(SIGMA + k);
      const off = (sign) =>
        middle.map((mm, i) => (mm == null || sigma[i] == null ? mm : mm + sign * 2 * sigma[i]));
      made.setData([at, off(1), off(-1), middle]);
    });
    this.error.setData([at, ...AXES.map((_, k) => column(ERROR + k))]);
    this.stage.setData([at, ...AXES.map((_, k) => column(STAGE + k))]);
    this.latency.setData([at, column(LATENCY)]);
  }

  redraw() {
    for (const made of [...this.bands, this.error, this.stage, this.latency]) {
      made.redraw(false, true);
    }
  }
}
