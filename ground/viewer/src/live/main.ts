// The page of `adit live`: takes what the server sends and shows it. Words of the link are text, never markup.

import { element } from "../dom";
import { drawSection } from "./section";
import { Strip } from "./strip";
import type { Range, Reading, Update, View } from "./view";

/** Without a word for so long the server is gone: it speaks five times a second. */
const SILENCE_MS = 1500;
const RETRY_MS = 1000;
/** Nearer to the centre than this nobody need steer; farther than that it is urgent. */
const CENTRED_M = 0.05;
const FAR_M = 0.3;
const NOTICES = 6;
const BEAMS = ["up", "right", "down", "left"] as const;
const ARROWS = ["↑", "→", "↓", "←"] as const;

const strip = new Strip(element("strip", HTMLCanvasElement));
let outline_m: [number, number][] = [];
let view: View | null = null;
let heard_ms = 0;
let dirty = true;

function connect(): void {
  // The token is part of this page's address.
  const socket = new WebSocket(`ws://${location.host}/live${location.search}`);
  strip.forget();
  socket.addEventListener("message", (event) => take(JSON.parse(String(event.data)) as Update));
  socket.addEventListener("close", () => setTimeout(connect, RETRY_MS));
}

function take(update: Update): void {
  heard_ms = performance.now();
  if (update.outline_m) outline_m = update.outline_m;
  strip.take(update.strip);
  view = update.view;
  dirty = true;
  write(view);
}

/** Sets an element's text and class, if they are others. */
function put(id: string, text: string, state = ""): void {
  const place = element(id, HTMLElement);
  if (place.textContent !== text) place.textContent = text;
  if (place.className !== state) place.className = state;
}

function words<T>(reading: Reading<T>, text: (value: T) => string): [string, string] {
  return [reading.value === null ? "–" : text(reading.value), reading.is_stale ? "old" : ""];
}

function write(view: View): void {
  // For tests: how far the board's clock was in what is shown.
  document.body.dataset.board = String(view.board_s ?? "");
  put("mode", view.mode.value === null ? "no board" : (view.mode.value.replace("SelfTest", "self-test")), view.mode.is_stale ? "old" : "");
  put("autopilot", ...words(view.autopilot, ({ name, mode, is_armed }) => [name, mode, is_armed ? "armed" : "disarmed"].filter(Boolean).join(" ")));
  element("battery", HTMLElement).hidden = view.battery.value === null;
  put("battery", ...words(view.battery, ({ voltage_v, remaining }) =>
    `${remaining === null ? "" : `${Math.round(remaining * 100)} % `}${voltage_v === null ? "" : `${voltage_v.toFixed(1)} V`}`));
  const { status, silent_s, rate_hz, lost } = view.link;
  const link = { up: `link ${Math.round(rate_hz)}/s${lost === null ? "" : `, ${Math.round(lost * 100)} % lost`}`, lost: `LINK LOST ${Math.round(silent_s ?? 0)} s`, waiting: "NO BOARD" };
  put("link", link[status], status);
  element("record", HTMLElement).hidden = view.record === null;
  if (view.record) put("record", view.record.has_failed ? "NOT RECORDING" : "● REC", view.record.has_failed ? "failed" : "");
  element("replay", HTMLElement).hidden = view.replay === null;
  if (view.replay) put("replay", view.replay.is_over ? "replay: end" : `replay ×${view.replay.speed}`);
  writeWarnings(view);
  writeFigures(view);
  lines("notices", view.notices.slice(0, NOTICES).map(({ at_s, severity, from, text }) =>
    [`${Math.round(view.time_s - at_s)} s ago, ${from}: ${text}`, severity <= 4 ? "urgent" : ""]), "li");
}

function writeWarnings(view: View): void {
  lines("warnings", view.warnings.map(({ level, text }) => [text, level]), "div");
}

/** Fills a list; elements are kept where they are the same, so that a screen reader does not start again. */
function lines(id: string, wanted: [string, string][], kind: string): void {
  const list = element(id, HTMLElement);
  while (list.childElementCount > wanted.length) list.lastElementChild!.remove();
  for (const [index, [text, state]] of wanted.entries()) {
    const line = list.children[index] ?? list.appendChild(document.createElement(kind));
    if (line.textContent !== text) line.textContent = text;
    if (line.className !== state) line.className = state;
  }
}

