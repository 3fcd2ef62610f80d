// The viewer's numbers by themselves, without a page.
import assert from "node:assert/strict";
import { createRequire } from "node:module";
import path from "node:path";
import { test } from "node:test";
import { pathToFileURL } from "node:url";
import { deflateSync } from "node:zlib";
import { root, temporaryFolder } from "./support.mjs";

/** A module of the page's sources, as JavaScript. */
async function source(t, name) {
  const { buildSync } = createRequire(path.join(root, "web/package.json"))("esbuild");
  const outfile = path.join(temporaryFolder(t), "source.mjs");
  buildSync({ entryPoints: [path.join(root, "web/src", name)], outfile, bundle: true, format: "esm" });
  return import(pathToFileURL(outfile));
}

const plane = (values) => ({ rows: 1, cols: values.length, values: Float32Array.from(values) });

// The contract of aolp_deg_of in polar/stokes.h: [0, 180). Just below 0 a float holds 180, which the colour wheel does not.
test("the angle of polarization stays below 180 degrees after rounding to float", async (t) => {
  const { aolp } = await source(t, "viewer/views.ts");
  const s2 = [0, 1, -1, -1e-3, -1e-6, -1e-7, -1e-9];
  const angles = aolp({ s0: plane(s2.map(() => 2)), s1: plane(s2.map(() => 1)), s2: plane(s2) }).values;
  const expected = [0, 22.5, 157.5, 180 - 9e-2 / Math.PI, 180 - 9e-5 / Math.PI, 0, 0];
  expected.forEach((angle, i) => assert.ok(Math.abs(angles[i] - angle) < 2e-5, `${s2[i]}: ${angles[i]}`));
  assert.ok(angles.every((angle) => angle >= 0 && angle < 180));
});

// Few pixels have the fewest bins, 32. Of a value on the border of two bins each has half, at the end of the range one half is lost.
test("the histogram shares a value between the two nearest bins, of pixels that have one", async (t) => {
  const { histogram } = await source(t, "viewer/histogram.ts");
  const width = 180 / 32, middle = (bin) => (bin + 0.5) * width;
  const values = [middle(5), middle(5), middle(31), 10 * width, 0, 500, NaN];
  const view = { name: "AoLP", unit: "deg", look: { kind: "palette", palette: "cyclic", low: 0, high: 180 } };
  const [{ x, y }] = histogram(view, [{ name: "after", planes: [plane(values)] }]).series;
  const expected = new Map([[5, 2], [31, 1], [9, 0.5], [10, 0.5], [0, 0.5]]);
  assert.equal(y.length, 32);
  x.forEach((at, bin) => assert.ok(Math.abs(at - middle(bin)) < 1e-9));
  y.forEach((share, bin) => assert.ok(Math.abs(share - (expected.get(bin) ?? 0) / 6) < 1e-6, `${bin}: ${share}`));
});

// The code of a pixel without a value is -1,048,576, the lowest of a number one more. Planes of one pixel have every dither.
test("a pixel without a value has none at any dither, and the lowest number is one", async (t) => {
  const { decode } = await source(t, "viewer/raster.ts");
  const kPlanes = 4000;
  const decoded = async (firstByte) => {
    const text = deflateSync(Buffer.concat(Array(kPlanes).fill(Buffer.from([firstByte, 0xff, 0x7f])))).toString("base64");
    globalThis.document = { getElementById: () => ({ textContent: text }) };
    t.after(() => delete globalThis.document);
    const planes = await decode({ blob: "b", rows: 1, cols: 1, scales: Array(kPlanes).fill({ slope: 0, offset: 1, step: 1 }), dithered: true });
    return planes.map(({ values }) => values[0]);
  };
  const lowest = await decoded(0xfd);
  assert.ok(new Set(lowest).size >= 16, "too few dithers");  // floats there are 1/16 apart
  assert.ok(lowest.every((value) => Math.abs(value + 1_048_575) < 0.6));
  assert.ok((await decoded(0xff)).every(Number.isNaN));
});

/** A block of one picture whose cell has these sites, each pixel its site's place in the cell plus 1. */
function blockOf(rows) {
  const sites = rows.flat().map((name) => {
    const [, color, angle] = name.match(/^(R|G1|G2|B|mono)?_?(\d+)?$/);
    return { name, color: color ?? "mono", angle: angle === undefined ? null : Number(angle) };
  });
  const cell = { rows: rows.length, cols: rows[0].length, sites };
  const block = { kind: "pictures", rows: cell.rows, cols: cell.cols, cell, gain: [], white: 1, pictures: [{ name: "one" }], layers: [] };
  return { block, channels: sites.map((_, i) => plane([i + 1])) };
}

