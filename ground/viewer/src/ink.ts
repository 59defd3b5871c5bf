// Lines, boxes and words over the wall, drawn in two dimensions from points on the wall.

import * as THREE from "three";
import type { Place } from "./scene";
import type { Section } from "./section";

/** Along the axis lines are straight on the screen too; around, they bend at the polyline's vertices. */
type Screen = [number, number];

export interface Style {
  colour: string;
  width?: number;
  fill?: string;
  dash?: number[];
}

export class Ink {
  private readonly context: CanvasRenderingContext2D;
  private readonly matrix = new THREE.Matrix4();
  private width = 1;
  private height = 1;
  private near = 0.005;

  constructor(readonly canvas: HTMLCanvasElement, private readonly section: Section) {
    const context = canvas.getContext("2d");
    if (!context) throw new Error("the browser has no 2D canvas");
    this.context = context;
  }

  /** Clears, and takes over the camera. */
  begin(camera: THREE.PerspectiveCamera, width: number, height: number, ratio: number): void {
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
    }
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.context.clearRect(0, 0, width, height);
    [this.width, this.height, this.near] = [width, height, camera.near];
    this.matrix.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
  }

  private clip(s_m: number, x_m: number): THREE.Vector4 {
    const [x, y] = this.section.point(s_m);
    return new THREE.Vector4(x, y, -x_m, 1).applyMatrix4(this.matrix);
  }

  private onScreen(at: THREE.Vector4): Screen {
    return [((at.x / at.w + 1) / 2) * this.width, ((1 - at.y / at.w) / 2) * this.height];
  }

  /** Where a place is on the screen, if it is in front. */
  at(place: Place): Screen | null {
    const clip = this.clip(this.section.wrap(place.s_m), place.x_m);
    return clip.w > this.near ? this.onScreen(clip) : null;
  }

  /** The stretches of a line on the wall between cuts (at the crown, where the unrolled wall ends), as points. */
  private stretches(path: readonly Place[]): Place[][] {
    const { perimeter_m: around, s_m: vertices } = this.section;
    const parts: Place[][] = [];
    for (let k = 0; k + 1 < path.length; k++) {
      const [a, b] = [path[k]!, path[k + 1]!];
      const shares = [0, 1];
      if (a.s_m !== b.s_m) {
        for (let turn = Math.floor(Math.min(a.s_m, b.s_m) / around); turn * around <= Math.max(a.s_m, b.s_m); turn++) {
          for (const vertex of vertices) {
            const share = (turn * around + vertex - a.s_m) / (b.s_m - a.s_m);
            if (share > 0 && share < 1) shares.push(share);
          }
        }
        shares.sort((one, other) => one - other);
      }
      for (let at = 0; at + 1 < shares.length; at++) {
        const place = (share: number) => ({ s_m: a.s_m + (b.s_m - a.s_m) * share, x_m: a.x_m + (b.x_m - a.x_m) * share });
        const [from, to] = [place(shares[at]!), place(shares[at + 1]!)];
        // The turn in which this piece lies, whichever end is on the cut.
        const turn = Math.floor((from.s_m + to.s_m) / 2 / around) * around;
        const inTurn = (p: Place) => ({ s_m: Math.min(Math.max(p.s_m - turn, 0), around), x_m: p.x_m });
        const [start, end] = [inTurn(from), inTurn(to)];
        const last = parts.at(-1)?.at(-1);
        if (last && Math.abs(last.s_m - start.s_m) < 1e-9 && Math.abs(last.x_m - start.x_m) < 1e-9) parts.at(-1)!.push(end);
        else parts.push([start, end]);
      }
    }
    return parts;
  }

  /** Draws a line, or a closed area, on the wall. */
  line(path: readonly Place[], style: Style): void {
    const { context } = this;
    context.beginPath();
    for (const part of this.stretches(path)) this.trace(part);
    if (style.fill) {
      context.fillStyle = style.fill;
      context.fill("evenodd");
    }
    context.strokeStyle = style.colour;
    context.lineWidth = style.width ?? 2;
    context.lineJoin = "round";
    context.setLineDash(style.dash ?? []);
    context.stroke();
    context.setLineDash([]);
  }

  /** Adds a part to the path, cut off where it passes behind the eye. */
  private trace(part: Place[]): void {
    let before: THREE.Vector4 | null = null;
    for (const place of part) {
      const now = this.clip(place.s_m, place.x_m);
      const visible = now.w > this.near;
      if (before) {
        const wasVisible = before.w > this.near;
        if (visible !== wasVisible) {
          const share = (this.near - before.w) / (now.w - before.w);
          const edge = before.clone().lerp(now, share);
          edge.w = Math.max(edge.w, 1e-6);
          if (visible) this.context.moveTo(...this.onScreen(edge));
          else this.context.lineTo(...this.onScreen(edge));
        }
        if (visible) this.context.lineTo(...this.onScreen(now));
      } else if (visible) {
        this.context.moveTo(...this.onScreen(now));
      }
      before = now;
    }
  }

  dot(place: Place, style: Style, radius = 5): void {
    const at = this.at(place);
    if (!at) return;
    this.context.beginPath();
    this.context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
    this.context.fillStyle = style.fill ?? "#0b1115";
    this.context.fill();
    this.context.strokeStyle = style.colour;
    this.context.lineWidth = style.width ?? 2;
    this.context.stroke();
  }

  label(place: Place, text: string, colour: string): void {
    const at = this.at(place);
    if (!at || at[0] < -200 || at[0] > this.width + 200) return;
    const { context } = this;
    context.font = "12px system-ui, sans-serif";
    const width = context.measureText(text).width + 12;
    context.fillStyle = "rgba(13, 17, 20, 0.85)";
    context.beginPath();
    context.roundRect(at[0] + 8, at[1] - 24, width, 19, 5);
    context.fill();
    context.fillStyle = colour;
    context.fillText(text, at[0] + 14, at[1] - 10);
  }
}
