// How much room the names and numbers around a plot take, which nothing measures before it is drawn.
import type { Axis, Chart, HeatSeries, PointSeries } from "./contract";
import { number, unit } from "./format";

const kManyCategories = 8, kSlantDeg = 60;
export const kMostLetters = 24, kLetterPx = 7;

const longest = (names: string[]) => Math.min(Math.max(0, ...names.map((name) => name.length)), kMostLetters);

/** Whether all names of a category axis fit beside each other. */
export const fewCategories = (axis: Axis) => axis.scale === "category" && axis.categories.length <= kManyCategories;

/** Whether the names below a plot are too many or too long to stand side by side in half a page. */
export function slanted(axis: Axis): boolean {
  return axis.scale === "category" && (axis.categories.length > kManyCategories || longest(axis.categories) * axis.categories.length > 64);
}

export const slantDeg = (axis: Axis) => (slanted(axis) ? kSlantDeg : 0);

/** How far slanted names reach down. */
function slantedPx(axis: Axis): number {
  return Math.max(40, Math.sin((kSlantDeg * Math.PI) / 180) * kLetterPx * longest(axis.categories) + 12);
}

/** Whether a value has a place on an axis: a logarithmic one begins above 0. */
export const hasPlace = (value: number | null, axis: Axis): value is number =>
  value !== null && Number.isFinite(value) && (axis.scale !== "log" || value > 0);

export const isPoints = (series: { mark: string }): series is PointSeries => series.mark !== "boxes" && series.mark !== "heat";

/** Smallest and largest number on an axis, with the ends of error bars. */
function extent(chart: Chart, horizontal: boolean): [number, number] {
  const along = horizontal ? chart.x : chart.y;
  let low = along.low ?? Infinity, high = along.high ?? -Infinity;
  const take = (value: number | null) => {
    if (!hasPlace(value, along)) return;
    low = Math.min(low, value);
    high = Math.max(high, value);
  };
  for (const series of chart.series)
    if (isPoints(series))
      (horizontal ? series.x : series.y).forEach((value, i) => {
        take(value);
        const error = horizontal ? 0 : (series.error[i] ?? 0);
        if (value !== null && error) [value - error, value + error].forEach(take);
      });
    else if (series.mark === "boxes" && !horizontal) {
      series.boxes.flat().forEach(take);
      series.outliers.forEach(({ value }) => take(value));
    }
  return [low, high];
}

/** Whether anything can be drawn along an axis. */
export const isEmpty = (chart: Chart, horizontal: boolean) => !extent(chart, horizontal).every(Number.isFinite);

/** Letters of the longest number that ECharts may put at a tick: about five, 1, 2, 3 or 5 times a power of ten apart. */
function tickLetters(chart: Chart, horizontal: boolean): number {
  const along = horizontal ? chart.x : chart.y;
  let [low, high] = extent(chart, horizontal);
  if (isEmpty(chart, horizontal)) return 2;
  const ticks: number[] = [];
  if (along.scale === "log")
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); ++power) ticks.push(10 ** power);
  else {
    if (!(high > low)) [low, high] = [low - Math.abs(low) / 2 - 1e-12, high + Math.abs(high) / 2 + 1e-12];
    const raw = (high - low) / 5, power = 10 ** Math.floor(Math.log10(raw)), lead = raw / power;
    const step = power * (lead < 1.5 ? 1 : lead < 2.5 ? 2 : lead < 4 ? 3 : lead < 7 ? 5 : 10);
    const first = Math.floor(low / step);
    for (let i = 0; i < 9; ++i) ticks.push((first + i) * step);
  }
  return Math.max(...ticks.map((tick) => number(tick).length));
}

/** Distance of an axis's title from the axis: beyond the numbers. */
export function nameGap(chart: Chart, horizontal: boolean): number {
  if (horizontal) return slanted(chart.x) ? slantedPx(chart.x) + 10 : 28;
  return chart.y.scale === "category" ? 62 : Math.max(60, tickLetters(chart, false) * kLetterPx + 20);
}

/** The two ends of a colour bar, the larger above. */
export function colorBarText(heat: HeatSeries): [string, string] {
  return [`${number(heat.high)} ${unit(heat.unit)}`.trim(), number(heat.low)];
}

/** Rows that a plain key of these names takes in this width. */
export function keyRows(names: string[], widthPx: number): number {
  const kMarkPx = 42;
  let rows = 1, x = 0;
  for (const name of names) {
    const width = kMarkPx + kLetterPx * name.length;
    if (x > 0 && x + width > widthPx) [rows, x] = [rows + 1, 0];
    x += width;
  }
  return rows;
}

export const kKeyRowPx = 22;

/** The margins around the plot itself. rowsOfKey: 0 without a key. */
export function margins(chart: Chart, heat: HeatSeries | undefined, rowsOfKey: number): object {
  const half = chart.x.scale === "category" ? 0 : Math.ceil((tickLetters(chart, true) * kLetterPx) / 2) + 4;
  const bar = heat ? Math.max(76, 16 + kLetterPx * Math.max(...colorBarText(heat).map(({ length }) => length))) : 0;
  return {
    left: chart.y.scale === "category" ? 88 : nameGap(chart, false) + 16,
    right: Math.max(18, half, bar),
    top: rowsOfKey ? 18 + kKeyRowPx * rowsOfKey : 16,
    bottom: slanted(chart.x) ? slantedPx(chart.x) + 32 : 48,
  };
}
