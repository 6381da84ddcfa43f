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
    const marks = [
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
    const colours = ["--beside", "--ink", "--model"].map(colour);
    const from = step * drive.points * 4;
    for (let k = from; k < from + 4 * drive.points; k += 4) {
      if (views[k + 2] === 255) continue;
      const near = 1 - views[k + 2] / 254;
      const size = 3 + 5 * near;
      pen.globalAlpha = views[k + 3] === 0 ? 0.45 : 0.9;
      pen.fillStyle = colours[views[k + 3]];
      pen.fillRect((views[k] / 254) * width - size / 2, (views[k + 1] / 254) * height - size / 2, size, size);
    }
    pen.globalAlpha = 1;
    drawRectangle(pen, drive, step, width, height);
  };

  const drawRectangle = (pen, drive, step, width, height) => {
    const [wide, high] = drive.sides[step];
    if (wide === null && high === null) return;
    const [back, over, cos, sin, tanWide, tanHigh] = drive.eye;
    const place = (y, z) => {
      const [x, up] = [drive.ahead - back, z - over];
      const depth = x * cos - up * sin;
      return [(1 - y / depth / tanWide) * 0.5 * width, (1 - (x * sin + up * cos) / depth / tanHigh) * 0.5 * height];
    };
    const half = Math.min(wide ?? drive.size[0], MOST) / 2;
    const top = Math.min(high ?? drive.size[1], MOST);
    pen.strokeStyle = colour(drive.moves[step] === "1" ? "--bad" : "--good");
    pen.fillStyle = pen.strokeStyle;
    pen.lineWidth = 4;
    pen.setLineDash(wide === null || high === null ? [10, 6] : []);
    pen.beginPath();
    for (const [y, z] of [[half, 0], [half, top], [-half, top], [-half, 0]]) pen.lineTo(...place(y, z));
    pen.closePath();
    pen.globalAlpha = 0.14;
    pen.fill();
    pen.globalAlpha = 1;
    pen.stroke();
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
    canvas.height = Math.round((canvas.width * drive.eye[5]) / drive.eye[4]);
    figure.classList.add("live");
    show();
  };

  const drives = JSON.parse(document.getElementById("frames").textContent);
  for (const figure of document.querySelectorAll("figure.drive")) start(figure, drives[Number(figure.dataset.number)]);
})();
