// Images of all cameras with points, common view and texture, and the aids for setting them up.

const INLIER = "#38d39f";
const REJECTED = "#ff5d5d";
const OVERLAP = "#f0c33c";
// Texture below this is hard to follow, grey levels per px.
const LEAST_TEXTURE = 3;
const CLIPPED = 0.02;

function element(tag, className, parent) {
  const made = document.createElement(tag);
  made.className = className;
  parent.append(made);
  return made;
}

function aid(parent, label, help) {
  const line = element("div", "aid", parent);
  line.title = help;
  element("span", "", line).textContent = label;
  const bar = element("b", "", element("i", "", line));
  return { bar, value: element("span", "", line) };
}

export class Cameras {
  constructor(parent, onDrawn) {
    this.parent = parent;
    this.onDrawn = onDrawn;
    this.views = [];
    this.header = null;
    this.shows = {};
    for (const layer of ["points", "overlap", "texture"]) {
      const box = document.getElementById(`show-${layer}`);
      this.shows[layer] = () => box.checked;
      box.addEventListener("change", () => this.redraw());
    }
  }

  setUp({ cameras, size_px: [width, height] }) {
    this.parent.replaceChildren();
    this.views = cameras.map((name) => {
      const figure = element("div", "camera", this.parent);
      const title = element("div", "name", figure);
      title.append(name);
      const remark = element("span", "", title);
      const canvas = element("canvas", "", figure);
      canvas.width = 2 * width;
      canvas.height = 2 * height;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `image of camera ${name}`);
      return {
        canvas, remark, best: 0, image: null,
        sharpness: aid(figure, "sharpness",
          "Share of the sharpest image so far. Turn the focus ring until it stops rising."),
        clipped: aid(figure, "clipped", "share of black and white pixels: adapt light or exposure"),
        mean: aid(figure, "brightness", "mean grey level, 0 to 255"),
      };
    });
  }

  // Draws an image set: header length, header, one JPEG per camera.
  async take(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    let at = 4 + length;
    const bodies = header.cameras.map(({ bytes }) => {
      const body = new Blob([new Uint8Array(buffer, at, bytes)], { type: "image/jpeg" });
      at += bytes;
      return body;
    });
    try {
      const images = await Promise.all(
        bodies.map((body) => (body.size ? createImageBitmap(body) : null)));
      this.header = header;
      this.views.forEach((view, k) => {
        view.image?.close();
        view.image = images[k];
      });
      this.redraw();
      this.showAids();
    } finally {
      // The next set comes when this one is on the screen.
      requestAnimationFrame(() => this.onDrawn(header.number));
    }
  }

  redraw() {
    const { header } = this;
    if (!header) return;
    this.views.forEach((view, k) => {
      const camera = header.cameras[k];
      const context = view.canvas.getContext("2d");
      const { width, height } = view.canvas;
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, width, height);
      if (!view.image || !camera) {
        view.remark.textContent = "no image";
        view.remark.className = "bad";
        return;
      }
      context.drawImage(view.image, 0, 0, width, height);
      const scale = width / camera.size[0];
      // Pixel coordinates count from the centre of the first pixel.
      context.setTransform(scale, 0, 0, scale, 0.5 * scale, 0.5 * scale);
      if (this.shows.texture()) drawTexture(context, camera, header.cells);
      if (this.shows.overlap() && camera.overlap) drawOverlap(context, camera.overlap);
      if (this.shows.points()) drawPoints(context, camera);
      const { inliers, rejected } = camera;
      view.remark.className = "";
      view.remark.textContent =
        inliers ? `${inliers.length} points, ${rejected.length} left out` : "";
    });
    this.showLegend();
  }

  showLegend() {
    const { header } = this;
    const counts = new Map();
    const first = header.cameras.find((camera) => camera.rejected);
    for (const [, , reason] of first?.rejected ?? []) {
      counts.set(reason, (counts.get(reason) ?? 0) + 1);
    }
    const reasons = [...counts].sort((a, b) => b[1] - a[1])
      .map(([reason, count]) => `${count} ${header.reasons[reason]}`);
    document.getElementById("rejected-legend").textContent =
      reasons.length ? `left out: ${reasons.join(", ")}` : "left out: none";
    document.getElementById("distance").textContent =
      header.distance_mm ? `at ${header.distance_mm.toFixed(0)} mm` : "";
  }

  showAids() {
    this.views.forEach((view, k) => {
      const aids = this.header.cameras[k]?.aids;
      if (!aids || !view.image) return;
      view.best = Math.max(view.best, aids.sharpness);
      const share = view.best > 0 ? aids.sharpness / view.best : 0;
      set(view.sharpness, share, `${(100 * share).toFixed(0)} %`, share < 0.7);
      const clipped = aids.white + aids.black;
      set(view.clipped, clipped, `${(100 * clipped).toFixed(1)} %`, clipped > CLIPPED);
      const isExtreme = aids.mean < 40 || aids.mean > 215;
      set(view.mean, aids.mean / 255, aids.mean.toFixed(0), isExtreme);
    });
  }
}

function set({ bar, value }, share, text, isBad) {
  bar.style.width = `${Math.min(100, 100 * share)}%`;
  bar.className = isBad ? "warn" : "";
  value.textContent = text;
}

function drawPoints(context, { inliers, rejected }) {
  context.lineWidth = 1;
  context.strokeStyle = INLIER;
  context.beginPath();
  for (const [x, y] of inliers ?? []) {
    context.moveTo(x + 2, y);
    context.arc(x, y, 2, 0, 7);
  }
  context.stroke();
  context.strokeStyle = REJECTED;
  context.beginPath();
  for (const [x, y] of rejected ?? []) {
    context.moveTo(x - 2, y - 2);
    context.lineTo(x + 2, y + 2);
    context.moveTo(x - 2, y + 2);
    context.lineTo(x + 2, y - 2);
  }
  context.stroke();
}

function drawOverlap(context, corners) {
  context.lineWidth = 1.2;
  context.strokeStyle = OVERLAP;
  context.setLineDash([6, 4]);
  context.beginPath();
  for (const [x, y] of corners) context.lineTo(x, y);
  context.closePath();
  context.stroke();
  context.setLineDash([]);
}

function drawTexture(context, { size: [width, height], aids }, [columns, rows]) {
  aids.texture.forEach((texture, index) => {
    const x = (index % columns) * width / columns;
    const y = Math.floor(index / columns) * height / rows;
    const isPoor = texture < LEAST_TEXTURE;
    context.fillStyle = isPoor ? "rgb(255 70 70 / .4)" : "rgb(56 211 159 / .22)";
    context.fillRect(x - 0.5, y - 0.5, width / columns - 1, height / rows - 1);
    context.fillStyle = "#fff";
    context.font = "9px sans-serif";
    context.fillText(texture.toFixed(0), x + 2, y + 9);
  });
}
