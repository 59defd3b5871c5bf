// The viewer as its user has it: the real program, a real browser, clicks on what is seen.
//
// Needs target/debug/adit and a Chromium on the PATH; `cargo xtask test` sees to both.

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, renameSync, rmSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { chromium } from "playwright-core";
import { decode } from "./png.mjs";
import { DOTS, LAST_LEVEL, writeReconstruction } from "./synthetic.mjs";

const ADIT = new URL("../../../target/debug/adit", import.meta.url).pathname;
const HEADSET = new URL("../node_modules/iwer/build/iwer.js", import.meta.url).pathname;
const FLAGS = [
  "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
  "--disable-background-networking", "--disable-component-update", "--disable-sync",
];
const folder = mkdtempSync(join(tmpdir(), "adit-viewer-"));
const out = join(folder, "out");
let browser;
let server;

const which = (names) => names.find((name) => {
  try {
    return execFileSync("which", [name], { stdio: ["ignore", "pipe", "ignore"] }).length > 0;
  } catch {
    return false;
  }
});

async function startBrowser(more = []) {
  const name = which(["chromium", "chromium-browser", "google-chrome"]);
  assert.ok(name, "no Chromium on the PATH");
  return chromium.launch({ executablePath: execFileSync("which", [name], { encoding: "utf8" }).trim(), args: [...FLAGS, ...more] });
}

function startServer() {
  const child = spawn(ADIT, ["view", out], { stdio: ["ignore", "pipe", "inherit"] });
  return new Promise((resolve, reject) => {
    child.once("exit", (code) => reject(new Error(`adit view ended with ${code}`)));
    child.stdout.once("data", (line) => resolve({ child, url: String(line).trim() }));
  });
}

before(async () => {
  writeReconstruction(out);
  server = await startServer();
  browser = await startBrowser();
});

after(async () => {
  await browser?.close();
  server?.child.kill("SIGKILL");
  rmSync(folder, { recursive: true, force: true });
});

/** Opens the page; every error on it fails the test. */
async function open() {
  const page = await browser.newPage({ viewport: { width: 900, height: 620 } });
  page.problems = [];
  page.asked = [];
  page.on("request", (request) => page.asked.push(request.url()));
  page.on("pageerror", (error) => page.problems.push(String(error)));
  page.on("console", (message) => message.type() === "error" && page.problems.push(message.text()));
  await page.goto(server.url);
  await page.waitForFunction(() => document.getElementById("cover").hidden);
  await quiet(page);
  return page;
}

/** Waits until every tile that the view wants is there. */
async function quiet(page) {
  await page.waitForFunction(() => document.getElementById("view").dataset.pending === "0");
  // The tile that came last is drawn in the next frame.
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
  await page.waitForFunction(() => document.getElementById("view").dataset.pending === "0");
}

async function unroll(page) {
  await page.keyboard.press("u");
  await page.waitForFunction(() => document.getElementById("unroll").value === "1");
  await quiet(page);
}

/**
 * Centre of a dot on the screen, and how many pixels it has; ours to find, not the page's to tell. A pixel is the dot's where
 * its strongest channel is twice as strong as the others, as nothing else on the page is.
 */
async function find(page, rgb) {
  const strong = rgb.indexOf(Math.max(...rgb));
  const { width, height, channels, pixels } = decode(await page.screenshot());
  let [x, y, count] = [0, 0, 0];
  for (let at = 0; at < width * height; at++) {
    const of = (c) => pixels[at * channels + c];
    if (of(strong) > 110 && [0, 1, 2].every((c) => c === strong || 2 * of(c) < of(strong))) {
      x += (at % width) + 0.5;
      y += Math.floor(at / width) + 0.5;
      count++;
    }
  }
  return { x: x / count, y: y / count, count };
}

const finest = (page) => page.evaluate(() => Number(document.getElementById("view").dataset.finest));
const readout = (page) => page.locator("#readout b").textContent();
/** Metres of a length as the page writes it. */
const metres = (text) => parseFloat(text) / (/ mm$/.test(text) ? 1000 : 1);

test("the page loads, and finer tiles arrive while zooming, down to the panorama's own pixels", async () => {
  const page = await open();
  await page.evaluate(() => document.getElementById("panel-button").click());
  await unroll(page);
  const coarse = await finest(page);
  const far = await find(page, DOTS.red.rgb);
  assert.ok(far.count > 10, "the red dot is on the screen");
  await page.mouse.move(far.x, far.y);
  for (let notch = 0; notch < 14; notch++) await page.mouse.wheel(0, -150);
  await quiet(page);
  const near = await find(page, DOTS.red.rgb);
  assert.ok(near.count > 50 * far.count, `the dot grew from ${far.count} to ${near.count} pixels`);
  assert.ok(Math.hypot(near.x - far.x, near.y - far.y) < 30, "the place under the pointer stays there");
  assert.equal(await finest(page), LAST_LEVEL);
  assert.ok(coarse < LAST_LEVEL, `the overview was drawn from level ${coarse}`);
  // Perhaps before the zoom already, for the wall beside the camera.
  assert.ok(page.asked.some((url) => url.includes(`/panorama_files/${LAST_LEVEL}/`)));
  assert.deepEqual(page.problems, []);
  await page.close();
});

