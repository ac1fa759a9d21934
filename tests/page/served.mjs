// A running `trinocular serve`, and what it prints.

import { spawn } from "node:child_process";
import { once } from "node:events";

const PATIENCE_MS = 60_000;

export class Served {
  constructor(program, ...options) {
    const listen = ["serve", "--listen", "127.0.0.1:0", ...options];
    this.process = spawn(program, listen, { stdio: ["ignore", "ignore", "pipe"] });
    this.printed = "";
    this.process.stderr.on("data", (data) => {
      this.printed += data;
    });
  }

  // Waits for a line that matches, the one of this index; returns its first group.
  async line(pattern, index = 0) {
    const end = Date.now() + PATIENCE_MS;
    for (;;) {
      const matches = [...this.printed.matchAll(pattern)];
      if (matches.length > index) return matches[index][1];
      if (Date.now() > end || this.process.exitCode !== null) {
        throw new Error(`no line ${pattern} in:\n${this.printed}`);
      }
      await new Promise((resolve) => setTimeout(resolve, 20));
    }
  }

  page() {
    return this.line(/live page: (\S+)/g);
  }

  // Returns the next control link; each is for one page.
  link() {
    this.links = (this.links ?? -1) + 1;
    return this.line(/control link, works once: (\S+)/g, this.links);
  }

  async close() {
    const ended = once(this.process, "exit");
    if (this.process.exitCode !== null) return this.process.exitCode;
    this.process.kill("SIGINT");
    return (await ended)[0];
  }
}
