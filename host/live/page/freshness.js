// Says when what is shown is old: the program hangs, or its run brings no new images.

// The program sends a sign of life twice a second, whatever its run does.
const SILENCE_MS = 1500;
const STANDSTILL_MS = 2000;
const LOOK_MS = 250;

export class Freshness {
  constructor(element) {
    this.element = element;
    this.heardAt = performance.now();
    this.turns = null;
    this.turnedAt = this.heardAt;
    this.isConnected = true;
    this.hasEnded = false;
    setInterval(() => this.look(), LOOK_MS);
    // A browser that was hidden or asleep looks late: what waits is taken first.
    document.addEventListener("visibilitychange", () => { this.heardAt = performance.now(); });
  }

  heard() {
    this.heardAt = performance.now();
    this.isConnected = true;
  }

  // The connection is lost, and the page has said so.
  lost() {
    this.isConnected = false;
    this.say(null);
  }

  seen({ turns, ended }) {
    this.hasEnded = ended;
    if (turns === this.turns) return;
    this.turns = turns;
    this.turnedAt = performance.now();
  }

  look() {
    if (!this.isConnected || this.hasEnded || document.hidden) return this.say(null);
    const now = performance.now();
    const silence = now - this.heardAt, standstill = now - this.turnedAt;
    const age = (ms) => `${Math.floor(ms / 1000)} s`;
    if (silence > SILENCE_MS) {
      return this.say(`STALE: the program has not answered for ${age(silence)}; it hangs or is ` +
        "suspended. What is shown is old, and STOP here does not reach the station. If the stage " +
        "moves, press the emergency stop. Then continue the program (kill -CONT), or end it.");
    }
    if (this.turns !== null && standstill > STANDSTILL_MS) {
      return this.say(`STALE: no new images for ${age(standstill)}. The program runs; STOP says ` +
        "whether the station takes it. See to the cameras and to the line to the station.");
    }
    return this.say(null);
  }

  say(text) {
    this.element.hidden = !text;
    if (this.element.textContent !== (text ?? "")) this.element.textContent = text ?? "";
  }
}
