// Words and numbers: notices, key figures, tables.
import type { Cell, FiguresBlock, NoticesBlock, TableBlock, TextBlock } from "./contract";
import { csv, tableRows } from "./csv";
import { button, element, fileStem, save } from "./dom";
import { measured, unit, withUnit } from "./format";

export function showText(block: TextBlock): HTMLElement {
  return element("div", { class: "text wide" }, ...block.paragraphs.map((text) => element("p", {}, text)));
}

export function showNotices(block: NoticesBlock): HTMLElement {
  const words = { good: "Good", note: "Note", warning: "Warning" };
  const list = element("ul", { class: "notices wide" });
  for (const { level, text } of block.items)
    list.append(element("li", { class: level }, element("strong", {}, words[level]), element("span", {}, text)));
  return list;
}

export function showFigures(block: FiguresBlock): HTMLElement {
  const list = element("dl", { class: "figures wide" });
  for (const item of block.items) {
    const name = item.symbol ? `${item.name}, ${item.symbol}` : item.name;
    const value = element("dd", { "data-value": item.value ?? "" }, measured(item));
    value.append(element("small", {}, ` ${unit(item.unit)}`));
    const card = element("div", {}, element("dt", {}, name), value);
    if (item.note) card.append(element("dd", { class: "note" }, item.note));
    list.append(card);
  }
  return list;
}

function showCell(cell: Cell): HTMLElement {
  if (typeof cell === "string") return element("td", {}, cell);
  return element(
    "td",
    { class: "number", "data-value": cell.value ?? "", "data-error": cell.error ?? "" },
    measured(cell).replace("± ", "±\u00a0"),
  );
}

export function showTable(block: TableBlock): HTMLElement {
  const head = element("tr", {}, element("th", { scope: "col" }, block.head));
  for (const column of block.columns) head.append(element("th", { scope: "col" }, withUnit(column.name, column.unit)));
  const body = element("tbody");
  for (const row of block.rows)
    body.append(element("tr", {}, element("th", { scope: "row" }, row.name), ...row.cells.map(showCell)));
  const table = element("table", { style: `--columns: ${block.columns.length}` }, element("caption", {}, block.title), element("thead", {}, head), body);
  const download = button("CSV", `Save the table ${block.title} as CSV`, () =>
    save(`${fileStem(block.title)}.csv`, new Blob([csv(tableRows(block))], { type: "text/csv" })),
  );
  const made = element("div", { class: "table wide" });
  // The box scrolls sideways on a phone, so it must be reachable with the keyboard.
  made.append(element("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": block.title }, table));
  if (block.note) made.append(element("p", { class: "note" }, block.note));
  made.append(element("div", { class: "tools" }, download));
  return made;
}
