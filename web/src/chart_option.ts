// A chart of the contract as an ECharts option: marks, colours of channels, axes.
import type { Axis, BoxSeries, Chart, HeatSeries, PointSeries, Series } from "./contract";
import { number, unit, withUnit } from "./format";
import { stops } from "./palettes";

export interface Colors {
  text: string;
  faint: string;
  grid: string;
  surface: string;
  accent: string;
}

const kSymbols = { circle: "circle", triangle: "triangle", square: "rect", diamond: "diamond" };

const kManyCategories = 8, kMostLetters = 24, kLetterPx = 7, kSlantDeg = 60;

const longest = (names: string[]) => Math.min(Math.max(0, ...names.map((name) => name.length)), kMostLetters);

/** Whether the names below a plot are too many or too long to stand side by side in half a page. */
function slanted(axis: Axis): boolean {
  return axis.scale === "category" && (axis.categories.length > kManyCategories || longest(axis.categories) * axis.categories.length > 64);
}

/** How far slanted names reach down. */
function slantedPx(axis: Axis): number {
  return Math.max(40, Math.sin((kSlantDeg * Math.PI) / 180) * kLetterPx * longest(axis.categories) + 12);
}

function nameGap(axis: Axis, horizontal: boolean): number {
  if (horizontal) return slanted(axis) ? slantedPx(axis) + 10 : 28;
  return axis.scale === "category" ? 62 : 60;
}

function axis(from: Axis, colors: Colors, horizontal: boolean, fromZero = false): object {
  const log = from.scale === "log", few = from.scale === "category" && from.categories.length <= kManyCategories;
  return {
    type: from.scale === "linear" ? "value" : from.scale,
    name: withUnit(from.name, from.unit),
    nameLocation: "middle",
    nameGap: nameGap(from, horizontal),
    nameTextStyle: { color: colors.text },
    data: from.scale === "category" ? from.categories : undefined,
    inverse: !horizontal && from.scale === "category",
    scale: !fromZero,
    min: from.low ?? undefined,
    max: from.high ?? undefined,
    axisLabel: {
      color: colors.text,
      rotate: horizontal && slanted(from) ? kSlantDeg : 0,
      formatter: from.scale === "category" ? undefined : (value: number) => number(value),
      ...(from.scale === "category" && { width: kMostLetters * kLetterPx, overflow: "truncate" }),
      // A bar without its name says nothing.
      ...(few ? { interval: 0 } : { hideOverlap: true }),
    },
    axisLine: { onZero: false, lineStyle: { color: colors.faint } },
    splitLine: { show: from.scale !== "category", lineStyle: { color: colors.grid } },
    minorTick: { show: log },
  };
}

function pointSeries(series: PointSeries, onCategories: boolean): object[] {
  const color = series.color;
  const data = series.x.map((x, i) => [x, series.y[i]]);
  if (series.mark === "line" || series.mark === "dashed")
    return [
      {
        type: "line", name: series.name, data, symbol: "none", color,
        lineStyle: { width: 1.5, type: series.mark === "dashed" ? "dashed" : "solid" },
      },
    ];
  if (series.mark === "bars")
    return [bars(series, onCategories)];
  const crosses = series.mark === "crosses";
  const points = {
    type: "scatter", name: series.name, data, color,
    symbol: crosses ? "path://M0,0L10,10M10,0L0,10" : kSymbols[series.symbol],
    symbolSize: crosses ? 8 : data.length > 300 ? 3 : 6,
    itemStyle: crosses ? { color: "none", borderColor: color, borderWidth: 1.5 } : { opacity: data.length > 300 ? 0.5 : 0.9 },
  };
  return series.error.length ? [points, errorBars(series, color)] : [points];
}

interface Api {
  value(i: number): number;
  coord(point: number[]): number[];
  size(extent: number[]): number[];
}

/** Bars of categories from 0; those of densities from the bottom of the plot, on logarithmic axes too. */
function bars(series: PointSeries, onCategories: boolean): object {
  const gaps = series.x.slice(1).map((x, i) => Math.abs((x ?? NaN) - (series.x[i] ?? NaN)));
  const width = 0.9 * Math.min(...gaps.filter((gap) => gap > 0), gaps.length ? Infinity : 1);
  return {
    type: "custom", name: series.name, color: series.color, data: series.x.map((x, i) => [x, series.y[i]]),
    renderItem: (params: { coordSys: { y: number; height: number } }, api: Api) => {
      const [x, y] = api.coord([api.value(0), api.value(1)]);
      const from = onCategories ? api.coord([api.value(0), 0])[1] : params.coordSys.y + params.coordSys.height;
      if (!Number.isFinite(y)) return undefined;
      // Between categories there are no coordinates: a category axis tells only the size of a whole one.
      const wide = onCategories ? width * api.size([1, 0])[0] : api.size([width, 0])[0];
      return {
        type: "rect",
        shape: { x: x - wide / 2, y: Math.min(y, from), width: wide, height: onCategories ? Math.abs(from - y) : Math.max(from - y, 0) },
        style: { fill: series.color, opacity: 0.45 },
      };
    },
  };
}

