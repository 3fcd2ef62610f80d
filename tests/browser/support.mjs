// Shared by the browser tests: the program, Chromium, and small raw files to work on.
import { execFileSync } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

const require = createRequire(import.meta.url);
const { chromium } = require("playwright-core");
const axeSource = readFileSync(require.resolve("axe-core/axe.min.js"), "utf8");

export const root = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
export const shared = process.env.MALUS_SHARED_DATA ?? path.join(root, "../shared/data");
const program = process.env.MALUS_PROGRAM ?? path.join(root, "build/release/malus");

/** Runs malus; returns what it prints. */
export function malus(...words) {
  return execFileSync(program, words.map(String), { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"], maxBuffer: 1 << 28 });
}

export function temporaryFolder(t) {
  const folder = mkdtempSync(path.join(tmpdir(), "malus-browser-"));
  t.after(() => rmSync(folder, { recursive: true, force: true }));
  return folder;
}

/** A NumPy file of little-endian floats. */
export function writeNpy(file, rows, cols, values) {
  const head = `{'descr': '<f4', 'fortran_order': False, 'shape': (${rows}, ${cols}), }`;
  const padded = head.padEnd(Math.ceil((head.length + 11) / 64) * 64 - 11) + "\n";
  const start = Buffer.from(`\x93NUMPY\x01\x00${String.fromCharCode(padded.length & 255, padded.length >> 8)}${padded}`, "latin1");
  writeFileSync(file, Buffer.concat([start, Buffer.from(Float32Array.from(values).buffer)]));
}

const kFlags = [
  "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
  "--disable-component-update", "--disable-sync",
];
const executable = ["/usr/bin/chromium", "/usr/bin/chromium-browser"].find(existsSync);
export const noBrowser = executable ? false : "needs Chromium (apt-get install chromium)";

/** A page showing a file, in a browser of its own; every console error and every request is written down. */
export async function open(t, file, options = {}) {
  const profile = mkdtempSync(path.join(tmpdir(), "malus-chromium-"));
  const context = await chromium.launchPersistentContext(profile, {
    executablePath: executable, args: kFlags, acceptDownloads: true, viewport: { width: 1280, height: 900 }, ...options,
  });
  t.after(async () => {
    await context.close();
    rmSync(profile, { recursive: true, force: true });
  });
  const page = await context.newPage();
  page.problems = [];
  page.requests = [];
  page.on("console", (message) => message.type() === "error" && page.problems.push(message.text()));
  page.on("pageerror", (error) => page.problems.push(error.message));
  page.on("request", (request) => page.requests.push(request.url()));
  await page.goto(`file://${file}`);
  return page;
}

/** Requests beyond the file itself and what it holds. */
export function outsideRequests(page) {
  return page.requests.slice(1).filter((url) => !/^(data|blob):/.test(url));
}

/** Serious and critical findings of axe, as text. */
export async function accessibilityFaults(page) {
  await page.evaluate(axeSource);
  const { violations } = await page.evaluate(() => axe.run(document, { resultTypes: ["violations"] }));
  return violations
    .filter(({ impact }) => impact === "serious" || impact === "critical")
    .map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map((n) => n.html.slice(0, 160)).join(" | ")}`);
}

/** Scrolls through the page so that everything is drawn. */
export async function drawAll(page) {
  const height = await page.evaluate(() => document.documentElement.scrollHeight);
  for (let y = 0; y < height; y += 600) {
    await page.evaluate((to) => scrollTo(0, to), y);
    await page.waitForTimeout(30);
  }
  await page.evaluate(() => scrollTo(0, 0));
}

/** What a button lets the reader save. */
export async function download(page, button) {
  const [saved] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return { name: saved.suggestedFilename(), bytes: readFileSync(await saved.path()) };
}

/** The numbers that a table cell carries. */
export async function cellValues(table) {
  return table.locator("td[data-value]").evaluateAll((cells) => cells.map((c) => Number(c.dataset.value)));
}
