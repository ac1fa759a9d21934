// A report in a browser: on light and dark screens and on a telephone, turned and copied, and
// without a request to other places.

import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import { Browser } from "./browser.mjs";

const { TRINOCULAR, CHROMIUM = "chromium" } = process.env;
const PATH = "document.querySelector('svg.turn g').innerHTML";

let browser;
let folder;
let page;

before(() => {
  folder = mkdtempSync(join(tmpdir(), "report-"));
  const file = join(folder, "run.html");
  const run = ["track", "--sim", "--path", "lissajous", "--seconds", "2", "--report", file];
  const { status, stderr } = spawnSync(TRINOCULAR, run, { encoding: "utf8" });
  assert.equal(status, 0, stderr);
  page = pathToFileURL(file).href;
  browser = new Browser(CHROMIUM);
});

after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true, force: true });
});

// Opens the report in a tab of its own; at the end the browser must not have complained, and must
// have loaded nothing but the file.
async function open(t, width, isDark) {
  const tab = await browser.tab(width, 900, isDark);
  t.after(() => tab.close());
  await tab.open(page);
  t.after(() => {
    assert.deepEqual(tab.complaints, []);
    const others = tab.requests.filter((url) => url !== page && !url.startsWith("data:"));
    assert.deepEqual(others, []);
  });
  return tab;
}

const colours = `["body", "svg path, svg polyline, svg text"].map((selector) => {
  const style = getComputedStyle(document.querySelector(selector));
  return selector === "body" ? style.backgroundColor : style.stroke + style.fill;
})`;

const brightness = (colour) => colour.match(/\d+/g).slice(0, 3).reduce((sum, n) => sum + +n, 0);

test("report follows the screen's colours", async (t) => {
  const [light, dark] = [await open(t, 1280, false), await open(t, 1280, true)];
  const [onLight, onDark] = [await light.evaluate(colours), await dark.evaluate(colours)];
  assert.ok(brightness(onLight[0]) > 600 && brightness(onDark[0]) < 200, [onLight, onDark]);
  assert.notEqual(onLight[1], onDark[1]);
});

test("report fits a telephone", async (t) => {
  const tab = await open(t, 390, false);
  const widths = "[document.documentElement.scrollWidth, innerWidth]";
  const [content, screen] = await tab.evaluate(widths);
  assert.ok(content <= screen, `${content} px on ${screen} px`);
});

test("path in space turns by keys and mouse, and comes back", async (t) => {
  const tab = await open(t, 1280, false);
  const still = await tab.evaluate(PATH);
  await tab.evaluate("document.querySelector('svg.turn').focus()");
  await tab.press("ArrowLeft");
  await tab.until(`${PATH} !== ${JSON.stringify(still)}`);
  const turned = await tab.evaluate(PATH);
  const event = (type, x) => `document.querySelector("svg.turn").dispatchEvent(
    new PointerEvent("${type}", { clientX: ${x}, clientY: 0, bubbles: true, pointerId: 1 }))`;
  // Without a pointer of its own the browser cannot capture one.
  await tab.evaluate("Element.prototype.setPointerCapture = () => {}");
  for (const [type, x] of [["pointerdown", 0], ["pointermove", 60], ["pointerup", 60]]) {
    await tab.evaluate(event(type, x));
  }
  await tab.until(`${PATH} !== ${JSON.stringify(turned)}`);
  const twice = "new MouseEvent('dblclick')";
  await tab.evaluate(`document.querySelector("svg.turn").dispatchEvent(${twice})`);
  assert.equal(await tab.evaluate(PATH), still);
});

test("data of the report are copied", async (t) => {
  const tab = await open(t, 1280, false);
  const folded = "document.querySelectorAll('details')";
  await tab.evaluate(`${folded}.forEach((part) => { part.open = true; })`);
  await tab.click("button.copy");
  await tab.until("document.querySelector('button.copy').textContent === 'Copied'");
  const selected = await tab.evaluate("getSelection().toString().length");
  assert.ok(selected > 10, `${selected} characters`);
});
