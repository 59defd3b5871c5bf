// The wall, streamed: a quadtree of the panorama's deep-zoom tiles, refined where a texel would cover more than a pixel.
//
// What is needed and not there yet is shown with the nearest coarser tile that is. Tiles are loaded coarse ones and large
// errors first, at most LOADS at a time; at most CACHE of them stay in memory. If a view needs more, it gets coarser ones.

import * as THREE from "three";
import { picture, reason, tell } from "./dom";
import type { Layer, Scene } from "./scene";
import type { Section } from "./section";

/** A texel may cover so many pixels of the screen. */
const TEXEL_PX = 1.15;
/** Tiles in the graphics card's memory: 350 KB each with mipmaps. */
const CACHE = 420;
const LOADS = 6;
/** Overlays are reduced to what every WebGL 2 takes. */
const LARGEST_OVERLAY_PX = 4096;

const VERTEX = /* glsl */ `
  uniform sampler2D section;
  uniform vec4 uvOf;
  uniform vec3 wallOf;
  attribute float around;
  attribute vec2 pixel;
  varying vec2 vUv;
  varying vec2 vWall;
  void main() {
    float k = min(floor(around), float(textureSize(section, 0).x - 2));
    vec2 a = texelFetch(section, ivec2(int(k), 0), 0).xy;
    vec2 b = texelFetch(section, ivec2(int(k) + 1, 0), 0).xy;
    vec2 p = mix(a, b, around - k);
    vUv = pixel * uvOf.xy + uvOf.zw;
    vWall = pixel * wallOf.z + wallOf.xy;
    gl_Position = projectionMatrix * modelViewMatrix * vec4(p, -pixel.y * wallOf.z, 1.0);
  }`;

const FRAGMENT = /* glsl */ `
  uniform sampler2D map;
  uniform sampler2D coverage;
  uniform sampler2D relief;
  uniform vec3 coverageOf;
  uniform vec3 reliefOf;
  uniform float perimeter;
  uniform float brightness;
  uniform float grid;
  varying vec2 vUv;
  varying vec2 vWall;
  vec3 over(vec3 below, sampler2D layer, vec3 of) {
    vec2 at = vec2(vWall.x / perimeter, (vWall.y - of.x) / (of.y - of.x));
    vec4 colour = texture2D(layer, at);
    float inside = step(0.0, at.y) * step(at.y, 1.0);
    return mix(below, colour.rgb, colour.a * of.z * inside);
  }
  void main() {
    vec4 texel = texture2D(map, vUv);
    // Nothing was seen here: a quiet hatch of 10 cm.
    float hatch = step(0.5, fract((vWall.x + vWall.y) * 10.0));
    vec3 unseen = mix(vec3(0.085, 0.10, 0.115), vec3(0.12, 0.14, 0.16), hatch);
    vec3 colour = mix(unseen, min(texel.rgb * brightness, 1.0), texel.a);
    if (coverageOf.z > 0.0) colour = over(colour, coverage, coverageOf);
    if (reliefOf.z > 0.0) colour = over(colour, relief, reliefOf);
    if (grid > 0.0) {
      vec2 off = abs(fract(vWall + 0.5) - 0.5) / max(fwidth(vWall), 1e-6);
      colour = mix(colour, vec3(0.55, 0.85, 0.95), grid * (1.0 - smoothstep(0.6, 1.6, min(off.x, off.y))));
    }
    gl_FragColor = vec4(colour, 1.0);
  }`;

interface Tile {
  level: number;
  column: number;
  row: number;
  /** Box in full-size pixels. */
  left: number;
  top: number;
  right: number;
  bottom: number;
  parent: Tile | null;
  children: Tile[] | null;
  state: "absent" | "loading" | "ready" | "broken";
  texture: THREE.Texture | null;
  mesh: THREE.Mesh<THREE.BufferGeometry, THREE.ShaderMaterial> | null;
  used: number;
  error_px: number;
}

export interface Eye {
  position: THREE.Vector3;
  /** Null: everything around, for headsets. */
  frustum: THREE.Frustum | null;
  /** Pixels of the screen per radian in its centre. */
  px_per_rad: number;
}

