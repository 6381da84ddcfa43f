"use strict";
// Which rows of a board are shown: by badge, by words.
(() => {
  const tools = document.getElementById("filters");
  if (!tools) return;
  const rows = [...document.querySelectorAll("table.board tbody tr")].map((row) => ({
    row,
    badge: Number(row.dataset.badge),
    words: row.cells[1].textContent.toLowerCase(),
  }));
  const least = document.getElementById("least");
  const words = document.getElementById("words");
  const count = document.getElementById("count");
  const apply = () => {
    const wanted = words.value.trim().toLowerCase();
    let shown = 0;
    for (const one of rows) {
      const inside = one.badge >= Number(least.value) && one.words.includes(wanted);
      one.row.hidden = !inside;
      shown += inside ? 1 : 0;
    }
    count.textContent = `${shown} of ${rows.length} entries`;
  };
  tools.hidden = false;
  tools.addEventListener("input", apply);
  apply();
})();
