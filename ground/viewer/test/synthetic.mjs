// A reconstruction's folder, written from the description of the formats alone: a pipe of 2 m, 8 m long, with coloured dots at
// known places.

import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { encode } from "./png.mjs";

const RADIUS_M = 1;
export const PERIMETER_M = 2 * Math.PI * RADIUS_M;
const WIDTH_PX = 1571;
const TEXEL_M = PERIMETER_M / WIDTH_PX;
const HEIGHT_PX = 2000;
const TILE_PX = 256;
export const LAST_LEVEL = 11;
const DOT_M = 0.05;

/** Arc length from the crown and distance along the axis. */
export const DOTS = {
  red: { s_m: PERIMETER_M / 2 - 0.5, x_m: 3.0, rgb: [230, 20, 20] },
  green: { s_m: PERIMETER_M / 2 + 0.5, x_m: 3.0, rgb: [20, 210, 20] },
  blue: { s_m: PERIMETER_M / 2 - 0.5, x_m: 3.8, rgb: [20, 20, 240] },
};

function wall() {
  const data = new Uint8Array(WIDTH_PX * HEIGHT_PX * 4);
  for (let v = 0; v < HEIGHT_PX; v++) {
    for (let u = 0; u < WIDTH_PX; u++) {
      const at = (v * WIDTH_PX + u) * 4;
      const grey = 110 + ((u >> 4) + (v >> 4)) % 2 * 20 + ((u * 7 + v * 13) % 11);
      data.set([grey, grey - 6, grey - 14, 255], at);
    }
  }
  for (const { s_m, x_m, rgb } of Object.values(DOTS)) {
    const [u0, v0, reach] = [s_m / TEXEL_M, x_m / TEXEL_M, Math.ceil(DOT_M / TEXEL_M) + 1];
    for (let v = Math.floor(v0 - reach); v <= v0 + reach; v++) {
      for (let u = Math.floor(u0 - reach); u <= u0 + reach; u++) {
        if (Math.hypot(u + 0.5 - u0, v + 0.5 - v0) * TEXEL_M <= DOT_M) data.set(rgb, (v * WIDTH_PX + u) * 4);
      }
    }
  }
  return { width: WIDTH_PX, height: HEIGHT_PX, data };
}

function halved({ width, height, data }) {
  const half = { width: Math.ceil(width / 2), height: Math.ceil(height / 2) };
  half.data = new Uint8Array(half.width * half.height * 4);
  for (let y = 0; y < half.height; y++) {
    for (let x = 0; x < half.width; x++) {
      const [x1, y1] = [Math.min(2 * x + 1, width - 1), Math.min(2 * y + 1, height - 1)];
      for (let c = 0; c < 4; c++) {
        const of = (column, row) => data[(row * width + column) * 4 + c];
        half.data[(y * half.width + x) * 4 + c] = (of(2 * x, 2 * y) + of(x1, 2 * y) + of(2 * x, y1) + of(x1, y1) + 2) >> 2;
      }
    }
  }
  return half;
}

function writeTiles(folder, image) {
  mkdirSync(folder, { recursive: true });
  for (let top = 0; top < image.height; top += TILE_PX) {
    for (let left = 0; left < image.width; left += TILE_PX) {
      const [width, height] = [Math.min(TILE_PX, image.width - left), Math.min(TILE_PX, image.height - top)];
      const data = new Uint8Array(width * height * 4);
      for (let y = 0; y < height; y++) data.set(image.data.subarray(((top + y) * image.width + left) * 4, ((top + y) * image.width + left + width) * 4), y * width * 4);
      writeFileSync(join(folder, `${left / TILE_PX}_${top / TILE_PX}.png`), encode({ width, height, data }));
    }
  }
}

/** Writes the folder. */
export function writeReconstruction(out) {
  const tiles = join(out, "panorama/tiles/panorama_files");
  let image = wall();
  for (let level = LAST_LEVEL; level >= 0; level--) {
    writeTiles(join(tiles, String(level)), image);
    image = halved(image);
  }
  const grid = { format: 1, mm_per_px: TEXEL_M * 1000, width_px: WIDTH_PX, height_px: HEIGHT_PX, x0_m: 0, s0_m: 0, perimeter_m: PERIMETER_M };
  writeFileSync(join(out, "panorama/panorama.json"), JSON.stringify({ ...grid, profile: { profile: "circle", radius_m: RADIUS_M } }));
  mkdirSync(join(out, "colmap"));
  writeFileSync(join(out, "colmap/cameras.txt"), "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 OPENCV 800 600 400 400 400 300 0 0 0 0\n");
  // Looks to the floor: cam z = tunnel z, cam y = -tunnel x (image up forward), cam x = tunnel y; a turn of 90 degrees about z.
  const q = Math.SQRT1_2;
  writeFileSync(join(out, "poses.csv"), `photo,qw,qx,qy,qz,x_m,y_m,z_m\nFLOOR.JPG,${q},0,0,${q},3,0,0\n`);
  const cells = { width: 40, height: Math.ceil((HEIGHT_PX * TEXEL_M * 40) / PERIMETER_M) };
  cells.data = new Uint8Array(cells.width * cells.height * 4).fill(255);
  writeFileSync(join(out, "coverage.png"), encode(cells));
  // Green from 5 to 6 m, on a lattice that begins a metre before the panorama.
  const relief = { width: 60, height: 90, data: new Uint8Array(60 * 90 * 4) };
  for (let row = 60; row < 70; row++) for (let column = 0; column < 60; column++) relief.data.set([20, 230, 20, 255], (row * 60 + column) * 4);
  writeFileSync(join(out, "relief.png"), encode(relief));
  mkdirSync(join(out, "surface"));
  writeFileSync(join(out, "surface/surface.json"), JSON.stringify({ lattice: { x0_m: -1, step_x_m: 0.1, rows: 90 } }));
  writeFileSync(join(out, "coverage.json"), JSON.stringify({ format: 1, cell_m: PERIMETER_M / 40, x0_m: 0, holes: [] }));
}
