// Where the reader looks: the same place for both pictures, in pixels of the mosaic.

export class Camera {
  /** Mosaic position in the middle of a pane. */
  x = 0;
  y = 0;
  /** Screen pixels per mosaic pixel. */
  zoom = 1;
  fitted = true;
  private pane = { width: 1, height: 1 };

  constructor(
    private readonly cols: number,
    private readonly rows: number,
  ) {}

  resize(width: number, height: number): void {
    this.pane = { width: Math.max(width, 1), height: Math.max(height, 1) };
    if (this.fitted) this.fit();
  }
  fit(): void {
    this.fitted = true;
    this.zoom = this.smallest();
    this.x = this.cols / 2;
    this.y = this.rows / 2;
  }
  private smallest(): number {
    return Math.min(this.pane.width / this.cols, this.pane.height / this.rows);
  }
  /** Zooms and keeps the mosaic position under the pane's point where it is. */
  zoomBy(factor: number, at?: { x: number; y: number }): void {
    const point = at ?? { x: this.pane.width / 2, y: this.pane.height / 2 };
    const before = this.toMosaic(point);
    this.zoom = Math.min(Math.max(this.zoom * factor, this.smallest()), 64);
    if (this.zoom <= this.smallest() * 1.0001) return this.fit();
    this.fitted = false;
    const after = this.toMosaic(point);
    this.moveBy((after.x - before.x) * this.zoom, (after.y - before.y) * this.zoom);
  }
  /** Moves the picture by screen pixels. */
  moveBy(dx: number, dy: number): void {
    this.x = Math.min(Math.max(this.x - dx / this.zoom, 0), this.cols);
    this.y = Math.min(Math.max(this.y - dy / this.zoom, 0), this.rows);
  }
  toMosaic(point: { x: number; y: number }): { x: number; y: number } {
    return {
      x: this.x + (point.x - this.pane.width / 2) / this.zoom,
      y: this.y + (point.y - this.pane.height / 2) / this.zoom,
    };
  }
  toPane(point: { x: number; y: number }): { x: number; y: number } {
    return {
      x: (point.x - this.x) * this.zoom + this.pane.width / 2,
      y: (point.y - this.y) * this.zoom + this.pane.height / 2,
    };
  }
  /** Brings a mosaic pixel into the pane. */
  reveal(point: { x: number; y: number }): void {
    const at = this.toPane(point);
    if (at.x < 0 || at.x > this.pane.width) this.x = point.x;
    if (at.y < 0 || at.y > this.pane.height) this.y = point.y;
  }
}
