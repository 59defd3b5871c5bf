// The page of `adit view`: what belongs together, and a frame when something has changed.

import * as THREE from "three";
import { Eye, FOV_DEG } from "./camera";
import { askJson, element, giveUp, picture, reason, tell } from "./dom";
import { Findings, clockText, drawBox } from "./findings";
import { Headset } from "./vr";
import { Ink } from "./ink";
import { Hands, type Commands } from "./keys";
import { TunnelMap, niceStep } from "./map";
import { Measure } from "./measure";
import { PhotoLayer } from "./photos";
import type { Layer, Place, Scene } from "./scene";
import { Section } from "./section";
import { Wall } from "./wall";

/** Longest side of a finding's picture. */
const SNAPSHOT_PX = 1280;
const SCALE_PX = 120;

type Mode = "look" | "measure" | "finding";

class Viewer implements Commands {
  private readonly canvas = element("view", HTMLCanvasElement);
  private readonly section: Section;
  private readonly wall: Wall;
  private readonly eye: Eye;
  private readonly ink: Ink;
  private readonly hands: Hands;
  private readonly measure: Measure;
  private readonly findings: Findings;
  private readonly photos: PhotoLayer;
  private readonly map: TunnelMap;
  private readonly headset: Headset;
  private readonly world = new THREE.Scene();
  private mode: Mode = "look";
  private drawn: [Place, Place] | null = null;
  private dirty = true;
  private last_ms = 0;

