// Where the photos lie on the wall, and which of them show a place.

import { element } from "./dom";
import type { Ink } from "./ink";
import type { Photo, Place, Scene } from "./scene";
import type { Section } from "./section";

/** Borders are drawn this far around the eye; a whole kilometre of them would be a carpet. */
const AROUND_M = 6;
const MOST_LISTED = 12;

export class PhotoLayer {
  shown = false;
  onChange: () => void = () => {};
  private selected: { place: Place; photos: Photo[]; marked: Photo | null } | null = null;

  constructor(private readonly scene: Scene, private readonly section: Section) {}

  show(shown: boolean): void {
    this.shown = shown;
    this.selected = null;
    this.list();
  }

  /** Lists the photos that show a place, the one that has it nearest to its middle first. */
  select(place: Place): void {
    const photos = this.scene.photos.filter((photo) => this.shows(photo, place));
    photos.sort((a, b) => this.off(a, place) - this.off(b, place));
    this.selected = { place, photos: photos.slice(0, MOST_LISTED), marked: photos[0] ?? null };
    this.list();
  }

  private middle(photo: Photo): Place {
    const sum = photo.footprint.reduce((sum, [s, x]) => [sum[0] + s, sum[1] + x] as [number, number], [0, 0]);
    return { s_m: sum[0] / photo.footprint.length, x_m: sum[1] / photo.footprint.length };
  }

  private off(photo: Photo, place: Place): number {
    const middle = this.middle(photo);
    return Math.hypot(this.section.near(place.s_m, middle.s_m) - middle.s_m, place.x_m - middle.x_m);
  }

  /** Whether the place lies within the border (even-odd rule). */
  private shows(photo: Photo, place: Place): boolean {
    const border = photo.footprint;
    if (border.length < 3) return false;
    const s_m = this.section.near(place.s_m, this.middle(photo).s_m);
    let inside = false;
    border.forEach(([s, x], at) => {
      const [t, y] = border[(at + 1) % border.length]!;
      if (x > place.x_m !== y > place.x_m && s_m < s + ((t - s) * (place.x_m - x)) / (y - x)) inside = !inside;
    });
    return inside;
  }

  draw(ink: Ink, eye_x_m: number): void {
    if (!this.shown) return;
    const listed = this.selected?.photos ?? [];
    for (const photo of this.scene.photos) {
      if (photo.footprint.length < 3 || Math.abs(photo.centre_m[0] - eye_x_m) > AROUND_M || photo === this.selected?.marked) continue;
      const colour = photo.status === "prior-only" ? "rgba(224, 164, 88, 0.6)" : "rgba(95, 179, 201, 0.35)";
      this.border(ink, photo, listed.includes(photo) ? "rgba(255, 255, 255, 0.7)" : colour, 1);
    }
    if (this.selected?.marked) this.border(ink, this.selected.marked, "#ffd166", 2.5);
    if (this.selected) ink.dot(this.selected.place, { colour: "#ffd166" }, 4);
  }

  private border(ink: Ink, photo: Photo, colour: string, width: number): void {
    const border = photo.footprint.map(([s_m, x_m]) => ({ s_m, x_m }));
    const first = border[0]!;
    ink.line([...border, { s_m: this.section.near(first.s_m, border.at(-1)!.s_m), x_m: first.x_m }], { colour, width });
  }

  private list(): void {
    element("photo-section", HTMLElement).hidden = !this.shown;
    const { selected } = this;
    if (!selected) {
      element("photo-list", HTMLUListElement).replaceChildren("Click the wall to list the photos that show it.");
      return;
    }
    const items = selected.photos.map((photo) => {
      const item = document.createElement("li");
      const text = document.createElement("span");
      const about = document.createElement("small");
      about.textContent =
        photo.status === "prior-only" ? "from its tag alone" : `±${photo.sigma_mm.toFixed(1)} mm, ${photo.matches} matches, ${photo.rms_px.toFixed(2)} px`;
      if (this.scene.has_photos) {
        const link = document.createElement("a");
        link.href = `photos/${encodeURIComponent(photo.name)}`;
        link.target = "_blank";
        link.textContent = photo.name;
        text.append(link);
      } else {
        text.append(photo.name);
      }
      text.append(document.createElement("br"), about);
      item.append(text);
      item.addEventListener("pointerenter", () => {
        selected.marked = photo;
        this.onChange();
      });
      return item;
    });
    element("photo-list", HTMLUListElement).replaceChildren(...(items.length > 0 ? items : ["No photo shows this place."]));
  }
}
