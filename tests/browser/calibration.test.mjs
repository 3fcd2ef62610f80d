// The page of a calibration: numbers, plots, saving, accessibility, hostile names.
import assert from "node:assert/strict";
import { existsSync, readFileSync, statSync, writeFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { accessibilityFaults, cellValues, download, drawAll, malus, noBrowser, open, outsideRequests, root, shared, temporaryFolder, writeNpy } from "./support.mjs";

const kHostile = `<script>window.hacked = 1</script><img src=x onerror="window.hacked = 1">`;

/** A session of a simulated sensor with sixteen channels: bias frames and flats at two gains. */
function simulatedSession(folder) {
  const [rows, cols, white] = [64, 64, 3000];
  const toml = [
    `[sensor]\nname = '${kHostile}'\nlayout = "polar-bayer-rggb"\nblack = 0\nwhite = 4095\nrow_group = 2\n`,
  ];
  const levels = [0, 100, 300, 800, 1500];
  for (const level of levels)
    writeNpy(path.join(folder, `level${level}.npy`), rows, cols, new Float32Array(rows * cols).fill(level));
  for (const gain of [0, 12])
    for (const level of levels) {
      const frames = level === 0 ? 12 : 4;
      const to = path.join(folder, `g${gain}_${level}`);
      malus("synthesize", path.join(folder, `level${level}.npy`), "--model", "imx250myr-simulated", "--layout", "polar-bayer-rggb",
        "--white", white, "--gain", gain, "--frames", frames, "--float", "--first-frame", 1000 * gain + level, "-o", to);
      toml.push(
        `[[frames]]\nkind = "${level === 0 ? "bias" : "flat"}"\ngain_db = ${gain}.0\nexposure_s = ${0.001 + level * 1e-5}\n` +
          `paths = ["g${gain}_${level}/*.tif"]\n`,
      );
    }
  const file = path.join(folder, "session.toml");
  writeFileSync(file, toml.join("\n"));
  return file;
}

function reportOf(folder, session) {
  const model = path.join(folder, "model.h5"), html = path.join(folder, "report.html");
  malus("calibrate", session, "-o", model);
  malus("report", model, "-o", html);
  return { html, shown: JSON.parse(malus("model", "show", model, "--json")) };
}

test("sixteen simulated channels: the page's numbers are the model file's", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t);
  const { html, shown } = reportOf(folder, simulatedSession(folder));
  const page = await open(t, html);
  await drawAll(page);
  for (const gain of shown.gains) {
    const rows = page.locator(`#parameters table:has(caption:text-is("Parameters at ${gain.gain_db} dB")) tbody tr`);
    assert.equal(await rows.count(), 16);
    for (let channel = 0; channel < 16; ++channel) {
      assert.equal(await rows.nth(channel).locator("th").textContent(), shown.channels[channel]);
      const values = await cellValues(rows.nth(channel));
      const expected = [gain.K.value, gain.mu.mean, gain.sigma_row.mean, gain.lambda.mean, gain.sigma_tl.mean];
      expected.forEach((list, i) => assert.equal(values[i], list[channel]));
    }
  }
  assert.deepEqual(page.problems, []);
  assert.deepEqual(outsideRequests(page), []);
  assert.equal(await page.evaluate(() => window.hacked), undefined);
  assert.ok((await page.locator("h1").textContent()).includes(kHostile));
  assert.deepEqual(await accessibilityFaults(page), []);
  // The saved plot's key names every channel, and once what lines are; the screen's is leafed through.
  const saved = (await download(page, page.locator("#transfer figure").first().getByRole("button", { name: "SVG" }))).bytes.toString();
  const key = [...saved.matchAll(/>([^<>]+)<\/text>/g)].map(([, text]) => text);
  for (const name of [...shown.channels, "fit"]) assert.equal(key.filter((text) => text === name).length, 1, name);
  assert.ok(!key.some((text) => /, fit$|^\d+\/\d+$/.test(text)), key.join(" | "));
  const bar = await page.locator("#correlation figure .plot svg").first().locator("text").allTextContents();
  assert.ok(bar.includes("1") && bar.includes("\u22121"), `a colour bar without numbers: ${bar.join(" | ")}`);
  for (const id of ["transfer", "bias", "correlation", "laws", "distribution", "pattern"])
    assert.ok((await page.locator(`#${id} figure`).count()) > 0, `section ${id} has figures`);
});

