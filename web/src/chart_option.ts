// A chart of the contract as an ECharts option: marks, colours of channels, axes.
import { colorBarText, fewCategories, hasPlace, isEmpty, isPoints, keyRows, kLetterPx, kMostLetters, margins, nameGap, slantDeg } from "./chart_layout";
import type { BoxSeries, Chart, HeatSeries, PointSeries, Series } from "./contract";
import { measured, number, unit, withUnit } from "./format";
import { stops } from "./palettes";

export interface Colors {
  text: string;
  faint: string;
  grid: string;
  surface: string;
  accent: string;
}

const kSymbols = { circle: "circle", triangle: "triangle", square: "rect", diamond: "diamond" };

function axis(chart: Chart, colors: Colors, horizontal: boolean, fromZero = false): object {
  const from = horizontal ? chart.x : chart.y, log = from.scale === "log", few = fewCategories(from);
  // Without a value above 0 there is no range to find.
  const nothing = log && isEmpty(chart, horizontal);
  return {
    type: from.scale === "linear" ? "value" : from.scale,
    name: withUnit(from.name, from.unit),
    nameLocation: "middle",
    nameGap: nameGap(chart, horizontal),
    nameTextStyle: { color: colors.text },
    data: from.scale === "category" ? from.categories : undefined,
    inverse: !horizontal && from.scale === "category",
    scale: !fromZero,
    min: from.low ?? (nothing ? 1 : undefined),
    max: from.high ?? (nothing ? 10 : undefined),
    axisLabel: {
      color: colors.text,
      rotate: horizontal ? slantDeg(from) : 0,
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

/** Places of a series; what has none on a logarithmic axis leaves a gap, as 0 would spoil the whole axis. */
function places(series: PointSeries, chart: Chart): (number | null)[][] {
  return series.x.map((x, i) => {
    const y = series.y[i];
    return hasPlace(x, chart.x) && hasPlace(y, chart.y) ? [x, y] : [null, null];
  });
}

function pointSeries(series: PointSeries, chart: Chart): object[] {
  const color = series.color;
  const data = places(series, chart);
  // A curve of one point, or a point between two gaps, has no line to be seen by.
  const isLone = (i: number) => data[i][1] !== null && data[i - 1]?.[1] == null && data[i + 1]?.[1] == null;
  if (series.mark === "line" || series.mark === "dashed")
    return [
      {
        type: "line", name: series.name, data, color,
        symbol: data.some((_, i) => isLone(i)) ? "circle" : "none", showAllSymbol: true,
        symbolSize: (_: unknown, { dataIndex }: { dataIndex: number }) => (isLone(dataIndex) ? 5 : 0),
        lineStyle: { width: 1.5, type: series.mark === "dashed" ? "dashed" : "solid" },
      },
    ];
  if (series.mark === "bars")
    return [bars(series, data, chart.x.scale === "category")];
  const crosses = series.mark === "crosses";
  const points = {
    type: "scatter", name: series.name, data, color,
    symbol: crosses ? "path://M0,0L10,10M10,0L0,10" : kSymbols[series.symbol],
    symbolSize: crosses ? 8 : data.length > 300 ? 3 : 6,
    itemStyle: crosses ? { color: "none", borderColor: color, borderWidth: 1.5 } : { opacity: data.length > 300 ? 0.5 : 0.9 },
  };
  return series.error.length ? [points, errorBars(series, data, chart.y.scale === "log")] : [points];
}

// By themselves keys stretch squares and put a dot on every line.
const kKeySymbols = {
  circle: "circle", triangle: "path://M5,0L10,10H0Z", square: "path://M0,0H10V10H0Z", diamond: "path://M5,0L10,5L5,10L0,5Z",
};
const kKeyLines: Partial<Record<PointSeries["mark"], string>> = {
  line: "path://M0,0H18V2H0Z", dashed: "path://M0,0H7V2H0ZM11,0H18V2H11Z",
};

interface Api {
  value(i: number): number;
  coord(point: number[]): number[];
  size(extent: number[]): number[];
}

/** Bars of categories from 0; those of densities from the bottom of the plot, on logarithmic axes too. */
function bars(series: PointSeries, data: (number | null)[][], onCategories: boolean): object {
  const gaps = series.x.slice(1).map((x, i) => Math.abs((x ?? NaN) - (series.x[i] ?? NaN)));
  const width = 0.9 * Math.min(...gaps.filter((gap) => gap > 0), gaps.length ? Infinity : 1);
  return {
    type: "custom", name: series.name, color: series.color, data,
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

/** A bar that reaches down to 0 on a logarithmic axis ends where the axis does. */
function errorBars(series: PointSeries, points: (number | null)[][], log: boolean): object {
  return {
    type: "custom",
    name: series.name,
    silent: true,
    z: 1,
    clip: true,
    encode: { x: 0, y: [1, 2] },
    data: points.map(([x, y], i) => {
      const low = (y ?? NaN) - series.error[i];
      return [x, log && low <= 0 ? null : low, (y ?? NaN) + series.error[i]];
    }),
    renderItem: ({ coordSys }: { coordSys: { y: number; height: number } }, api: Api) => {
      const [x, top] = api.coord([api.value(0), api.value(2)]), floor = coordSys.y + coordSys.height;
      const low = api.value(1), bottom = Number.isFinite(low) ? api.coord([api.value(0), low])[1] : floor;
      if (![x, top, bottom].every(Number.isFinite)) return undefined;
      return { type: "line", shape: { x1: x, y1: bottom, x2: x, y2: top }, style: { stroke: series.color, lineWidth: 1 } };
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
    precision: 2, text: colorBarText(heat), textStyle: { color: colors.text }, inRange: { color: stops(heat.palette) },
    formatter: (value: number) => number(value),
  };
}

function seriesOptions(series: Series, chart: Chart, colors: Colors): object[] {
  if (series.mark === "boxes") return boxSeries(series, colors);
  if (series.mark === "heat") return [heatSeries(series)];
  return pointSeries(series, chart);
}

/** The length of a bar is its value: such a plot begins at 0. */
function showsLengths(chart: Chart): boolean {
  return chart.x.scale === "category" && chart.series.some(({ mark }) => mark === "bars");
}

/** What a pointer shows: the series, both coordinates with units, the standard error, and why a point was left out. */
function tooltip(chart: Chart, owners: Series[]): object {
  return {
    trigger: "item",
    renderMode: "richText",
    confine: true,
    formatter: (at: { seriesIndex: number; seriesName: string; value: number[]; dataIndex: number; seriesType: string; name: string }) => {
      const value = Array.isArray(at.value) ? at.value : [at.value];
      if (at.seriesType === "heatmap")
        return `${chart.x.categories[value[0]]}, ${chart.y.categories[value[1]]}: ${number(value[2])}`;
      if (at.seriesType === "boxplot") return `${at.name}: median ${number(value[3])} ${unit(chart.y.unit)}`;
      const owner = owners[at.seriesIndex], series = owner && isPoints(owner) ? owner : undefined;
      const note = series?.notes?.[at.dataIndex] ?? "";
      const x = chart.x.scale === "category" ? chart.x.categories[value[0]] : `${number(value[0])} ${unit(chart.x.unit)}`;
      const y = measured({ value: value[1], error: series?.error[at.dataIndex] ?? null });
      return `${at.seriesName}\n${x}, ${y} ${unit(chart.y.unit)}${note ? "\n" + note : ""}`;
    },
  };
}

/** "R, fit" beside "R": whose it is, and what. */
function partOf(name: string, names: Set<string>): { owner: string; part: string } | undefined {
  const at = name.lastIndexOf(", ");
  return at > 0 && names.has(name.slice(0, at)) ? { owner: name.slice(0, at), part: name.slice(at + 2) } : undefined;
}

/** On paper the key cannot be leafed through: it names every channel once with its symbol, and once what their lines and crosses are. */
function paperKey(chart: Chart, colors: Colors): { names: string[]; samples: object[] } {
  const all = new Set(chart.series.map(({ name }) => name)), own = new Set<string>(), parts = new Map<string, object>();
  for (const series of chart.series) {
    const part = partOf(series.name, all);
    if (!part) own.add(series.name);
    else if (isPoints(series) && !parts.has(part.part))
      parts.set(part.part, pointSeries({ ...series, name: part.part, color: colors.text, x: [], y: [], error: [] }, chart)[0]);
  }
  return { names: [...own, ...parts.keys()], samples: [...parts.values()] };
}

function legend(chart: Chart, names: string[], colors: Colors, onPaper: boolean): object {
  const icon = (name: string) => {
    const series = chart.series.find((s) => s.name === name || s.name.endsWith(`, ${name}`));
    if (!series || !isPoints(series)) return undefined;
    return series.mark === "points" ? kKeySymbols[series.symbol] : kKeyLines[series.mark];
  };
  return {
    type: onPaper ? "plain" : "scroll", top: 4, left: "center", itemWidth: 18, itemHeight: 10, textStyle: { color: colors.text },
    data: names.map((name) => ({ name, icon: icon(name) })), pageIconColor: colors.text, pageTextStyle: { color: colors.text },
  };
}

/** paperPx: the width of a page that cannot be pointed at; 0 on the screen. */
export function chartOption(chart: Chart, colors: Colors, paperPx = 0): Record<string, unknown> {
  const heat = chart.series.find((s): s is HeatSeries => s.mark === "heat");
  const all = new Set(chart.series.map(({ name }) => name));
  const key = paperPx ? paperKey(chart, colors) : { names: [...all], samples: [] };
  const keyed = !heat && all.size > 1;
  const owners: Series[] = [], series: object[] = [];
  for (const one of chart.series)
    for (const made of seriesOptions(one, chart, colors)) {
      owners.push(one);
      series.push(paperPx ? { ...made, name: partOf(one.name, all)?.owner ?? one.name } : made);
    }
  return {
    animation: false,
    backgroundColor: colors.surface,
    textStyle: { fontFamily: "system-ui, sans-serif", color: colors.text },
    grid: margins(chart, heat, keyed ? (paperPx ? keyRows(key.names, paperPx - 20) : 1) : 0),
    legend: keyed ? legend(chart, key.names, colors, paperPx > 0) : undefined,
    tooltip: tooltip(chart, owners),
    xAxis: axis(chart, colors, true),
    yAxis: axis(chart, colors, false, showsLengths(chart)),
    visualMap: heat ? visualMap(heat, colors) : undefined,
    series: [...series, ...key.samples],
  };
}

/** How many points have no place on a logarithmic axis, in words; empty where all have. */
export function withoutPlace(chart: Chart): string {
  let count = 0;
  for (const series of chart.series)
    if (isPoints(series))
      series.x.forEach((x, i) => {
        const y = series.y[i];
        if (x !== null && y !== null && !(hasPlace(x, chart.x) && hasPlace(y, chart.y))) ++count;
      });
  if (count === 0) return "";
  return `${count === 1 ? "One point is 0 or below and has" : `${count} points are 0 or below and have`} no place on a logarithmic axis; the numbers have ${count === 1 ? "it" : "them"}.`;
}
