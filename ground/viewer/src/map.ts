// The strip along the bottom: coverage over the whole tunnel, findings, and where one is.

import type { Grid, Place, Layer } from "./scene";

const MARGIN_PX = 14;
const AXIS_PX = 18;

export class TunnelMap {
  /** Coverage if there is one, else the wall itself, coarse. */
  background: { image: CanvasImageSource & { width: number; height: number }; x_from_m: number; x_to_m: number } | null = null;
  onVisit: (place: Place) => void = () => {};
  private readonly context: CanvasRenderingContext2D;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly grid: Grid) {
    const context = canvas.getContext("2d");
    if (!context) throw new Error("the browser has no 2D canvas");
    this.context = context;
    const visit = (event: PointerEvent) => {
      const { width, height } = canvas.getBoundingClientRect();
      const share = 1 - (event.offsetY - 6) / (height - AXIS_PX - 6);
      this.onVisit({ s_m: Math.min(Math.max(share, 0), 0.9999) * grid.perimeter_m, x_m: this.metres(event.offsetX, width) });
    };
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      visit(event);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons > 0) visit(event);
    });
  }

  layer(image: ImageBitmap, layer: Layer): void {
    this.background = { image, x_from_m: layer.x_from_m, x_to_m: layer.x_to_m };
  }

  private get length_m(): number {
    return (this.grid.height_px * this.grid.mm_per_px) / 1000;
  }

  private metres(px: number, width: number): number {
    const share = (px - MARGIN_PX) / (width - 2 * MARGIN_PX);
    return this.grid.x0_m + Math.min(Math.max(share, 0), 1) * this.length_m;
  }

  draw(at: Place | null, eye_x_m: number, marks: { x_m: number; s_m: number; colour: string }[]): void {
    const { canvas, context, grid } = this;
    const { width, height } = canvas.getBoundingClientRect();
    const ratio = window.devicePixelRatio;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const [top, bottom] = [6, height - AXIS_PX];
    const px = (x_m: number) => MARGIN_PX + ((x_m - grid.x0_m) / this.length_m) * (width - 2 * MARGIN_PX);
    const py = (s_m: number) => bottom - (s_m / grid.perimeter_m) * (bottom - top);
    if (this.background) {
      const { image, x_from_m, x_to_m } = this.background;
      const [left, right] = [px(x_from_m), px(x_to_m)];
      // Columns of the picture go up, its rows to the right.
      context.setTransform(0, (-ratio * (bottom - top)) / image.width, (ratio * (right - left)) / image.height, 0, ratio * left, ratio * bottom);
      context.globalAlpha = 0.75;
      context.drawImage(image, 0, 0);
      context.globalAlpha = 1;
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.axis(px, top, bottom, width);
    for (const mark of marks) this.spot(px(mark.x_m), py(mark.s_m), mark.colour, 3.5);
    context.fillStyle = "#fff";
    context.fillRect(px(eye_x_m) - 1, top - 2, 2, bottom - top + 4);
    if (at) this.spot(px(at.x_m), py(at.s_m), "#fff", 4.5);
  }

  private spot(x: number, y: number, colour: string, radius: number): void {
    this.context.beginPath();
    this.context.arc(x, y, radius, 0, 2 * Math.PI);
    this.context.fillStyle = colour;
    this.context.fill();
    this.context.strokeStyle = "#0b1115";
    this.context.lineWidth = 1.5;
    this.context.stroke();
  }

  private axis(px: (x_m: number) => number, top: number, bottom: number, width: number): void {
    const { context, grid } = this;
    context.strokeStyle = "#2c343c";
    context.strokeRect(px(grid.x0_m), top, width - 2 * MARGIN_PX, bottom - top);
    const most = Math.max((width - 2 * MARGIN_PX) / 70, 1);
    const step = niceStep(this.length_m / most);
    context.fillStyle = "#8b98a4";
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    for (let x = Math.ceil(grid.x0_m / step) * step; x <= grid.x0_m + this.length_m; x += step) {
      context.fillRect(px(x), bottom, 1, 4);
      context.fillText(`${Number(x.toFixed(2))} m`, px(x), bottom + 15);
    }
    context.textAlign = "start";
  }
}

/** The next of 1, 2, 5 times a power of ten. */
export function niceStep(least: number): number {
  const power = 10 ** Math.floor(Math.log10(least));
  return ([1, 2, 5].find((factor) => factor * power >= least * 0.999) ?? 10) * power;
}