function errorBars(series: PointSeries, color: string): object {
  return {
    type: "custom",
    name: series.name,
    silent: true,
    z: 1,
    clip: true,
    encode: { x: 0, y: [1, 2] },
    data: series.x.map((x, i) => [x, (series.y[i] ?? NaN) - series.error[i], (series.y[i] ?? NaN) + series.error[i]]),
    renderItem: (_: unknown, api: Api) => {
      const low = api.coord([api.value(0), api.value(1)]), high = api.coord([api.value(0), api.value(2)]);
      if (![low, high].flat().every(Number.isFinite)) return undefined;
      return { type: "line", shape: { x1: low[0], y1: low[1], x2: high[0], y2: high[1] }, style: { stroke: color, lineWidth: 1 } };
    },
  };
}

function boxSeries(series: BoxSeries, colors: Colors): object[] {
  const data = series.boxes.map((value, i) => {
    const color = series.colors[i];
    return { value, itemStyle: { borderColor: color, color: color + "33", borderWidth: 1.5 } };
  });
  const outliers = series.outliers.map(({ category, value }) => [category, value]);
  return [
    { type: "boxplot", name: series.name, data },
    { type: "scatter", name: `${series.name}, outliers`, data: outliers, symbolSize: 4, color: colors.faint },
  ];
}

function heatSeries(series: HeatSeries): object {
  const data = series.cells.flatMap((line, r) => line.map((value, c) => [c, r, value]));
  const few = data.length <= 64;
  return {
    type: "heatmap", name: series.name, data, progressive: 0,
    label: { show: few, formatter: ({ value }: { value: number[] }) => number(Number(value[2].toFixed(2))) },
  };
}

function visualMap(heat: HeatSeries, colors: Colors): object {
  return {
    min: heat.low, max: heat.high, calculable: false, orient: "vertical", right: 4, top: "middle", itemHeight: 120,
    precision: 2, text: [unit(heat.unit), ""], textStyle: { color: colors.text }, inRange: { color: stops(heat.palette) },
    formatter: (value: number) => number(value),
  };
}

function seriesOptions(series: Series, chart: Chart, colors: Colors): object[] {
  if (series.mark === "boxes") return boxSeries(series, colors);
  if (series.mark === "heat") return [heatSeries(series)];
  return pointSeries(series, chart.x.scale === "category");
}

/** The length of a bar is its value: such a plot begins at 0. */
function showsLengths(chart: Chart): boolean {
  return chart.x.scale === "category" && chart.series.some(({ mark }) => mark === "bars");
}

/** What a pointer shows: the series, both coordinates with units, and why a point was left out. */
function tooltip(chart: Chart): object {
  return {
    trigger: "item",
    renderMode: "richText",
    confine: true,
    formatter: (at: { seriesName: string; value: number[]; dataIndex: number; seriesType: string; name: string }) => {
      const value = Array.isArray(at.value) ? at.value : [at.value];
      if (at.seriesType === "heatmap")
        return `${chart.x.categories[value[0]]}, ${chart.y.categories[value[1]]}: ${number(value[2])}`;
      if (at.seriesType === "boxplot") return `${at.name}: median ${number(value[3])} ${unit(chart.y.unit)}`;
      const series = chart.series.find((s) => s.name === at.seriesName) as PointSeries | undefined;
      const note = series?.notes?.[at.dataIndex] ?? "";
      const x = chart.x.scale === "category" ? chart.x.categories[value[0]] : `${number(value[0])} ${unit(chart.x.unit)}`;
      return `${at.seriesName}\n${x}, ${number(value[1])} ${unit(chart.y.unit)}${note ? "\n" + note : ""}`;
    },
  };
}

export function chartOption(chart: Chart, colors: Colors): Record<string, unknown> {
  const heat = chart.series.find((s): s is HeatSeries => s.mark === "heat");
  const names = chart.series.map((s) => s.name);
  const legend = !heat && names.length > 1;
  return {
    animation: false,
    backgroundColor: colors.surface,
    textStyle: { fontFamily: "system-ui, sans-serif", color: colors.text },
    grid: {
      left: chart.y.scale === "category" ? 88 : 76, right: heat ? 76 : 18, top: legend ? 40 : 16,
      bottom: slanted(chart.x) ? slantedPx(chart.x) + 32 : 48,
    },
    legend: legend ? { type: "scroll", top: 4, textStyle: { color: colors.text }, data: names, pageIconColor: colors.text, pageTextStyle: { color: colors.text } } : undefined,
    tooltip: tooltip(chart),
    xAxis: axis(chart.x, colors, true),
    yAxis: axis(chart.y, colors, false, showsLengths(chart)),
    visualMap: heat ? visualMap(heat, colors) : undefined,
    series: chart.series.flatMap((s) => seriesOptions(s, chart, colors)),
  };
}
