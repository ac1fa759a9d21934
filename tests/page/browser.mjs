// A browser without a window, driven over a pipe by the Chrome DevTools Protocol.

import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";

const PATIENCE_MS = 60_000;

const FLAGS = [
  "--headless=new", "--no-sandbox", "--disable-gpu", "--remote-debugging-pipe", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-sync",
];

export class Browser {
  constructor(program) {
    this.folder = mkdtempSync(join(tmpdir(), "page-"));
    const stdio = ["ignore", "ignore", "ignore", "pipe", "pipe"];
    const flags = [...FLAGS, `--user-data-dir=${this.folder}`, "about:blank"];
    this.process = spawn(program, flags, { stdio });
    this.answers = new Map();
    this.tabs = new Map();
    this.count = 0;
    let text = "";
    this.process.stdio[4].on("data", (data) => {
      const parts = (text + data).split("\0");
      text = parts.pop();
      for (const part of parts) this.take(JSON.parse(part));
    });
  }

  take(message) {
    if (message.id) {
      this.answers.get(message.id)(message);
      this.answers.delete(message.id);
    } else {
      this.tabs.get(message.sessionId)?.take(message);
    }
  }

  async call(method, params = {}, sessionId = undefined) {
    const id = ++this.count;
    this.process.stdio[3].write(`${JSON.stringify({ id, method, params, sessionId })}\0`);
    const answer = await new Promise((resolve) => this.answers.set(id, resolve));
    if (answer.error) throw new Error(`${method}: ${answer.error.message}`);
    return answer.result;
  }

  async tab(width, height, isDark = false) {
    const { targetId } = await this.call("Target.createTarget", { url: "about:blank" });
    const { sessionId } = await this.call("Target.attachToTarget", { targetId, flatten: true });
    const tab = new Tab(this, sessionId);
    this.tabs.set(sessionId, tab);
    for (const domain of ["Page", "Runtime", "Log", "Network"]) await tab.call(`${domain}.enable`);
    await tab.call("Emulation.setDeviceMetricsOverride",
      { width, height, deviceScaleFactor: 1, mobile: width < 600 });
    await tab.call("Emulation.setEmulatedMedia", {
      features: [{ name: "prefers-color-scheme", value: isDark ? "dark" : "light" }],
    });
    return tab;
  }

  async close() {
    const ended = new Promise((resolve) => this.process.once("exit", resolve));
    // Killed, it would leave helpers that still write into the folder.
    await this.call("Browser.close");
    await ended;
    rmSync(this.folder, { recursive: true, force: true, maxRetries: 20 });
  }
}

class Tab {
  constructor(browser, sessionId) {
    this.browser = browser;
    this.sessionId = sessionId;
    this.complaints = [];
    this.requests = [];
  }

  take({ method, params }) {
    if (method === "Runtime.exceptionThrown") {
      this.complaints.push(JSON.stringify(params.exceptionDetails));
    } else if (method === "Runtime.consoleAPICalled" && params.type !== "log") {
      this.complaints.push(JSON.stringify(params.args));
    } else if (method === "Log.entryAdded") {
      // The tests themselves read the canvases.
      const isOurs = params.entry.text.includes("willReadFrequently");
      if (!isOurs) this.complaints.push(`${params.entry.text} ${params.entry.url ?? ""}`);
    } else if (method === "Network.requestWillBeSent") {
      this.requests.push(params.request.url);
    } else if (method === "Network.webSocketCreated") {
      this.requests.push(params.url);
    }
  }

  call(method, params) {
    return this.browser.call(method, params, this.sessionId);
  }

  async open(url) {
    await this.call("Page.navigate", { url });
    await this.until("location.href !== 'about:blank' && document.readyState === 'complete'");
  }

  async evaluate(expression) {
    const { result, exceptionDetails } =
      await this.call("Runtime.evaluate", { expression, awaitPromise: true, returnByValue: true });
    if (exceptionDetails) throw new Error(JSON.stringify(exceptionDetails));
    return result.value;
  }

  // Waits until an expression is true in the page.
  async until(expression) {
    const end = Date.now() + PATIENCE_MS;
    while (!(await this.evaluate(`Boolean(${expression})`))) {
      if (Date.now() > end) throw new Error(`never true: ${expression}`);
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
  }

  async press(key) {
    for (const type of ["keyDown", "keyUp"]) {
      await this.call("Input.dispatchKeyEvent", { type, key, code: key === " " ? "Space" : key });
    }
  }

  // Clicks the middle of an element.
  async click(selector) {
    const [x, y] = await this.evaluate(`(() => {
      const element = document.querySelector(${JSON.stringify(selector)});
      element.scrollIntoView({ block: "center" });
      const box = element.getBoundingClientRect();
      return [box.x + box.width / 2, box.y + box.height / 2];
    })()`);
    for (const type of ["mousePressed", "mouseReleased"]) {
      await this.call("Input.dispatchMouseEvent", { type, x, y, button: "left", clickCount: 1 });
    }
  }

  async close() {
    await this.call("Page.close");
  }
}