export class Wall {
  readonly group = new THREE.Group();
  /** Called when something has arrived that should be drawn. */
  onChange: () => void = () => {};
  /** For the status line and for tests. */
  pending = 0;
  finest = 0;
  rootPicture: ImageBitmap | null = null;
  private readonly root: Tile;
  private readonly sectionTexture: THREE.DataTexture;
  private readonly shared: Record<string, THREE.IUniform>;
  private readonly nothing: THREE.DataTexture;
  private readonly box = new THREE.Box3();
  private readonly ready = new Set<Tile>();
  private readonly meshes = new Set<Tile>();
  private wanted: Tile[] = [];
  private loading = 0;
  private frame = 0;
  private coarser = 1;
  private broken = 0;

  constructor(private readonly scene: Scene, private readonly section: Section, private readonly anisotropy: number) {
    const data = new Float32Array(4 * section.count);
    this.sectionTexture = new THREE.DataTexture(data, section.count, 1, THREE.RGBAFormat, THREE.FloatType);
    this.nothing = new THREE.DataTexture(new Uint8Array(4), 1, 1);
    this.nothing.needsUpdate = true;
    this.shared = {
      section: { value: this.sectionTexture },
      coverage: { value: this.nothing },
      relief: { value: this.nothing },
      coverageOf: { value: new THREE.Vector3(0, 1, 0) },
      reliefOf: { value: new THREE.Vector3(0, 1, 0) },
      perimeter: { value: section.perimeter_m },
      brightness: { value: 1 },
      grid: { value: 0 },
    };
    this.root = this.tile(Math.min(8, scene.last_level), 0, 0, null);
    this.rolled();
  }

  /** To be called when the section has been unrolled by another amount. */
  rolled(): void {
    const data = this.sectionTexture.image.data as Float32Array;
    for (let k = 0; k < this.section.count; k++) data.set([this.section.points[2 * k]!, this.section.points[2 * k + 1]!], 4 * k);
    this.sectionTexture.needsUpdate = true;
  }

  setBrightness(brightness: number): void {
    this.shared.brightness!.value = brightness;
  }

  setGrid(shown: boolean): void {
    this.shared.grid!.value = shown ? 0.5 : 0;
  }

  /** Shows a picture over the wall; an opacity of zero hides it. Throws if the picture cannot be had. */
  async overlay(which: "coverage" | "relief", layer: Layer, opacity: number): Promise<ImageBitmap | null> {
    const of = this.shared[`${which}Of`]!.value as THREE.Vector3;
    of.set(layer.x_from_m, layer.x_to_m, opacity);
    if (opacity === 0 || this.shared[which]!.value !== this.nothing) return null;
    const bitmap = await picture(`files/${layer.url}`, LARGEST_OVERLAY_PX);
    const texture = new THREE.Texture(bitmap);
    texture.flipY = false;
    texture.wrapS = THREE.RepeatWrapping;
    texture.generateMipmaps = false;
    texture.minFilter = THREE.LinearFilter;
    texture.magFilter = which === "coverage" ? THREE.NearestFilter : THREE.LinearFilter;
    texture.needsUpdate = true;
    this.shared[which]!.value = texture;
    return bitmap;
  }

  /** The overlays that have arrived and are shown. */
  layers(): string[] {
    const shown = (which: string) => this.shared[which]!.value !== this.nothing && (this.shared[`${which}Of`]!.value as THREE.Vector3).z > 0;
    return ["coverage", "relief"].filter(shown);
  }

  /** Chooses the tiles for a view, shows them as well as they are there, and asks for the rest. */
  update(eye: Eye): void {
    this.frame++;
    let chosen: Tile[] = [];
    // A few rounds find a coarseness at which the view fits; it relaxes again once there is room.
    for (let round = 0; round < 12; round++) {
      chosen = [];
      this.choose(this.root, eye, chosen);
      if (chosen.length <= CACHE * 0.7) break;
      this.coarser *= 1.25;
    }
    if (chosen.length < CACHE * 0.4) this.coarser = Math.max(1, this.coarser / 1.25);
    for (const tile of this.meshes) tile.mesh!.visible = false;
    this.finest = 0;
    this.wanted = [];
    for (const tile of chosen) {
      this.show(tile);
      for (let at: Tile | null = tile; at; at = at.parent) {
        // Every second level up is enough of a stand-in, and the root always.
        if (at !== tile && at.parent && (tile.level - at.level) % 2 === 1) continue;
        at.used = this.frame;
        if (at.state === "absent" && !this.wanted.includes(at)) this.wanted.push(at);
      }
    }
    this.wanted.sort((a, b) => a.level - b.level || b.error_px - a.error_px);
    this.pending = this.wanted.length + this.loading;
    this.evict();
    this.load();
  }