function writeFigures(view: View): void {
  const offset = view.offset_m.is_stale ? null : view.offset_m.value;
  steer("steer-y", offset && -offset[0], ["◀", "▶"]);
  steer("steer-z", offset && -offset[1], ["▲", "▼"]);
  put("speed-value", ...words(view.speed_mps, (speed) => speed.toFixed(2)));
  put("limit-value", ...words(view.limit_mps, (limit) => limit.toFixed(2)));
  const states = { Idle: "", Requested: "requested", Enforced: "enforced", Ineffective: "IGNORED", NotPossible: "BY HAND" };
  const enforcement = view.enforcement.is_stale ? null : view.enforcement.value;
  put("enforcement", enforcement ? states[enforcement] : "", enforcement === "Enforced" ? "good" : enforcement === "Requested" ? "" : "bad");
  element("speed", HTMLElement).className = view.is_overspeed && !view.speed_mps.is_stale ? "over" : "";
  const [speed, limit] = [view.speed_mps.value ?? 0, view.limit_mps.value ?? 0];
  element("bar-filled", HTMLElement).style.width = `${Math.min(100, limit > 0 ? Math.max(0, (speed / limit) * 66.67) : 0)}%`;
  const stored = view.confirmed === null ? "storing not wired" : `${view.confirmed} stored`;
  put("photos", `${view.captures.value ?? "–"} taken, ${stored}${view.missed.value ? `, ${view.missed.value} MISSED` : ""}`,
    view.captures.is_stale ? "old" : view.missed.value ? "warn" : "");
  for (const [index, beam] of BEAMS.entries()) put(`range-${beam}`, `${ARROWS[index]} ${metres(view.ranges[index]!)}`, view.ranges[index]!.state);
  put("seen", view.wall ? `${view.wall.seen_m2.toFixed(1)} m²${view.wall.marked_m2 > 0 ? `, ${view.wall.marked_m2.toFixed(1)} m² missing` : ""}` : "–", view.wall?.marked_m2 ? "warn" : "");
  put("shaft", ...words(view.shaft_rad, (shaft) => `${Math.round((shaft * 180) / Math.PI)}°`));
  put("place", ...words(view.odometer_m, (x) => `${x.toFixed(2)} m`));
  put("water", ...words(view.water_level_m, (level) => `${Math.round(level * 100)} cm`));
}

function metres({ state, range_m }: Range): string {
  return range_m !== null ? range_m.toFixed(2) : { valid: "–", invalid: "no reading", stale: "silent", unknown: "–", unfitted: "none" }[state];
}

/** Which way to fly, and how far; `along_m` grows to the right and downwards. */
function steer(id: string, along_m: number | null, [less, more]: [string, string]): void {
  const place = element(id, HTMLElement);
  const [arrow, far] = [place.firstElementChild!, place.lastElementChild!];
  if (along_m === null) {
    [arrow.textContent, far.textContent, place.className] = ["?", "", "arrow unknown"];
    return;
  }
  const length_m = Math.abs(along_m);
  arrow.textContent = length_m < CENTRED_M ? "•" : along_m < 0 ? less : more;
  far.textContent = `${Math.round(length_m * 100)} cm`;
  place.className = `arrow${length_m < CENTRED_M ? "" : length_m < FAR_M ? " off" : " far"}`;
}

function frame(): void {
  if (view && performance.now() - heard_ms > SILENCE_MS) {
    put("link", "NO ANSWER FROM adit live", "lost");
    for (const id of ["mode", "speed-value", "limit-value", "photos", "shaft", "place", "water", "battery"]) element(id, HTMLElement).className = "old";
  }
  if (view && dirty) {
    dirty = false;
    drawSection(element("section", HTMLCanvasElement), outline_m, view);
    strip.draw(view);
  }
  requestAnimationFrame(frame);
}

const button = (id: string, action: () => void) => element(id, HTMLButtonElement).addEventListener("click", () => {
  action();
  dirty = true;
});
button("closer", () => strip.scale(1));
button("farther", () => strip.scale(-1));
button("follow", () => strip.follow());
strip.onFollow = (follows) => {
  element("follow", HTMLButtonElement).className = follows ? "on" : "";
  dirty = true;
};
addEventListener("resize", () => (dirty = true));
connect();
frame();
