// The page of a denoise run: the viewer's pictures, numbers, divider, zoom, planes.
import assert from "node:assert/strict";
import { existsSync, readdirSync, statSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { accessibilityFaults, cellValues, download, malus, noBrowser, open, outsideRequests, root, temporaryFolder, writeNpy } from "./support.mjs";

const [kRows, kCols, kBlack] = [64, 96, 100];

/** Raw values of a polarized scene that the test knows: a smooth mosaic of whole DN, noise and all. */
function rawValue(row, col) {
  const hash = Math.imul(row * 7919 + col * 104729 + 13, 2654435761) >>> 24;
  return kBlack + 300 + 8 * (row % 2) * (col % 2 ? 12 : 5) + Math.round(col / 2) + (hash % 31);
}

function denoisedReport(t, input, ...words) {
  const folder = temporaryFolder(t);
  const html = path.join(folder, "report.html");
  malus("denoise", input, "-o", path.join(folder, "out"), ...words);
  const record = readdirSync(path.join(folder, "out")).find((name) => name.endsWith("_denoised.json"));
  malus("report", path.join(folder, "out", record), "-o", html);
  return html;
}

function smallReport(t) {
  const input = path.join(temporaryFolder(t), "scene.npy");
  writeNpy(input, kRows, kCols, Array.from({ length: kRows * kCols }, (_, i) => rawValue(Math.floor(i / kCols), i % kCols)));
  return denoisedReport(t, input, "--layout", "polar-mono", "--black", kBlack, "--white", 4095, "--gain", 0,
    "--model", "imx250mzr-simulated");
}

const ready = (page) => page.locator(".viewer[data-ready]").first().waitFor();

/** The canvas as text, to tell two states apart. */
const look = async (page) => {
  await page.waitForTimeout(120);
  return page.locator(".viewer canvas").first().evaluate((canvas) => canvas.toDataURL());
};

/** Moves to a pixel with the keyboard from the middle of the picture and reads its numbers. */
async function readPixel(page, x, y) {
  await page.locator(".stage canvas").focus();
  let [atX, atY] = [Math.floor(kCols / 2), Math.floor(kRows / 2)];
  for (; atX !== x; atX += Math.sign(x - atX)) await page.keyboard.press(x > atX ? "ArrowRight" : "ArrowLeft");
  for (; atY !== y; atY += Math.sign(y - atY)) await page.keyboard.press(y > atY ? "ArrowDown" : "ArrowUp");
  const rows = page.locator(".readout tbody tr");
  const heads = await page.locator(".readout thead th").allTextContents();
  const numbers = await rows.evaluateAll((list) => list.map((row) => [...row.querySelectorAll("td")].map((c) => Number(c.dataset.value))));
  return { heads, before: numbers[0], after: numbers[1] };
}

test("pixel values are the file's, in DN and electrons; DoLP follows from them", { skip: noBrowser }, async (t) => {
  const page = await open(t, smallReport(t));
  await ready(page);
  const chosen = await page.getByLabel("Show", { exact: true }).evaluate((list) => list.selectedOptions[0].text);
  assert.equal(chosen, "DoLP");  // where two pictures differ most
  const [x, y] = [51, 35];
  const { K } = JSON.parse(malus("model", "show", "imx250mzr-simulated", "--gain", 0, "--json")).gains[0];
  await page.getByLabel("Show", { exact: true }).selectOption("mosaic");
  const raw = await readPixel(page, x, y);
  assert.equal(raw.before[0], rawValue(y, x) - kBlack);
  assert.ok(raw.heads[1].includes("raw 0"), raw.heads.join());  // [90 45; 135 0] at odd row and column
  const electrons = (rawValue(y, x) - kBlack) / K.value[3];
  assert.ok(Math.abs(raw.before[1] - electrons) < 1e-4 * electrons, `${raw.before[1]} e- is not ${electrons}`);

  await page.getByLabel("Show", { exact: true }).selectOption("DoLP");
  await page.keyboard.press("Tab");
  await page.locator(".stage canvas").focus();
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowLeft");
  const shown = await page.locator(".readout tbody tr").first().locator("td").last().getAttribute("data-value");
  const [i90, i45, i135, i0] = [[34, 50], [34, 51], [35, 50], [35, 51]].map(([r, c]) => rawValue(r, c) - kBlack);
  const expected = Math.hypot(i0 - i90, i45 - i135) / ((i0 + i45 + i90 + i135) / 2);
  assert.ok(Math.abs(Number(shown) - expected) < 1e-5, `${shown} is not ${expected}`);
});

test("divider, zoom, planes, side by side and saving change what they should", { skip: noBrowser }, async (t) => {
  const page = await open(t, smallReport(t));
  await ready(page);
  const whole = await look(page);
  await page.getByLabel("Divider", { exact: true }).focus();
  await page.keyboard.press("End");
  const left = await look(page);
  assert.notEqual(left, whole);
  await page.getByRole("button", { name: "Zoom in" }).click();
  const near = await look(page);
  assert.notEqual(near, left);
  await page.getByRole("button", { name: "Show the whole picture" }).click();
  assert.equal(await look(page), left);
  const names = await page.getByLabel("Show", { exact: true }).locator("option").allTextContents();
  for (const plane of ["S0, intensity", "DoLP", "AoLP", "S1", "S2", "0°", "45°", "90°", "135°", "mosaic"])
    assert.ok(names.includes(plane), plane);
  const pictures = new Set();
  for (const name of ["DoLP", "AoLP", "S1", "mosaic"]) {
    await page.getByLabel("Show", { exact: true }).selectOption(name);
    pictures.add(await look(page));
    assert.match(await page.locator(".viewer figure h3").textContent(), new RegExp(name));
  }
  assert.equal(pictures.size, 4);
  await page.getByLabel("Show", { exact: true }).selectOption("AoLP");
  assert.equal(await page.locator(".legend canvas").getAttribute("role"), "img");
  const before = await look(page);
  await page.getByLabel("Compare", { exact: true }).selectOption("side by side");
  assert.notEqual(await look(page), before);
  const saved = await download(page, page.locator(".viewer > .tools").getByRole("button", { name: "PNG" }));
  assert.match(saved.name, /AoLP\.png$/);
  assert.equal(saved.bytes.subarray(1, 4).toString(), "PNG");
  assert.deepEqual(page.problems, []);
  assert.deepEqual(outsideRequests(page), []);
  assert.deepEqual(await accessibilityFaults(page), []);
});

test("of two pictures alike the histogram shows both curves: one is dashed over the other", { skip: noBrowser }, async (t) => {
  const page = await open(t, smallReport(t));
  await ready(page);
  const plot = page.locator(".viewer details svg").first();
  await plot.waitFor();
  const curves = await plot.evaluate((svg) => {
    const strokes = ["#d55e00", "#0072b2"];  // before, after
    return strokes.map((color) => [...svg.querySelectorAll(`path[stroke="${color}"]`)].map((path) => {
      return { long: path.getTotalLength() > 300, dashed: path.hasAttribute("stroke-dasharray") };
    }).filter(({ long }) => long));
  });
  assert.deepEqual(curves.map((list) => list.map(({ dashed }) => dashed)), [[false], [true]]);
});

test("the wheel zooms only a picture that was chosen, and drags move it", { skip: noBrowser }, async (t) => {
  const page = await open(t, smallReport(t));
  await ready(page);
  const canvas = page.locator(".stage canvas");
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(...middle);
  const before = await look(page);
  await page.mouse.wheel(0, -40);
  await page.mouse.wheel(0, 40);
  assert.equal(await look(page), before);
  await canvas.focus();
  await page.mouse.move(...middle);
  await page.mouse.wheel(0, -600);
  const zoomed = await look(page);
  assert.notEqual(zoomed, before);
  await page.mouse.down();
  await page.mouse.move(middle[0] - 80, middle[1] - 40, { steps: 4 });
  await page.mouse.up();
  assert.notEqual(await look(page), zoomed);
});

// How long it takes is measured by bench/page_opening.mjs.
test("the page of a five-megapixel run opens and stays below five megabytes", { skip: noBrowser }, async (t) => {
  const input = path.join(root, "examples/imx250mzr/fruits.png");
  if (!existsSync(input)) return t.skip("needs examples/imx250mzr");
  const html = denoisedReport(t, input, "--layout", "polar-mono", "--black", 0, "--profile", "fast");
  assert.ok(statSync(html).size < 5e6, `the file has ${statSync(html).size} bytes`);
  const page = await open(t, html);
  await ready(page);
  assert.deepEqual(page.problems, []);
});

test("with a reference the page shows it and the metrics, before and after", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t);
  const input = path.join(folder, "scene.npy"), reference = path.join(folder, "clean.npy");
  const raw = Array.from({ length: kRows * kCols }, (_, i) => rawValue(Math.floor(i / kCols), i % kCols));
  writeNpy(input, kRows, kCols, raw);
  // Twice the light, and 10 DN (of the frame's light) off everywhere: the frame's PSNR is known.
  const [ratio, off, white] = [2, 10, 4095];
  writeNpy(reference, kRows, kCols, raw.map((value) => ratio * (value - kBlack + off)));
  const html = denoisedReport(t, input, "--layout", "polar-mono", "--black", kBlack, "--white", white, "--gain", 0,
    "--model", "imx250mzr-simulated", "--reference", reference, "--reference-ratio", ratio);
  const page = await open(t, html);
  await ready(page);
  const table = page.locator('table:has(caption:text-is("Against the reference"))');
  const before = await cellValues(table.locator("tbody tr").first());
  const expected = 20 * Math.log10((white - kBlack) / ratio / off);
  assert.ok(Math.abs(before[0] - expected) < 0.01, `${before[0]} dB is not ${expected}`);
  assert.deepEqual(await page.getByLabel("Right", { exact: true }).locator("option").allTextContents(), ["before", "after", "reference"]);
  await page.locator(".stage canvas").focus();
  await page.keyboard.press("ArrowRight");
  assert.equal(await page.locator(".readout tbody tr").count(), 3);
  assert.deepEqual(await accessibilityFaults(page), []);
});
