// Findings: the list, the form, the boxes on the wall. The server keeps them (ground/src/findings/).

import { ask, askJson, element, reason, tell } from "./dom";
import type { Ink } from "./ink";
import type { Place } from "./scene";
import type { Section } from "./section";

interface Observation {
  kind: string;
  severity: number;
  note: string;
  x_from_m: number;
  x_to_m: number;
  clock_from: number;
  clock_to: number;
}

export interface Finding extends Observation {
  id: number;
  snapshot?: string;
}

interface File {
  inspection: Record<string, string>;
  findings: Finding[];
}

const KINDS: Record<string, string> = {
  crack: "Crack", fracture: "Fracture (open crack)", break: "Break, collapse", "surface-damage": "Surface damage",
  "defective-brickwork": "Defective brickwork", "missing-mortar": "Missing mortar", deformation: "Deformation",
  "displaced-joint": "Displaced joint", "lining-defect": "Lining defect", "defective-repair": "Defective repair",
  infiltration: "Infiltration", "attached-deposit": "Attached deposit", "settled-deposit": "Settled deposit",
  roots: "Roots", obstacle: "Obstacle", connection: "Connection", remark: "Remark",
};
const COLOURS = ["", "#8fbf7f", "#c9cf6a", "#f0b84f", "#ee8245", "#e2574c"];
const FIELDS = ["reference", "from_node", "to_node", "location", "date", "inspector"] as const;

const input = (id: string) => element(id, HTMLInputElement);
const round = (value: number, digits: number) => Number(value.toFixed(digits));
const distance = (finding: Observation) =>
  finding.x_to_m - finding.x_from_m < 0.005 ? `${finding.x_from_m.toFixed(2)} m` : `${finding.x_from_m.toFixed(2)}–${finding.x_to_m.toFixed(2)} m`;
export const clockText = (clock: number) => {
  const minutes = Math.round(clock * 60) % 720;
  return `${Math.floor(minutes / 60) || 12}:${String(minutes % 60).padStart(2, "0")}`;
};

export class Findings {
  list: Finding[] = [];
  shown = true;
  onChange: () => void = () => {};
  onVisit: (place: Place) => void = () => {};
  /** What the form is about: a known finding, or a new one with its picture. */
  private edited: { id: number | null; snapshot: string | null } = { id: null, snapshot: null };
  private readonly dialog = element("finding-dialog", HTMLDialogElement);

  constructor(private readonly section: Section) {
    const kinds = element("finding-kind", HTMLSelectElement);
    for (const [value, name] of Object.entries(KINDS)) kinds.add(new Option(name, value));
    onSubmit("finding-form", () => this.save());
    element("finding-delete", HTMLButtonElement).addEventListener("click", () => void this.remove());
    element("inspection-button", HTMLButtonElement).addEventListener("click", () => void this.describe());
    onSubmit("inspection-form", () => this.saveInspection());
  }

  async load(): Promise<void> {
    try {
      this.list = (await askJson<File>("api/findings")).findings;
    } catch (error) {
      tell("findings", `The findings cannot be shown: ${reason(error)}`);
    }
    this.showList();
    this.onChange();
  }

  /** Opens the form for a new finding between two corners. */
  create(a: Place, b: Place, snapshot: string): void {
    const other = this.section.near(b.s_m, a.s_m);
    const clocks = [Math.min(a.s_m, other), Math.max(a.s_m, other)].map((s_m) => this.section.clock(s_m));
    this.edited = { id: null, snapshot };
    this.fill("New finding", {
      kind: "crack", severity: 2, note: "",
      x_from_m: Math.min(a.x_m, b.x_m), x_to_m: Math.max(a.x_m, b.x_m), clock_from: clocks[0]!, clock_to: clocks[1]!,
    }, snapshot);
  }

  edit(finding: Finding): void {
    this.edited = { id: finding.id, snapshot: null };
    this.fill(`Finding ${finding.id}`, finding, finding.snapshot ? `files/${finding.snapshot}` : null);
  }

  private fill(title: string, finding: Observation, picture: string | null): void {
    element("finding-title", HTMLHeadingElement).textContent = title;
    element("finding-kind", HTMLSelectElement).value = finding.kind;
    element("finding-severity", HTMLSelectElement).value = String(finding.severity);
    element("finding-note", HTMLTextAreaElement).value = finding.note;
    input("finding-x-from").value = String(round(finding.x_from_m, 3));
    input("finding-x-to").value = String(round(finding.x_to_m, 3));
    input("finding-clock-from").value = String(round(finding.clock_from, 2));
    input("finding-clock-to").value = String(round(finding.clock_to, 2));
    const snapshot = element("finding-snapshot", HTMLImageElement);
    snapshot.hidden = picture === null;
    if (picture !== null) snapshot.src = picture;
    element("finding-error", HTMLParagraphElement).hidden = true;
    element("finding-delete", HTMLButtonElement).hidden = this.edited.id === null;
    this.dialog.showModal();
  }

  private async save(): Promise<void> {
    const observation: Observation = {
      kind: element("finding-kind", HTMLSelectElement).value,
      severity: Number(element("finding-severity", HTMLSelectElement).value),
      note: element("finding-note", HTMLTextAreaElement).value.trim(),
      x_from_m: input("finding-x-from").valueAsNumber,
      x_to_m: input("finding-x-to").valueAsNumber,
      clock_from: input("finding-clock-from").valueAsNumber,
      clock_to: input("finding-clock-to").valueAsNumber,
    };
    const { id, snapshot } = this.edited;
    await this.attempt("finding-error", async () => {
      if (id !== null) await ask(`api/findings/${id}`, "PUT", observation);
      else await ask("api/findings", "POST", { observation, snapshot: snapshot?.replace(/^data:image\/jpeg;base64,/, "") ?? null });
      this.dialog.close();
    });
  }