  constructor(private readonly scene: Scene, private readonly renderer: THREE.WebGLRenderer) {
    const { grid } = scene;
    this.section = new Section(scene.section);
    this.eye = new Eye(this.section, [grid.x0_m, grid.x0_m + (grid.height_px * grid.mm_per_px) / 1000]);
    this.wall = new Wall(scene, this.section, Math.min(8, renderer.capabilities.getMaxAnisotropy()));
    this.headset = new Headset(renderer, this.eye);
    this.world.add(this.wall.group, this.headset.rig);
    this.world.background = new THREE.Color(0x12161a);
    const inkCanvas = document.createElement("canvas");
    inkCanvas.id = "ink";
    this.canvas.after(inkCanvas);
    this.ink = new Ink(inkCanvas, this.section);
    this.measure = new Measure(this.section);
    this.findings = new Findings(this.section);
    this.photos = new PhotoLayer(scene, this.section);
    this.map = new TunnelMap(element("map", HTMLCanvasElement), grid);
    this.hands = new Hands(this.canvas, this.eye, this);
    this.wall.onChange = this.findings.onChange = this.photos.onChange = this.headset.onLeave = () => this.changed();
    this.findings.onVisit = this.map.onVisit = (place) => this.visit(place);
    this.eye.onUnroll = () => {
      this.wall.rolled();
      element("unroll", HTMLInputElement).value = String(this.eye.share);
    };
    this.buttons();
    this.layers();
    this.resize();
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      giveUp("The graphics card gave up. Reload the page.");
    });
    renderer.setAnimationLoop((now) => this.frame(now));
  }

  async start(): Promise<void> {
    await this.findings.load();
    const { coverage } = this.scene;
    if (!coverage) return;
    try {
      this.map.layer(await picture(`files/${coverage.url}`, 4096), coverage);
      this.changed();
    } catch (error) {
      tell("coverage", `Coverage cannot be shown: ${reason(error)}`);
    }
  }

  // What happens on the wall.

  click(place: Place, x: number, y: number): void {
    if (this.mode === "measure") {
      const first = this.measure.points[0];
      const at = first && this.ink.at(first);
      this.measure.add(place, !!at && Math.hypot(at[0] - x, at[1] - y) < 12);
      this.readout();
    } else if (this.photos.shown) {
      this.photos.select(place);
    } else if (this.findings.shown) {
      const finding = this.findings.at(place);
      if (finding) this.findings.edit(finding);
    }
    this.changed();
  }

  doubleClick(place: Place): void {
    if (this.mode === "look") this.eye.goTo(place, performance.now(), true);
    this.changed();
  }

  box(from: Place, to: Place, done: boolean): void {
    const end = { s_m: this.section.near(to.s_m, from.s_m), x_m: to.x_m };
    this.drawn = [from, end];
    if (done) {
      this.frame(performance.now(), true);
      const snapshot = this.snapshot();
      this.drawn = null;
      this.setMode("look");
      this.findings.create(from, end, snapshot);
    }
    this.changed();
  }

  hover(place: Place | null): void {
    if (this.mode === "measure" && this.measure.points.length > 0 && !this.measure.closed) {
      this.measure.next = place;
      this.changed();
    }
  }

  marks(): boolean {
    return this.mode === "finding";
  }

  changed(): void {
    this.dirty = true;
  }

  key(key: string): boolean {
    switch (key.toLowerCase()) {
      case "u": this.eye.toggle(performance.now()); break;
      case "m": this.setMode(this.mode === "measure" ? "look" : "measure"); break;
      case "f": this.setMode(this.mode === "finding" ? "look" : "finding"); break;
      case "g": this.openGoTo(); break;
      case "l": this.togglePanel(); break;
      case "h": this.eye.home(); this.eye.apply(); break;
      case "?": element("help-dialog", HTMLDialogElement).showModal(); break;
      case "escape": this.setMode("look"); break;
      default: return false;
    }
    this.changed();
    return true;
  }

  private visit(place: Place): void {
    this.eye.goTo(place, performance.now());
    this.changed();
  }

  private setMode(mode: Mode): void {
    this.mode = mode;
    this.drawn = null;
    if (mode !== "measure") this.measure.clear();
    this.canvas.classList.toggle("marking", mode !== "look");
    element("measure-button", HTMLButtonElement).classList.toggle("on", mode === "measure");
    element("finding-button", HTMLButtonElement).classList.toggle("on", mode === "finding");
    this.readout();
    this.changed();
  }

  private readout(): void {
    const readout = element("readout", HTMLDivElement);
    readout.hidden = this.mode === "look";
    if (readout.hidden) return;
    const [result, ...more] = this.mode === "measure" ? this.measure.words() : ["Mark a finding", "Drag a box on the wall, or click a point. Esc leaves."];
    const head = document.createElement("b");
    head.textContent = result!;
    const lines = more.map((text) => {
      const line = document.createElement("p");
      line.className = "quiet";
      line.textContent = text;
      return line;
    });
    readout.replaceChildren(head, ...lines);
  }

  // Buttons and layers.

  private buttons(): void {
    const on = (id: string, work: () => void) => element(id, HTMLButtonElement).addEventListener("click", () => (work(), this.changed()));
    on("measure-button", () => this.key("m"));
    on("finding-button", () => this.key("f"));
    on("goto-button", () => this.openGoTo());
    on("panel-button", () => this.togglePanel());
    on("help-button", () => element("help-dialog", HTMLDialogElement).showModal());
    element("unroll", HTMLInputElement).addEventListener("input", (event) => {
      this.eye.stop();
      this.eye.setShare((event.target as HTMLInputElement).valueAsNumber);
      this.changed();
    });
    for (const cancel of document.querySelectorAll("button.cancel")) cancel.addEventListener("click", () => cancel.closest("dialog")?.close());
    const dialog = element("goto-dialog", HTMLDialogElement);
    dialog.addEventListener("close", () => {
      if (dialog.returnValue !== "go") return;
      const [x_m, clock] = [element("goto-x", HTMLInputElement).valueAsNumber, element("goto-clock", HTMLInputElement).valueAsNumber];
      this.visit({ s_m: this.section.sAtClock(clock), x_m });
    });
    element("name", HTMLElement).textContent = this.scene.name;
    document.title = `${this.scene.name} – Adit`;
    // Open at first where there is room beside it.
    if (window.innerWidth >= 900) this.togglePanel();
  }

  private togglePanel(): void {
    const open = !element("panel", HTMLElement).classList.toggle("closed");
    element("panel-button", HTMLButtonElement).classList.toggle("on", open);
    this.eye.covered = open ? Math.min(280 / this.canvas.clientWidth, 0.4) : 0;
  }

  private openGoTo(): void {
    const at = this.centre();
    const dialog = element("goto-dialog", HTMLDialogElement);
    dialog.returnValue = "";
    element("goto-x", HTMLInputElement).value = (at?.x_m ?? 0).toFixed(2);
    element("goto-clock", HTMLInputElement).value = String(Number((at ? this.section.clock(at.s_m) : 0).toFixed(2)));
    dialog.showModal();
    element("goto-x", HTMLInputElement).select();
  }

  private layers(): void {
    const { scene } = this;
    this.overlay("coverage", scene.coverage);
    this.overlay("relief", scene.relief);
    if (scene.coverage) {
      const names = ["no photo", "1", "2", "3", "4 or more"];
      legend("coverage", scene.coverage.colours.map((rgb, at) => [`rgb(${rgb.join()})`, names[at] ?? ""]));
    }
    if (scene.relief) {
      const full = scene.relief.full_colour_mm;
      const words = (sign: string) => (full === null ? "" : ` ${sign}${full.toFixed(0)} mm`);
      legend("relief", [["#2166ac", `lies back${words("−")}`], ["#f7f7f7", "0"], ["#b2182b", `stands out${words("+")}`]]);
    }
    const check = (id: string, work: (on: boolean) => void) =>
      element(id, HTMLInputElement).addEventListener("change", (event) => {
        work((event.target as HTMLInputElement).checked);
        this.changed();
      });
    check("layer-photos", (on) => this.photos.show(on));
    check("layer-findings", (on) => (this.findings.shown = on));
    check("layer-grid", (on) => this.wall.setGrid(on));
    element("brightness", HTMLInputElement).addEventListener("input", (event) => {
      this.wall.setBrightness((event.target as HTMLInputElement).valueAsNumber);
      this.changed();
    });
    element("photo-count", HTMLElement).textContent = scene.photos.length > 0 ? String(scene.photos.length) : "none";
    scene.notes.forEach((note, at) => tell(`note${at}`, note, "note"));
  }

  private overlay(which: "coverage" | "relief", layer: Layer | null): void {
    const [box, slider] = [element(`layer-${which}`, HTMLInputElement), element(`opacity-${which}`, HTMLInputElement)];
    if (!layer) {
      box.disabled = slider.disabled = true;
      box.parentElement!.classList.add("off");
      box.parentElement!.title = which === "relief" ? "This reconstruction has no relief.png" : "This reconstruction has no coverage";
      return;
    }
    const update = async () => {
      element(`legend-${which}`, HTMLDivElement).hidden = !box.checked;
      try {
        await this.wall.overlay(which, layer, box.checked ? slider.valueAsNumber : 0);
      } catch (error) {
        box.checked = false;
        tell(which, `${which === "relief" ? "Relief" : "Coverage"} cannot be shown: ${reason(error)}`);
      }
      this.changed();
    };
    box.addEventListener("change", () => void update());
    slider.addEventListener("input", () => void update());
  }

  // Drawing.

  private resize(): void {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.eye.camera.aspect = width / height;
    this.eye.apply();
    this.changed();
  }

  private frame(now_ms: number, at_once = false): void {
    const seconds = Math.min((now_ms - this.last_ms) / 1000, 0.1);
    this.last_ms = now_ms;
    if (this.headset.worn) {
      this.headset.move(seconds);
      const position = this.renderer.xr.getCamera().getWorldPosition(new THREE.Vector3());
      this.wall.update({ position, frustum: null, px_per_rad: 1100 });
      this.renderer.render(this.world, this.eye.camera);
      return;
    }
    const moved = this.hands.walk(seconds, this.hands.fast);
    const glided = this.eye.move(now_ms);
    if (!moved && !glided && !this.dirty && !at_once) return;
    this.dirty = false;
    const { camera } = this.eye;
    const frustum = new THREE.Frustum().setFromProjectionMatrix(
      new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    this.wall.update({ position: camera.position, frustum, px_per_rad: this.pxPerRad(this.renderer.domElement.height) });
    this.renderer.render(this.world, camera);
    this.drawInk();
    this.status();
  }

  private pxPerRad(height_px: number): number {
    return height_px / (2 * Math.tan((FOV_DEG * Math.PI) / 360));
  }

  private drawInk(): void {
    this.ink.begin(this.eye.camera, this.canvas.clientWidth, this.canvas.clientHeight, this.renderer.getPixelRatio());
    this.photos.draw(this.ink, this.eyeX());
    this.findings.draw(this.ink);
    if (this.drawn) drawBox(this.ink, ...this.drawn, "#5fb3c9");
    this.measure.draw(this.ink);
  }

  private eyeX(): number {
    return -this.eye.camera.position.z;
  }

  private centre() {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    return this.eye.pick(width / 2, height / 2, width, height);
  }

  private status(): void {
    const at = this.centre();
    const { grid } = this.scene;
    const distance = at?.distance ?? 0;
    const loading = this.wall.pending > 0 ? " · loading…" : "";
    const m_per_px = distance / this.pxPerRad(this.canvas.clientHeight);
    element("place", HTMLElement).textContent = at
      ? `${at.x_m.toFixed(2)} m · ${clockText(this.section.clock(at.s_m))} o’clock · ${((m_per_px * 1000) / this.renderer.getPixelRatio()).toFixed(2)} mm/px${loading}`
      : "";
    const length = niceStep((m_per_px * SCALE_PX) / 1.6);
    const shown = at !== null && m_per_px > 0 && Number.isFinite(length);
    element("scale", HTMLDivElement).hidden = !shown;
    if (shown) {
      element("scale-bar", HTMLDivElement).style.width = `${length / m_per_px}px`;
      element("scale-text", HTMLElement).textContent = this.eye.share === 1 ? scaleText(length) : `${scaleText(length)} at the wall in the centre`;
    }
    const root = this.wall.rootPicture;
    if (root && !this.map.background) {
      const full = 2 ** (this.scene.last_level - Math.min(8, this.scene.last_level));
      this.map.background = { image: root, x_from_m: grid.x0_m, x_to_m: grid.x0_m + (root.height * full * grid.mm_per_px) / 1000 };
    }
    this.map.draw(at && { s_m: at.s_m, x_m: at.x_m }, this.eyeX(), this.findings.marks());
    this.canvas.dataset.pending = String(this.wall.pending);
    this.canvas.dataset.finest = String(this.wall.finest);
    this.canvas.dataset.layers = this.wall.layers().join(" ");
  }

  /** The view with what is drawn on it, as a JPEG's data URL. */
  private snapshot(): string {
    const [width, height] = [this.canvas.width, this.canvas.height];
    const factor = Math.min(1, SNAPSHOT_PX / Math.max(width, height));
    const copy = document.createElement("canvas");
    copy.width = Math.round(width * factor);
    copy.height = Math.round(height * factor);
    const context = copy.getContext("2d")!;
    for (const layer of [this.canvas, this.ink.canvas]) context.drawImage(layer, 0, 0, copy.width, copy.height);
    return copy.toDataURL("image/jpeg", 0.85);
  }
}

