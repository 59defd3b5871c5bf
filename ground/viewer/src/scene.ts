// What the server says about the reconstruction (ground/src/view/scene.rs). Metres; frames as in ARCHITECTURE.md.

export interface Grid {
  mm_per_px: number;
  width_px: number;
  height_px: number;
  x0_m: number;
  s0_m: number;
  perimeter_m: number;
}

export interface Layer {
  url: string;
  x_from_m: number;
  x_to_m: number;
}

export interface Photo {
  name: string;
  status: "adjusted" | "prior-only";
  centre_m: [number, number, number];
  sigma_mm: number;
  rms_px: number;
  matches: number;
  /** [s, x] around; s may leave [0, perimeter). */
  footprint: [number, number][];
}

export interface Scene {
  name: string;
  program: string;
  grid: Grid;
  tile_px: number;
  last_level: number;
  section: { s_m: number[]; y_m: number[]; z_m: number[] };
  coverage: (Layer & { colours: [number, number, number][] }) | null;
  relief: (Layer & { full_colour_mm: number | null }) | null;
  photos: Photo[];
  has_photos: boolean;
  notes: string[];
}

/** A place on the wall: arc length from the crown, clockwise looking forward; distance along the axis. */
export interface Place {
  s_m: number;
  x_m: number;
}
