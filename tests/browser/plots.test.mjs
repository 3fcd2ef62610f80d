// What plots draw, which no JSON shows: logarithmic axes, lone points, labels, saved keys, and paper.
import assert from "node:assert/strict";
import { readFileSync, writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { download, drawAll, malus, noBrowser, open, temporaryFolder, writeNpy } from "./support.mjs";

/** The page of a record of these charts and more. */
function pageOf(t, charts, more = {}) {
  const folder = temporaryFolder(t), html = path.join(folder, "page.html");
  writeNpy(path.join(folder, "one.npy"), 8, 8, Array.from({ length: 64 }, (_, i) => i));
  writeFileSync(path.join(folder, "record.json"), JSON.stringify({ title: "plots", charts, ...more }));
  malus("report", path.join(folder, "record.json"), "-o", html);
  return html;
}

const chart = (title, y, series) => ({ title, text: "", x: { name: "step" }, y, series });
const kPictures = [{ title: "p", layout: "mono", white_dn: 64, files: [{ name: "one", file: "one.npy" }] }];

const figure = (page, title) => page.locator(`figure.chart:has(h3:text-is("${title}"))`);

/** Texts of a plot with their boxes, its curves and dots. */
const drawn = (plot) =>
  plot.locator(".plot svg").evaluate((svg) => {
    const box = (e) => { const { left, right, top, bottom } = e.getBoundingClientRect(); return { left, right, top, bottom }; };
    const paths = [...svg.querySelectorAll("path")];
    return {
      texts: [...svg.querySelectorAll("text")].map((e) => ({ text: e.textContent, ...box(e) })),
      curves: paths.filter((e) => e.getAttribute("fill") === "none" && e.getAttribute("stroke") === "#0072b2").map((e) => ({ d: e.getAttribute("d"), ...box(e) })),
      dots: paths.filter((e) => e.getAttribute("fill") === "#fff" || (e.getAttribute("fill") === "#0072b2" && box(e).right - box(e).left > 2)).length,
      ...box(svg),
    };
  });

test("names of files are those of the program's figures", { skip: noBrowser }, async (t) => {
  const page = await open(t, pageOf(t, [chart("Loss at -3 dB, 0-1 DN", { name: "loss" }, [{ name: "a", x: [1, 2], y: [1, 2] }])]));
  await drawAll(page);
  const saved = await download(page, page.locator("figure.chart").first().getByRole("button", { name: "SVG" }));
  assert.equal(saved.name, "Loss_at_minus3_dB_0_1_DN.svg");
});

test("a long name pushes nothing out of a phone", { skip: noBrowser }, async (t) => {
  const long = "scene_2026_11_27_indoor_lamp_" + "w".repeat(150);
  const tables = [{ title: long, head: "picture", columns: [{ name: "PSNR", unit: "dB" }], rows: [{ name: long, cells: [31] }] }];
  const page = await open(t, pageOf(t, [chart(long, { name: "loss" }, [{ name: "a", x: [1, 2], y: [1, 2] }])], { title: long, text: long, tables }),
    { viewport: { width: 400, height: 800 } });
  await drawAll(page);
  assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= 400);
  const cell = await page.locator("td.number").first().evaluate((e) => e.getBoundingClientRect().right);
  assert.ok(cell <= 400, `the number ends at ${cell} px`);
});

test("a damaged picture is told as such", { skip: noBrowser }, async (t) => {
  const html = pageOf(t, [], { pictures: kPictures });
  writeFileSync(html, readFileSync(html, "utf8").replace(/(<script type="text\/plain" id="[^"]*">)[^<]*/, "$1AAAABBBBCCCC"));
  const page = await open(t, html);
  assert.equal(await page.locator(".viewer [role=alert]").textContent({ timeout: 10_000 }), "The pictures cannot be shown: a picture in this file is damaged");
});

