// Results of node:test as JUnit XML, for scripts/summarize_tests.py.
const safe = (text) =>
  String(text).replace(/[<>&"]/g, (c) => `&#${c.charCodeAt(0)};`).replace(/[^\t\n\r -\uFFFD]/g, "");

export default async function* junit(events) {
  yield '<?xml version="1.0" encoding="utf-8"?>\n<testsuite name="browser">\n';
  for await (const { type, data } of events) {
    if (type !== "test:pass" && type !== "test:fail") continue;
    // A file is reported as a test of its own; only what failed outside its tests counts.
    if (data.details?.type === "suite" || (/\.test\.mjs$/.test(data.name) && type === "test:pass")) continue;
    yield `<testcase classname="browser" name="${safe(data.name)}" time="${(data.details?.duration_ms ?? 0) / 1000}">`;
    if (data.skip !== undefined) yield `<skipped message="${safe(data.skip)}"/>`;
    else if (type === "test:fail") yield `<failure>${safe(data.details?.error?.cause?.stack ?? data.details?.error)}</failure>`;
    yield "</testcase>\n";
  }
  yield "</testsuite>\n";
}
