// The data contract between the program (src/malus/report/report.h writes it) and this page.
// The file holds one <script type="application/json" id="malus-report"> with a Report, and one
// <script type="text/plain" id="…"> of base64 text per raster. docs/report.md explains every field.

/** Raised when a field changes its meaning; the page refuses other versions. */
export const kFormat = 1;

export interface Report {
  format: number;
  title: string;
  subtitle: string;
  program: string;
  /** 65 colours "#rrggbb" along each palette, from src/malus/report/colors.h. */
  palettes: Record<PaletteName, string[]>;
  sections: Section[];
}

export interface Section {
  id: string;
  title: string;
  lead: string;
  blocks: Block[];
}

export type Block = FiguresBlock | NoticesBlock | TextBlock | TableBlock | ChartsBlock | PicturesBlock;

export interface TextBlock {
  kind: "text";
  paragraphs: string[];
}

export interface NoticesBlock {
  kind: "notices";
  items: { level: "good" | "note" | "warning"; text: string }[];
}

/** A value with its standard error; null where there is none. */
export interface Measured {
  value: number | null;
  error: number | null;
}

/** The few numbers that a reader looks for first. */
export interface FiguresBlock {
  kind: "figures";
  items: ({ name: string; symbol: string; unit: string; note: string } & Measured)[];
}

export type Cell = string | Measured;

export interface TableBlock {
  kind: "table";
  title: string;
  note: string;
  head: string;
  columns: { name: string; unit: string }[];
  rows: { name: string; cells: Cell[] }[];
}

export interface Axis {
  name: string;
  unit: string;
  scale: "linear" | "log" | "category";
  categories: string[];
  low: number | null;
  high: number | null;
}

export type SymbolName = "circle" | "triangle" | "square" | "diamond";

/** Numbers that cannot be shown are null. */
export interface PointSeries {
  name: string;
  mark: "line" | "dashed" | "points" | "crosses" | "bars";
  color: string;
  symbol: SymbolName;
  x: (number | null)[];
  y: (number | null)[];
  error: number[];
  notes: string[];
}

export interface BoxSeries {
  name: string;
  mark: "boxes";
  /** One per category. */
  colors: string[];
  /** Per category: lower whisker, quartile, median, quartile, upper whisker. */
  boxes: number[][];
  outliers: { category: number; value: number }[];
}

export interface HeatSeries {
  name: string;
  mark: "heat";
  /** rows x columns, first row on top. */
  cells: (number | null)[][];
  low: number;
  high: number;
  palette: PaletteName;
  unit: string;
}

export type Series = PointSeries | BoxSeries | HeatSeries;

export interface Chart {
  title: string;
  text: string;
  x: Axis;
  y: Axis;
  series: Series[];
}

/** One chart, or several to choose from (gains, channels). */
export interface ChartsBlock {
  kind: "charts";
  choice: string;
  wide: boolean;
  charts: { name: string; chart: Chart }[];
}

export type PaletteName = "grey" | "sequential" | "diverging" | "cyclic";

/**
 * Planes of integers. code -> value: t = (code - dither) * step; value = t * sqrt(offset) where t < 0 or slope = 0,
 * else ((t * slope / 2 + sqrt(offset))² - offset) / slope. With slope 0, offset 1 and no dither the value is
 * code * step. Otherwise `slope` and `offset` are the noise's variance line and `step` is a part of its standard
 * deviation. src/malus/report/raster.h defines the dither and how codes are packed.
 */
export interface Raster {
  blob: string;
  rows: number;
  cols: number;
  scales: { slope: number; offset: number; step: number }[];
  dithered: boolean;
}

export interface Picture {
  name: string;
  raster: Raster;
  exact: boolean;
}

export interface Layer {
  name: string;
  unit: string;
  text: string;
  palette: PaletteName;
  low: number;
  high: number;
  /** One raster per picture, null where the picture has no such layer. Mosaic or cell resolution. */
  rasters: (Raster | null)[];
}

export interface Site {
  name: string;
  color: "mono" | "R" | "G1" | "G2" | "B";
  angle: number | null;
}

export interface PicturesBlock {
  kind: "pictures";
  title: string;
  text: string;
  /** Size of the mosaic and of its repeating cell. */
  rows: number;
  cols: number;
  cell: { rows: number; cols: number; sites: Site[] };
  /** DN per electron, one per channel; empty when not known. */
  gain: number[];
  /** Saturation in DN above black. */
  white: number;
  pictures: Picture[];
  layers: Layer[];
}
