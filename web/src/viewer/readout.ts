// The numbers of one pixel, for every picture.
import type { PicturesBlock } from "../contract";
import { element } from "../dom";
import { number, unit } from "../format";
import { pixelsPerValue, rounding, type Plane } from "./raster";
import type { Shown, View } from "./views";

function at(plane: Plane, block: PicturesBlock, x: number, y: number): number {
  const { rows, cols, cell } = block;
  const r = Math.min(Math.floor(y / pixelsPerValue(rows, plane.rows, cell.rows)), plane.rows - 1);
  const c = Math.min(Math.floor(x / pixelsPerValue(cols, plane.cols, cell.cols)), plane.cols - 1);
  return plane.values[r * plane.cols + c];
}

/** The mosaic's value of a picture at a pixel, in DN above black. */
export function mosaicValue(block: PicturesBlock, channels: Plane[], x: number, y: number): number {
  const { cell } = block;
  const plane = channels[(y % cell.rows) * cell.cols + (x % cell.cols)];
  return plane.values[Math.floor(y / cell.rows) * plane.cols + Math.floor(x / cell.cols)];
}

function fixed(value: number): string {
  return Number.isFinite(value) ? number(value) : "undefined";
}

export function readout(block: PicturesBlock, pictures: Plane[][], view: View, shown: (Shown | null)[], x: number, y: number): HTMLElement {
  const { cell, gain } = block;
  const channel = (y % cell.rows) * cell.cols + (x % cell.cols);
  const site = cell.sites[channel].name;
  const seen = view.unit === "1" ? view.name : `${view.name} [${unit(view.unit)}]`;
  // A block of maps alone (fixed pattern) has no raw values.
  const columns = pictures.length ? [`raw ${site} [DN]`, ...(gain.length ? ["[e⁻]"] : []), seen] : [`${seen}, ${site}`];
  const head = element("tr", {}, element("th", { scope: "col" }, `x ${x}, y ${y}`));
  for (const name of columns) head.append(element("th", { scope: "col" }, name));
  const body = element("tbody");
  for (let p = 0; p < Math.max(pictures.length, shown.length); ++p) {
    const row = element("tr", {}, element("th", { scope: "row" }, block.pictures[p]?.name ?? "map"));
    if (pictures[p]) {
      const value = mosaicValue(block, pictures[p], x, y);
      const half = block.pictures[p].exact ? 0 : rounding(value, block.pictures[p].raster.scales[channel]);
      row.append(element("td", { "data-value": value }, fixed(value) + (half ? ` ± ${number(Number(half.toPrecision(1)))}` : "")));
      if (gain.length) row.append(element("td", { "data-value": value / gain[channel] }, fixed(value / gain[channel])));
    }
    const values = (shown[p]?.planes ?? []).map((plane) => at(plane, block, x, y));
    row.append(element("td", { "data-value": values.join(" ") }, values.map(fixed).join("  ") || "–"));
    body.append(row);
  }
  return element("table", {}, element("thead", {}, head), body);
}
