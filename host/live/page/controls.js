// Buttons and keys that control the run, on a page that was opened by the control link.

const byId = (id) => document.getElementById(id);
// A stop is answered when the station has answered it, whatever the program's loop does.
const STOP_PATIENCE_MS = 1000;

export class Controls {
  constructor(link) {
    this.link = link;
    this.isOn = false;
    this.offers = {};
    this.isFollowing = false;
    this.isRecording = false;
    const on = (id, action) => byId(id).addEventListener("click", () => this.ask(action()));
    byId("stop").addEventListener("click", () => this.stop());
    byId("stop-bar").addEventListener("click", () => this.stop());
    on("follow", () => ({ follow: { on: !this.isFollowing } }));
    on("reset", () => ({ reset: {} }));
    on("zero", () => ({ zero: {} }));
    on("home", () => ({ home: {} }));
    on("motors-on", () => ({ motors_on: {} }));
    for (const button of document.querySelectorAll("[data-jog]")) {
      const way = button.dataset.jog.split(",").map(Number);
      button.addEventListener("click", () => {
        const step = Number(byId("jog-step").value);
        this.ask({ jog: { distance_um: way.map((sign) => sign * step) } });
      });
    }
    on("record", () => ({ record: { on: !this.isRecording } }));
    byId("mark-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.ask({ mark: { text: byId("mark-text").value || "mark" } });
      byId("mark-text").value = "";
    });
    // Before any other handler, so that no focused button takes the key.
    addEventListener("keydown", (event) => this.key(event), { capture: true });
  }

  key(event) {
    if (!this.isOn) return;
    const isTyping = event.target instanceof HTMLInputElement && event.target.type !== "checkbox";
    if (event.key === "Escape" || (event.key === " " && !isTyping)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) this.stop();
    }
  }

  async stop() {
    const error = await this.link.do({ stop: {} }, STOP_PATIENCE_MS);
    byId("answer").textContent = error
      ? `STOP WAS NOT ANSWERED: ${error}. Press the emergency stop.` : "The station has taken the stop.";
  }

  async ask(action) {
    const error = await this.link.do(action);
    byId("answer").textContent = error ?? "";
  }

  setOffers(offers) {
    this.offers = offers;
    this.show(null);
  }

  setControl(isOn) {
    this.isOn = isOn;
    byId("controls-panel").hidden = !isOn;
    byId("stop-bar").hidden = !isOn;
    document.body.classList.toggle("control", isOn);
    byId("mode").textContent = isOn ? "control" : "read-only";
    byId("mode").classList.toggle("on", isOn);
  }

  // Enables what the station can do in this state.
  show(state) {
    const { offers } = this;
    const station = state?.station;
    if (state) {
      this.isFollowing = state.following;
      this.isRecording = state.recording !== null;
    }
    const isReady = Boolean(offers.motion && station && station.state === "idle" && station.motors);
    const enable = (id, is) => {
      byId(id).disabled = !is;
    };
    enable("follow", offers.motion && (this.isFollowing || isReady));
    byId("follow").textContent = this.isFollowing ? "End following" : "Start following";
    const isStuck = station?.state === "stopped" || station?.state === "faulted";
    enable("reset", offers.motion && isStuck);
    enable("zero", isReady && !this.isFollowing);
    enable("home", isReady && offers.home && !this.isFollowing);
    byId("home").title = offers.home ? "" : "the rig file names no home switch";
    // A station without a configuration has no motors to switch.
    const areOff = Boolean(station && !station.motors && station.state !== "unconfigured");
    byId("motors-on").hidden = !areOff;
    enable("motors-on", offers.motion && areOff && !this.isFollowing);
    enable("record", offers.record);
    byId("record").title = offers.record ? "" : "only --record records this run";
    byId("record").textContent = this.isRecording ? "End recording" : "Record";
    byId("record").setAttribute("aria-pressed", String(this.isRecording));
    if (state) byId("recording").textContent = state.recording ? `recording ${state.recording}` : "";
    enable("mark", offers.mark);
    enable("mark-text", offers.mark);
    const canJog = offers.motion && !this.isFollowing && station?.motors &&
      (station.state === "idle" || station.state === "moving");
    for (const button of document.querySelectorAll("[data-jog]")) button.disabled = !canJog;
    byId("stop").disabled = !offers.stop;
  }
}
