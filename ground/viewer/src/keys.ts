// Keyboard, mouse and touch: who moves the eye, and what is clicked.

import type { Eye } from "./camera";
import type { Place } from "./scene";

/** More than a trembling hand. */
const DRAG_PX = 5;
const WHEEL_SHARE = 0.0014;
const TURN_RAD_PER_S = 1.2;

export interface Commands {
  /** The wall was clicked; `x`, `y` on the screen. */
  click(place: Place, x: number, y: number): void;
  doubleClick(place: Place): void;
  /** A box is being drawn; `done`: it is. Only asked where `marks()`. */
  box(from: Place, to: Place, done: boolean): void;
  hover(place: Place | null): void;
  /** Whether a drag draws a box. */
  marks(): boolean;
  key(key: string): boolean;
  changed(): void;
}

export class Hands {
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private readonly held = new Set<string>();
  private began: { x: number; y: number; place: Place | null; box: boolean } | null = null;
  private dragged = false;
  private pinch_px = 0;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly eye: Eye, private readonly commands: Commands) {
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.up(event, true));
    canvas.addEventListener("pointercancel", (event) => this.up(event, false));
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("dblclick", (event) => {
      const place = this.pick(event.offsetX, event.offsetY);
      if (place) commands.doubleClick(place);
    });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("keydown", (event) => this.keyDown(event));
    window.addEventListener("keyup", (event) => this.held.delete(event.code));
    window.addEventListener("blur", () => this.held.clear());
  }

  private pick(x: number, y: number): Place | null {
    return this.eye.pick(x, y, this.canvas.clientWidth, this.canvas.clientHeight);
  }

  private down(event: PointerEvent): void {
    this.canvas.focus();
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
    this.eye.stop();
    if (this.pointers.size > 1) {
      // The second finger pinches; what the first began is off.
      this.began = null;
      this.pinch_px = this.spread();
      return;
    }
    this.dragged = false;
    const place = this.pick(event.offsetX, event.offsetY);
    this.began = { x: event.offsetX, y: event.offsetY, place, box: this.commands.marks() && event.button === 0 && place !== null };
    if (!this.began.box) this.canvas.classList.add("looking");
  }

  private moved(event: PointerEvent): void {
    const last = this.pointers.get(event.pointerId);
    if (!last) {
      this.commands.hover(this.pick(event.offsetX, event.offsetY));
      return;
    }
    const [dx, dy] = [event.offsetX - last.x, event.offsetY - last.y];
    this.pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY });
    if (this.pointers.size > 1) return this.pinched();
    const { began } = this;
    if (!began) return;
    this.dragged ||= Math.hypot(event.offsetX - began.x, event.offsetY - began.y) > DRAG_PX;
    if (!this.dragged) return;
    if (began.box) {
      const to = this.pick(event.offsetX, event.offsetY);
      if (to && began.place) this.commands.box(began.place, to, false);
    } else {
      this.eye.drag(dx, dy, this.canvas.clientHeight);
    }
    this.commands.changed();
  }

  private up(event: PointerEvent, meant: boolean): void {
    const { began } = this;
    this.pointers.delete(event.pointerId);
    this.canvas.classList.remove("looking");
    this.began = null;
    if (!began?.place || !meant) return;
    if (began.box) this.commands.box(began.place, (this.dragged && this.pick(event.offsetX, event.offsetY)) || began.place, true);
    else if (!this.dragged && event.button === 0) this.commands.click(began.place, event.offsetX, event.offsetY);
  }

  private spread(): number {
    const [a, b] = [...this.pointers.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  }

  private pinched(): void {
    const [a, b] = [...this.pointers.values()];
    const spread = this.spread();
    if (!a || !b || this.pinch_px === 0 || spread === 0) return;
    this.zoom(1 - this.pinch_px / spread, (a.x + b.x) / 2, (a.y + b.y) / 2);
    this.pinch_px = spread;
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    // Lines of 16 pixels where the mouse counts in lines; a trackpad's pinch arrives with the control key.
    const px = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1) * (event.ctrlKey ? 4 : 1);
    this.zoom(1 - Math.exp(Math.min(Math.max(px, -400), 400) * WHEEL_SHARE), event.offsetX, event.offsetY);
  }

  private zoom(share: number, x: number, y: number): void {
    this.eye.stop();
    this.eye.zoom(share, x, y, this.canvas.clientWidth, this.canvas.clientHeight);
    this.commands.changed();
  }

  private keyDown(event: KeyboardEvent): void {
    const typing = event.target instanceof HTMLElement && event.target.matches("input:not([type=range]):not([type=checkbox]), select, textarea");
    if (typing || document.querySelector("dialog[open]") || event.ctrlKey || event.metaKey || event.altKey) return;
    if (MOVES.has(event.code)) {
      // A slider has its own use for the arrows.
      if (event.code.startsWith("Arrow") && event.target instanceof HTMLInputElement && event.target.type === "range") return;
      this.held.add(event.code);
      this.commands.changed();
      event.preventDefault();
    } else if (this.commands.key(event.key)) {
      event.preventDefault();
    }
  }

  /** Moves by the keys that are down; call it every frame. */
  walk(seconds: number, fast: boolean): boolean {
    if (this.held.size === 0) return false;
    const on = (...codes: string[]) => (codes.some((code) => this.held.has(code)) ? 1 : 0);
    const speed = (this.eye.flat ? this.eye.hover.height * 0.7 : 1.5) * (fast ? 4 : 1) * seconds;
    this.eye.stop();
    const turn = on("ArrowRight") - on("ArrowLeft");
    const right = on("KeyD") - on("KeyA") + (this.eye.flat ? turn : 0);
    if (!this.eye.flat) this.eye.turn(turn * TURN_RAD_PER_S * seconds, 0);
    this.eye.walk(right * speed, (on("KeyE") - on("KeyQ")) * speed, (on("KeyW", "ArrowUp") - on("KeyS", "ArrowDown")) * speed);
    return true;
  }

  get fast(): boolean {
    return this.held.has("ShiftLeft") || this.held.has("ShiftRight");
  }
}

const MOVES = new Set([
  "KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE", "ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "ShiftLeft", "ShiftRight",
]);
