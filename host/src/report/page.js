"use strict";
// Copy buttons, and paths in space that are turned by dragging or by the arrow keys.
(() => {
  document.querySelectorAll("button.copy").forEach((button) => {
    const text = button.parentElement.querySelector("pre");
    button.hidden = false;
    button.addEventListener("click", () => {
      const range = document.createRange();
      range.selectNodeContents(text);
      const selection = getSelection();
      selection.removeAllRanges();
      selection.addRange(range);
      const done = () => { button.textContent = "Copied"; };
      const byHand = () => { if (document.execCommand("copy")) done(); };
      if (navigator.clipboard) navigator.clipboard.writeText(text.textContent).then(done, byHand);
      else byHand();
    });
  });

  const SVG = "http://www.w3.org/2000/svg";
  const element = (parent, name, attributes) => {
    const made = parent.appendChild(document.createElementNS(SVG, name));
    Object.entries(attributes).forEach(([key, value]) => made.setAttribute(key, value));
    return made;
  };
  const radians = (degrees) => degrees * Math.PI / 180;

  document.querySelectorAll("svg.turn").forEach((svg) => {
    const scene = JSON.parse(svg.dataset.scene);
    const group = svg.querySelector("g");
    const still = group.innerHTML;
    const view = { azimuth: scene.azimuth, elevation: scene.elevation };

    const draw = () => {
      const [a, e] = [radians(view.azimuth), radians(view.elevation)];
      const place = (unit) => {
        const [x, y, z] = unit.map((value, i) => value * scene.half[i]);
        const right = Math.cos(a) * y - Math.sin(a) * x;
        const up = Math.cos(e) * z - Math.sin(e) * (Math.cos(a) * x + Math.sin(a) * y);
        const scale = 0.92 * scene.scale;
        return [scene.centre[0] + scale * right, scene.centre[1] - scale * up].map(Math.round);
      };
      const line = (units, stroke, width, dashes) => {
        const points = units.map(place).join(" ");
        const attributes = { points, stroke, "stroke-width": width, fill: "none" };
        if (dashes) attributes["stroke-dasharray"] = dashes;
        element(group, "polyline", attributes);
      };
      const write = (text, [x, y], anchor, fill) => {
        const attributes = { x, y, fill, "text-anchor": anchor, "dominant-baseline": "middle" };
        element(group, "text", { ...attributes, "font-size": scene.text }).textContent = text;
      };
      // The near side of the floor, and the walls behind.
      const near = [Math.cos(a) > 0 ? 1 : -1, Math.sin(a) > 0 ? 1 : -1];
      const [backX, backY] = [-near[0], -near[1]];
      group.replaceChildren();
      scene.axes[0].ticks.forEach(([t]) => {
        line([[t, -1, -1], [t, 1, -1]], "var(--grid)", 10);
        line([[t, backY, -1], [t, backY, 1]], "var(--grid)", 10);
      });
      scene.axes[1].ticks.forEach(([t]) => {
        line([[-1, t, -1], [1, t, -1]], "var(--grid)", 10);
        line([[backX, t, -1], [backX, t, 1]], "var(--grid)", 10);
      });
      scene.axes[2].ticks.forEach(([t]) => {
        line([[backX, -1, t], [backX, 1, t]], "var(--grid)", 10);
        line([[-1, backY, t], [1, backY, t]], "var(--grid)", 10);
      });
      [[[backX, -1, 1], [backX, 1, 1]], [[-1, backY, 1], [1, backY, 1]],
        [[backX, backY, -1], [backX, backY, 1]]].forEach((edge) => line(edge, "var(--shadow)", 10));
      // The upright axis stands at the leftmost corner.
      const corners = [[-1, -1], [-1, 1], [1, -1], [1, 1]];
      const left = corners.sort((p, q) => place([...p, -1])[0] - place([...q, -1])[0])[0];
      const edges = [(t) => [t, near[1], -1], (t) => [near[0], t, -1], (t) => [...left, t]];
      edges.forEach((edge, i) => {
        line([edge(-1), edge(1)], "var(--axis)", 12);
        const middle = place(edge(0));
        const isUpright = i === 2;
        const toRight = middle[0] > scene.centre[0];
        const anchor = isUpright ? "end" : toRight ? "start" : "end";
        const aside = anchor === "start" ? 80 : -80;
        scene.axes[i].ticks.forEach(([t, label]) => {
          const [x, y] = place(edge(t));
          write(label, [x + aside, y + (isUpright ? 0 : 120)], anchor, "var(--soft)");
        });
        const [x, y] = isUpright ? place(edge(1)) : middle;
        const at = isUpright ? [x, y - 160] : [x + 5 * aside, y + 330];
        write(scene.axes[i].name, at, isUpright ? "middle" : anchor, "var(--ink)");
      });
      const runs = (points) => points.reduce((all, point) => {
        if (point) all[all.length - 1].push(point);
        else all.push([]);
        return all;
      }, [[]]);
      scene.series.forEach((series) => runs(series.points).forEach((run) => {
        line(run.map(([x, y]) => [x, y, -1]), "var(--shadow)", 12);
      }));
      scene.series.forEach((series) => {
        const colour = `var(--c${series.colour})`;
        runs(series.points).forEach((run) => {
          if (series.line) line(run, colour, series.width, series.dashes);
          if (series.dots || run.length === 1) {
            run.forEach((point) => {
              const [cx, cy] = place(point);
              element(group, "circle", { cx, cy, r: 36, fill: colour });
            });
          }
        });
      });
    };

    const turn = (right, up) => {
      view.azimuth -= right;
      view.elevation = Math.min(88, Math.max(4, view.elevation + up));
      draw();
    };
    let last = null;
    svg.addEventListener("pointerdown", (event) => {
      last = event;
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (!last) return;
      turn((event.clientX - last.clientX) * 0.5, (event.clientY - last.clientY) * 0.4);
      last = event;
    });
    ["pointerup", "pointercancel"].forEach((name) => {
      svg.addEventListener(name, () => { last = null; });
    });
    svg.addEventListener("dblclick", () => {
      Object.assign(view, { azimuth: scene.azimuth, elevation: scene.elevation });
      group.innerHTML = still;
    });
    const keys = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, -6], ArrowDown: [0, 6] };
    svg.addEventListener("keydown", (event) => {
      const step = keys[event.key];
      if (!step) return;
      event.preventDefault();
      turn(...step);
    });
    svg.tabIndex = 0;
    svg.classList.add("turnable");
    const hint = document.createElement("p");
    hint.className = "hint";
    hint.textContent = "Drag or press the arrow keys to turn; double-click to reset.";
    svg.after(hint);
  });
})();
