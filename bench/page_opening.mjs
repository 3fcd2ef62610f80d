// How long Chromium takes from opening a report of five megapixels to its first pictures; the target is two seconds.
//   tests/browser/run (once, for its tools);   node bench/page_opening.mjs [RUNS] [REPORT.html ...]
// Several reports (of a program before and after a change) are opened in turn; medians.
import path from "node:path";
import { malus, noBrowser, open, root, temporaryFolder } from "../tests/browser/support.mjs";

const cleaners = [];
const all = { after: (cleaner) => cleaners.push(cleaner) };

function exampleReport() {
  const folder = temporaryFolder(all);
  const html = path.join(folder, "report.html");
  malus("denoise", path.join(root, "examples/imx250mzr/fruits.png"), "-o", path.join(folder, "out"), "--layout", "polar-mono",
    "--black", 0, "--profile", "fast");
  malus("report", path.join(folder, "out/fruits_denoised.json"), "-o", html);
  return html;
}

async function opening(html) {
  const own = [];
  const page = await open({ after: (cleaner) => own.push(cleaner) }, "/dev/null");
  await page.addInitScript(() => {
    const seen = new MutationObserver(() => {
      if (!document.querySelector(".viewer[data-ready]")) return;
      window.readyAt ??= performance.now();
      seen.disconnect();
    });
    seen.observe(document, { subtree: true, attributes: true, childList: true });
  });
  await page.goto(`file://${path.resolve(html)}`);
  await page.waitForFunction(() => window.readyAt);
  const milliseconds = await page.evaluate(() => window.readyAt);
  for (const cleaner of own) await cleaner();
  return milliseconds;
}

if (noBrowser) {
  console.error(noBrowser);
  process.exit(1);
}
const [runs = "7", ...named] = process.argv.slice(2);
const reports = named.length ? named : [exampleReport()];
const times = reports.map(() => []);
for (let run = 0; run < Number(runs); ++run)
  for (const [i, html] of reports.entries()) times[i].push(await opening(html));
times.forEach((list, i) => {
  const sorted = list.sort((a, b) => a - b).map(Math.round);
  console.log(`${sorted[sorted.length >> 1]} ms (${sorted[0]} to ${sorted.at(-1)}) ${named[i] ?? "examples/imx250mzr/fruits.png"}`);
});
for (const cleaner of cleaners) cleaner();
