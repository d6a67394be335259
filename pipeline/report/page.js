"use strict";
(() => {
  // Tables: a press on a heading sorts, a second press turns the order round.
  const value = (row, column, numeric) => {
    const text = row.cells[column].dataset.sort;
    return numeric ? (text === "" ? NaN : Number(text)) : text;
  };
  const numericColumn = (rows, column) =>
    rows.every((row) => row.cells[column].dataset.sort === "" || Number.isFinite(Number(row.cells[column].dataset.sort)));
  const sort = (heading) => {
    const table = heading.closest("table"), body = table.tBodies[0], rows = [...body.rows];
    const column = heading.cellIndex, numeric = numericColumn(rows, column);
    const up = heading.getAttribute("aria-sort") !== "ascending";
    rows.sort((a, b) => {
      const x = value(a, column, numeric), y = value(b, column, numeric);
      if (numeric) {
        if (Number.isNaN(x) || Number.isNaN(y)) return Number.isNaN(x) - Number.isNaN(y);
        return up ? x - y : y - x;
      }
      return (up ? 1 : -1) * x.localeCompare(y, "en", { numeric: true });
    });
    for (const other of heading.parentNode.cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", up ? "ascending" : "descending");
    body.append(...rows);
  };
  for (const button of document.querySelectorAll("th button"))
    button.addEventListener("click", () => sort(button.closest("th")));

  // Figures: the value nearest to the pointer, or the next one on an arrow key.
  const tip = document.getElementById("tip"), REACH = 28;
  let seen = null;
  const hide = () => {
    tip.hidden = true;
    if (seen) seen.classList.remove("seen");
    seen = null;
  };
  const place = () => {
    if (!seen) return;
    const at = seen.getBoundingClientRect(), box = tip.getBoundingClientRect();
    const left = Math.min(Math.max(4, at.x + at.width / 2 - box.width / 2), innerWidth - box.width - 4);
    const above = at.y - box.height - 8;
    tip.style.left = `${left}px`;
    tip.style.top = `${above < 4 ? at.bottom + 8 : above}px`;
  };
  const show = (mark) => {
    if (seen === mark) return;
    hide();
    seen = mark;
    mark.classList.add("seen");
    tip.textContent = mark.dataset.tip;
    tip.hidden = false;
    place();
  };
  const distance = (box, x, y) =>
    Math.hypot(Math.max(box.left - x, 0, x - box.right), Math.max(box.top - y, 0, y - box.bottom)) +
    1e-3 * Math.hypot((box.left + box.right) / 2 - x, (box.top + box.bottom) / 2 - y);
  for (const plot of document.querySelectorAll(".plot")) {
    const marks = [...plot.querySelectorAll("[data-tip]")];
    let index = -1;
    plot.addEventListener("pointermove", (event) => {
      let best = null, least = REACH;
      for (const mark of marks) {
        const d = distance(mark.getBoundingClientRect(), event.clientX, event.clientY);
        if (d < least) [best, least] = [mark, d];
      }
      if (best) show(best); else hide();
    });
    plot.addEventListener("pointerleave", hide);
    plot.addEventListener("blur", hide);
    plot.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (event.key === "Escape") hide();
      if (!step || !marks.length) return;
      event.preventDefault();
      index = (index + step + marks.length + (index < 0 && step < 0 ? 1 : 0)) % marks.length;
      show(marks[index]);
    });
  }
  // Followed, not hidden: a figure reached by Tab is scrolled into view, and that may end after the first arrow key.
  // Captured, because a wide figure scrolls in its own box and such a scroll does not bubble.
  addEventListener("scroll", place, { passive: true, capture: true });
})();
