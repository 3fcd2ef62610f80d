// A figure: the plot, a choice of variants, its numbers as a table, and the ways to save it.
import { BoxplotChart, CustomChart, HeatmapChart, LineChart, ScatterChart } from "echarts/charts";
import { GridComponent, LegendScrollComponent, TooltipComponent, VisualMapContinuousComponent } from "echarts/components";
import * as echarts from "echarts/core";
import { SVGRenderer } from "echarts/renderers";
import { chartOption, withoutPlace, type Colors } from "./chart_option";
import type { Chart, ChartsBlock } from "./contract";
import { chartRows, csv } from "./csv";
import { button, choice, element, fileStem, save } from "./dom";
import { number } from "./format";

echarts.use([
  BoxplotChart, CustomChart, HeatmapChart, LineChart, ScatterChart,
  GridComponent, LegendScrollComponent, TooltipComponent, VisualMapContinuousComponent, SVGRenderer,
]);

function colors(): Colors {
  const style = getComputedStyle(document.documentElement);
  const read = (name: string) => style.getPropertyValue(name).trim();
  return {
    text: read("--text"), faint: read("--faint"), grid: read("--grid"), surface: read("--surface"), accent: read("--accent"),
  };
}

const kPaper: Colors = { text: "#1c2430", faint: "#5b6675", grid: "#e3e7ec", surface: "#ffffff", accent: "#0b63b0" };
const kPaperSize = { width: 720, height: 460 };

/** The plot on white at a fixed size, as SVG text: the same whatever the screen. */
function paperSvg(chart: Chart): string {
  const plot = echarts.init(null, null, { renderer: "svg", ssr: true, ...kPaperSize });
  plot.setOption(chartOption(chart, kPaper, kPaperSize.width));
  const svg = plot.renderToSVGString();
  plot.dispose();
  return svg;
}

async function paperPng(chart: Chart): Promise<Blob> {
  const picture = new Image();
  picture.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(paperSvg(chart))}`;
  await picture.decode();
  const scale = 2;
  const canvas = element("canvas", { width: kPaperSize.width * scale, height: kPaperSize.height * scale });
  canvas.getContext("2d")!.drawImage(picture, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => canvas.toBlob((blob) => done(blob!), "image/png"));
}

const kMostRows = 400;

function numbersTable(chart: Chart): HTMLElement {
  const [head, ...rows] = chartRows(chart);
  const body = element("tbody");
  for (const row of rows.slice(0, kMostRows))
    body.append(
      element("tr", {}, ...row.map((cell) => element("td", {}, typeof cell === "number" ? number(cell) : (cell ?? "")))),
    );
  const table = element("table", {}, element("caption", { class: "hidden" }, `Numbers of ${chart.title}`));
  table.append(element("thead", {}, element("tr", {}, ...head.map((name) => element("th", { scope: "col" }, String(name))))), body);
  const made = element("div", { class: "scroll", tabindex: 0, role: "region", "aria-label": `Numbers of ${chart.title}` }, table);
  if (rows.length > kMostRows)
    made.append(element("p", {}, `The first ${kMostRows} of ${rows.length} numbers; the CSV has all of them.`));
  return made;
}

// Known before any listener of a plot runs.
let printing = false;
addEventListener("beforeprint", () => (printing = true));
addEventListener("afterprint", () => (printing = false));

/** A plot that is printed: drawn for paper at a size of its own, which the style sheet fits to the page; the page's is not known yet. */
class PrintedPlot {
  private static readonly size = { width: 680, height: 380 };
  /** Drawn for paper; what then changes on the screen is drawn afterwards. */
  onPaper = false;
  constructor(private readonly plot: echarts.ECharts, private readonly chart: () => Chart, private readonly redraw: () => void) {
    addEventListener("beforeprint", () => this.begin());
    addEventListener("afterprint", () => this.end());
    if (printing) this.begin();
  }
  private svg(): Element | null {
    return this.plot.getDom().querySelector("svg");
  }
  private begin(): void {
    this.onPaper = true;
    const { width, height } = PrintedPlot.size;
    this.plot.resize({ width, height });
    this.plot.setOption(chartOption(this.chart(), kPaper, width), { notMerge: true });
    this.svg()?.setAttribute("viewBox", `0 0 ${width} ${height}`);
  }
  private end(): void {
    this.onPaper = false;
    this.svg()?.removeAttribute("viewBox");
    this.plot.resize({ width: "auto", height: "auto" });
    this.redraw();
  }
}

/** Draws when the figure comes near the screen, and before printing. */
export function whenNear(target: HTMLElement, draw: () => void): void {
  let drawn = false;
  const once = () => {
    if (drawn) return;
    drawn = true;
    observer.disconnect();
    draw();
  };
  const observer = new IntersectionObserver((entries) => entries.some((e) => e.isIntersecting) && once(), {
    rootMargin: "600px",
  });
  observer.observe(target);
  addEventListener("beforeprint", once);
}

/** A figure whose chart can be replaced. */
export function liveChart(first: Chart, wide: boolean): { root: HTMLElement; tools: HTMLElement; show(chart: Chart): void } {
  let chart = first;
  let plot: echarts.ECharts | undefined;
  const title = element("h3");
  const canvas = element("div", { class: "plot", role: "img" });
  const text = element("p");
  const details = element("details", {}, element("summary", {}, "Numbers"));
  const fillNumbers = () => {
    details.querySelector(".scroll")?.remove();
    if (details.open) details.append(numbersTable(chart));
  };
  details.addEventListener("toggle", fillNumbers);
  const draw = () => plot?.setOption(chartOption(chart, colors()), { notMerge: true });
  const show = (next: Chart) => {
    chart = next;
    title.textContent = chart.title;
    text.textContent = [chart.text, withoutPlace(chart)].filter(Boolean).join(" ");
    canvas.setAttribute("aria-label", `Plot: ${chart.title}. ${chart.text} The numbers follow as a table.`);
    draw();
    fillNumbers();
  };
  show(first);
  const stem = () => fileStem(chart.title);
  const tools = element(
    "div",
    { class: "tools" },
    button("SVG", "Save the plot as SVG", () => save(`${stem()}.svg`, new Blob([paperSvg(chart)], { type: "image/svg+xml" }))),
    button("PNG", "Save the plot as PNG", async () => save(`${stem()}.png`, await paperPng(chart))),
    button("CSV", "Save the numbers as CSV", () => save(`${stem()}.csv`, new Blob([csv(chartRows(chart))], { type: "text/csv" }))),
  );
  whenNear(canvas, () => {
    plot = echarts.init(canvas, null, { renderer: "svg" });
    if (!printing) draw();
    new ResizeObserver(() => printing || plot!.resize()).observe(canvas);
    const printed = new PrintedPlot(plot, () => chart, draw);
    // Printing changes the theme, too, before the plots are told and again at its end.
    addEventListener("malus-theme", () => printing || printed.onPaper || draw());
  });
  const root = element("figure", { class: wide ? "chart wide" : "chart" }, title, canvas, element("figcaption", {}, text), tools, details);
  return { root, tools, show };
}

export function showCharts(block: ChartsBlock): HTMLElement {
  const { root, tools, show } = liveChart(block.charts[0].chart, block.wide);
  if (block.charts.length > 1)
    tools.prepend(choice(block.choice, block.charts.map(({ name }) => name), (index) => show(block.charts[index].chart)));
  return root;
}
