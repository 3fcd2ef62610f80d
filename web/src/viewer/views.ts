// What the viewer can show of a mosaic: the mosaic, colours, angles, Stokes parameters, DoLP, AoLP.
// S0 = (I0+I45+I90+I135)/2, S1 = I0-I90, S2 = I45-I135, DoLP = sqrt(S1²+S2²)/S0, AoLP = ½ atan2(S2,S1) in
// [0°,180°), undefined where S0 <= 0 and AoLP also where S1 = S2 = 0: the definitions of src/malus/polar/stokes.h
// (a test compares the two).
import type { PaletteName, PicturesBlock, Site } from "../contract";
import type { Plane } from "./raster";

/** How values become colours: light through the display's curve, or a palette over a range. */
export type Look =
  | { kind: "light" }
  | { kind: "palette"; palette: PaletteName; low: number; high: number; /** Range from the values. */ fitted?: boolean };

/** A thing to show: one plane, or three for a colour picture. `bright` dims the palette (AoLP by DoLP). */
export interface Shown {
  planes: Plane[];
  bright?: Plane;
}

export interface View {
  name: string;
  unit: string;
  look: Look;
  /** The decoded channels of one picture -> what to show. */
  of(channels: Plane[], picture: number): Shown | null;
}

type Cell = PicturesBlock["cell"];

function combine(planes: Plane[], rule: (at: number) => number): Plane {
  const { rows, cols } = planes[0];
  const values = new Float32Array(rows * cols);
  for (let i = 0; i < values.length; ++i) values[i] = rule(i);
  return { rows, cols, values };
}

function mean(planes: Plane[]): Plane {
  if (planes.length === 1) return planes[0];
  return combine(planes, (i) => planes.reduce((sum, plane) => sum + plane.values[i], 0) / planes.length);
}

export interface Stokes {
  s0: Plane;
  s1: Plane;
  s2: Plane;
}

export function stokes(i0: Plane, i45: Plane, i90: Plane, i135: Plane): Stokes {
  const [a, b, c, d] = [i0.values, i45.values, i90.values, i135.values];
  const [s0, s1, s2] = [0, 1, 2].map(() => new Float32Array(a.length));
  for (let i = 0; i < a.length; ++i) {
    s0[i] = (a[i] + b[i] + c[i] + d[i]) / 2;
    s1[i] = a[i] - c[i];
    s2[i] = b[i] - d[i];
  }
  const plane = (values: Float32Array) => ({ rows: i0.rows, cols: i0.cols, values });
  return { s0: plane(s0), s1: plane(s1), s2: plane(s2) };
}

export function dolp({ s0, s1, s2 }: Stokes): Plane {
  const [light, x, y] = [s0.values, s1.values, s2.values];
  const values = new Float32Array(light.length);
  for (let i = 0; i < values.length; ++i) values[i] = light[i] > 0 ? Math.sqrt(x[i] * x[i] + y[i] * y[i]) / light[i] : NaN;
  return { ...s0, values };
}

export function aolp({ s0, s1, s2 }: Stokes): Plane {
  return combine([s0], (i) => {
    if (!(s0.values[i] > 0) || (s1.values[i] === 0 && s2.values[i] === 0)) return NaN;
    const degrees = (Math.atan2(s2.values[i], s1.values[i]) * 90) / Math.PI;
    const wrapped = degrees < 0 ? degrees + 180 : degrees;
    return Math.fround(wrapped) >= 180 ? 0 : wrapped;  // 179.999999 rounds to 180 in a Float32Array
  });
}

function mosaic(block: PicturesBlock, channels: Plane[]): Plane {
  const { rows, cols, cell } = block;
  const values = new Float32Array(rows * cols);
  for (let r = 0; r < rows; ++r)
    for (let c = 0; c < cols; ++c) {
      const plane = channels[(r % cell.rows) * cell.cols + (c % cell.cols)];
      values[r * cols + c] = plane.values[Math.floor(r / cell.rows) * plane.cols + Math.floor(c / cell.cols)];
    }
  return { rows, cols, values };
}

/** A colour that the reader may choose: the names of its filters. */
interface Group {
  name: string;
  filters: Site["color"][];
}

function colorGroups(cell: Cell): Group[] {
  const present = new Set(cell.sites.map((site) => site.color));
  if (present.size === 1) return [{ name: "", filters: [...present] }];
  const groups: Group[] = [
    { name: "red", filters: ["R"] },
    { name: "green", filters: ["G1", "G2"] },
    { name: "blue", filters: ["B"] },
    { name: "mono", filters: ["mono"] },
  ];
  return groups.filter(({ filters }) => filters.some((f) => present.has(f)));
}

/** What one picture of light shows: red, green and blue together where the cell has all three, anything else by itself. */
function lights(groups: Group[]): { name: string; groups: Group[] }[] {
  const colored = groups.filter(({ name }) => name !== "mono");
  const together = colored.length === 3 ? [{ name: "", groups: colored }] : [];
  const alone = groups.filter(({ name }) => !together.length || name === "mono");
  return [...together, ...alone.map((group) => ({ name: group.name, groups: [group] }))];
}

