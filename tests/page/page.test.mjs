// The live page in a browser: opens, shows images and plots, stops the station, and asks nothing of
// other computers.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { Browser } from "./browser.mjs";
import { Served } from "./served.mjs";

const { TRINOCULAR, CHROMIUM = "chromium" } = process.env;
const POSITION = "document.querySelector('#readout tbody').textContent";
const STATE = "document.getElementById('state').textContent";

let browser;
let served;

// Opens a page in a tab of its own, which closes with the test.
async function open(t, url, width = 1280, height = 900, isDark = false) {
  const tab = await browser.tab(width, height, isDark);
  t.after(() => tab.close());
  await tab.open(url);
  return tab;
}

before(() => {
  browser = new Browser(CHROMIUM);
  served = new Served(TRINOCULAR, "--control");
});

after(async () => {
  await browser?.close();
  await served?.close();
});

// A number that changes with the image on a canvas.
const pixels = (selector) => `(() => {
  const canvas = document.querySelector(${JSON.stringify(selector)});
  if (!canvas?.width) return 0;
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return data.reduce((sum, value, index) => (sum * 31 + value * (index % 7)) % 1e9, 0);
})()`;

function isOwn(url, page) {
  const own = new URL(page);
  const { protocol, host } = new URL(url);
  return protocol === "blob:" || protocol === "data:" || url === "about:blank" || host === own.host;
}

async function changes(tab, expression) {
  const first = await tab.evaluate(expression);
  await tab.until(`${expression} !== ${JSON.stringify(first)}`);
}

test("page shows moving images and plots, and only watches", async (t) => {
  const page = await served.page();
  const tab = await open(t, page);
  await tab.until("document.querySelectorAll('.camera').length === 3");
  await tab.until(`${STATE} === "following"`);
  for (const k of [1, 2, 3]) await changes(tab, pixels(`.camera:nth-child(${k}) canvas`));
  for (const plot of ["plot-x", "plot-error", "plot-stage", "plot-latency"]) {
    await changes(tab, pixels(`#${plot} canvas`));
  }
  await changes(tab, pixels("#path"));
  await tab.until("document.querySelector('#cameras .name span').textContent.includes('points')");
  assert.equal(await tab.evaluate("document.getElementById('controls-panel').hidden"), true);
  await tab.press("Escape");
  await changes(tab, POSITION);
  assert.equal(await tab.evaluate(STATE), "following");
  assert.deepEqual(tab.complaints, []);
  assert.deepEqual(tab.requests.filter((url) => !isOwn(url, page)), []);
});

for (const [name, press] of [
  ["button", (tab) => tab.click("#stop")],
  ["Escape", (tab) => tab.press("Escape")],
  ["Space", (tab) => tab.press(" ")],
]) {
  test(`STOP by ${name} stops the station`, async (t) => {
    const tab = await open(t, await served.link());
    await tab.until("!document.getElementById('controls-panel').hidden");
    assert.equal(await tab.evaluate("location.hash"), "", "the token leaves the address bar");
    await tab.until(`${STATE} === "following" || ${STATE} === "idle"`);
    if (await tab.evaluate(`${STATE} === "idle"`)) {
      await tab.click("#follow");
      await tab.until(`${STATE} === "following"`);
    }
    await changes(tab, POSITION);
    await press(tab);
    await tab.until(`${STATE} === "stopped"`);
    const stood = await tab.evaluate(POSITION);
    const sets = "document.querySelector('#counts td').textContent";
    for (let k = 0; k < 5; k += 1) await changes(tab, sets);
    const mm = (text) => text.match(/-?\d+\.\d{3}/g)?.slice(0, 3);
    assert.deepEqual(mm(await tab.evaluate(POSITION)), mm(stood));
    await tab.click("#reset");
    await tab.until(`${STATE} === "idle"`);
    assert.deepEqual(tab.complaints, []);
  });
}

test("jog, zero and mark work from the page", async (t) => {
  const tab = await open(t, await served.link(), 390, 844);
  await tab.until(`${STATE} === "idle"`);
  assert.equal(await tab.evaluate("document.documentElement.scrollWidth"), 390, "fits a phone");
  const bottom = await tab.evaluate(
    "document.getElementById('stop-bar').getBoundingClientRect().bottom");
  assert.ok(bottom > 780 && bottom <= 844, "STOP is at the thumb");
  await tab.until("!document.getElementById('zero').disabled");
  await tab.click("#zero");
  await tab.until("document.getElementById('notes').textContent.includes('zero: the position became 0 0 0 mm')");
  await tab.click("[data-jog='1,0,0']");
  await tab.until("document.querySelector('#readout .x td').textContent === '1.000'");
  await tab.until("!document.getElementById('mark').disabled");
  await tab.evaluate("document.getElementById('mark-text').value = '<b>lamp & off</b>'");
  await tab.click("#mark");
  await tab.until("document.getElementById('notes').textContent.includes('<b>lamp & off</b>')");
  assert.equal(await tab.evaluate("document.querySelectorAll('#notes b').length"), 0);
  assert.deepEqual(tab.complaints, []);
});

