import "./style.css";
import { kFormat, type Report } from "./contract";
import { element } from "./dom";
import { showReport } from "./page";

const data = document.getElementById("malus-report");
const page = document.getElementById("page")!;
try {
  const report = JSON.parse(data?.textContent ?? "null") as Report | null;
  if (!report) throw new Error("this file is the empty page: malus puts a report into it");
  if (report.format !== kFormat)
    throw new Error(`the report has format ${report.format}, this page reads format ${kFormat}`);
  showReport(report, page);
} catch (error) {
  page.append(element("p", { role: "alert", class: "broken" }, `The report cannot be shown: ${(error as Error).message}`));
}