test("lengths and areas on the flat wall are those of the dots within 1 %", async () => {
  const page = await open();
  await page.evaluate(() => document.getElementById("panel-button").click());
  await unroll(page);
  const at = {};
  for (const [name, dot] of Object.entries(DOTS)) at[name] = await find(page, dot.rgb);
  await page.keyboard.press("m");
  await page.mouse.click(at.red.x, at.red.y);
  await page.mouse.click(at.green.x, at.green.y);
  const around = metres(await readout(page));
  assert.ok(Math.abs(around - 1.0) < 0.01, `${around} m around, 1 m is true`);
  await page.mouse.click(at.blue.x, at.blue.y);
  const both = metres(await readout(page));
  const truth = 1.0 + Math.hypot(1.0, 0.8);
  assert.ok(Math.abs(both - truth) < 0.01 * truth, `${both} m, ${truth} m is true`);
  await page.mouse.click(at.red.x, at.red.y);
  const text = await readout(page);
  assert.match(text, /m²/);
  assert.ok(Math.abs(parseFloat(text) - 0.4) < 0.008, `${text}, 0.4 m² is true`);
  assert.match(await page.locator("#readout").textContent(), /arc length/);
  await page.keyboard.press("Escape");
  assert.ok(await page.locator("#readout").isHidden());
  await page.close();
});

test("inside the tunnel, in perspective, lengths are the same", async () => {
  const page = await open();
  await page.evaluate(() => document.getElementById("panel-button").click());
  await page.keyboard.press("g");
  await page.fill("#goto-x", "3.4");
  await page.fill("#goto-clock", "6");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /^3\.(39|4\d) m · (5:59|6:0\d)/.test(document.getElementById("place").textContent));
  await quiet(page);
  const [red, blue] = [await find(page, DOTS.red.rgb), await find(page, DOTS.blue.rgb)];
  assert.ok(red.count > 20 && blue.count > 20, "both dots are seen");
  await page.keyboard.press("m");
  await page.mouse.click(red.x, red.y);
  await page.mouse.click(blue.x, blue.y);
  const along = metres(await readout(page));
  assert.ok(Math.abs(along - 0.8) < 0.008, `${along} m along, 0.8 m is true`);
  await page.close();
});

test("a finding is saved beside the survey, survives a reload, and its words are only words", async () => {
  const page = await open();
  await page.evaluate(() => document.getElementById("panel-button").click());
  await unroll(page);
  const [red, blue] = [await find(page, DOTS.red.rgb), await find(page, DOTS.blue.rgb)];
  await page.evaluate(() => document.getElementById("panel-button").click());
  await page.keyboard.press("f");
  await page.mouse.move(red.x, red.y - 40);
  await page.mouse.down();
  await page.mouse.move(blue.x, blue.y + 40, { steps: 4 });
  await page.mouse.up();
  await page.selectOption("#finding-kind", "infiltration");
  await page.selectOption("#finding-severity", "4");
  await page.fill("#finding-note", "<img src=x onerror=\"document.title='owned'\"> & drips");
  await page.click("#finding-save");
  await page.waitForSelector("#finding-list li");
  await page.reload();
  await page.waitForSelector("#finding-list li");
  assert.match(await page.locator("#finding-list li").textContent(), /Infiltration/);
  assert.doesNotMatch(await page.title(), /owned/);
  const [finding] = JSON.parse(readFileSync(join(out, "findings.json"), "utf8")).findings;
  assert.equal(finding.severity, 4);
  assert.ok(Math.abs(finding.x_from_m - 3.0) < 0.02 && Math.abs(finding.x_to_m - 3.8) < 0.02, JSON.stringify(finding));
  // The red and blue dots lie half a metre before the floor: 0.5 rad of a circle of 1 m.
  const clock = 6 - (0.5 / (2 * Math.PI)) * 12;
  assert.ok(finding.clock_from < clock && clock < finding.clock_to, JSON.stringify(finding));
  assert.equal(readFileSync(join(out, finding.snapshot)).subarray(0, 3).toString("hex"), "ffd8ff");
  const xml = await (await page.request.get(new URL("api/export/findings.xml", server.url).href)).text();
  assert.match(xml, /<A>BBF<\/A>[^]*&lt;img src=x[^]*<I>3\.0\d<\/I>/);
  await page.close();
});

test("the relief lies where its lattice says", async () => {
  const page = await open();
  await unroll(page);
  const [red, blue] = [await find(page, DOTS.red.rgb), await find(page, DOTS.blue.rgb)];
  const [response] = await Promise.all([page.waitForResponse(/relief\.png$/), page.check("#layer-relief")]);
  await response.finished();
  await page.waitForFunction(() => document.getElementById("view").dataset.layers?.includes("relief"));
  await quiet(page);
  const green = await find(page, DOTS.green.rgb);
  const px_per_m = (blue.x - red.x) / (DOTS.blue.x_m - DOTS.red.x_m);
  const middle_m = DOTS.red.x_m + (green.x - red.x) / px_per_m;
  assert.ok(green.count > 1000 && Math.abs(middle_m - 5.5) < 0.05, `${green.count} green pixels around ${middle_m} m`);
  await page.close();
});

