// The section, looking forward: y to the right, z down.

import { COLOURS, sized, type View } from "./view";

/** What is drawn of the covariance. */
const SIGMAS = 2;
const BEAMS: [number, number][] = [[0, -1], [1, 0], [0, 1], [-1, 0]];
const FONT = "600 20px system-ui, sans-serif";

export function drawSection(canvas: HTMLCanvasElement, outline_m: [number, number][], view: View): void {
  const page = sized(canvas);
  if (!page) return;
  const { ink, width, height } = page;
  ink.font = FONT;
  ink.textAlign = "center";
  ink.textBaseline = "middle";
  if (outline_m.length === 0) {
    ink.fillStyle = COLOURS.quiet;
    ink.fillText("section not known", width / 2, height / 2);
    return;
  }
  const ys = outline_m.map(([y]) => y);
  const zs = outline_m.map(([, z]) => z);
  const [left, right, top, bottom] = [Math.min(...ys), Math.max(...ys), Math.min(...zs), Math.max(...zs)];
  // Room for the readings outside the wall.
  const scale = Math.min((width - 130) / (right - left), (height - 76) / (bottom - top));
  const x = (y: number) => width / 2 + (y - (left + right) / 2) * scale;
  const y = (z: number) => height / 2 + (z - (top + bottom) / 2) * scale;
  const path = (points: [number, number][]) => {
    ink.beginPath();
    for (const [index, [py, pz]] of points.entries()) index === 0 ? ink.moveTo(x(py), y(pz)) : ink.lineTo(x(py), y(pz));
  };
  path(outline_m);
  ink.fillStyle = "#0a0f13";
  ink.fill();
  drawWater(ink, view, { left: x(left), right: x(right), bottom: y(bottom), scale });
  path(outline_m);
  ink.strokeStyle = COLOURS.text;
  ink.lineWidth = 4;
  ink.stroke();
  // The axis, to be aimed at.
  ink.strokeStyle = COLOURS.quiet;
  ink.lineWidth = 2;
  ink.beginPath();
  ink.moveTo(x(0) - 16, y(0));
  ink.lineTo(x(0) + 16, y(0));
  ink.moveTo(x(0), y(0) - 16);
  ink.lineTo(x(0), y(0) + 16);
  ink.stroke();
  readings(ink, view, [x(0), Math.min(width - 34, x(right) + 36), Math.max(34, x(left) - 36)], [y(top) - 18, y(bottom) + 18, y(0)]);
  if (view.offset_m.value) drawVehicle(ink, view, view.offset_m.value, { x, y, scale, reach: Math.min(right - left, bottom - top) });
}

function drawWater(ink: CanvasRenderingContext2D, view: View, wall: { left: number; right: number; bottom: number; scale: number }): void {
  const level_m = view.water_level_m.value;
  if (level_m === null || level_m < 0.02) return;
  ink.save();
  ink.clip();
  ink.fillStyle = "#16405f";
  ink.fillRect(wall.left, wall.bottom - level_m * wall.scale, wall.right - wall.left, level_m * wall.scale);
  ink.restore();
}

function readings(ink: CanvasRenderingContext2D, view: View, [middle, right, left]: [number, number, number], [above, below, level]: [number, number, number]): void {
  const places: [number, number][] = [[middle, above], [right, level], [middle, below], [left, level]];
  for (const [index, range] of view.ranges.entries()) {
    const [px, py] = places[index]!;
    if (range.state === "unfitted") continue;
    const words = range.state === "valid" && range.range_m !== null ? range.range_m.toFixed(2) : range.state === "unknown" ? "?" : "––––";
    ink.fillStyle = range.state === "valid" ? COLOURS.text : range.state === "unknown" ? COLOURS.quiet : COLOURS.bad;
    ink.fillText(words, px, py);
  }
}

interface Frame {
  x: (y: number) => number;
  y: (z: number) => number;
  scale: number;
  reach: number;
}

function drawVehicle(ink: CanvasRenderingContext2D, view: View, [cy, cz]: [number, number], { x, y, scale, reach }: Frame): void {
  const [sin, cos] = [Math.sin(view.roll_rad.value ?? 0), Math.cos(view.roll_rad.value ?? 0)];
  const at = ([by, bz]: [number, number], length_m: number): [number, number] =>
    [x(cy + (by * cos - bz * sin) * length_m), y(cz + (by * sin + bz * cos) * length_m)];
  const line = (from: [number, number], to: [number, number], colour: string, width: number, dash: number[] = []) => {
    ink.strokeStyle = colour;
    ink.lineWidth = width;
    ink.setLineDash(dash);
    ink.beginPath();
    ink.moveTo(...from);
    ink.lineTo(...to);
    ink.stroke();
    ink.setLineDash([]);
  };
  const centre: [number, number] = [x(cy), y(cz)];
  for (const [index, range] of view.ranges.entries()) {
    if (range.range_m !== null) line(centre, at(BEAMS[index]!, range.range_m), "#4d606c", 2, [6, 6]);
  }
  const old = view.offset_m.is_stale;
  const shaft = view.shaft_rad.value;
  if (shaft !== null && !view.shaft_rad.is_stale) line(centre, at([Math.sin(shaft), -Math.cos(shaft)], reach * 0.26), COLOURS.warn, 6);
  line(at([-1, 0], reach * 0.09), at([1, 0], reach * 0.09), old ? COLOURS.quiet : COLOURS.text, 5);
  ink.fillStyle = old ? COLOURS.quiet : COLOURS.text;
  ink.beginPath();
  ink.arc(...centre, 5, 0, 2 * Math.PI);
  ink.fill();
  if (view.sigma_m && !old) {
    ink.strokeStyle = "#5fd0ff";
    ink.fillStyle = "#5fd0ff33";
    ink.lineWidth = 3;
    ink.beginPath();
    ink.ellipse(...centre, Math.max(1, SIGMAS * view.sigma_m[0] * scale), Math.max(1, SIGMAS * view.sigma_m[1] * scale), 0, 0, 2 * Math.PI);
    ink.fill();
    ink.stroke();
  }
}
