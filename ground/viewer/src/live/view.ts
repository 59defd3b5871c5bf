// What the server sends: `ground/src/live/view.rs`, `web/update.rs`.

export interface Reading<T> {
  value: T | null;
  age_s: number | null;
  is_stale: boolean;
}

export interface Range {
  state: "valid" | "invalid" | "stale" | "unknown" | "unfitted";
  range_m: number | null;
}

export interface Gap {
  x_from_m: number;
  x_to_m: number;
}

export interface View {
  time_s: number;
  board_s: number | null;
  link: { status: "waiting" | "up" | "lost"; words: string; silent_s: number | null; rate_hz: number; lost: number | null };
  mode: Reading<string>;
  autopilot: Reading<{ name: string; mode: string | null; is_armed: boolean }>;
  offset_m: Reading<[number, number]>;
  sigma_m: [number, number] | null;
  roll_rad: Reading<number>;
  ranges: [Range, Range, Range, Range];
  odometer_m: Reading<number>;
  speed_mps: Reading<number>;
  limit_mps: Reading<number>;
  enforcement: Reading<"Idle" | "Requested" | "Enforced" | "Ineffective" | "NotPossible">;
  is_overspeed: boolean;
  shaft_rad: Reading<number>;
  captures: Reading<number>;
  confirmed: number | null;
  missed: Reading<number>;
  water_level_m: Reading<number>;
  battery: Reading<{ voltage_v: number | null; remaining: number | null }>;
  wall: { seen_m2: number; marked_m2: number } | null;
  gaps: Gap[];
  notices: { at_s: number; severity: number; from: string; text: string }[];
  warnings: { level: "note" | "warning" | "alarm"; text: string }[];
  record: { file: string; has_failed: boolean } | null;
  replay: { speed: number; is_over: boolean } | null;
}

export interface Update {
  view: View;
  /** The section once around, closed, `[y, z]`; absent if it is as before. */
  outline_m?: [number, number][];
  strip: { cell_m: number; columns: number; rows: number; stretches: [number, string][] };
}

/** A canvas in the screen's own pixels; its context draws in CSS pixels. */
export function sized(canvas: HTMLCanvasElement): { ink: CanvasRenderingContext2D; width: number; height: number } | null {
  const ratio = window.devicePixelRatio || 1;
  const { clientWidth: width, clientHeight: height } = canvas;
  const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (canvas.width !== columns || canvas.height !== rows) [canvas.width, canvas.height] = [columns, rows];
  const ink = canvas.getContext("2d");
  if (!ink || width === 0 || height === 0) return null;
  ink.setTransform(ratio, 0, 0, ratio, 0, 0);
  ink.clearRect(0, 0, width, height);
  return { ink, width, height };
}

export const COLOURS = { good: "#46d18c", warn: "#ffc233", bad: "#ff4d4d", begun: "#3d8bd9", text: "#eef3f6", quiet: "#8fa1ad", line: "#26323a" };