test("emva001: real camera's page, plots can be chosen and saved", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t);
  const session = path.join(root, "examples/emva/session.toml");
  const { html, shown } = reportOf(folder, session);
  assert.ok(statSync(html).size < 5e6, `the file has ${statSync(html).size} bytes`);
  const page = await open(t, html);
  await drawAll(page);
  const figure = page.locator("#summary dl.figures dd[data-value]").first();
  assert.equal(Number(await figure.getAttribute("data-value")), shown.gains[0].K.value[0]);

  const plot = page.locator("#transfer figure").first();
  const csv = (await download(page, plot.getByRole("button", { name: "CSV" }))).bytes.toString();
  const [head, ...lines] = csv.trim().split("\r\n");
  assert.match(head, /^series,mean signal \[DN\],temporal variance \[DN\^2\],standard error,note$/);
  assert.ok(lines.length >= 5);
  const svg = await download(page, plot.getByRole("button", { name: "SVG" }));
  assert.match(svg.bytes.toString(), /^<svg[^]*<\/svg>\s*$/);
  const png = await download(page, plot.getByRole("button", { name: "PNG" }));
  assert.equal(png.bytes.subarray(1, 4).toString(), "PNG");
  assert.ok(png.bytes.length > 5000);

  // Saturated levels have next to no noise: thousands of their ratio would flatten the curve.
  const ratios = page.locator("figure").filter({ has: page.getByRole("heading", { name: /^Signal to noise/ }) }).first();
  const points = (await download(page, ratios.getByRole("button", { name: "CSV" }))).bytes.toString().trim().split("\r\n").slice(1);
  assert.ok(points.length > 20);
  for (const [series, signal, ratio] of points.map((line) => line.split(",")).map((cells) => [cells[0], ...cells.slice(-4).map(Number)]))
    assert.ok(!(ratio > 1.5 * Math.sqrt(signal)), `${series}: ${ratio} at ${signal} e-`);

  // A map's value can be read off with the keyboard.
  const maps = page.locator(".viewer[data-ready]").first();
  await maps.waitFor();
  await maps.locator(".stage canvas").focus();
  await page.keyboard.press("ArrowRight");
  const read = maps.locator(".readout tbody tr");
  assert.equal(await read.count(), 1);
  const shading = Number(await read.locator("td").last().getAttribute("data-value"));
  assert.ok(Number.isFinite(shading) && shading !== 0 && Math.abs(shading) < 5, `dark shading ${shading} DN`);

  // A pointer tells the standard error that the bar shows.
  const residuals = page.locator("#transfer figure .plot").nth(1);
  await residuals.scrollIntoViewIfNeeded();
  const marks = await residuals.locator('svg path[fill="#7f7f7f"]').evaluateAll((all) =>
    all.map((e) => e.getBoundingClientRect()).map((box) => [box.x + box.width / 2, box.y + box.height / 2, box.width]).filter(([, , width]) => width < 10));
  const told = [];
  for (const [x, y] of marks) {
    await page.mouse.move(x - 2, y);
    await page.mouse.move(x, y);
    await page.waitForTimeout(50);
    told.push(...(await residuals.locator("svg text").allTextContents()).filter((text) => text.includes("\u00b1")));
  }
  assert.ok(told.length > 0 && told.every((text) => / DN, .* \u00b1 .* %$/.test(text)), told.join(" | "));
  await page.mouse.move(0, 0);

  await plot.locator("summary").click();
  await plot.locator("details tbody tr").first().waitFor();  // filled when it is opened
  assert.equal(await plot.locator("details tbody tr").count(), lines.length);
  assert.deepEqual(page.problems, []);
  assert.deepEqual(outsideRequests(page), []);
  assert.deepEqual(await accessibilityFaults(page), []);
});

test("the reference camera's gain on the page is the accepted one",
  { skip: noBrowser || (!existsSync(path.join(shared, "emva001")) && "needs ../shared/data/emva001") }, async (t) => {
    const folder = temporaryFolder(t);
    const session = path.join(folder, "session.toml");
    malus("session-from-emva", path.join(shared, "emva001/EMVA1288_Data.txt"), "-o", session);
    const { html } = reportOf(folder, session);
    const page = await open(t, html);
    const K = Number(await page.locator("#summary dl.figures dd[data-value]").first().getAttribute("data-value"));
    assert.ok(K > 0.277 && K < 0.284, `K = ${K}`);
  });

test("phone width and dark colours: nothing sticks out, nothing is unreadable", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t);
  const html = path.join(folder, "report.html");
  malus("report", "imx250myr-simulated", "-o", html);
  for (const options of [{ viewport: { width: 390, height: 844 } }, { colorScheme: "dark" }]) {
    const page = await open(t, html, options);
    await drawAll(page);
    const { scroll, width } = await page.evaluate(() => ({ scroll: document.documentElement.scrollWidth, width: innerWidth }));
    assert.ok(scroll <= width, `${scroll} px wide on a screen of ${width}`);
    assert.deepEqual(await accessibilityFaults(page), []);
    assert.deepEqual(page.problems, []);
  }
});

test("figures for papers are well-formed SVG", { skip: noBrowser }, async (t) => {
  const folder = temporaryFolder(t);
  const { files } = JSON.parse(malus("report", "imx250myr-simulated", "--figures", path.join(folder, "figures"), "--json"));
  assert.ok(files.length >= 3);
  const page = await open(t, files[0]);
  for (const file of files) {
    const text = readFileSync(file, "utf8");
    const fault = await page.evaluate((svg) => new DOMParser().parseFromString(svg, "image/svg+xml").querySelector("parsererror")?.textContent, text);
    assert.equal(fault, undefined, file);
  }
});