  private choose(tile: Tile, eye: Eye, chosen: Tile[]): void {
    const box = this.bounds(tile);
    if (eye.frustum && !eye.frustum.intersectsBox(box)) return;
    const texel_m = (this.scene.grid.mm_per_px / 1000) * 2 ** (this.scene.last_level - tile.level);
    tile.error_px = (texel_m * eye.px_per_rad) / Math.max(box.distanceToPoint(eye.position), 1e-6);
    const children = tile.error_px > TEXEL_PX * this.coarser ? this.childrenOf(tile) : [];
    if (children.length === 0) chosen.push(tile);
    for (const child of children) this.choose(child, eye, chosen);
  }

  private tile(level: number, column: number, row: number, parent: Tile | null): Tile {
    const { grid, tile_px, last_level } = this.scene;
    const side = tile_px * 2 ** (last_level - level);
    const [left, top] = [column * side, row * side];
    const [right, bottom] = [Math.min(left + side, grid.width_px), Math.min(top + side, grid.height_px)];
    return { level, column, row, left, top, right, bottom, parent, children: null, state: "absent", texture: null, mesh: null, used: 0, error_px: 0 };
  }

  private childrenOf(tile: Tile): Tile[] {
    if (tile.children) return tile.children;
    tile.children = [];
    if (tile.level === this.scene.last_level) return tile.children;
    for (const [right, down] of [[0, 0], [1, 0], [0, 1], [1, 1]] as const) {
      const child = this.tile(tile.level + 1, 2 * tile.column + right, 2 * tile.row + down, tile);
      if (child.left < child.right && child.top < child.bottom) tile.children.push(child);
    }
    return tile.children;
  }

  private s(column_px: number): number {
    const texel_m = this.scene.grid.mm_per_px / 1000;
    return Math.min(Math.max(this.scene.grid.s0_m + column_px * texel_m, 0), this.section.perimeter_m);
  }

  private x(row_px: number): number {
    return this.scene.grid.x0_m + (row_px * this.scene.grid.mm_per_px) / 1000;
  }

  private bounds(tile: Tile): THREE.Box3 {
    const { section, box } = this;
    box.makeEmpty();
    box.min.z = -this.x(tile.bottom);
    box.max.z = -this.x(tile.top);
    const widen = (x: number, y: number) => {
      box.min.x = Math.min(box.min.x, x);
      box.max.x = Math.max(box.max.x, x);
      box.min.y = Math.min(box.min.y, y);
      box.max.y = Math.max(box.max.y, y);
    };
    const [from, to] = [this.s(tile.left), this.s(tile.right)];
    widen(...section.point(from));
    widen(...section.point(to));
    for (let k = Math.ceil(section.index(from)); k <= section.index(to); k++) widen(section.points[2 * k]!, section.points[2 * k + 1]!);
    return box;
  }

  private show(tile: Tile): void {
    tile.mesh ??= this.mesh(tile);
    this.meshes.add(tile);
    let source: Tile | null = tile;
    while (source && source.state !== "ready") source = source.parent;
    const uniforms = tile.mesh.material.uniforms;
    const texture = source?.texture ?? this.nothing;
    if (source?.texture) {
      const factor = 2 ** (this.scene.last_level - source.level);
      const { width, height } = source.texture.image as ImageBitmap;
      const offset = (edge: number, place: number, size: number) => (edge / factor - place * this.scene.tile_px) / size;
      (uniforms.uvOf!.value as THREE.Vector4).set(
        1 / (factor * width), 1 / (factor * height), offset(tile.left, source.column, width), offset(tile.top, source.row, height));
      this.finest = Math.max(this.finest, source.level);
    }
    uniforms.map!.value = texture;
    tile.mesh.visible = true;
  }

