// Puts the page together: the link, and what shows its messages.

import { Cameras } from "./cameras.js";
import { Controls } from "./controls.js";
import { Freshness } from "./freshness.js";
import { Link } from "./link.js";
import { Path } from "./path.js";
import { ERROR, Plots, SIGMA, STAGE } from "./plots.js";

const byId = (id) => document.getElementById(id);
const PATH_PERIOD_MS = 100;
const MOST_NOTES = 60;

let hello = null;
let names = [];
let drawnPath = 0;

const plots = new Plots();
const path = new Path(byId("path"));
const cameras = new Cameras(byId("cameras"), (drawn) => link.send({ drawn }));
const link = new Link({
  hello(message) {
    hello = message;
    names = message.cameras;
    byId("station-name").textContent = message.station;
    document.title = `Trinocular: ${message.station}`;
    cameras.setUp(message);
    controls.setOffers(message.offers);
    setUpTravel(message.travel_mm);
    byId("scale").hidden = !message.scale;
    setText("scale", message.scale ? sentence(message.scale) : "");
    plots.clear();
    byId("notes").replaceChildren();
    banner(null);
  },
  heard() {
    freshness.heard();
  },
  state(message) {
    freshness.seen(message);
    plots.add(message.samples);
    showFigures(message);
    showStation(message);
    showCounts(message);
    showNotes(message.notes);
    controls.show(message);
    if (message.ended) banner("The run has ended. What is shown is its last state.");
    const now = performance.now();
    if (!plots.isPaused && now - drawnPath > PATH_PERIOD_MS) {
      drawnPath = now;
      path.show(plots.samples);
    }
  },
  images(buffer) {
    cameras.take(buffer);
  },
  control(isOn, wasAsked) {
    controls.setControl(isOn);
    if (!isOn && wasAsked) {
      banner("This control link was used before. The program has printed the next one.");
    }
  },
  lost() {
    freshness.lost();
    controls.setControl(false);
    showState("not connected", "bad");
    banner("No connection to the program. What is shown may be old; the buttons do nothing.");
  },
});
const freshness = new Freshness(byId("stale"));
const controls = new Controls(link);
controls.setControl(false);

byId("pause").addEventListener("click", () => {
  plots.isPaused = !plots.isPaused;
  byId("pause").setAttribute("aria-pressed", String(plots.isPaused));
});

function banner(text) {
  byId("banner").hidden = !text;
  byId("banner").textContent = text ?? "";
}

function setText(id, text) {
  const element = typeof id === "string" ? byId(id) : id;
  if (element.textContent !== text) element.textContent = text;
}

function showFigures({ rate_hz: rate, latency_ms: latency, samples }) {
  setText("rate", rate ? rate.toFixed(1) : "–");
  setText("latency", latency ? `${latency[0].toFixed(0)} / ${latency[1].toFixed(0)}` : "–");
  const last = samples.at(-1);
  if (!last) return;
  [...byId("readout").tBodies[0].rows].forEach((row, k) => {
    const number = (value, digits, factor = 1) =>
      (value == null ? "–" : (factor * value).toFixed(digits));
    setText(row.cells[1], number(last[STAGE + k], 3));
    setText(row.cells[2], number(last[ERROR + k], 1));
    setText(row.cells[3], number(last[SIGMA + k], 1, 1000));
    const gauge = byId("travel").children[k];
    if (!gauge) return;
    const [low, high] = hello.travel_mm[k];
    const share = Math.max(0, Math.min(1, (last[STAGE + k] - low) / (high - low)));
    gauge.querySelector("b").style.left = `${100 * share}%`;
  });
}

function setUpTravel(travel) {
  byId("travel").replaceChildren(...travel.map(([low, high], k) => {
    const gauge = document.createElement("div");
    gauge.className = `gauge ${"xyz"[k]}`;
    const end = (mm) => {
      const span = document.createElement("span");
      span.textContent = mm.toFixed(0);
      return span;
    };
    const bar = document.createElement("i");
    bar.append(document.createElement("b"));
    gauge.append(end(low), bar, end(high));
    return gauge;
  }));
}

function showState(text, kind) {
  setText("state", text);
  byId("state").className = `pill ${kind}`;
}

function showStation({ station, following, refusal, ended }) {
  if (!station) return;
  const kinds = { idle: "good", following: "busy", moving: "busy", homing: "busy",
    stopping: "warn", stopped: "warn", faulted: "bad", unconfigured: "warn" };
  showState(ended ? "ended" : station.state, ended ? "" : kinds[station.state] ?? "");
  const isLost = following && station.sight !== "tracking";
  setText("meaning", sentence(station.meaning));
  const { fault } = station;
  byId("fault").hidden = !fault;
  if (fault) setText("fault", `Fault ${fault.number}, ${fault.name}: ${fault.cause}.`);
  const next = fault?.action ?? (following ? null : station.next);
  const advice = following && refusal ? `The last images were not used: ${refusal}` :
    isLost && station.sight !== "none" ? `The target is not seen for ${station.seen_ms} ms.` :
      next && next !== "nothing" ? `To do: ${next}` : null;
  byId("next").hidden = !advice;
  setText("next", (advice ?? "").replaceAll("`", ""));
  setText("trust", station.position);
  setText("sight", station.sight);
  setText("motors", station.motors ? "on" : "off");
}

function sentence(text) {
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}

function showCounts({ turns, refusals, drops }) {
  const rows = [["frame sets", turns]];
  for (const [reason, count] of Object.entries(refusals)) rows.push([`not used: ${reason}`, count]);
  drops.forEach((counts, k) => {
    for (const [reason, count] of Object.entries(counts)) {
      rows.push([`camera ${names[k]}: ${reason}`, count]);
    }
  });
  const table = byId("counts").tBodies[0];
  while (table.rows.length > rows.length) table.deleteRow(-1);
  rows.forEach(([name, count], index) => {
    const row = table.rows[index] ?? table.insertRow();
    if (!row.cells.length) {
      row.append(document.createElement("th"));
      row.insertCell();
    }
    setText(row.cells[0], name);
    setText(row.cells[1], String(count));
  });
}

function showNotes(notes) {
  for (const { at_s: at, kind, text } of notes) {
    const item = document.createElement("li");
    item.className = kind;
    const time = document.createElement("time");
    time.textContent = `${at.toFixed(1)} s`;
    item.append(time, text);
    byId("notes").prepend(item);
  }
  while (byId("notes").children.length > MOST_NOTES) byId("notes").lastChild.remove();
}