  private async remove(): Promise<void> {
    if (this.edited.id === null || !confirm(`Delete finding ${this.edited.id}?`)) return;
    await this.attempt("finding-error", async () => {
      await ask(`api/findings/${this.edited.id}`, "DELETE");
      this.dialog.close();
    });
  }

  private async describe(): Promise<void> {
    try {
      const { inspection } = await askJson<File>("api/findings");
      for (const field of FIELDS) input(`inspection-${field}`).value = inspection[field] ?? "";
      element("inspection-error", HTMLParagraphElement).hidden = true;
      element("inspection-dialog", HTMLDialogElement).showModal();
    } catch (error) {
      tell("findings", reason(error));
    }
  }

  private async saveInspection(): Promise<void> {
    const inspection = Object.fromEntries(FIELDS.map((field) => [field, input(`inspection-${field}`).value.trim()]));
    await this.attempt("inspection-error", async () => {
      await ask("api/inspection", "PUT", inspection);
      element("inspection-dialog", HTMLDialogElement).close();
    });
  }

  /** Does it and shows the list anew; a refusal stays in the form, with all that was typed. */
  private async attempt(line: string, work: () => Promise<void>): Promise<void> {
    const error = element(line, HTMLParagraphElement);
    error.hidden = true;
    try {
      await work();
    } catch (problem) {
      error.textContent = `Not saved: ${reason(problem)}`;
      error.hidden = false;
      return;
    }
    await this.load();
  }

  private showList(): void {
    element("finding-count", HTMLElement).textContent = this.list.length > 0 ? String(this.list.length) : "none yet";
    const items = this.list.map((finding) => {
      const item = document.createElement("li");
      item.dataset.id = String(finding.id);
      const dot = document.createElement("i");
      dot.className = "dot";
      dot.style.background = COLOURS[finding.severity] ?? "";
      const text = document.createElement("span");
      const where = document.createElement("small");
      where.textContent = `${distance(finding)}, ${clockText(finding.clock_from)}–${clockText(finding.clock_to)}`;
      text.append(`${finding.id} ${KINDS[finding.kind] ?? finding.kind}`, document.createElement("br"), where);
      const edit = document.createElement("button");
      edit.className = "edit";
      edit.textContent = "edit";
      edit.addEventListener("click", (event) => {
        event.stopPropagation();
        this.edit(finding);
      });
      item.title = finding.note;
      item.append(dot, text, edit);
      item.addEventListener("click", () => this.onVisit(this.middle(finding)));
      return item;
    });
    element("finding-list", HTMLUListElement).replaceChildren(...items);
  }

  /** [from, to] around, `to` not before `from`. */
  private around(finding: Observation): [number, number] {
    const [from, to] = [this.section.sAtClock(finding.clock_from), this.section.sAtClock(finding.clock_to)];
    return [from, to < from - 1e-6 ? to + this.section.perimeter_m : to];
  }

  private middle(finding: Observation): Place {
    const [from, to] = this.around(finding);
    return { s_m: (from + to) / 2, x_m: (finding.x_from_m + finding.x_to_m) / 2 };
  }

  /** The finding whose box holds a place. */
  at(place: Place): Finding | undefined {
    const slack = 0.02;
    return this.list.find((finding) => {
      const [from, to] = this.around(finding);
      const s_m = this.section.near(place.s_m, (from + to) / 2);
      return place.x_m >= finding.x_from_m - slack && place.x_m <= finding.x_to_m + slack && s_m >= from - slack && s_m <= to + slack;
    });
  }

  draw(ink: Ink): void {
    if (!this.shown) return;
    for (const finding of this.list) {
      const colour = COLOURS[finding.severity] ?? "#fff";
      const [from, to] = this.around(finding);
      drawBox(ink, { s_m: from, x_m: finding.x_from_m }, { s_m: to, x_m: finding.x_to_m }, colour);
      ink.label({ s_m: from, x_m: finding.x_from_m }, `${finding.id} ${KINDS[finding.kind] ?? ""}`, colour);
    }
  }

  /** Ticks for the map. */
  marks(): { x_m: number; s_m: number; colour: string }[] {
    return this.list.map((finding) => ({ ...this.middle(finding), colour: COLOURS[finding.severity] ?? "#fff" }));
  }
}

function onSubmit(form: string, work: () => Promise<void>): void {
  element(form, HTMLFormElement).addEventListener("submit", (event) => {
    event.preventDefault();
    void work();
  });
}

/** A box between two corners on the wall; a point is a dot. */
export function drawBox(ink: Ink, a: Place, b: Place, colour: string): void {
  if (Math.abs(a.s_m - b.s_m) < 0.005 && Math.abs(a.x_m - b.x_m) < 0.005) {
    ink.dot(a, { colour, fill: "rgba(13, 17, 20, 0.6)" }, 7);
    return;
  }
  const border = [a, { s_m: b.s_m, x_m: a.x_m }, b, { s_m: a.s_m, x_m: b.x_m }, a];
  ink.line(border, { colour: "rgba(0, 0, 0, 0.5)", width: 4 });
  ink.line(border, { colour, width: 2, fill: `${colour}22` });
}