const kPolarized = ["DoLP", "AoLP", "AoLP, brightness by DoLP", "S1", "S2"];
const withSuffix = (names, suffix) => names.map((name) => `${name}, ${suffix}`);

for (const { what, rows, names, shown } of [
  { what: "a complete cell of four angles", rows: [["90", "45"], ["135", "0"]],
    names: ["S0, intensity", ...kPolarized, "0°", "45°", "90°", "135°", "mosaic"], shown: { "45°": [2] } },
  { what: "three colours", rows: [["R", "G1"], ["G2", "B"]], names: ["colour", "mosaic"], shown: { colour: [1, 2.5, 4] } },
  // No colour has all four angles.
  { what: "angles of another colour each", rows: [["R0", "G1_45"], ["G2_90", "B135"]], names: ["mosaic"], shown: {} },
  { what: "three angles", rows: [["0", "45"], ["90", "mono"]], names: ["mosaic"], shown: {} },
  { what: "angles beside colours without", rows: [["R", "0", "G1", "45"], ["90", "G2", "135", "B"]],
    names: ["colour", "mosaic"], shown: { colour: [1, 4.5, 8] } },
  // Two colours make no picture in colour, and white light is none of the three.
  { what: "two colours and mono", rows: [["R", "mono"], ["mono", "B"]],
    names: ["red", "blue", "mono", "mosaic"], shown: { red: [1], blue: [4], mono: [2.5] } },
  { what: "three colours and mono", rows: [["R", "G1"], ["B", "mono"]], names: ["colour", "mono", "mosaic"], shown: { colour: [1, 2, 3], mono: [4] } },
  { what: "one colour with all angles beside mono with all", rows: [["R0", "R45", "0", "45"], ["R135", "R90", "135", "90"]],
    names: [...withSuffix(["S0, intensity"], "red"), ...withSuffix(["S0, intensity"], "mono"), ...kPolarized, ...withSuffix(kPolarized, "red"),
      ...withSuffix(kPolarized, "mono"), ...["0°", "45°", "90°", "135°"].flatMap((name) => [`${name}, red`, `${name}, mono`]), "mosaic"],
    shown: { "S0, intensity, red": [7], "S0, intensity, mono": [11], "45°, mono": [4] } },
])
  test(`views of ${what}`, async (t) => {
    const { viewsOf } = await source(t, "viewer/views.ts");
    const { block, channels } = blockOf(rows);
    const views = viewsOf(block, []);
    assert.deepEqual(views.map(({ name }) => name), names);
    for (const view of views) {
      const planes = view.of(channels, 0).planes.map(({ values }) => values[0]);
      assert.ok(planes.length === 1 || planes.length === 3, view.name);
      if (shown[view.name]) assert.deepEqual(planes, shown[view.name], view.name);
    }
  });

test("polarization of all colours is of red, green and blue alike, though a cell has two greens", async (t) => {
  const { viewsOf } = await source(t, "viewer/views.ts");
  const quad = (color) => [[`${color}_90`, `${color}_45`], [`${color}_135`, `${color}_0`]];
  const beside = (left, right) => left.map((row, r) => [...row, ...right[r]]);
  const { block } = blockOf([...beside(quad("R"), quad("G1")), ...beside(quad("G2"), quad("B"))]);
  const light = { R: 9, G1: 12, G2: 0, B: 0 };  // behind 0 degrees; nothing behind the others
  const channels = block.cell.sites.map(({ color, angle }) => plane([angle === 0 ? light[color] : 0]));
  const s1 = (name) => viewsOf(block, []).find((view) => view.name === name).of(channels, 0).planes[0].values[0];
  assert.deepEqual(["S1", "S1, red", "S1, green", "S1, blue"].map(s1), [5, 9, 6, 0]);
});

// A frame may end inside a cell: 202 = 50 cells of 4 and a half one.
test("a value of a cell is read from the cell that the pixel lies in, to the last row", async (t) => {
  const { pixelsPerValue } = await source(t, "viewer/raster.ts");
  for (const [extent, cell] of [[202, 4], [2050, 4], [1001, 4], [2051, 4], [203, 2], [5, 4], [64, 1]])
    for (let y = 0; y < extent; ++y)
      assert.equal(Math.floor(y / pixelsPerValue(extent, Math.ceil(extent / cell), cell)), Math.floor(y / cell), `${y} of ${extent}`);
  assert.equal(pixelsPerValue(202, 202, 4), 1);
  assert.equal(pixelsPerValue(4000, 500, 4), 8);
});
