"use strict";
// Sorts the rows of each model by a column, and hides those that do not hold a word. Nothing else.
const table = document.querySelector("table.devices");
const key = (row, at) => {
  const text = row.cells[at].textContent.trim();
  const number = parseFloat(text);
  return [Number.isNaN(number) ? Infinity : number, text.replace("–", "\uffff")];
};
table.tHead.querySelectorAll("th").forEach((head, at) => {
  const button = document.createElement("button");
  button.type = "button";
  button.append(...head.childNodes);
  head.append(button);
  button.addEventListener("click", () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    table.tHead.querySelectorAll("th").forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const named = at < 3 || at === table.tHead.rows[0].cells.length - 1;
    for (const body of table.tBodies) {
      const rows = [...body.rows].filter((row) => row.cells.length > 1);
      const keyed = rows.map((row) => [key(row, at), row]);
      keyed.sort(([a], [b]) => (named ? 0 : a[0] === b[0] ? 0 : a[0] - b[0]) ||
        a[1].localeCompare(b[1], undefined, { numeric: true }));
      // What has no number stays last, whichever way.
      const last = keyed.filter(([k]) => k[1] === "\uffff" || (!named && k[0] === Infinity));
      const known = keyed.filter((entry) => !last.includes(entry));
      if (down) known.reverse();
      body.append(...[...known, ...last].map((entry) => entry[1]));
    }
  });
});
const label = document.createElement("label");
const field = document.createElement("input");
field.type = "search";
label.append("Show devices with ", field);
label.className = "filter";
if (table.rows.length > 12) document.getElementById("filter").append(label);
field.addEventListener("input", () => {
  const word = field.value.toLowerCase();
  for (const body of table.tBodies)
    for (const row of body.rows)
      row.hidden = row.cells.length > 1 && !row.textContent.toLowerCase().includes(word);
});
