// Values to pixels of a canvas.
import { table } from "../palettes";
import type { Look, Shown } from "./views";

/** Undefined pixels: a grey that no palette uses. */
const kUndefined = (255 << 24) | (0x80 << 16) | (0x80 << 8) | 0x80;
const kLightSteps = 4096;
const kDisplayCurve = Uint8Array.from({ length: kLightSteps }, (_, i) => {
  const x = i / (kLightSteps - 1);
  return Math.round(255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055));
});

function clampIndex(value: number, steps: number): number {
  return value <= 0 ? 0 : value >= 1 ? steps - 1 : (value * (steps - 1) + 0.5) | 0;
}

function paintLight(shown: Shown, pixels: Uint32Array, full: number): void {
  const [red, green = red, blue = red] = shown.planes.map((plane) => plane.values);
  const scale = 1 / full;
  for (let i = 0; i < pixels.length; ++i) {
    const r = red[i], g = green[i], b = blue[i];
    if (r !== r || g !== g || b !== b) {
      pixels[i] = kUndefined;
      continue;
    }
    pixels[i] =
      (255 << 24) |
      (kDisplayCurve[clampIndex(b * scale, kLightSteps)] << 16) |
      (kDisplayCurve[clampIndex(g * scale, kLightSteps)] << 8) |
      kDisplayCurve[clampIndex(r * scale, kLightSteps)];
  }
}

function dimmed(pixel: number, by: number): number {
  const part = Math.min(Math.max(by, 0), 1) ** 0.5;
  const channel = (shift: number) => Math.round(((pixel >>> shift) & 255) * part) << shift;
  return (255 << 24) | channel(16) | channel(8) | channel(0);
}

function paintPalette(shown: Shown, pixels: Uint32Array, look: Look & { kind: "palette" }): void {
  const colors = table(look.palette);
  const values = shown.planes[0].values;
  const scale = 1 / (look.high - look.low);
  for (let i = 0; i < pixels.length; ++i) {
    const value = values[i];
    if (value !== value) pixels[i] = kUndefined;
    else {
      const pixel = colors[clampIndex((value - look.low) * scale, colors.length)];
      pixels[i] = shown.bright ? dimmed(pixel, shown.bright.values[i]) : pixel;
    }
  }
}

/** Paints into `canvas`, which takes the planes' size. `full`: the light that is shown as white. */
export function paint(shown: Shown, look: Look, full: number, canvas: HTMLCanvasElement): void {
  const { rows, cols } = shown.planes[0];
  canvas.width = cols;
  canvas.height = rows;
  const image = new ImageData(cols, rows);
  const pixels = new Uint32Array(image.data.buffer);
  if (look.kind === "light") paintLight(shown, pixels, full);
  else paintPalette(shown, pixels, look);
  canvas.getContext("2d")!.putImageData(image, 0, 0);
}

/** The value below which `part` of the finite values, as `of` takes them, lie: from at most 20,000 of each plane. */
export function quantile(planes: { values: Float32Array }[], part: number, of = (value: number) => value): number {
  const sample: number[] = [];
  for (const { values } of planes) {
    const stride = Math.max(1, Math.floor(values.length / 20_000));
    for (let i = 0; i < values.length; i += stride) if (Number.isFinite(values[i])) sample.push(of(values[i]));
  }
  const sorted = Float64Array.from(sample).sort();
  return sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(part * sorted.length))] : 0;
}
