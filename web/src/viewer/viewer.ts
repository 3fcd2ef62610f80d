// The picture viewer: choose what to see, compare two pictures, read single pixels.
import { liveChart, whenNear } from "../charts";
import type { PicturesBlock } from "../contract";
import { button, choice, element, fileStem, freshId, save } from "../dom";
import { histogram } from "./histogram";
import { drawLegend } from "./legend";
import { paint, quantile } from "./paint";
import { decode, type Plane } from "./raster";
import { readout } from "./readout";
import { Stage } from "./stage";
import { firstView, viewsOf, type Shown, type View } from "./views";

/** The next of 1, 2, 5, 10, … times a power of ten: a range that can be read off a legend. */
function roundUp(value: number): number {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * ([1, 2, 5, 10].find((lead) => lead * power >= value) ?? 10);
}

/** When the page has been read, viewers get ready one after the other, seen or not: printing waits for none. */
let lastInLine: Promise<void> = new Promise((done) =>
  document.readyState === "complete" ? done() : addEventListener("load", () => done(), { once: true }),
);
function whenIdle(work: () => Promise<void>): void {
  const idle = () => new Promise<void>((done) => (window.requestIdleCallback ?? setTimeout)(() => done()));
  lastInLine = lastInLine.then(idle).then(work);
}

class Viewer {
  readonly root: HTMLElement;
  private readonly stage: Stage;
  private readonly values = element("div", { class: "readout" });
  private readonly spoken = element("p", { class: "hidden", "aria-live": "polite" });
  private readonly legend = element("div", { class: "legend" });
  private readonly tools = element("div", { class: "tools" });
  private readonly brightness = element("input", { type: "range", min: -4, max: 8, step: 0.25, value: 0 });
  private readonly chart: ReturnType<typeof liveChart>;
  private pictures: Plane[][] = [];
  private views: View[] = [];
  private view = 0;
  private sides: number[];
  private shown: (Shown | null)[] = [];
  private light = 1;
  private reach = 1;
  private loading?: Promise<void>;

  constructor(private readonly block: PicturesBlock) {
    this.stage = new Stage(block.title, block.cols, block.rows, block.cell);
    const count = Math.max(block.pictures.length, ...block.layers.map(({ rasters }) => rasters.length));
    this.sides = count > 1 ? [0, 1] : [0];
    this.chart = liveChart(histogram({ name: "", unit: "1", look: { kind: "light" }, of: () => null }, []), true);
    const wait = element("p", { role: "status" }, "Unpacking the pictures…");
    this.root = element("figure", { class: "viewer wide" }, element("h3", {}, block.title), element("p", { class: "note" }, block.text), wait);
    this.values.textContent = "Point at the picture to read its values, or move to it with the Tab key and use the arrows.";
    // The stage needs its size before anything is drawn, so that the page does not jump.
    this.root.append(this.tools, this.stage.root, this.wipe(), element("div", { class: "below" }, this.values, this.legend), this.spoken);
    this.root.append(element("details", { open: true }, element("summary", {}, "Histogram"), this.chart.root));
    this.brightness.id = freshId("brightness");
    const start = () => (this.loading ??= this.load(wait));
    whenNear(this.root, () => void start());
    whenIdle(start);
  }

  private async load(wait: HTMLElement): Promise<void> {
    try {
      this.pictures = await Promise.all(this.block.pictures.map(({ raster }) => decode(raster)));
      const layers = await Promise.all(
        this.block.layers.map(({ rasters }) => Promise.all(rasters.map(async (r) => (r ? (await decode(r))[0] : null)))),
      );
      this.views = viewsOf(this.block, layers);
      this.view = firstView(this.views, this.sides.length > 1);
      this.refresh();
    } catch (error) {
      wait.textContent = `The pictures cannot be shown: ${(error as Error).message}`;
      wait.setAttribute("role", "alert");
      return;
    }
    wait.remove();
    this.controls();
    this.stage.onPick = (x, y, spoken) => this.showPixel(x, y, spoken);
    addEventListener("malus-theme", () => this.showLegend());
    this.root.dataset.ready = "true";
  }

  private wipe(): HTMLElement {
    if (this.sides.length < 2) return element("div");
    const id = freshId("wipe");
    const slider = element("input", { id, type: "range", min: 0, max: 100, step: 1, value: 50 });
    slider.addEventListener("input", () => {
      this.stage.wipe = Number(slider.value) / 100;
      this.stage.draw();
    });
    return element("div", { class: "wipe" }, element("label", { for: id }, "Divider"), slider);
  }

