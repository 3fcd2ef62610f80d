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

test("a 0 on a logarithmic axis leaves a gap and is told, the axis is that of the others", { skip: noBrowser }, async (t) => {
  const x = Array.from({ length: 200 }, (_, i) => i + 1), y = x.map((i) => (i === 50 ? 0 : 1 / i));
  const page = await open(t, pageOf(t, [
    chart("Loss", { name: "loss", log: true }, [{ name: "a", x, y }]),
    chart("None", { name: "loss", log: true }, [{ name: "a", x: [1, 2], y: [0, -1] }]),
  ]));
  await drawAll(page);
  const { texts, curves } = await drawn(figure(page, "Loss"));
  for (const label of ["1", "0.1", "0.01"]) assert.ok(texts.some(({ text }) => text === label), texts.map(({ text }) => text).join(" "));
  assert.ok(curves.some(({ top, bottom }) => bottom - top > 100), "the curve is a sliver");
  assert.match(await figure(page, "Loss").locator("figcaption").textContent(), /One point is 0 or below/);
  assert.match(await figure(page, "None").locator("figcaption").textContent(), /2 points are 0 or below/);
  assert.deepEqual(page.problems, []);
});

test("a curve of one point is seen, axis titles and the last label have their room", { skip: noBrowser }, async (t) => {
  const page = await open(t, pageOf(t, [
    chart("Validation", { name: "loss" }, [{ name: "a", x: [30], y: [0.3] }]),
    chart("Rate", { name: "Learning rate" }, [{ name: "a", x: [0, 50_000, 100_000], y: [0.000123, 0.000121, 0.00012] }]),
  ]));
  await drawAll(page);
  assert.equal((await drawn(figure(page, "Validation"))).dots, 1);
  const { texts, right } = await drawn(figure(page, "Rate"));
  const last = texts.find(({ text }) => text === "100000"), title = texts.find(({ text }) => text === "Learning rate");
  assert.ok(last && last.right <= right, `the last label ends at ${last?.right} of ${right} px`);
  const labels = texts.filter(({ text }) => text.startsWith("0.00012"));
  assert.ok(labels.length > 1);
  for (const label of labels) assert.ok(label.left >= title.right, `${label.text} begins at ${label.left} px, the title ends at ${title.right}`);
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

test("printing draws every plot once for paper, and once for the screen when it is over", { skip: noBrowser }, async (t) => {
  const charts = Array.from({ length: 3 }, (_, i) => chart(`Loss ${i}`, { name: "loss" }, [{ name: "a", x: [1, 2], y: [1, 2] }]));
  const page = await open(t, pageOf(t, charts));
  await drawAll(page);
  // A plot for the screen asks for the page's colours, one for paper does not.
  const asked = await page.evaluate(() => {
    const real = window.getComputedStyle;
    let count = 0;
    window.getComputedStyle = (of, ...more) => {
      if (of === document.documentElement) ++count;
      return real(of, ...more);
    };
    return ["beforeprint", "afterprint"].map((name) => {
      count = 0;
      dispatchEvent(new Event(name));
      return count;
    });
  });
  assert.deepEqual(asked, [0, 3]);
});

test("paper is light, holds plots and tables whole, and pictures that nobody scrolled to", { skip: noBrowser }, async (t) => {
  const charts = Array.from({ length: 6 }, (_, i) => chart(`Loss ${i}`, { name: "loss" }, [{ name: "a", x: [1, 2], y: [1, 2] }, { name: "b", x: [1, 2], y: [2, 1] }]));
  const columns = Array.from({ length: 12 }, (_, i) => ({ name: `quantity ${i}`, unit: "DN/e-" }));
  const cells = columns.map((_, i) => ({ value: 0.12345 + i, stderr: 0.0012 }));
  const html = pageOf(t, charts, { pictures: kPictures, tables: [{ title: "T", head: "channel", columns, rows: [{ name: "G1_135", cells }] }] });
  for (const options of [{}, { colorScheme: "dark" }]) {
    const page = await open(t, html, options);
    await page.locator(".viewer[data-ready]").waitFor({ state: "attached", timeout: 10_000 });
    if (!options.colorScheme) await page.locator("header button").click();  // dark by the page's own switch
    const ground = () => page.evaluate(() => [getComputedStyle(document.body).backgroundColor, getComputedStyle(document.body).color]);
    const before = await ground();
    await page.evaluate(() => dispatchEvent(new Event("beforeprint")));
    await page.emulateMedia({ media: "print" });
    await page.setViewportSize({ width: 718, height: 1000 });  // A4 with margins of 1 cm
    await page.waitForTimeout(200);
    assert.deepEqual(await ground(), ["rgb(255, 255, 255)", "rgb(28, 36, 48)"]);
    const { plots, tables } = await page.evaluate(() => ({
      plots: [...document.querySelectorAll("main > section .chart > .plot svg")].map((svg) => {
        const own = svg.getBoundingClientRect(), room = svg.closest("figure").getBoundingClientRect();
        return { fits: own.right <= room.right && own.bottom <= room.bottom, drawn: own.height > 200, ground: svg.querySelector("rect").getAttribute("fill"), box: svg.getAttribute("viewBox") };
      }),
      tables: [...document.querySelectorAll("section > .grid > .table table")].map((e) => e.getBoundingClientRect().right),
    }));
    assert.ok(plots.length >= 6);
    for (const plot of plots.slice(0, 6)) assert.deepEqual(plot, { fits: true, drawn: true, ground: "#ffffff", box: "0 0 680 380" });
    for (const right of tables) assert.ok(right <= 718, `a table ends at ${right} px`);
    await page.emulateMedia({ media: null, ...options });
    await page.evaluate(() => dispatchEvent(new Event("afterprint")));
    assert.deepEqual(await ground(), before);
    assert.deepEqual(page.problems, []);
  }
});
