// web/built/report.html is checked in, so that building malus needs neither Node.js nor a network. Here it is built
// again and compared: what is checked in is what the sources say.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import path from "node:path";
import { test } from "node:test";
import { root, temporaryFolder } from "./support.mjs";

const web = path.join(root, "web");
const tool = (name) => path.join(web, "node_modules/.bin", name);

test("the page's sources are free of type errors", () => {
  execFileSync(tool("tsc"), ["--noEmit"], { cwd: web, encoding: "utf8" });
});

test("the checked-in page is built from the sources", (t) => {
  const folder = temporaryFolder(t);
  execFileSync(tool("vite"), ["build", "--outDir", folder, "--emptyOutDir", "--logLevel", "error"], { cwd: web });
  const built = readFileSync(path.join(folder, "report.html")), kept = readFileSync(path.join(web, "built/report.html"));
  assert.ok(built.equals(kept), "web/built/report.html is stale: run npm run build in web/ and commit the result");
});