/** SensorLayout::polarized: all four angles are present for every colour. */
function polarized({ sites }: Cell): boolean {
  return sites.every(({ color }) => [0, 45, 90, 135].every((angle) => sites.some((site) => site.color === color && site.angle === angle)));
}

function select(cell: Cell, channels: Plane[], filters: Site["color"][], angle: number | null): Plane {
  return mean(channels.filter((_, c) => filters.includes(cell.sites[c].color) && cell.sites[c].angle === angle));
}

/** Of the mean of these colours, which weigh alike although a cell has two greens: as mean_stokes in src/malus/polar/stokes.h. */
function stokesOf(cell: Cell, channels: Plane[], groups: Group[]): Stokes {
  const [i0, i45, i90, i135] = [0, 45, 90, 135].map((angle) => mean(groups.map(({ filters }) => select(cell, channels, filters, angle))));
  return stokes(i0, i45, i90, i135);
}

function polarViews(block: PicturesBlock): View[] {
  const { cell } = block;
  const groups = colorGroups(cell);
  const signed: Look = { kind: "palette", palette: "diverging", low: -1, high: 1, fitted: true };
  const degree: Look = { kind: "palette", palette: "sequential", low: 0, high: 1, fitted: true };
  const wheel: Look = { kind: "palette", palette: "cyclic", low: 0, high: 180 };
  const light = (title: string, of: (channels: Plane[], group: Group) => Plane): View[] =>
    lights(groups).map(({ name, groups: together }) => ({
      name: name ? `${title}, ${name}` : title, unit: "DN", look: { kind: "light" },
      of: (channels) => ({ planes: together.map((group) => of(channels, group)) }),
    }));
  const views = light("S0, intensity", (channels, group) => stokesOf(cell, channels, [group]).s0);
  const each = groups.map((group) => ({ name: group.name, colors: [group] }));
  const sets = groups.length > 1 ? [{ name: "", colors: groups }, ...each] : each;
  for (const { name, colors } of sets) {
    const suffix = name ? `, ${name}` : "";
    const of = (rule: (s: Stokes) => Plane) => (channels: Plane[]) => ({ planes: [rule(stokesOf(cell, channels, colors))] });
    views.push(
      { name: `DoLP${suffix}`, unit: "1", look: degree, of: of(dolp) },
      { name: `AoLP${suffix}`, unit: "deg", look: wheel, of: of(aolp) },
      {
        name: `AoLP, brightness by DoLP${suffix}`, unit: "deg", look: wheel,
        of: (channels) => {
          const s = stokesOf(cell, channels, colors);
          return { planes: [aolp(s)], bright: dolp(s) };
        },
      },
      { name: `S1${suffix}`, unit: "DN", look: signed, of: of((s) => s.s1) },
      { name: `S2${suffix}`, unit: "DN", look: signed, of: of((s) => s.s2) },
    );
  }
  for (const angle of [0, 45, 90, 135]) views.push(...light(`${angle}°`, (channels, { filters }) => select(cell, channels, filters, angle)));
  return views;
}

/** Colours of pixels without a polarizer. One kind of pixels alone is the mosaic. */
function colorViews({ cell }: PicturesBlock): View[] {
  const bare = (group: Group) => cell.sites.some(({ color, angle }) => group.filters.includes(color) && angle === null);
  const groups = colorGroups(cell);
  if (groups.length === 1) return [];
  return lights(groups.filter(bare)).map(({ name, groups: together }) => ({
    name: name || "colour", unit: "DN", look: { kind: "light" },
    of: (channels) => ({ planes: together.map(({ filters }) => select(cell, channels, filters, null)) }),
  }));
}

/** All views of a block, the most telling first. */
export function viewsOf(block: PicturesBlock, layers: (Plane | null)[][]): View[] {
  const { cell } = block;
  const views = polarized(cell) ? polarViews(block) : colorViews(block);
  if (block.pictures.length)
    views.push({ name: cell.sites.length > 1 ? "mosaic" : "picture", unit: "DN", look: { kind: "light" }, of: (channels) => ({ planes: [mosaic(block, channels)] }) });
  block.layers.forEach(({ name, unit, palette, low, high }, l) =>
    views.push({
      name, unit, look: { kind: "palette", palette, low, high },
      of: (_, picture) => {
        const plane = layers[l][picture];
        return plane ? { planes: [plane] } : null;
      },
    }),
  );
  return views;
}

/** The view to begin with. Intensity, the mean of four angles, hardly shows what has changed between two pictures: DoLP does. */
export function firstView(views: View[], compared: boolean): number {
  return compared ? Math.max(views.findIndex(({ name }) => name === "DoLP"), 0) : 0;
}
