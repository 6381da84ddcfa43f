"use strict";
// Which rows of a board are shown: by badge, by words, and of a long board the first ones until all are asked for.
(() => {
  const LIMIT = 200;
  const tools = document.getElementById("filters");
  if (!tools) return;
  const body = document.querySelector("table.board").tBodies[0];
  const [least, words, count, every] = ["least", "words", "count", "all"].map((id) => document.getElementById(id));
  let all = false;
  const apply = () => {
    const wanted = words.value.trim().toLowerCase();
    let inside = 0;
    for (const row of body.rows) {
      const fits =
        Number(row.dataset.badge) >= Number(least.value) &&
        (!wanted || row.cells[1].textContent.toLowerCase().includes(wanted));
      inside += fits ? 1 : 0;
      row.hidden = !fits || (!all && inside > LIMIT);
    }
    count.textContent = `${inside} of ${body.rows.length} entries`;
    every.hidden = all || inside <= LIMIT;
  };
  tools.hidden = false;
  tools.addEventListener("input", apply);
  every.addEventListener("click", () => {
    all = true;
    apply();
  });
  body.parentElement.tHead.addEventListener("click", apply);
  apply();
})();
