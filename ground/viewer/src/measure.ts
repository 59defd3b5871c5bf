// Lengths and areas along the wall: on the unrolled section, where a straight line is the shortest way.

import type { Ink } from "./ink";
import type { Place } from "./scene";
import type { Section } from "./section";

export const metres = (value: number) => (Math.abs(value) < 1 ? `${(value * 1000).toFixed(value < 0.1 ? 1 : 0)} mm` : `${value.toFixed(3)} m`);

const COLOUR = "#ffd166";

export class Measure {
  points: Place[] = [];
  closed = false;
  /** Follows the pointer. */
  next: Place | null = null;

  constructor(private readonly section: Section) {}

  clear(): void {
    [this.points, this.closed, this.next] = [[], false, null];
  }

  /** Adds a point, the short way around from the one before. `first`: the pointer is on the first point. */
  add(place: Place, first: boolean): void {
    if (this.closed) this.clear();
    if (first && this.points.length > 2) {
      this.closed = true;
      return;
    }
    this.points.push(this.near(place));
  }

  private near(place: Place): Place {
    const last = this.points.at(-1);
    return last ? { s_m: this.section.near(place.s_m, last.s_m), x_m: place.x_m } : { s_m: this.section.wrap(place.s_m), x_m: place.x_m };
  }

  get length_m(): number {
    const path = this.path();
    let sum = 0;
    for (let k = 1; k < path.length; k++) sum += Math.hypot(path[k]!.s_m - path[k - 1]!.s_m, path[k]!.x_m - path[k - 1]!.x_m);
    return sum;
  }

  /** By the shoelace formula; null as long as the line is open. */
  get area_m2(): number | null {
    if (!this.closed) return null;
    const path = this.path();
    // A line around the whole tunnel ends one turn further: it bounds no area.
    if (Math.abs(path.at(-1)!.s_m - path[0]!.s_m) > 1e-9) return null;
    let twice = 0;
    for (let k = 1; k < path.length; k++) twice += path[k - 1]!.s_m * path[k]!.x_m - path[k]!.s_m * path[k - 1]!.x_m;
    return Math.abs(twice) / 2;
  }

  private path(): Place[] {
    const [first, last] = [this.points[0], this.points.at(-1)];
    if (!this.closed || !first || !last) return this.points;
    return [...this.points, { s_m: this.section.near(first.s_m, last.s_m), x_m: first.x_m }];
  }

  draw(ink: Ink): void {
    const last = this.points.at(-1);
    const open = !this.closed && this.next && last ? [...this.points, this.near(this.next)] : this.path();
    ink.line(open, { colour: "rgba(0, 0, 0, 0.6)", width: 5 });
    ink.line(open, { colour: COLOUR, width: 2, ...(this.closed ? { fill: "rgba(255, 209, 102, 0.18)" } : {}) });
    for (const point of this.points) ink.dot(point, { colour: COLOUR });
    const path = this.path();
    for (let k = 1; k < path.length; k++) {
      const [a, b] = [path[k - 1]!, path[k]!];
      const middle = { s_m: (a.s_m + b.s_m) / 2, x_m: (a.x_m + b.x_m) / 2 };
      ink.label(middle, metres(Math.hypot(b.s_m - a.s_m, b.x_m - a.x_m)), COLOUR);
    }
  }

  /** What the readout says, as lines of text; the first is the result. */
  words(): string[] {
    if (this.points.length === 0) return ["Measure", "Click two points on the wall."];
    if (this.points.length === 1) return ["Measure", "Click the next point. Esc ends."];
    const [a, b] = [this.points.at(-2)!, this.points.at(-1)!];
    const steps = `last piece: ${metres(Math.abs(b.x_m - a.x_m))} along, ${metres(Math.abs(b.s_m - a.s_m))} around`;
    const how = "Along the wall (unrolled nominal section, arc length).";
    if (this.closed) {
      const area = this.area_m2;
      return [area === null ? "goes all the way around" : `${area.toFixed(4)} m²`, `border ${metres(this.length_m)}`, how];
    }
    const more = this.points.length > 2 ? ["Click the first point for the area."] : [];
    return [metres(this.length_m), steps, ...more, how];
  }
}
