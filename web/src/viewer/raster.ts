// Rasters: base64 -> inflate -> variable-length integers -> prediction undone -> values. The inverse of
// src/malus/report/raster.cpp.
import type { Raster } from "../contract";

/** One plane of values; a pixel without a value is NaN. */
export interface Plane {
  rows: number;
  cols: number;
  values: Float32Array;
}

/** Of a pixel without a value, in 1/256 of a step: its code with the lowest dither, -128, taken off; every real code lies above. */
const kLargestNoValue = -1_048_576 * 256 + 128;

function bytesOf(base64: string): Uint8Array<ArrayBuffer> {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return bytes;
}

const kDamaged = "a picture in this file is damaged";

/** By hand, although a Blob's stream and a Response say it in one line: those take ten times as long, by way of other processes. */
async function inflate(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array> {
  const { readable, writable } = new DecompressionStream("deflate");
  const write = async () => {
    const writer = writable.getWriter();
    await writer.write(bytes);
    await writer.close();
  };
  const parts: Uint8Array[] = [];
  const read = async () => {
    const reader = readable.getReader();
    for (let { done, value } = await reader.read(); !done; { done, value } = await reader.read()) parts.push(value!);
  };
  try {
    await Promise.all([write(), read()]);
  } catch {
    throw new Error(kDamaged);
  }
  const out = new Uint8Array(parts.reduce((sum, { length }) => sum + length, 0));
  let at = 0;
  for (const part of parts) {
    out.set(part, at);
    at += part.length;
  }
  return out;
}

/** Integers of all planes: zigzag, seven bits a byte, low bits first. */
function integers(bytes: Uint8Array, count: number): Int32Array {
  const out = new Int32Array(count);
  let at = 0;
  for (let i = 0; i < count; ++i) {
    let byte = bytes[at++];
    let value = byte & 127;
    for (let shift = 7; byte > 127; shift += 7) {
      byte = bytes[at++];
      value |= (byte & 127) << shift;
    }
    out[i] = (value >>> 1) ^ -(value & 1);
  }
  if (at !== bytes.length) throw new Error(kDamaged);
  return out;
}

/** 256 times the subtractive dither of a place. */
function dither(channel: number, row: number, col: number): number {
  let mixed = (Math.imul(0x9e3779b1, row) + Math.imul(0x85ebca6b, col) + Math.imul(0xc2b2ae35, channel)) | 0;
  mixed = Math.imul(mixed ^ (mixed >>> 15), 0x2c1b3c6d);
  mixed ^= mixed >>> 13;
  return (mixed & 255) - 128;
}

/**
 * Each pixel was written as its difference from what its west, north-west, north and north-east neighbours let
 * expect. Turns the differences of one channel into values in 1/256 of a step.
 */
function undoPrediction(placed: Int32Array, channel: number, { rows, cols, dithered }: Raster): void {
  for (let r = 0; r < rows; ++r) {
    let at = channel * rows * cols + r * cols;
    for (let c = 0; c < cols; ++c, ++at) {
      const north = at - cols;
      let expected = 0;
      if (r === 0) expected = c === 0 ? 0 : placed[at - 1];
      else if (c === 0 || c === cols - 1) expected = placed[north];
      else expected = (placed[at - 1] + placed[north - 1] + placed[north] + placed[north + 1]) >> 2;
      const d = dithered ? dither(channel, r, c) : 0;
      placed[at] = 256 * (placed[at] + ((expected + d + 128) >> 8)) - d;
    }
  }
}

function valueOf(t: number, root: number, slope: number, offset: number): number {
  if (t < 0 || slope === 0) return t * root;
  const s = (t * slope) / 2 + root;
  return (s * s - offset) / slope;
}

/** The planes of a raster, one per scale. */
export async function decode(raster: Raster): Promise<Plane[]> {
  const text = document.getElementById(raster.blob)?.textContent;
  if (!text) throw new Error("a picture is missing in this file");
  const { rows, cols, scales } = raster;
  const size = rows * cols;
  const placed = integers(await inflate(bytesOf(text.trim())), size * scales.length);
  return scales.map(({ slope, offset, step }, channel) => {
    undoPrediction(placed, channel, raster);
    const values = new Float32Array(size);
    const root = Math.sqrt(offset);
    for (let i = 0; i < size; ++i) {
      const value = placed[channel * size + i];
      values[i] = value <= kLargestNoValue ? NaN : valueOf((value / 256) * step, root, slope, offset);
    }
    return { rows, cols, values };
  });
}

/** How many pixels of the mosaic, along one side of it, a value of a plane stands for: a cell's, of which the last may be cut; else
 * the plane is of pixels, or a smaller picture of the whole. */
export function pixelsPerValue(extent: number, values: number, cell: number): number {
  return values === Math.ceil(extent / cell) ? cell : extent / values;
}

/** Half the distance between neighbouring stored values around `value`: the read-out's uncertainty. */
export function rounding(value: number, { slope, offset, step }: Raster["scales"][number]): number {
  return 0.5 * step * Math.sqrt(slope * Math.max(value, 0) + offset);
}
