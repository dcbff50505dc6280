// Opens pages in one browser as a person would, and prints what it saw as JSON: test_in_browsers.py judges it.
//   node browse.mjs DRIVER BROWSER EXECUTABLE PROFILE PAGES, where PAGES is JSON: {run, many, several, index, out}
import {createRequire} from "module";
import fs from "fs";
import path from "path";
import {pathToFileURL} from "url";

const [driver, browserName, executablePath, userDataDir, pages] = process.argv.slice(2);
const puppeteer = createRequire(path.join(driver, "package.json"))("puppeteer-core");
const files = JSON.parse(pages), chromium = browserName === "chrome";
const quiet = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"];
const browser = await puppeteer.launch({browser: browserName, executablePath, userDataDir, headless: true, args: chromium ? quiet : []});
const seen = {complaints: [], requests: []};

async function opened(file, {width = 1400, height = 900, hash = "", touch = false, dark = false} = {}) {
  const page = await browser.newPage();
  page.on("console", message => { if (["error", "warn", "warning"].includes(message.type())) seen.complaints.push(message.text()); });
  page.on("pageerror", error => seen.complaints.push(String(error)));
  page.on("request", request => seen.requests.push(request.url()));
  await page.setViewport(chromium ? {width, height, hasTouch: touch, isMobile: touch} : {width, height});
  if (dark) await page.emulateMediaFeatures([{name: "prefers-color-scheme", value: "dark"}]);
  await page.goto(pathToFileURL(file).href + hash);
  if (file !== files.index) await page.waitForSelector("body[data-ready]");
  return page;
}

// After the page has drawn what was asked of it.
const settled = page => page.evaluate(() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done))));
const now = async page => {
  await settled(page);
  return page.evaluate(() => ({
    clock: document.getElementById("clock").textContent,
    said: document.querySelector("figcaption").textContent,
    event: document.querySelector("#events [aria-current]")?.textContent ?? null,
  }));
};
const width = page => page.evaluate(() => [document.documentElement.scrollWidth, innerWidth]);

// Every text that is seen, with its contrast against what is behind it (WCAG 2.2, 1.4.3); the lowest ones.
const contrasts = page => page.evaluate(() => {
  const parsed = colour => (colour.match(/[\d.]+/g) || []).map(Number);
  const luminance = ([r, g, b]) => [r, g, b].map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const behind = element => {
    for (let at = element; at; at = at.parentElement) {
      const [r, g, b, a = 1] = parsed(getComputedStyle(at).backgroundColor);
      if (a === 1) return [r, g, b];
      if (a !== 0) throw new Error(`half transparent: ${at.outerHTML.slice(0, 80)}`);
    }
    return [255, 255, 255];
  };
  const found = [], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let text = walk.nextNode(); text; text = walk.nextNode()) {
    const element = text.parentElement, style = getComputedStyle(element);
    if (!text.data.trim() || ["SCRIPT", "STYLE", "NOSCRIPT"].includes(element.tagName) || !element.getClientRects().length) continue;
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && +style.fontWeight >= 700);
    const [a, b] = [luminance(parsed(style.color)), luminance(behind(element))].sort((p, q) => q - p);
    found.push({ratio: (a + 0.05) / (b + 0.05), needed: large ? 3 : 4.5, text: text.data.trim().slice(0, 40)});
  }
  return {texts: found.length, low: found.filter(({ratio, needed}) => ratio < needed), least: Math.min(...found.map(({ratio}) => ratio))};
});

// How many colours each canvas that is seen has.
const colours = page => page.evaluate(() => [...document.querySelectorAll("canvas")].filter(canvas => canvas.getClientRects().length).map(canvas => {
  const pixels = new Uint32Array(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data.buffer);
  return new Set(pixels).size;
}));