  /** Columns at the polyline's vertices and at the tile's edges, so that neighbours of any size meet without a crack. */
  private mesh(tile: Tile) {
    const { section, scene } = this;
    const texel_m = scene.grid.mm_per_px / 1000;
    const [from, to] = [section.index(this.s(tile.left)), section.index(this.s(tile.right))];
    const columns: [number, number][] = [[from, 0]];
    for (let k = Math.floor(from) + 1; k < to; k++) columns.push([k, (section.s_m[k]! - scene.grid.s0_m) / texel_m - tile.left]);
    columns.push([to, tile.right - tile.left]);
    const geometry = new THREE.BufferGeometry();
    const index: number[] = [];
    const pixel: number[] = [];
    const triangles: number[] = [];
    columns.forEach(([k, u], at) => {
      index.push(k, k);
      pixel.push(u, 0, u, tile.bottom - tile.top);
      if (at > 0) triangles.push(2 * at - 2, 2 * at - 1, 2 * at, 2 * at, 2 * at - 1, 2 * at + 1);
    });
    geometry.setAttribute("around", new THREE.Float32BufferAttribute(index, 1));
    geometry.setAttribute("pixel", new THREE.Float32BufferAttribute(pixel, 2));
    geometry.setIndex(triangles);
    const material = new THREE.ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      side: THREE.DoubleSide,
      uniforms: {
        ...this.shared,
        map: { value: this.nothing },
        uvOf: { value: new THREE.Vector4() },
        wallOf: { value: new THREE.Vector3(this.s(tile.left), this.x(tile.top), texel_m) },
      },
    });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    // Heights count from the tile's edge, so that single precision holds a kilometre.
    mesh.position.z = -this.x(tile.top);
    this.group.add(mesh);
    return mesh;
  }

  private load(): void {
    while (this.loading < LOADS) {
      const tile = this.wanted.shift();
      if (!tile) return;
      tile.state = "loading";
      this.loading++;
      void this.fetch(tile);
    }
  }

  private async fetch(tile: Tile): Promise<void> {
    const name = `${tile.level}/${tile.column}_${tile.row}.png`;
    try {
      const bitmap = await picture(`files/panorama/tiles/panorama_files/${name}`);
      const texture = new THREE.Texture(bitmap);
      texture.flipY = false;
      texture.anisotropy = this.anisotropy;
      texture.minFilter = THREE.LinearMipmapLinearFilter;
      texture.needsUpdate = true;
      tile.texture = texture;
      tile.state = "ready";
      this.ready.add(tile);
      if (tile === this.root) this.rootPicture = bitmap;
    } catch (error) {
      tile.state = "broken";
      this.broken++;
      const more = this.broken > 1 ? ` (and ${this.broken - 1} more)` : "";
      tell("tiles", `Tile ${name} cannot be shown${more}: ${reason(error)}. The wall there is shown coarser or hatched.`);
    }
    this.loading--;
    this.pending = this.wanted.length + this.loading;
    this.onChange();
    this.load();
  }

  /** Frees what has not been used for longest; never what this frame uses. */
  private evict(): void {
    const free = (tile: Tile) => {
      if (tile.mesh) {
        tile.mesh.geometry.dispose();
        tile.mesh.material.dispose();
        this.group.remove(tile.mesh);
        tile.mesh = null;
        this.meshes.delete(tile);
      }
    };
    for (const tile of [...this.meshes]) if (!tile.mesh!.visible && this.meshes.size > CACHE) free(tile);
    if (this.ready.size <= CACHE) return;
    const old = [...this.ready].filter((tile) => tile.used < this.frame && tile !== this.root).sort((a, b) => a.used - b.used);
    for (const tile of old.slice(0, this.ready.size - CACHE)) {
      (tile.texture!.image as ImageBitmap).close();
      tile.texture!.dispose();
      tile.texture = null;
      tile.state = "absent";
      this.ready.delete(tile);
    }
  }
}