test("a used link only watches, and says so", async (t) => {
  const link = await served.link();
  const first = await open(t, link);
  await first.until("!document.getElementById('controls-panel').hidden");
  const second = await open(t, link);
  await second.until("document.getElementById('banner').textContent.includes('used before')");
  assert.equal(await second.evaluate("document.getElementById('controls-panel').hidden"), true);
  // A tab with control keeps it when it opens a used link, and after a reload.
  await first.evaluate(`location.hash = ${JSON.stringify(new URL(link).hash)}`);
  await first.until("location.hash === ''");
  await first.until("!document.getElementById('mark').disabled");
  await first.evaluate("document.getElementById('mark-text').value = 'still in control'");
  await first.click("#mark");
  await first.until("document.getElementById('notes').textContent.includes('still in control')");
  await first.call("Page.reload");
  await first.until("document.readyState === 'complete'");
  await first.until("!document.getElementById('controls-panel').hidden");
});

test("a suspended program is told by the page", async (t) => {
  const own = new Served(TRINOCULAR, "--control");
  t.after(() => own.close());
  const tab = await open(t, await own.link());
  await tab.until("!document.getElementById('controls-panel').hidden");
  await tab.until(`${STATE} === "following"`);
  assert.equal(await tab.evaluate("document.getElementById('stale').hidden"), true);
  own.process.kill("SIGSTOP");
  await tab.until("document.getElementById('stale').textContent.includes('emergency stop')");
  await tab.click("#stop");
  await tab.until("document.getElementById('answer').textContent.includes('NOT ANSWERED')");
  own.process.kill("SIGCONT");
  await tab.until("document.getElementById('stale').hidden");
  // The stop that waited is obeyed.
  await tab.until(`${STATE} === "stopped"`);
  assert.deepEqual(tab.complaints, []);
});

test("a refused jog is named, and a pause is a gap in the plots", async (t) => {
  const tab = await open(t, await served.link());
  await tab.until("!document.getElementById('controls-panel').hidden");
  await tab.until(`${STATE} === "idle"`);
  await tab.click("#zero");
  await tab.until("document.getElementById('trust').textContent === 'known'");
  await tab.evaluate("document.getElementById('jog-step').value = '10000'");
  for (const axis of ["0,1,0", "0,-1,0"]) await tab.click(`[data-jog='${axis}']`);
  await tab.until("document.getElementById('answer').textContent.includes('still moves')");
  await tab.until(`${STATE} === "idle"`);
  const rows = await tab.evaluate(`import("/plots.js").then(({ withGaps }) =>
    withGaps([[0, 1], [0.1, 1], [0.2, 1], [2, 1], [2.1, 1]]))`);
  assert.deepEqual(rows.map((row) => row[1]), [1, 1, 1, null, 1, 1]);
  assert.deepEqual(tab.complaints, []);
});

test("page of another server cannot connect", async (t) => {
  const { createServer } = await import("node:http");
  const foreign = createServer((_, answer) => {
    answer.setHeader("content-type", "text/html");
    answer.end("<title>foreign</title>");
  });
  await new Promise((resolve) => foreign.listen(0, "127.0.0.1", resolve));
  t.after(() => {
    foreign.closeAllConnections();
    foreign.close();
  });
  const tab = await open(t, `http://127.0.0.1:${foreign.address().port}/`);
  await tab.until("document.title === 'foreign'");
  const { host } = new URL(await served.page());
  const outcome = await tab.evaluate(`new Promise((resolve) => {
    const socket = new WebSocket("ws://${host}/live");
    socket.onopen = () => resolve("open");
    socket.onerror = () => resolve("refused");
  })`);
  assert.equal(outcome, "refused");
  const read = await tab.evaluate(`fetch("http://${host}/state.json")
    .then(() => "read", () => "refused")`);
  assert.equal(read, "refused");
});

test("page says that the program has ended", async (t) => {
  const short = new Served(TRINOCULAR);
  t.after(() => short.close());
  const tab = await open(t, await short.page(), 1280, 900, true);
  await tab.until(`${STATE} === "following"`);
  assert.equal(await short.close(), 0);
  await tab.until("!document.getElementById('banner').hidden");
});
