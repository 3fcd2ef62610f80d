// Pages of evaluations and records: bars, which a browser draws and no JSON shows.
import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { accessibilityFaults, drawAll, malus, noBrowser, open, temporaryFolder, writeNpy } from "./support.mjs";

const [kRows, kCols, kPeak] = [32, 48, 1000];

/** Mosaics that are `off` DN away from a reference everywhere, so that their PSNR is known; evaluated. */
function evaluationOf(t, offsets) {
  const folder = temporaryFolder(t);
  const clean = Array.from({ length: kRows * kCols }, (_, i) => 200 + (i % 97));
  const named = (name) => path.join(folder, `${name}.npy`);
  writeNpy(named("clean"), kRows, kCols, clean);
  const tests = Object.entries(offsets).map(([name, off]) => {
    writeNpy(named(name), kRows, kCols, clean.map((value) => value + off));
    return named(name);
  });
  const html = path.join(folder, "page.html");
  malus("evaluate", "--reference", named("clean"), "--test", ...tests, "--layout", "mono", "--white", kPeak, "--report", html);
  return html;
}

/** Boxes of the half-transparent marks of a plot, and its texts. */
const drawn = (plot) =>
  plot.locator("svg").first().evaluate((svg) => ({
    bars: [...svg.querySelectorAll('path[fill-opacity="0.45"]')].map((bar) => {
      const { x, y, width, height } = bar.getBBox();
      return { x, y, width, height };
    }),
    texts: [...svg.querySelectorAll("text")].map((text) => text.textContent),
    width: svg.getBoundingClientRect().width,
  }));

test("bars of an evaluation are as wide as a picture's place, as long as its value, and named", { skip: noBrowser }, async (t) => {
  const offsets = { noisy: 100, a_name_that_is_rather_long: 10 };
  const page = await open(t, evaluationOf(t, offsets));
  await drawAll(page);
  const { bars, texts, width } = await drawn(page.locator('figure.chart:has(h3:text-is("image PSNR")) .plot'));
  const psnr = Object.values(offsets).map((off) => 20 * Math.log10(kPeak / off));  // 20 and 40 dB
  assert.equal(bars.length, 2);
  for (const bar of bars) assert.ok(bar.width > 0.2 * width && bar.width < 0.5 * width, `a bar of ${bar.width} px in a plot of ${width}`);
  assert.ok(bars[0].x + bars[0].width <= bars[1].x + 0.5, "bars overlap");
  assert.ok(Math.abs(bars[1].height / bars[0].height - psnr[1] / psnr[0]) < 0.02, bars.map(({ height }) => height).join(" px, "));
  assert.equal(texts.filter((text) => /^noisy\.npy$|^a_name_that_is/.test(text)).length, 2, texts.join(" | "));
  assert.ok(texts.includes("0"), "the axis does not begin at 0");
  assert.deepEqual(page.problems, []);
  assert.deepEqual(await accessibilityFaults(page), []);
});

test("bars of many pictures have a width, too", { skip: noBrowser }, async (t) => {
  const page = await open(t, evaluationOf(t, Object.fromEntries(Array.from({ length: 12 }, (_, i) => [`frame_${i}`, 10 + i]))));
  await drawAll(page);
  const { bars } = await drawn(page.locator('figure.chart:has(h3:text-is("image PSNR")) .plot'));
  assert.equal(bars.length, 12);
  assert.ok(bars.every(({ width, height }) => width > 5 && height > 20));
});

test("a page of one section has no navigation, whose only word would be the title below", { skip: noBrowser }, async (t) => {
  const page = await open(t, evaluationOf(t, { a: 1, b: 2 }));
  assert.equal(await page.locator("nav").count(), 0);
  assert.equal(await page.locator("h1").textContent(), "Evaluation");
  assert.equal(await page.locator("h2").textContent(), "Results");
});

test("pictures that cannot be shown say so in their place", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t), html = path.join(folder, "page.html");
  writeNpy(path.join(folder, "one.npy"), 4, 4, Array(16).fill(1));
  const record = { title: "one", charts: [], pictures: [{ title: "p", layout: "mono", white_dn: 1, files: [{ name: "one", file: "one.npy" }] }] };
  writeFileSync(path.join(folder, "record.json"), JSON.stringify(record));
  malus("report", path.join(folder, "record.json"), "-o", html);
  writeFileSync(html, readFileSync(html, "utf8").replace('"cell":{"rows":1', '"cell":{"rows":2'));
  const page = await open(t, html);
  assert.match(await page.locator(".viewer [role=alert]").textContent({ timeout: 10_000 }), /^The pictures cannot be shown: /);
  assert.deepEqual(page.problems, []);
});
