// A click on a heading sorts the table by that column.
const table = document.querySelector("table"), heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
const orderOf = (row, k) => {
  const order = row.cells[k].dataset.order, number = order === "inf" ? Infinity : Number(order);
  return Number.isNaN(number) ? order : number;
};
heads.forEach((head, k) => {
  for (const row of body.rows) row.cells[k].dataset.words = head.textContent;
  head.firstChild.onclick = () => {
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const compared = (a, b) => typeof a === "string" || typeof b === "string" ? String(a).localeCompare(String(b), "en", {numeric: true}) : a < b ? -1 : a > b ? 1 : 0;
    body.append(...[...body.rows].sort((a, b) => (down ? -1 : 1) * compared(orderOf(a, k), orderOf(b, k))));
  };
});