async function aRun() {
  const page = await opened(files.run, {hash: "#t=20"});
  seen.drawn = await page.evaluate(() => performance.getEntriesByName("drawn")[0].startTime);
  seen.loaded = await now(page);
  seen.colours = await colours(page);
  seen.keys = [];
  for (const pressed of [".", ",", "ArrowRight", "ArrowLeft", "n", "p", "End", "Home", "Shift+ArrowRight"]) {
    const [key, ...held] = pressed.split("+").reverse();
    for (const each of held) await page.keyboard.down(each);
    await page.keyboard.press(key);
    for (const each of held) await page.keyboard.up(each);
    seen.keys.push([pressed, (await now(page)).clock]);
  }
  await page.keyboard.press(" ");
  await page.waitForFunction(() => parseFloat(document.getElementById("clock").textContent) > 11);
  seen.playing = await page.evaluate(() => document.getElementById("play").textContent);
  await page.keyboard.press(" ");
  const stopped = await now(page);
  seen.paused = stopped.clock === (await now(page)).clock && await page.evaluate(() => document.getElementById("play").textContent);
  const buttons = await page.$$("#events button");
  await buttons[buttons.length - 1].click();
  seen.clicked = await now(page);
  await page.evaluate(() => { location.hash = "#t=5.1"; });
  await page.waitForFunction(() => document.getElementById("clock").textContent === "5.1 s");
  seen.linked = await now(page);
  seen.link = await page.evaluate(() => document.getElementById("link").getAttribute("href"));
  const line = await (await page.$("#line")).boundingBox();
  await page.mouse.click(line.x + 44 + (line.width - 52) / 2, line.y + 40);
  seen.half = await now(page);
  await (await page.$("figure canvas")).click();
  const box = (await page.$$("#layers input"))[0], plain = await page.evaluate(() => document.querySelector("figure canvas").toDataURL());
  await box.click(); await settled(page);
  seen.hidden = plain !== await page.evaluate(() => document.querySelector("figure canvas").toDataURL());
  seen.contrast = await contrasts(page);
  if (chromium) seen.tree = await page.accessibility.snapshot();
  fs.writeFileSync(path.join(files.out, `${browserName}.pdf`), await page.pdf({format: "A4"}));
  await settled(page);
  await page.close();
}

async function aPhone() {
  const page = await opened(files.run, {width: 360, height: 740, hash: "#t=2", touch: true});
  seen.phone = {width: await width(page), colours: (await colours(page)).slice(0, 2)};
  const line = await (await page.$("#line")).boundingBox(), y = line.y + 40, x = share => line.x + 44 + share * (line.width - 52);
  await page.touchscreen.touchStart(x(0.25), y);
  const first = await now(page);
  await page.touchscreen.touchMove(x(0.5), y);
  await page.touchscreen.touchMove(x(0.75), y);
  const second = await now(page);
  await page.touchscreen.touchEnd();
  Object.assign(seen.phone, {touched: first.clock, moved: second.clock});
  await page.close();
}

async function manyEvents() {
  const page = await opened(files.many, {hash: "#t=25"});
  await settled(page);
  seen.many = await page.evaluate(() => {
    const box = query => document.querySelector(query).getBoundingClientRect();
    const inside = (a, b) => a.top >= b.top - 1 && a.bottom <= b.bottom + 1;
    return {event: inside(box("#events [aria-current]"), box("#events")), legend: inside(box("#layers"), box("aside")), scrolled: scrollY};
  });
  await page.close();
}

async function severalRuns() {
  const page = await opened(files.several, {hash: "#t=20"});
  const captions = () => page.$$eval("figure", all => all.filter(one => one.getClientRects().length).map(one => one.querySelector("figcaption").textContent));
  await settled(page);
  seen.together = await captions();
  seen.parting = await page.$$eval("#events button", all => all.map(one => one.textContent).filter(text => text.includes("Parts from A")));
  await page.evaluate(() => [...document.querySelectorAll("#ways button")].pop().click());
  await settled(page);
  seen.beside = {captions: await captions(), colours: await colours(page), pressed: await page.$$eval("#ways button", all => all.map(one => one.getAttribute("aria-pressed")))};
  seen.several_contrast = await contrasts(page);
  await page.setViewport({width: 360, height: 740});
  await settled(page);
  seen.several_width = await width(page);
  await page.close();
}

async function anIndex() {
  const page = await opened(files.index);
  const names = () => page.$$eval("tbody tr", rows => rows.map(row => [row.querySelector("th").textContent, row.className]));
  seen.index = {before: await names(), contrast: await contrasts(page)};
  const heads = await page.$$("thead button");
  for (const which of ["first", "again"]) {
    await heads[1].click();
    seen.index[which] = [await names(), await page.$$eval("thead th", all => all.map(head => head.getAttribute("aria-sort")))];
  }
  seen.index.pictures = await page.$$eval("img", all => all.map(image => image.naturalWidth));
  await page.setViewport({width: 360, height: 740});
  seen.index.width = await width(page);
  await page.close();
}

async function byNight() {
  for (const [name, file] of [["run", files.run], ["several", files.several], ["index", files.index]]) {
    const page = await opened(file, {dark: true});
    seen[`${name}_by_night`] = await contrasts(page);
    await page.close();
  }
}

try {
  await aRun(); await aPhone(); await manyEvents(); await severalRuns(); await anIndex();
  if (chromium) await byNight();
  console.log(JSON.stringify(seen));
} finally {
  await browser.close();
}