  private names(): string[] {
    return this.block.pictures.map(({ name }) => name);
  }

  private controls(): void {
    const show = choice("Show", this.views.map(({ name }) => name), (index) => this.pickView(index));
    show.querySelector("select")!.selectedIndex = this.view;
    this.tools.append(show);
    const names = this.names();
    if (names.length > 2)
      for (const side of [0, 1]) {
        const made = choice(side ? "Right" : "Left", names, (index) => {
          this.sides[side] = index;
          this.refresh();
        });
        made.querySelector("select")!.selectedIndex = side;
        this.tools.append(made);
      }
    if (this.sides.length > 1)
      this.tools.append(
        choice("Compare", ["with a divider", "side by side"], (index) => {
          this.stage.arrangement = index ? "beside" : "wipe";
          this.stage.resize();
        }),
      );
    this.brightness.addEventListener("input", () => this.repaint());
    this.tools.append(
      element("span", { class: "choice" }, element("label", { for: this.brightness.id }, "Brightness"), this.brightness),
      button("−", "Zoom out", () => this.stage.zoomBy(0.5)),
      button("+", "Zoom in", () => this.stage.zoomBy(2)),
      button("Whole", "Show the whole picture", () => this.stage.fit()),
      button("PNG", "Save what is shown as PNG", async () =>
        save(`${fileStem(this.block.title)}_${fileStem(this.views[this.view].name)}.png`, await this.stage.toPng()),
      ),
    );
  }

  private pickView(index: number): void {
    this.view = index;
    this.brightness.value = "0";
    this.refresh();
  }

  /** Computes the chosen view of every picture. */
  private refresh(): void {
    const view = this.views[this.view];
    const count = Math.max(this.pictures.length, ...this.block.layers.map(({ rasters }) => rasters.length));
    this.shown = Array.from({ length: count }, (_, p) => view.of(this.pictures[p] ?? [], p));
    const last = this.shown[Math.min(1, count - 1)] ?? this.shown.find((s) => s !== null);
    this.light = Math.max(quantile(last?.planes ?? [], 0.99) / 0.9, 1e-6);
    this.reach = roundUp(quantile(last?.planes ?? [], 0.99, Math.abs));
    this.repaint();
    const names = this.names();
    const present = this.shown.flatMap((s, p) => (s ? [{ name: names[p] ?? view.name, planes: s.planes }] : []));
    this.chart.show(histogram(view, present));
  }

  private range(): { low: number; high: number } {
    const { look } = this.views[this.view];
    if (look.kind === "light") return { low: 0, high: 1 };
    // Brightness narrows the range of a palette; the wheel of angles has none to narrow.
    const part = look.palette === "cyclic" ? 1 : 2 ** -Number(this.brightness.value);
    if (look.fitted) return { low: look.low * this.reach * part, high: look.high * this.reach * part };
    const fixed = look.palette === "diverging" ? (look.low + look.high) / 2 : look.low;
    return { low: fixed + (look.low - fixed) * part, high: fixed + (look.high - fixed) * part };
  }

  private repaint(): void {
    const view = this.views[this.view];
    const look = view.look.kind === "light" ? view.look : { ...view.look, ...this.range() };
    const full = this.light * 2 ** -Number(this.brightness.value);
    const panes = this.sides.flatMap((p) => {
      const shown = this.shown[p];
      if (!shown) return [];
      const picture = element("canvas");
      paint(shown, look, full, picture);
      return [{ label: this.names()[p] ?? "", picture }];
    });
    this.stage.show(panes);
    this.showLegend();
  }

  private showLegend(): void {
    const { low, high } = this.range();
    drawLegend(this.legend, this.views[this.view], low, high);
  }

  private showPixel(x: number, y: number, spoken: boolean): void {
    const table = readout(this.block, this.pictures, this.views[this.view], this.shown, x, y);
    this.values.replaceChildren(table);
    if (spoken)
      this.spoken.textContent = [...table.querySelectorAll("tr")].map((row) => [...row.children].map((c) => c.textContent).join(", ")).join("; ");
  }
}

export function showPictures(block: PicturesBlock): HTMLElement {
  return new Viewer(block).root;
}
