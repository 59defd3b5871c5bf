// The live page as who helps the pilot has it: a simulated flight in real time, the real program, a real browser.
//
// Needs target/debug/adit, target/debug/adit-sim and a Chromium on the PATH; `cargo xtask test` sees to all of them. Times are the
// board's own where they can be, so that a busy machine, on which the flight itself is late, does not count.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { createSocket } from "node:dgram";
import { mkdtempSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { chromium } from "playwright-core";

const PROGRAMS = new URL("../../../target/debug/", import.meta.url).pathname;
const MISSION = new URL("../../../tests/tests/system/live.toml", import.meta.url).pathname;
/** When the mission unplugs the upward sensor and makes the camera deaf; a picture comes every 0.2 s. */
const [UNPLUGGED_S, DEAF_S, PICTURE_S] = [8, 14, 0.2];
const folder = mkdtempSync(join(tmpdir(), "adit-live-"));
const children = [];
let browser;

before(async () => {
  const find = 'for name in chromium chromium-browser google-chrome; do command -v "$name" && exit; done; exit 1';
  const executablePath = execFileSync("sh", ["-c", find], { encoding: "utf8" }).trim();
  browser = await chromium.launch({ executablePath, args: ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"] });
});

after(async () => {
  await browser?.close();
  for (const child of children) child.kill("SIGKILL");
  rmSync(folder, { recursive: true, force: true });
});

async function freePort() {
  const socket = createSocket("udp4");
  const port = await new Promise((resolve) => socket.bind(0, "127.0.0.1", () => resolve(socket.address().port)));
  await new Promise((resolve) => socket.close(resolve));
  return port;
}

function start(program, args, output) {
  const child = spawn(PROGRAMS + program, args, { stdio: ["ignore", output, output === "pipe" ? "inherit" : "ignore"] });
  children.push(child);
  return child;
}

/** Starts `adit live`; where its page is. */
function watch(port, web) {
  const child = start("adit", ["live", `udpin:127.0.0.1:${port}`, "--mission", MISSION, "--web", web], "pipe");
  return new Promise((resolve, reject) => {
    child.once("exit", (code) => reject(new Error(`adit live ended with ${code}`)));
    child.stdout.once("data", (line) => resolve({ child, url: String(line).trim() }));
  });
}

const fly = (port) => start("adit-sim", ["fly", MISSION, "--out", join(folder, `flight-${port}`), "--autopilot", "ardupilot-4.7", "--realtime",
  "--no-photos", "--seed", "3", "--mavlink", `udpout:127.0.0.1:${port}`], "ignore");

async function open(url) {
  const page = await browser.newPage({ viewport: { width: 1180, height: 820 } });
  page.problems = [];
  page.asked = [];
  page.on("request", (request) => page.asked.push(request.url()));
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("dialog", (dialog) => page.problems.push(dialog.message()));
  await page.goto(url);
  return page;
}

const text = (page, id) => page.locator(`#${id}`).textContent();
const state = (page, id, wanted, timeout = 30000) =>
  page.waitForFunction(([id, wanted]) => document.getElementById(id).className === wanted, [id, wanted], { timeout, polling: 20 });
const boardTime = (page) => page.evaluate(() => Number(document.body.dataset.board));

/** Whether more of the strip's pixels are red or yellow: found on the picture, not told by the page. */
const isMarked = (least) => {
  const strip = document.getElementById("strip");
  const { data } = strip.getContext("2d").getImageData(0, 0, strip.width, strip.height);
  let marked = 0;
  for (let at = 0; at < data.length; at += 4) {
    const [red, green, blue] = [data[at], data[at + 1], data[at + 2]];
    if (red > 240 && blue < 90 && (Math.abs(green - 77) < 12 || Math.abs(green - 194) < 12)) marked++;
  }
  return marked > least;
};

/** A STATUSTEXT of the board as it goes over the wire (mavlink.io, "Packet Serialization"). */
function statustext(words) {
  const payload = Buffer.alloc(51);
  payload[0] = 2;
  payload.write(words, 1, "latin1");
  const frame = Buffer.concat([Buffer.from([0xfd, payload.length, 0, 0, 200, 1, 191, 253, 0, 0]), payload]);
  let crc = 0xffff;
  // The last byte stands for the message's layout.
  for (const byte of [...frame.subarray(1), 83]) {
    let mixed = (byte ^ (crc & 0xff)) & 0xff;
    mixed = (mixed ^ (mixed << 4)) & 0xff;
    crc = ((crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)) & 0xffff;
  }
  return Buffer.concat([frame, Buffer.from([crc & 0xff, crc >> 8])]);
}

async function say(port, words) {
  const socket = createSocket("udp4");
  await new Promise((resolve) => socket.send(statustext(words), port, "127.0.0.1", resolve));
  socket.close();
}

test("a flight is seen; sensor, camera, link and server fail, and each is shown in time", async () => {
  const port = await freePort();
  const server = await watch(port, "127.0.0.1:0");
  const page = await open(server.url);
  await state(page, "link", "waiting");
  const flight = fly(port);
  await state(page, "link", "up");
  await page.waitForFunction(() => document.getElementById("mode").textContent === "Scanning");
  for (const beam of ["up", "right", "down", "left"]) await state(page, `range-${beam}`, "valid");
  assert.match(await text(page, "limit-value"), /^0\.\d\d$/);

  await state(page, "range-up", "invalid");
  const unplugged_s = (await boardTime(page)) - UNPLUGGED_S;
  assert.ok(unplugged_s > 0 && unplugged_s <= 1 - PICTURE_S, `shown ${unplugged_s} s after it was unplugged`);
  assert.equal(await text(page, "range-up"), "↑ no reading");
  await state(page, "range-up", "valid");

  assert.ok(!(await page.evaluate(isMarked, 0)), "no gap before the camera is deaf");
  await page.waitForFunction(isMarked, 100, { timeout: 30000, polling: 20 });
  const gap_s = (await boardTime(page)) - DEAF_S;
  assert.ok(gap_s > 0 && gap_s <= 2 - PICTURE_S, `shown ${gap_s} s after the camera was deaf`);
  await page.waitForFunction(() => /[1-9] MISSED/.test(document.getElementById("photos").textContent));

  await say(port, "<script>alert(1)</script><img src=x onerror=alert(2)>");
  await page.waitForFunction(() => document.getElementById("notices").textContent.includes("<script>alert(1)</script>"));
  assert.equal(await page.evaluate(() => document.querySelectorAll("script").length), 1, "words are no markup");

  flight.kill("SIGSTOP");
  const stopped = Date.now();
  await state(page, "link", "lost");
  const lost_ms = Date.now() - stopped;
  assert.ok(lost_ms < 2000, `the lost link was shown after ${lost_ms} ms`);
  assert.match(await text(page, "warnings"), /LINK LOST/);
  assert.equal(await page.locator("#speed-value").getAttribute("class"), "old");
  flight.kill("SIGCONT");
  await state(page, "link", "up");

  // The server itself goes, and comes back at its address.
  server.child.removeAllListeners("exit");
  server.child.kill("SIGKILL");
  await page.waitForFunction(() => document.getElementById("link").textContent.includes("NO ANSWER"), null, { timeout: 2500, polling: 20 });
  await watch(port, new URL(server.url).host);
  await state(page, "link", "up");
  assert.deepEqual(page.problems, []);
  const origin = new URL(server.url).origin;
  assert.deepEqual(page.asked.filter((url) => !url.startsWith(origin) && !url.startsWith("data:")), [], "nothing is fetched from elsewhere");
  await page.close();
});

test("another site's page gets nothing, and beyond this machine nobody without the token", async () => {
  const { url } = await watch(await freePort(), "127.0.0.1:0");
  const foreign = createServer((_, response) => response.end("<!doctype html><title>elsewhere</title>"));
  await new Promise((resolve) => foreign.listen(0, "127.0.0.1", resolve));
  const page = await open(`http://127.0.0.1:${foreign.address().port}/`);
  const outcome = await page.evaluate((target) => new Promise((resolve) => {
    const socket = new WebSocket(target);
    socket.onmessage = () => resolve("message");
    socket.onclose = () => resolve("closed");
  }), url.replace("http:", "ws:") + "live");
  assert.equal(outcome, "closed");
  await page.close();
  foreign.close();

  const open_to_all = new URL((await watch(await freePort(), "0.0.0.0:0")).url);
  assert.match(open_to_all.search, /^\?token=[0-9a-f]{32}$/);
  const here = `http://127.0.0.1:${open_to_all.port}/`;
  assert.equal((await fetch(here)).status, 401);
  assert.equal((await fetch(`${here}?token=${"0".repeat(32)}`)).status, 401);
  const visitor = await open(here + open_to_all.search);
  await state(visitor, "link", "waiting");
  assert.deepEqual(visitor.problems, []);
  await visitor.close();
});
