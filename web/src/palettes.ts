// Colour maps come with the report (src/malus/report/colors.h defines them); here they are looked up.
import type { PaletteName } from "./contract";

export type Rgb = [number, number, number];

let given: Record<PaletteName, string[]>;
const tables = new Map<PaletteName, Uint32Array>();
const kSteps = 512;

export function usePalettes(palettes: Record<PaletteName, string[]>): void {
  given = palettes;
}

function stop(css: string): Rgb {
  return [1, 3, 5].map((at) => parseInt(css.slice(at, at + 2), 16)) as Rgb;
}

/** The colour of t in [0, 1], between the two nearest of the report's. */
export function color(palette: PaletteName, t: number): Rgb {
  const list = given[palette];
  const at = Math.min(Math.max(t, 0), 1) * (list.length - 1);
  const below = Math.min(Math.floor(at), list.length - 2);
  const [from, to] = [stop(list[below]), stop(list[below + 1])];
  return from.map((value, i) => Math.round(value + (at - below) * (to[i] - value))) as Rgb;
}

/** 512 colours packed as little-endian RGBA, ready for a canvas. */
export function table(palette: PaletteName): Uint32Array {
  let made = tables.get(palette);
  if (!made) {
    made = Uint32Array.from({ length: kSteps }, (_, i) => {
      const [r, g, b] = color(palette, i / (kSteps - 1));
      return (255 << 24) | (b << 16) | (g << 8) | r;
    });
    tables.set(palette, made);
  }
  return made;
}

/** For charts. */
export function stops(palette: PaletteName): string[] {
  return given[palette];
}