const scaleText = (length_m: number) => (length_m < 0.9 ? `${Number((length_m * 1000).toPrecision(1))} mm` : `${Number(length_m.toPrecision(1))} m`);

function legend(which: string, entries: [string, string][]): void {
  const items = entries.map(([colour, text]) => {
    const item = document.createElement("span");
    const patch = document.createElement("i");
    patch.style.background = colour;
    item.append(patch, text);
    return item;
  });
  element(`legend-${which}`, HTMLDivElement).replaceChildren(...items);
}

function renderer(): THREE.WebGLRenderer | null {
  try {
    return new THREE.WebGLRenderer({ canvas: element("view", HTMLCanvasElement), antialias: true, powerPreference: "high-performance" });
  } catch {
    return null;
  }
}

async function main(): Promise<void> {
  let scene: Scene;
  try {
    scene = await askJson<Scene>("api/scene");
  } catch (error) {
    giveUp(`The survey cannot be shown: ${reason(error)}`);
    return;
  }
  const drawing = renderer();
  if (!drawing) {
    giveUp("This browser has no WebGL 2 (or it is switched off, or the graphics driver is blocked), so the tunnel cannot be drawn.");
    const links = element("cover-links", HTMLParagraphElement);
    const link = document.createElement("a");
    link.href = "files/panorama/panorama.png";
    link.textContent = "The panorama as a picture";
    links.replaceChildren(link);
    links.hidden = false;
    return;
  }
  try {
    const viewer = new Viewer(scene, drawing);
    element("cover", HTMLDivElement).hidden = true;
    await viewer.start();
  } catch (error) {
    giveUp(`The viewer failed: ${reason(error)}`);
  }
}

void main();