test("a click lists the photos that show a place", async () => {
  const page = await open();
  await unroll(page);
  await page.check("#layer-photos");
  const red = await find(page, DOTS.red.rgb);
  await page.mouse.click(red.x, red.y);
  assert.match(await page.locator("#photo-list").textContent(), /FLOOR\.JPG/);
  await page.close();
});

test("with a headset (emulated) one enters the tunnel, moves by the stick, and comes out where one went", async () => {
  const page = await browser.newPage({ viewport: { width: 640, height: 480 } });
  const problems = [];
  page.on("pageerror", (error) => problems.push(String(error)));
  await page.addInitScript({ path: HEADSET });
  await page.addInitScript(() => {
    window.device = new window.IWER.XRDevice(window.IWER.metaQuest3);
    window.device.installRuntime({ forceInstall: true });
  });
  await page.goto(server.url);
  await page.waitForFunction(() => document.getElementById("cover").hidden);
  await quiet(page);
  const x_m = async () => parseFloat(await page.locator("#place").textContent());
  const before_m = await x_m();
  await page.click("#vr-button");
  await page.waitForFunction(() => window.device.activeSession);
  await page.evaluate(async () => {
    window.device.controllers.right.updateAxes("thumbstick", 0, -1);
    for (let frame = 0; frame < 30; frame++) await new Promise((done) => window.device.activeSession.requestAnimationFrame(done));
    await window.device.activeSession.end();
  });
  await page.waitForFunction((before_m) => parseFloat(document.getElementById("place").textContent) > before_m + 0.1, before_m);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a broken and a missing tile are named and the rest of the wall is shown", async () => {
  const tile = (name) => join(out, "panorama/tiles/panorama_files", name);
  const [broken, missing] = [tile(`${LAST_LEVEL}/3_2.png`), tile(`${LAST_LEVEL}/3_3.png`)];
  const whole = [readFileSync(broken), readFileSync(missing)];
  writeFileSync(broken, whole[0].subarray(0, 40));
  rmSync(missing);
  const page = await open();
  await page.keyboard.press("g");
  await page.fill("#goto-x", "3");
  await page.fill("#goto-clock", "6");
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => /cannot be shown \(and 1 more\)/.test(document.getElementById("messages").textContent));
  await quiet(page);
  assert.ok((await find(page, DOTS.red.rgb)).count > 20, "the dot is shown from the coarser tile");
  await page.close();
  writeFileSync(broken, whole[0]);
  writeFileSync(missing, whole[1]);
});

test("a missing file is a message and not a blank page", async () => {
  const coverage = join(out, "coverage.png");
  renameSync(coverage, `${coverage}.away`);
  const page = await browser.newPage();
  await page.goto(server.url);
  await page.waitForFunction(() => document.getElementById("cover").hidden);
  assert.ok(await page.locator("#layer-coverage").isDisabled());
  renameSync(`${coverage}.away`, coverage);
  const panorama = join(out, "panorama/panorama.json");
  renameSync(panorama, `${panorama}.away`);
  await page.reload();
  await page.waitForSelector("#cover.failed");
  assert.match(await page.locator("#cover-text").textContent(), /no panorama.*adit reconstruct/);
  renameSync(`${panorama}.away`, panorama);
  await page.close();
});

test("without WebGL the page says so and offers the panorama", async () => {
  const blind = await startBrowser(["--disable-3d-apis"]);
  const page = await blind.newPage();
  await page.goto(server.url);
  await page.waitForSelector("#cover.failed");
  assert.match(await page.locator("#cover-text").textContent(), /WebGL/);
  assert.match(await page.locator("#cover-links a").getAttribute("href"), /panorama\.png/);
  await blind.close();
});

test("a page of another origin gets nothing", async () => {
  const other = createServer((_, response) => response.setHeader("content-type", "text/html").end("<title>other</title>"));
  await new Promise((ready) => other.listen(0, "127.0.0.1", ready));
  const page = await browser.newPage();
  await page.goto(`http://127.0.0.1:${other.address().port}/`);
  const got = await page.evaluate(async (url) => {
    const read = await fetch(`${url}api/scene`).then(() => "read", () => "refused");
    const wrote = await fetch(`${url}api/findings/1`, { method: "DELETE", mode: "cors" }).then(() => "wrote", () => "refused");
    const saw = await new Promise((done) => {
      const image = new Image();
      image.onload = () => done("seen");
      image.onerror = () => done("refused");
      image.src = `${url}files/coverage.png`;
    });
    return [read, wrote, saw];
  }, server.url);
  assert.deepEqual(got, ["refused", "refused", "refused"]);
  await page.close();
  other.close();
});

test("Ctrl-C ends the server in good order", async () => {
  server.child.removeAllListeners("exit");
  const exit = new Promise((done) => server.child.once("exit", done));
  server.child.kill("SIGINT");
  assert.equal(await exit, 0);
  assert.ok(existsSync(join(out, "findings.json")));
});
