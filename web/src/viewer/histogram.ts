// How often each value occurs in the shown planes, for the two pictures.
import type { Chart, PointSeries } from "../contract";
import { quantile } from "./paint";
import type { Plane } from "./raster";
import type { View } from "./views";

const kMostBins = 128;
const kFewestBins = 32;
/** Second differences above this part of the counts are steps of digitised values or too few pixels, not the picture. */
const kRough = 0.2;
const kColors = ["#d55e00", "#0072b2", "#009e73"];

/** Each value is shared by the two nearest bins. */
function counts(planes: Plane[], low: number, high: number, bins: number): number[] {
  const filled = new Float64Array(bins + 2);  // one more at both ends, for the half of a value that lies outside
  const scale = bins / (high - low);
  let total = 0;
  for (const { values } of planes)
    for (let i = 0; i < values.length; ++i) {
      const value = values[i];
      if (value !== value) continue;
      ++total;
      const at = (value - low) * scale + 0.5;
      if (!(at >= 0 && at < bins + 1)) continue;
      const bin = at | 0;
      filled[bin] += bin + 1 - at;
      filled[bin + 1] += at - bin;
    }
  return Array.from(filled.subarray(1, bins + 1), (n) => n / Math.max(total, 1));
}

function rough(shares: number[]): boolean {
  let bends = 0, sum = 0;
  for (let i = 1; i + 1 < shares.length; ++i) {
    bends += Math.abs(shares[i - 1] - 2 * shares[i] + shares[i + 1]);
    sum += shares[i];
  }
  return bends > kRough * sum;
}

/** As many bins as the values fill smoothly. */
function smoothCounts(pictures: Plane[][], low: number, high: number): number[][] {
  for (let bins = kMostBins; ; bins /= 2) {
    const shares = pictures.map((planes) => counts(planes, low, high, bins));
    if (bins <= kFewestBins || !shares.some(rough)) return shares;
  }
}

export function histogram(view: View, pictures: { name: string; planes: Plane[] }[]): Chart {
  const all = pictures.flatMap(({ planes }) => planes);
  let low = quantile(all, 0.001), high = quantile(all, 0.999);
  if (view.look.kind === "palette" && view.look.palette === "cyclic") [low, high] = [0, 180];
  if (!(high > low)) [low, high] = [low - 1, low + 1];
  const shares = smoothCounts(pictures.map(({ planes }) => planes), low, high);
  const bins = shares[0]?.length ?? kMostBins;
  const width = (high - low) / bins;
  const x = Array.from({ length: bins }, (_, i) => low + (i + 0.5) * width);
  const series = pictures.map(
    ({ name }, i): PointSeries => ({
      // Two pictures alike have one curve: dashes on a line show both.
      name, mark: i === 0 ? "line" : "dashed", color: kColors[i % kColors.length], symbol: "circle", x, y: shares[i], error: [], notes: [],
    }),
  );
  return {
    title: `Histogram: ${view.name}`,
    text: `Share of pixels per bin of ${width.toPrecision(3)}${view.unit === "1" ? "" : ` ${view.unit}`}, between the 0.1 and 99.9 % points.`,
    x: { name: view.name, unit: view.unit, scale: "linear", categories: [], low: null, high: null },
    y: { name: "share of pixels", unit: "1", scale: "linear", categories: [], low: 0, high: null },
    series,
  };
}
