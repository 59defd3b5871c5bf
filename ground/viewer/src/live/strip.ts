// The wall unrolled: along the tunnel to the right, once around from twelve o'clock at the top to twelve at the bottom.

import { COLOURS, sized, type Update, type View } from "./view";

const MARGIN_PX = 30;
const AXIS_PX = 20;
/** Share of the width behind the vehicle while it is followed. */
const BEHIND = 0.78;
const SCALES_PX_PER_M = [6, 12, 25, 50, 100, 200];
/** Ahead, gap, thin, begun, seen. */
const CELLS: [number, number, number][] = [[20, 28, 34], [255, 77, 77], [255, 194, 51], [61, 139, 217], [70, 209, 140]];

export class Strip {
  private readonly stretches = new Map<number, HTMLCanvasElement>();
  private cell_m = 0;
  private columns = 0;
  private rows = 0;
  private zoom = 4;
  private vehicle_m = 0;
  /** The place at the vehicle's usual mark; `null` follows it. */
  private held_m: number | null = null;
  onFollow: (follows: boolean) => void = () => undefined;

  constructor(private readonly canvas: HTMLCanvasElement) {
    let last: { id: number; x: number } | null = null;
    canvas.addEventListener("pointerdown", (event) => {
      last = { id: event.pointerId, x: event.clientX };
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (last?.id !== event.pointerId || event.clientX === last.x) return;
      this.held_m = (this.held_m ?? this.vehicle_m) - (event.clientX - last.x) / this.pxPerM();
      last.x = event.clientX;
      this.onFollow(false);
    });
    const end = () => (last = null);
    canvas.addEventListener("pointerup", end);
    canvas.addEventListener("pointercancel", end);
  }

  follow(): void {
    this.held_m = null;
    this.onFollow(true);
  }

  scale(steps: number): void {
    this.zoom = Math.max(0, Math.min(SCALES_PX_PER_M.length - 1, this.zoom + steps));
  }

  /** What this page had is no more what the server has. */
  forget(): void {
    this.stretches.clear();
  }

  take(update: Update["strip"]): void {
    [this.cell_m, this.columns, this.rows] = [update.cell_m, update.columns, update.rows];
    for (const [number, cells] of update.stretches) this.stretches.set(number, this.paint(cells));
  }

  draw(view: View): void {
    const page = sized(this.canvas);
    if (!page) return;
    const { ink, width, height } = page;
    ink.font = "15px system-ui, sans-serif";
    ink.fillStyle = COLOURS.quiet;
    if (this.columns === 0) {
      ink.fillText("not shown: the section is not known", 10, height / 2);
      return;
    }
    this.vehicle_m = view.odometer_m.value ?? this.vehicle_m;
    const perM = this.pxPerM();
    const from_m = (this.held_m ?? this.vehicle_m) - (BEHIND * (width - MARGIN_PX)) / perM;
    const x = (x_m: number) => MARGIN_PX + (x_m - from_m) * perM;
    const [top, tall] = [0, height - AXIS_PX];
    ink.imageSmoothingEnabled = false;
    ink.fillStyle = `rgb(${CELLS[0]!.join()})`;
    ink.fillRect(MARGIN_PX, 0, width, tall);
    const stretch_m = this.rows * this.cell_m;
    for (const [number, picture] of this.stretches) {
      const [left, right] = [x(number * stretch_m), x((number + 1) * stretch_m)];
      if (right > MARGIN_PX && left < width) ink.drawImage(picture, left, top, right - left, tall);
    }
    ink.clearRect(0, 0, MARGIN_PX, height);
    this.drawGrid(ink, { x, from_m, perM, width, tall });
    this.drawVehicle(ink, view, x, tall);
  }

  private pxPerM(): number {
    return SCALES_PX_PER_M[this.zoom] ?? 100;
  }

  /** A stretch as a picture: a pixel per cell, along the axis to the right. */
  private paint(cells: string): HTMLCanvasElement {
    const bytes = atob(cells);
    const picture = document.createElement("canvas");
    [picture.width, picture.height] = [this.rows, this.columns];
    const ink = picture.getContext("2d");
    if (!ink) return picture;
    const pixels = ink.createImageData(this.rows, this.columns);
    for (let row = 0; row < this.rows; row++) {
      for (let column = 0; column < this.columns; column++) {
        const colour = CELLS[bytes.charCodeAt(row * this.columns + column)] ?? CELLS[0]!;
        pixels.data.set([...colour, 255], 4 * (column * this.rows + row));
      }
    }
    ink.putImageData(pixels, 0, 0);
    return picture;
  }

  private drawGrid(ink: CanvasRenderingContext2D, { x, from_m, perM, width, tall }: { x: (x_m: number) => number; from_m: number; perM: number; width: number; tall: number }): void {
    ink.textBaseline = "middle";
    ink.textAlign = "right";
    ink.fillStyle = COLOURS.quiet;
    for (const [share, hour] of [[0, "12"], [0.25, "3"], [0.5, "6"], [0.75, "9"], [1, "12"]] as const) {
      ink.fillText(hour, MARGIN_PX - 6, Math.min(tall - 7, Math.max(8, share * tall)));
      ink.fillRect(MARGIN_PX, share * tall, width, share % 0.5 === 0 ? 0 : 0.5);
    }
    const step = [1, 2, 5, 10, 20, 50].find((step) => step * perM >= 60) ?? 100;
    ink.textAlign = "center";
    for (let metre = Math.ceil(from_m / step) * step; x(metre) < width; metre += step) {
      ink.fillRect(x(metre), tall, 1, 5);
      if (x(metre) > MARGIN_PX + 12) ink.fillText(`${metre} m`, x(metre), tall + 12);
    }
  }

  private drawVehicle(ink: CanvasRenderingContext2D, view: View, x: (x_m: number) => number, tall: number): void {
    if (view.odometer_m.value === null) return;
    const at = x(view.odometer_m.value);
    if (at < MARGIN_PX) return;
    ink.fillStyle = view.odometer_m.is_stale ? COLOURS.quiet : COLOURS.text;
    ink.fillRect(at - 1.5, 0, 3, tall);
    ink.beginPath();
    ink.moveTo(at + 2, tall / 2 - 12);
    ink.lineTo(at + 20, tall / 2);
    ink.lineTo(at + 2, tall / 2 + 12);
    ink.fill();
  }
}
