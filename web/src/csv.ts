// Tables and plots as CSV (RFC 4180) with the full precision of the report's numbers.
import type { Cell, Chart, TableBlock } from "./contract";

export type Row = (string | number | null)[];

function field(value: string | number | null): string {
  if (value === null) return "";
  const text = String(value);
  // A leading = + - @ would be run as a formula by spreadsheets; numbers are safe.
  const guarded = typeof value === "string" && /^[=+\-@\t\r]/.test(text) ? `'${text}` : text;
  return /[",\r\n]/.test(guarded) ? `"${guarded.replace(/"/g, '""')}"` : guarded;
}

export function csv(rows: Row[]): string {
  return rows.map((row) => row.map(field).join(",")).join("\r\n") + "\r\n";
}

function cells(cell: Cell): Row {
  return typeof cell === "string" ? [cell, null] : [cell.value, cell.error];
}

export function tableRows(table: TableBlock): Row[] {
  const head: Row = [table.head];
  for (const { name, unit } of table.columns) head.push(`${name} [${unit}]`, "standard error");
  return [head, ...table.rows.map((row) => [row.name, ...row.cells.flatMap(cells)])];
}

/** One row per number of the chart. */
export function chartRows(chart: Chart): Row[] {
  const x = `${chart.x.name} [${chart.x.unit}]`, y = `${chart.y.name} [${chart.y.unit}]`;
  const head: Row = ["series", x, y, "standard error", "note"];
  const rows: Row[] = [];
  for (const series of chart.series) {
    if (series.mark === "boxes") {
      const parts = ["lower whisker", "lower quartile", "median", "upper quartile", "upper whisker"];
      series.boxes.forEach((box, c) =>
        box.forEach((value, part) => rows.push([series.name, chart.x.categories[c], value, null, parts[part]])),
      );
      for (const { category, value } of series.outliers)
        rows.push([series.name, chart.x.categories[category], value, null, "outlier"]);
    } else if (series.mark === "heat") {
      head[2] = `${series.name} [${series.unit}]`;
      head[4] = y;
      series.cells.forEach((line, r) =>
        line.forEach((value, c) => rows.push([series.name, chart.x.categories[c], value, null, chart.y.categories[r]])),
      );
    } else {
      series.x.forEach((value, i) => {
        const at = chart.x.scale === "category" && value !== null ? chart.x.categories[value] : value;
        rows.push([series.name, at, series.y[i], series.error[i] ?? null, series.notes[i] ?? ""]);
      });
    }
  }
  return [head, ...rows];
}
