// The canvas: two pictures at the same place, divided by a movable line or side by side; pan, zoom, pick a pixel.
import { element } from "../dom";
import { Camera } from "./camera";
import { pixelsPerValue } from "./raster";

export interface Pane {
  label: string;
  picture: HTMLCanvasElement;
}

export type Arrangement = "wipe" | "beside";

export class Stage {
  readonly root: HTMLElement;
  readonly camera: Camera;
  arrangement: Arrangement = "wipe";
  /** Part of the width that shows the left picture. */
  wipe = 0.5;
  /** Called with a mosaic pixel; `spoken` when a screen reader should hear it. */
  onPick: (x: number, y: number, spoken: boolean) => void = () => {};

  private readonly canvas: HTMLCanvasElement;
  private readonly labels = [element("span", { class: "label left" }), element("span", { class: "label right" })];
  private panes: Pane[] = [];
  private pick = { x: 0, y: 0 };
  private pickShown = false;
  private drawing = false;
  private readonly pointers = new Map<number, { x: number; y: number }>();

  constructor(
    title: string,
    private readonly cols: number,
    private readonly rows: number,
    private readonly cell: { rows: number; cols: number },
  ) {
    this.camera = new Camera(cols, rows);
    this.pick = { x: Math.floor(cols / 2), y: Math.floor(rows / 2) };
    this.canvas = element("canvas", {
      tabindex: 0, role: "application", "aria-roledescription": "picture viewer",
      "aria-label": `${title}: arrow keys move to the next pixel, with shift ten further; plus and minus zoom, 0 shows the whole picture. The values of the pixel are read out.`,
    });
    this.root = element("div", { class: "stage", style: `aspect-ratio:${cols}/${rows}` }, this.canvas, ...this.labels);
    this.listen();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
  }

  show(panes: Pane[]): void {
    this.panes = panes;
    this.labels.forEach((label, i) => {
      label.textContent = panes[i]?.label ?? "";
      label.hidden = !panes[i]?.label;
    });
    this.draw();
  }

  draw(): void {
    if (this.drawing) return;
    this.drawing = true;
    requestAnimationFrame(() => {
      this.drawing = false;
      this.paint();
    });
  }

  toPng(): Promise<Blob> {
    this.paint();
    return new Promise((done) => this.canvas.toBlob((blob) => done(blob!), "image/png"));
  }

  private get beside(): boolean {
    return this.arrangement === "beside" && this.panes.length > 1;
  }
  private paneWidth(): number {
    return this.beside ? this.canvas.clientWidth / 2 : this.canvas.clientWidth;
  }

  resize(): void {
    const scale = Math.max(devicePixelRatio, 1);
    this.canvas.width = Math.round(this.canvas.clientWidth * scale);
    this.canvas.height = Math.round(this.canvas.clientHeight * scale);
    this.camera.resize(this.paneWidth(), this.canvas.clientHeight);
    this.draw();
  }

  private paint(): void {
    const context = this.canvas.getContext("2d")!;
    const scale = Math.max(devicePixelRatio, 1);
    const width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    const divider = this.beside ? width / 2 : width * this.wipe;
    this.panes.slice(0, 2).forEach((pane, i) => {
      const from = i === 0 ? 0 : divider;
      const to = i === 0 && this.panes.length > 1 ? divider : width;
      context.save();
      context.beginPath();
      context.rect(from, 0, to - from, height);
      context.clip();
      this.paintPane(context, pane, this.beside && i === 1 ? divider : 0);
      context.restore();
    });
    if (this.panes.length > 1) {
      context.fillStyle = "#ffffff";
      context.fillRect(divider - 1, 0, 2, height);
    }
    this.canvas.style.touchAction = this.camera.fitted ? "pan-y" : "none";
  }

