// How often each value occurs in the shown planes, for the two pictures.
import type { Chart, PointSeries } from "../contract";
import { quantile } from "./paint";
import type { Plane } from "./raster";
import type { View } from "./views";

const kBins = 128;
const kColors = ["#d55e00", "#0072b2", "#009e73"];

function counts(planes: Plane[], low: number, high: number): number[] {
  const bins = new Array<number>(kBins).fill(0);
  let total = 0;
  // Each value is shared by the two nearest bins: whole bins would beat with the steps of digitised values.
  const add = (bin: number, share: number) => {
    if (bin >= 0 && bin < kBins) bins[bin] += share;
  };
  for (const { values } of planes)
    for (let i = 0; i < values.length; ++i) {
      if (values[i] !== values[i]) continue;
      ++total;
      const at = ((values[i] - low) / (high - low)) * kBins - 0.5;
      const bin = Math.floor(at);
      add(bin, bin + 1 - at);
      add(bin + 1, at - bin);
    }
  return bins.map((n) => n / Math.max(total, 1));
}

export function histogram(view: View, pictures: { name: string; planes: Plane[] }[]): Chart {
  const all = pictures.flatMap(({ planes }) => planes);
  let low = quantile(all, 0.001), high = quantile(all, 0.999);
  if (view.look.kind === "palette" && view.look.palette === "cyclic") [low, high] = [0, 180];
  if (!(high > low)) [low, high] = [low - 1, low + 1];
  const width = (high - low) / kBins;
  const x = Array.from({ length: kBins }, (_, i) => low + (i + 0.5) * width);
  const series = pictures.map(
    ({ name, planes }, i): PointSeries => ({
      name, mark: "line", color: kColors[i % kColors.length], symbol: "circle", x, y: counts(planes, low, high), error: [], notes: [],
    }),
  );
  return {
    title: `Histogram: ${view.name}`,
    text: `Share of pixels per bin of ${width.toPrecision(3)} ${view.unit === "1" ? "" : view.unit}, between the 0.1 and 99.9 % points.`,
    x: { name: view.name, unit: view.unit, scale: "linear", categories: [], low: null, high: null },
    y: { name: "share of pixels", unit: "1", scale: "linear", categories: [], low: 0, high: null },
    series,
  };
}
