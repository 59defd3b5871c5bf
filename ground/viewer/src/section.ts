// The section as a polyline, rolled up or unrolled by any amount, and what follows from it: points, rays, clock positions.
//
// World frame (as in model.glb): X = tunnel y (right), Y = -tunnel z (up), Z = -tunnel x, so that a camera at rest looks forward.
// Unrolling turns every piece of the polyline towards the floor's direction and keeps its length: all states are isometric, so
// what is measured on the wall is the same in each. The wall is cut at the crown and held at the floor.

import type { Place, Scene } from "./scene";

/** Direction of the unrolled wall: at the floor, clockwise is to the left. */
const FLAT_RAD = -Math.PI;

export interface Hit extends Place {
  distance: number;
}

export class Section {
  readonly count: number;
  readonly perimeter_m: number;
  /** Distance at which the polyline's vertices lie around the wall. */
  readonly s_m: Float64Array;
  /** [X, Y] of every vertex as unrolled now. */
  readonly points: Float64Array;
  /** 0 rolled up, 1 flat. */
  unrolled = 0;
  /** Where the wall is held: straight below the axis. */
  readonly held_s_m: number;
  private readonly rolled: Float64Array;
  private readonly angles: Float64Array;
  private readonly lengths: Float64Array;
  private readonly held: [number, number];

  constructor(section: Scene["section"]) {
    this.count = section.s_m.length;
    this.s_m = Float64Array.from(section.s_m);
    this.perimeter_m = this.s_m[this.count - 1]!;
    this.rolled = new Float64Array(2 * this.count);
    for (let k = 0; k < this.count; k++) {
      this.rolled[2 * k] = section.y_m[k]!;
      this.rolled[2 * k + 1] = -section.z_m[k]!;
    }
    this.points = this.rolled.slice();
    this.angles = new Float64Array(this.count - 1);
    this.lengths = new Float64Array(this.count - 1);
    for (let k = 0; k + 1 < this.count; k++) {
      const dx = this.rolled[2 * k + 2]! - this.rolled[2 * k]!;
      const dy = this.rolled[2 * k + 3]! - this.rolled[2 * k + 1]!;
      const before = k > 0 ? this.angles[k - 1]! : 0;
      const turn = Math.atan2(dy, dx) - before;
      this.angles[k] = before + turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
      this.lengths[k] = Math.hypot(dx, dy);
    }
    this.held_s_m = this.sAtClock(6);
    this.held = this.point(this.held_s_m);
  }

  /** Unrolls by a share from 0 to 1. */
  unroll(share: number): void {
    this.unrolled = share;
    this.points.set(this.rolled);
    if (share === 0) return;
    for (let k = 0; k + 1 < this.count; k++) {
      const angle = this.angles[k]! + (FLAT_RAD - this.angles[k]!) * share;
      this.points[2 * k + 2] = this.points[2 * k]! + this.lengths[k]! * Math.cos(angle);
      this.points[2 * k + 3] = this.points[2 * k + 1]! + this.lengths[k]! * Math.sin(angle);
    }
    const [x, y] = this.point(this.held_s_m);
    for (let k = 0; k < this.count; k++) {
      this.points[2 * k]! += this.held[0] - x;
      this.points[2 * k + 1]! += this.held[1] - y;
    }
  }

  wrap(s_m: number): number {
    const wrapped = s_m % this.perimeter_m;
    return wrapped < 0 ? wrapped + this.perimeter_m : wrapped;
  }

  /** The arc length next to `near_m` that is the same place as `s_m`. */
  near(s_m: number, near_m: number): number {
    return s_m + Math.round((near_m - s_m) / this.perimeter_m) * this.perimeter_m;
  }

  /** Position on the polyline, vertex number and share of the piece behind it, for `s_m` in [0, perimeter]. */
  index(s_m: number): number {
    let [low, high] = [0, this.count - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.s_m[middle]! <= s_m) low = middle;
      else high = middle;
    }
    return low + Math.min(Math.max((s_m - this.s_m[low]!) / (this.s_m[high]! - this.s_m[low]!), 0), 1);
  }

  /** [X, Y] at `s_m` in [0, perimeter] as unrolled now. */
  point(s_m: number): [number, number] {
    const index = this.index(s_m);
    const k = Math.min(Math.floor(index), this.count - 2);
    const share = index - k;
    const mix = (at: number) => this.points[at]! + (this.points[at + 2]! - this.points[at]!) * share;
    return [mix(2 * k), mix(2 * k + 1)];
  }

  /** Clock position in [0, 12) of the rolled-up wall at `s_m`. */
  clock(s_m: number): number {
    const index = this.index(this.wrap(s_m));
    const k = Math.min(Math.floor(index), this.count - 2);
    const share = index - k;
    const mix = (at: number) => this.rolled[at]! + (this.rolled[at + 2]! - this.rolled[at]!) * share;
    const hours = (Math.atan2(mix(2 * k), mix(2 * k + 1)) / (2 * Math.PI)) * 12;
    const clock = hours < 0 ? hours + 12 : hours;
    return clock > 12 - 1e-9 ? 0 : clock;
  }

  /** Arc length of the wall in the direction of a clock position. */
  sAtClock(clock: number): number {
    const angle = (clock / 12) * 2 * Math.PI;
    return this.meet(this.rolled, 0, 0, Math.sin(angle), Math.cos(angle))?.s_m ?? 0;
  }

  /** Where a ray from [x, y, z] along [dx, dy, dz] (world) meets the wall first. */
  hit(origin: readonly [number, number, number], direction: readonly [number, number, number]): Hit | null {
    const met = this.meet(this.points, origin[0], origin[1], direction[0], direction[1]);
    if (!met) return null;
    return { s_m: met.s_m, x_m: -(origin[2] + direction[2] * met.distance), distance: met.distance };
  }

  /** Whether [X, Y] lies inside the rolled-up section. */
  contains(x: number, y: number): boolean {
    let inside = false;
    const points = this.rolled;
    for (let k = 0; k + 1 < this.count; k++) {
      const [ax, ay, bx, by] = [points[2 * k]!, points[2 * k + 1]!, points[2 * k + 2]!, points[2 * k + 3]!];
      if (ay > y !== by > y && x < ax + ((bx - ax) * (y - ay)) / (by - ay)) inside = !inside;
    }
    return inside;
  }

  private meet(points: Float64Array, x: number, y: number, dx: number, dy: number) {
    let best: { s_m: number; distance: number } | null = null;
    for (let k = 0; k + 1 < this.count; k++) {
      const [ax, ay] = [points[2 * k]! - x, points[2 * k + 1]! - y];
      const [ex, ey] = [points[2 * k + 2]! - points[2 * k]!, points[2 * k + 3]! - points[2 * k + 1]!];
      const cross = dx * ey - dy * ex;
      if (cross === 0) continue;
      const distance = (ax * ey - ay * ex) / cross;
      const share = (ax * dy - ay * dx) / cross;
      if (distance > 1e-9 && share >= -1e-9 && share <= 1 + 1e-9 && (!best || distance < best.distance)) {
        best = { s_m: this.s_m[k]! + (this.s_m[k + 1]! - this.s_m[k]!) * Math.min(Math.max(share, 0), 1), distance };
      }
    }
    return best;
  }
}