  private paintPane(context: CanvasRenderingContext2D, { picture }: Pane, left: number): void {
    const origin = this.camera.toPane({ x: 0, y: 0 });
    const zoom = this.camera.zoom;
    const across = pixelsPerValue(this.cols, picture.width, this.cell.cols), down = pixelsPerValue(this.rows, picture.height, this.cell.rows);
    // Pixels stay squares when they are enlarged; only shrinking averages.
    context.imageSmoothingEnabled = zoom * across < 1;
    context.imageSmoothingQuality = "high";
    context.save();
    context.beginPath();
    context.rect(left + origin.x, origin.y, this.cols * zoom, this.rows * zoom);  // a last cell may be cut
    context.clip();
    context.drawImage(picture, left + origin.x, origin.y, picture.width * across * zoom, picture.height * down * zoom);
    context.restore();
    if (!this.pickShown) return;
    const x = Math.floor(this.pick.x / across) * across, y = Math.floor(this.pick.y / down) * down;
    const corner = this.camera.toPane({ x, y });
    const side = Math.max(across * zoom, 7);
    for (const [color, grow] of [["#000000", 1.5], ["#ffffff", 0.5]] as const) {
      context.strokeStyle = color;
      context.strokeRect(left + corner.x - grow, corner.y - grow, side + 2 * grow, side + 2 * grow);
    }
  }

  private setPick(x: number, y: number, spoken: boolean): void {
    if (spoken && (x < 0 || y < 0 || x >= this.cols || y >= this.rows)) return;
    this.pick = {
      x: Math.min(Math.max(Math.floor(x), 0), this.cols - 1),
      y: Math.min(Math.max(Math.floor(y), 0), this.rows - 1),
    };
    this.pickShown = true;
    this.onPick(this.pick.x, this.pick.y, spoken);
    this.draw();
  }

  private pointOf(event: MouseEvent): { x: number; y: number } {
    const box = this.canvas.getBoundingClientRect();
    const x = event.clientX - box.left;
    return { x: this.beside && x > box.width / 2 ? x - box.width / 2 : x, y: event.clientY - box.top };
  }

  private listen(): void {
    const canvas = this.canvas;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, this.pointOf(event));
    });
    canvas.addEventListener("pointermove", (event) => this.pointerMoved(event));
    for (const end of ["pointerup", "pointercancel"] as const)
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener("click", (event) => {
      const at = this.camera.toMosaic(this.pointOf(event));
      this.setPick(at.x, at.y, true);
    });
    canvas.addEventListener("dblclick", (event) => this.zoomBy(4, this.pointOf(event)));
    canvas.addEventListener(
      "wheel",
      (event) => {
        // The page scrolls under the wheel until the reader has chosen the picture.
        if (!event.ctrlKey && document.activeElement !== canvas) return;
        event.preventDefault();
        this.zoomBy(Math.exp(-event.deltaY * 0.002), this.pointOf(event));
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => this.keyPressed(event));
  }

  zoomBy(factor: number, at?: { x: number; y: number }): void {
    this.camera.zoomBy(factor, at);
    this.draw();
  }
  fit(): void {
    this.camera.fit();
    this.draw();
  }

  private pointerMoved(event: PointerEvent): void {
    const to = this.pointOf(event);
    const from = this.pointers.get(event.pointerId);
    if (!from) {
      const at = this.camera.toMosaic(to);
      if (at.x >= 0 && at.y >= 0 && at.x < this.cols && at.y < this.rows) this.setPick(at.x, at.y, false);
      return;
    }
    if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, point]) => point);
      const span = (p: { x: number; y: number }) => Math.hypot(p.x - other.x, p.y - other.y);
      this.camera.zoomBy(span(to) / Math.max(span(from), 1), { x: (to.x + other.x) / 2, y: (to.y + other.y) / 2 });
    } else this.camera.moveBy(to.x - from.x, to.y - from.y);
    this.pointers.set(event.pointerId, to);
    this.draw();
  }

  private keyPressed(event: KeyboardEvent): void {
    const step = event.shiftKey ? 10 : 1;
    const moves: Record<string, [number, number]> = {
      ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step],
    };
    const move = moves[event.key];
    if (move) {
      this.setPick(this.pick.x + move[0], this.pick.y + move[1], true);
      this.camera.reveal(this.pick);
    } else if (event.key === "+" || event.key === "=") this.zoomBy(1.5, this.camera.toPane(this.pick));
    else if (event.key === "-") this.zoomBy(1 / 1.5);
    else if (event.key === "0") this.fit();
    else return;
    event.preventDefault();
  }
}
