"use strict";
// Plays the paths of robots: where one is in the room, what its camera sees, the free rectangle that its model tells.
(() => {
  const MOVES = ["ended", "turns", "goes forward", "collides"];
  const STEP_MS = 110;
  const MOST = 2;
  const SVG = "http://www.w3.org/2000/svg";
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const made = (name, attributes) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return element;
  };
  const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  const moveRobot = (svg, drive, step) => {
    const [x, y] = drive.places[step];
    const heading = drive.headings[step];
    const says = drive.moves[step] === "1" ? "blocked" : "passes";
    const radius = (drive.size[0] / 2) * drive.scale;
    const ahead = drive.ahead * drive.scale;
    const half = (Math.min(drive.sides[step][0] ?? drive.size[0], MOST) / 2) * drive.scale;
    const sight = Math.min(1.2, drive.reach) * drive.scale;
    const wide = drive.camera[2];
    const marks = [
      made("path", { class: "sight", d: `M${sight} ${-sight * wide}L0 0L${sight} ${sight * wide}` }),
      made("circle", { r: radius }),
      made("line", { class: "nose", x2: radius }),
      made("line", { class: `says ${says}`, x1: ahead, x2: ahead, y1: -half, y2: half }),
    ];
    const robot = svg.querySelector(".robot");
    robot.setAttribute("transform", `translate(${x} ${y}) rotate(${(-heading * 180) / Math.PI})`);
    robot.replaceChildren(...marks);
    const trail = drive.places.slice(0, step + 1).map((p) => p.join(",")).join(" ");
    svg.querySelector(".trail").setAttribute("points", trail);
  };

  const drawView = (canvas, drive, views, step) => {
    const pen = canvas.getContext("2d");
    const { width, height } = canvas;
    pen.clearRect(0, 0, width, height);
    const from = step * drive.points * 3;
    const ink = colour("--ink");
    for (let k = from; k < from + 3 * drive.points; k += 3) {
      if (views[k + 2] === 255) continue;
      const near = 1 - views[k + 2] / 254;
      pen.globalAlpha = 0.25 + 0.75 * near;
      pen.fillStyle = ink;
      const size = 2 + 4 * near * near;
      pen.fillRect((views[k] / 254) * width - size / 2, (views[k + 1] / 254) * height - size / 2, size, size);
    }
    pen.globalAlpha = 1;
    drawRectangle(pen, drive, step, width, height);
  };

  const drawRectangle = (pen, drive, step, width, height) => {
    const [wide, high] = drive.sides[step];
    if (wide === null && high === null) return;
    const [forward, up, tanWide, tanHigh] = drive.camera;
    const depth = drive.ahead - forward;
    if (depth <= 0) return;
    const column = (y) => (1 - y / depth / tanWide) * 0.5 * width;
    const row = (z) => (1 - (z - up) / depth / tanHigh) * 0.5 * height;
    const half = Math.min(wide ?? drive.size[0], MOST) / 2;
    const within = (value, most) => Math.min(Math.max(value, 3), most - 3);
    const [left, right] = [column(half), column(-half)].map((value) => within(value, width));
    const [top, bottom] = [row(Math.min(high ?? drive.size[1], MOST)), row(0)].map((value) => within(value, height));
    pen.strokeStyle = colour(drive.moves[step] === "1" ? "--bad" : "--good");
    pen.fillStyle = pen.strokeStyle;
    pen.lineWidth = 4;
    pen.setLineDash(wide === null || high === null ? [10, 6] : []);
    pen.globalAlpha = 0.12;
    pen.fillRect(left, top, right - left, bottom - top);
    pen.globalAlpha = 1;
    pen.strokeRect(left, top, right - left, bottom - top);
    pen.setLineDash([]);
  };

  const metres = (value) => (value === null ? "" : `${value.toFixed(2)} m`);
  const told = (drive, step) => {
    const [wide, high] = drive.sides[step];
    const sides = [wide === null ? "" : `${metres(wide)} wide`, high === null ? "" : `${metres(high)} high`];
    const free = sides.filter(Boolean).join(", ");
    const says = drive.moves[step] === "1" ? "does not pass" : "passes";
    return `step ${step + 1} of ${drive.places.length}: ${says}${free ? ` (free: ${free})` : ""}; ${MOVES[drive.moves[step]]}`;
  };

  const start = (figure, drive) => {
    const svg = figure.querySelector("svg");
    const canvas = figure.querySelector("canvas");
    const slider = figure.querySelector("input");
    const button = figure.querySelector("button");
    const output = figure.querySelector("output");
    const views = bytesOf(drive.views);
    const last = drive.places.length - 1;
    let timer = null;
    const show = () => {
      const step = Number(slider.value);
      moveRobot(svg, drive, step);
      drawView(canvas, drive, views, step);
      output.textContent = told(drive, step);
    };
    const stop = () => {
      clearInterval(timer);
      timer = null;
      button.textContent = "Play";
    };
    const next = () => {
      if (Number(slider.value) >= last) return stop();
      slider.value = Number(slider.value) + 1;
      return show();
    };
    button.addEventListener("click", () => {
      if (timer) return stop();
      if (Number(slider.value) >= last) slider.value = 0;
      button.textContent = "Pause";
      timer = setInterval(next, STEP_MS);
      return show();
    });
    slider.max = last;
    slider.addEventListener("input", show);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
    canvas.height = Math.round((canvas.width * drive.camera[3]) / drive.camera[2]);
    figure.classList.add("live");
    show();
  };

  const drives = JSON.parse(document.getElementById("frames").textContent);
  for (const figure of document.querySelectorAll("figure.drive")) start(figure, drives[Number(figure.dataset.number)]);
})();
