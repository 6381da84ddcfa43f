"use strict";
// Point clouds, arrows and disks on a canvas: drag or arrow keys turn, wheel, + and - zoom, 0 resets.
// All primitives of a scene are sorted by depth and painted from the back to the front.
(() => {
  const source = document.getElementById("scenes-data");
  if (!source) return;
  const scenes = JSON.parse(source.textContent);
  const views = [];
  const START = { yaw: -0.62, pitch: 0.42, zoom: 1 };
  const TURN = 0.12;
  const SIDES = 28; // of a disk
  const PIECES = 14; // of an arrow's shaft

  const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const mul = (a, k) => [a[0] * k, a[1] * k, a[2] * k];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => mul(a, 1 / Math.hypot(...a));

  function decode(text, scale) {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const packed = new DataView(bytes.buffer);
    const cloud = new Float32Array(bytes.length / 2);
    for (let k = 0; k < cloud.length; k += 1) cloud[k] = packed.getInt16(2 * k, true) * scale;
    return cloud;
  }

  function palette() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    const names = ["environment", "object", "model", "truth", "ink", "muted", "panel"];
    return Object.fromEntries(names.map((name) => [name, colour(name)]));
  }

  function shown() {
    const on = (name, otherwise) => {
      const box = document.getElementById(`show-${name}`);
      return box ? box.checked : otherwise;
    };
    return {
      vectors: on("vectors", true),
      planes: on("planes", true),
      truth: on("truth", true),
      beside: on("beside", false),
    };
  }

  class View {
    constructor(canvas, scene) {
      this.canvas = canvas;
      this.scene = scene;
      this.camera = { ...START };
      this.env = decode(scene.env, scene.scale);
      this.obj = decode(scene.obj, scene.scale);
      this.listen();
      new ResizeObserver(() => this.draw()).observe(canvas);
    }

    listen() {
      const { canvas } = this;
      let from = null;
      canvas.addEventListener("pointerdown", (event) => {
        from = [event.clientX, event.clientY];
        canvas.setPointerCapture(event.pointerId);
      });
      canvas.addEventListener("pointermove", (event) => {
        if (!from) return;
        this.turn((event.clientX - from[0]) * -0.011, (event.clientY - from[1]) * 0.011);
        from = [event.clientX, event.clientY];
      });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (from = null));
      canvas.addEventListener(
        "wheel",
        (event) => {
          if (document.activeElement !== canvas) return; // a page that scrolls must not get stuck here
          event.preventDefault();
          this.zoom(Math.exp(-event.deltaY * 0.0014));
        },
        { passive: false },
      );
      canvas.addEventListener("keydown", (event) => this.key(event));
      for (const button of canvas.parentElement.querySelectorAll("[data-do]")) {
        button.addEventListener("click", () => this.act(button.dataset.do));
      }
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const turns = { ArrowLeft: [TURN, 0], ArrowRight: [-TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN] };
      const acts = { "+": "in", "=": "in", "-": "out", 0: "reset" };
      if (turns[event.key]) this.turn(...turns[event.key]);
      else if (acts[event.key]) this.act(acts[event.key]);
      else return;
      event.preventDefault();
    }

    act(name) {
      if (name === "in") this.zoom(1.2);
      else if (name === "out") this.zoom(1 / 1.2);
      else {
        this.camera = { ...START };
        this.draw();
      }
    }

    turn(yaw, pitch) {
      this.camera.yaw += yaw;
      this.camera.pitch = Math.max(-1.57, Math.min(1.57, this.camera.pitch + pitch));
      this.draw();
    }

    zoom(factor) {
      this.camera.zoom = Math.max(0.3, Math.min(12, this.camera.zoom * factor));
      this.draw();
    }

    // Centre and radius of what is seen.
    bounds(place) {
      const low = [Infinity, Infinity, Infinity];
      const high = [-Infinity, -Infinity, -Infinity];
      const take = (cloud, offset) => {
        for (let k = 0; k < cloud.length; k += 1) {
          const value = cloud[k] + offset[k % 3];
          low[k % 3] = Math.min(low[k % 3], value);
          high[k % 3] = Math.max(high[k % 3], value);
        }
      };
      take(this.env, [0, 0, 0]);
      take(this.obj, place);
      const centre = mul(add(low, high), 0.5);
      return { centre, radius: Math.max(0.5 * Math.hypot(...sub(high, low)), 1e-9) };
    }

    projector(bounds, width, height) {
      const { yaw, pitch, zoom } = this.camera;
      const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
      const distance = 4.5;
      const size = ((0.5 * Math.min(width * 0.86, height)) / bounds.radius) * 1.02 * zoom;
      return (p) => {
        const [x, y, z] = sub(p, bounds.centre);
        const along = -sy * x + cy * y;
        const depth = along * cp - z * sp; // away from the eye
        const near = distance / Math.max(distance + depth / bounds.radius, 0.3);
        return [width / 2 + (cy * x + sy * y) * size * near, height / 2 - (z * cp + along * sp) * size * near, depth, near];
      };
    }

    draw() {
      const ratio = window.devicePixelRatio || 1;
      const { canvas, scene } = this;
      const [width, height] = [canvas.clientWidth || 340, canvas.clientHeight || 272];
      if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
        canvas.width = Math.round(width * ratio);
        canvas.height = Math.round(height * ratio);
      }
      const pen = canvas.getContext("2d");
      const colours = palette();
      const on = shown();
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, width, height);
      const place = on.beside || !scene.place ? scene.beside : scene.place;
      const bounds = this.bounds(place);
      const project = this.projector(bounds, width, height);
      const items = [];
      const labels = [];
      const dot = Math.max(1.8, Math.min(3, width / 180)) * Math.sqrt(Math.min(this.camera.zoom, 4));
      this.points(items, project, this.env, [0, 0, 0], colours.environment, dot, 0.62);
      this.points(items, project, this.obj, place, colours.object, dot * 1.15, 0.85);
      if (on.truth) for (const t of scene.truth) this.length(items, labels, project, t, bounds.radius, colours.truth);
      for (const m of scene.model) {
        if (on.planes) for (const at of m.planes) this.disk(items, project, at, m.vector, 0.2 * bounds.radius, colours.model);
        if (on.vectors && m.vector) this.arrow(items, labels, project, m, bounds.radius, colours.model);
      }
      items.sort((a, b) => b.depth - a.depth);
      for (const item of items) item.paint(pen, bounds.radius);
      pen.globalAlpha = 1;
      this.write(pen, labels, colours);
      this.corner(pen, project, bounds, width, height, colours);
    }

    points(items, project, cloud, offset, colour, size, alpha) {
      const paint = function (pen, radius) {
        const fade = Math.max(0, Math.min(1, (this.depth / radius + 1) / 2)); // 0 near, 1 far
        pen.globalAlpha = alpha * (1.12 - 0.78 * fade);
        pen.fillStyle = colour;
        pen.fillRect(this.x - this.s / 2, this.y - this.s / 2, this.s, this.s);
      };
      for (let k = 0; k < cloud.length; k += 3) {
        const [x, y, depth, near] = project([cloud[k] + offset[0], cloud[k + 1] + offset[1], cloud[k + 2] + offset[2]]);
        items.push({ x, y, depth, s: size * near, paint });
      }
    }

    // A line in pieces, so that points can lie before and behind it.
    line(items, project, from, to, colour, thickness, dash = false) {
      for (let k = 0; k < PIECES; k += 1) {
        if (dash && k % 2) continue;
        const a = project(add(from, mul(sub(to, from), k / PIECES)));
        const b = project(add(from, mul(sub(to, from), (k + 1) / PIECES)));
        items.push({
          depth: (a[2] + b[2]) / 2,
          paint: (pen) => {
            pen.globalAlpha = 0.95;
            pen.strokeStyle = colour;
            pen.lineWidth = thickness;
            pen.beginPath();
            pen.moveTo(a[0], a[1]);
            pen.lineTo(b[0], b[1]);
            pen.stroke();
          },
        });
      }
    }

    head(items, project, tip, direction, size, colour) {
      const a = project(tip);
      const b = project(sub(tip, mul(direction, size)));
      const [dx, dy] = [a[0] - b[0], a[1] - b[1]];
      items.push({
        depth: a[2],
        paint: (pen) => {
          const reach = Math.hypot(dx, dy);
          const wide = 4.2;
          const [ox, oy] = reach > 0.5 ? [(-dy / reach) * wide, (dx / reach) * wide] : [wide, 0];
          pen.globalAlpha = 1;
          pen.fillStyle = colour;
          pen.beginPath();
          pen.moveTo(a[0], a[1]);
          pen.lineTo(b[0] + ox, b[1] + oy);
          pen.lineTo(b[0] - ox, b[1] - oy);
          pen.fill();
        },
      });
    }

    arrow(items, labels, project, model, radius, colour) {
      const direction = unit(model.vector);
      const tip = add(model.at, mul(direction, 0.42 * radius));
      this.line(items, project, model.at, tip, colour, 2.6);
      this.head(items, project, tip, direction, 0.09 * radius, colour);
      labels.push({ at: project(add(model.at, mul(direction, 0.5 * radius))), text: model.name, colour });
    }

    // A true length: from face to face, with rings on the faces.
    length(items, labels, project, truth, radius, colour) {
      const [from, to] = truth.ends;
      const direction = unit(sub(to, from));
      this.line(items, project, from, to, colour, 1.5, true);
      for (const [end, sign] of [[from, -1], [to, 1]]) this.head(items, project, end, mul(direction, sign), 0.06 * radius, colour);
      for (const end of truth.ends) this.disk(items, project, end, direction, 0.16 * radius, colour, true);
      labels.push({ at: project(add(to, mul(direction, 0.13 * radius))), text: truth.name, colour });
    }

    disk(items, project, at, normal, radius, colour, ring = false) {
      if (!normal) return;
      const n = unit(normal);
      const u = unit(cross(n, Math.abs(n[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
      const v = cross(n, u);
      const rim = [];
      for (let k = 0; k <= SIDES; k += 1) {
        const angle = (2 * Math.PI * k) / SIDES;
        rim.push(project(add(at, add(mul(u, radius * Math.cos(angle)), mul(v, radius * Math.sin(angle))))));
      }
      const centre = project(at);
      for (let k = 0; k < SIDES; k += 1) {
        const [a, b] = [rim[k], rim[k + 1]];
        items.push({
          depth: (a[2] + b[2] + centre[2]) / 3,
          paint: (pen) => {
            pen.globalAlpha = ring ? 0.75 : 0.2;
            pen.fillStyle = colour;
            pen.strokeStyle = colour;
            pen.lineWidth = ring ? 1.2 : 1.6;
            pen.beginPath();
            if (!ring) {
              pen.moveTo(centre[0], centre[1]);
              pen.lineTo(a[0], a[1]);
              pen.lineTo(b[0], b[1]);
              pen.fill();
              pen.globalAlpha = 0.9;
              pen.beginPath();
            }
            pen.moveTo(a[0], a[1]);
            pen.lineTo(b[0], b[1]);
            pen.stroke();
          },
        });
      }
    }

    write(pen, labels, colours) {
      pen.font = "12px system-ui, sans-serif";
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      pen.lineJoin = "round";
      for (const { at, text, colour } of labels) {
        pen.strokeStyle = colours.panel;
        pen.lineWidth = 3.5;
        pen.strokeText(text, at[0], at[1]);
        pen.fillStyle = colour;
        pen.fillText(text, at[0], at[1]);
      }
    }

    // Axes and a length to compare with.
    corner(pen, project, bounds, width, height, colours) {
      const origin = project(bounds.centre);
      const pixels = (p) => {
        const at = project(add(bounds.centre, mul(p, bounds.radius * 1e-3)));
        return [(at[0] - origin[0]) * 1e3, (at[1] - origin[1]) * 1e3];
      };
      const reach = (0.5 * Math.min(width * 0.86, height)) * 1.02 * this.camera.zoom;
      const [x0, y0] = [26, height - 26];
      pen.lineWidth = 1.2;
      pen.strokeStyle = colours.muted;
      pen.fillStyle = colours.muted;
      pen.font = "11px system-ui, sans-serif";
      ["x", "y", "z"].forEach((name, axis) => {
        const [dx, dy] = pixels([0, 1, 2].map((k) => (k === axis ? 1 : 0))).map((v) => (v / reach) * 17);
        pen.beginPath();
        pen.moveTo(x0, y0);
        pen.lineTo(x0 + dx, y0 + dy);
        pen.stroke();
        pen.fillText(name, x0 + dx * 1.4, y0 + dy * 1.4);
      });
      const perMetre = reach / bounds.radius;
      const raw = (0.22 * width) / perMetre;
      const power = 10 ** Math.floor(Math.log10(raw));
      const bar = [5, 2, 1].map((m) => m * power).find((m) => m <= raw);
      const [x1, y1] = [width - 12, height - 12];
      pen.beginPath();
      pen.moveTo(x1 - bar * perMetre, y1);
      pen.lineTo(x1, y1);
      pen.stroke();
      pen.fillText(`${Number(bar.toPrecision(2))} m`, x1 - (bar * perMetre) / 2, y1 - 9);
    }
  }

  const drawAll = () => views.forEach((view) => view.draw());
  for (const canvas of document.querySelectorAll("canvas[data-scene]")) {
    views.push(new View(canvas, scenes[Number(canvas.dataset.scene)]));
  }
  drawAll();
  for (const box of document.querySelectorAll("input[id^=show-]")) box.addEventListener("change", drawAll);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  addEventListener("beforeprint", () => {
    document.documentElement.dataset.print = "";
    drawAll();
  });
  addEventListener("afterprint", () => {
    delete document.documentElement.dataset.print;
    drawAll();
  });
})();
