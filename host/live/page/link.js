// Connection to the program: state and images in, requests out. Connects again when it is lost.

const KEY = "trinocular-key";
const RETRY_MS = 1000;

// Returns the token of a control link, and removes it from the address bar and the history.
function takeToken() {
  const match = /^#control=([0-9a-f]+)$/.exec(location.hash);
  if (location.hash) history.replaceState(null, "", location.pathname);
  return match ? match[1] : null;
}

export class Link {
  constructor(handlers) {
    this.handlers = handlers;
    this.token = takeToken();
    this.waiting = new Map();
    this.count = 0;
    // The program's clock in the last message that carried it: it tells the program how old the
    // things are that a user sees when a button is pressed.
    this.seenMs = 0;
    this.connect();
    addEventListener("hashchange", () => {
      this.token = takeToken();
      if (this.token) this.send({ token: this.token });
    });
  }

  connect() {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.seenMs = 0;
      const key = sessionStorage.getItem(KEY);
      if (this.token) this.send({ token: this.token });
      else if (key) this.send({ key });
    };
    socket.onmessage = ({ data }) => {
      this.handlers.heard();
      if (typeof data === "string") this.take(JSON.parse(data));
      else this.handlers.images(data);
    };
    socket.onclose = () => {
      for (const answer of this.waiting.values()) answer("the connection was lost");
      this.waiting.clear();
      this.handlers.lost();
      setTimeout(() => this.connect(), RETRY_MS);
    };
    this.socket = socket;
  }

  take(message) {
    if (message.type === "control") {
      const key = sessionStorage.getItem(KEY);
      if (!message.key && this.token && key) {
        // The link was used before; the key of this tab still counts.
        this.token = null;
        this.send({ key });
        return;
      }
      if (message.key) sessionStorage.setItem(KEY, message.key);
      else sessionStorage.removeItem(KEY);
      this.handlers.control(Boolean(message.key), Boolean(this.token));
      this.token = null;
    } else if (message.type === "done") {
      const answer = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (answer) answer(message.error);
    } else {
      this.seenMs = message.clock_ms ?? this.seenMs;
      this.handlers[message.type]?.(message);
    }
  }

  send(message) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(message));
    return true;
  }

  // Asks for an action; resolves to null, or to the reason why it was not done. Without an answer
  // it resolves to such a reason after `patienceMs`.
  do(action, patienceMs = 15_000) {
    return new Promise((resolve) => {
      const id = ++this.count;
      if (!this.send({ do: action, id, seen_ms: this.seenMs })) {
        resolve("not connected");
        return;
      }
      const timer = setTimeout(() => {
        this.waiting.delete(id);
        resolve("the program does not answer");
      }, patienceMs);
      this.waiting.set(id, (error) => {
        clearTimeout(timer);
        resolve(error);
      });
    });
  }
}
