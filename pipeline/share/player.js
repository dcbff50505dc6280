// The player: what is where on the page, the clock, and who moves it.
let clock = 0, playing = false, before = 0, shown, pictures = [];
const SPEEDS = [0.5, 1, 2, 4, 8, 16, 32];

function setUp() {
  $("name").textContent = head.title;
  $("about").textContent = alone ? runs[0].about : runs.map(run => `${run.letter} ${run.name}`).join("; ");
  const damage = runs.filter(run => run.damage).map(run => `${run.letter} ${run.damage}`.trim());
  if (damage.length) $("about").append(make("div", {textContent: damage.join("; ")}));
  for (const [key, words, colour] of head.layers) {
    const box = make("input", {type: "checkbox", checked: layers[key] = true}), mark = make("i", {className: "swatch"});
    const stops = colour === null ? head.weights : colour === "runs" ? runs.map(run => run.colour) : null;
    mark.style.background = stops ? `linear-gradient(90deg, ${[...stops, stops[stops.length - 1]].map(css).join(",")})` : css(colour);
    box.onchange = () => { layers[key] = box.checked; dirty = true; };
    $("layers").append(make("label", {className: "layer"}, box, mark, words));
  }
  if (banded().length) $("states").append("state line:", ...head.verdicts.map(([kind]) => chip(kind)));
  for (const event of head.events) {
    event.button = make("button", {type: "button", className: event.level === "WARN" ? "warn" : ""});
    event.button.append(...(alone ? [] : [letter(runs[event.run]), " "]), event.text);
    event.button.onclick = () => go(event.time);
    $("events").append(make("li", {}, event.button));
  }
  for (const curve of head.curves.slice(1)) {
    curve.title = make("h2"); curve.canvas = make("canvas", {className: "curve"});
    curve.canvas.setAttribute("role", "img");
    scrub(curve.canvas);
    $("curves").append(curve.title, curve.canvas);
  }
  scrub($("line"));
  if (alone) $("run").textContent = head.about;
  else tables();
  for (const times of SPEEDS) $("speed").add(new Option(`${times} x`, times, times === 4, times === 4));
  Object.assign($("time"), {min: first(), max: last(), oninput: () => go(+$("time").value)});
  $("play").onclick = toggle; $("fit").onclick = fit; $("follow").onchange = () => { dirty = true; };
  $("link").onclick = () => { navigator.clipboard?.writeText($("link").href).catch(() => {}); };
  addEventListener("resize", () => { dirty = true; });
  addEventListener("hashchange", fromHash);
  addEventListener("keydown", key);
  matchMedia("(prefers-color-scheme: dark)").onchange = () => { dirty = true; };
  addEventListener("beforeprint", () => { printing = true; draw(); });
  addEventListener("afterprint", () => { printing = false; dirty = true; });
  $("line").style.height = `${lineHeight()}px`;
  arrange();
}

// Of several runs what came out, and in what their parameters differ, side by side.
function tables() {
  $("run").remove();
  $("more").open = true;
  $("more").firstChild.textContent = "Results, and parameters that differ";
  const heads = make("tr", {}, make("td"), ...runs.map(run => make("td", {}, letter(run))));
  const rows = head.table.map(([name, ...texts]) => make("tr", {}, make("th", {scope: "row", textContent: name}), ...texts.map(textContent => make("td", {textContent}))));
  $("more").append(make("div", {className: "wide", tabIndex: 0}, make("table", {}, heads, ...rows)));
}

function arrange() {
  const several = runs.filter(run => !run.track), tracks = runs.filter(run => run.track);
  const figure = (run, others) => {
    const canvas = make("canvas", {tabIndex: 0}), caption = make("figcaption");
    canvas.setAttribute("role", "img");
    const made = make("figure", {}, caption, canvas);
    $("maps").append(made);
    return Object.assign(new Picture(canvas, run, others), {figure: made, caption});
  };
  const beside = several.map(run => figure(run, null)), together = !alone && head.one_map ? [figure(runs[0], runs)] : [];
  beside[0].tracks = tracks;
  const show = chosen => {
    for (const picture of [...beside, ...together]) picture.figure.style.display = chosen.includes(picture) ? "" : "none";
    pictures = chosen;
    $("maps").style.gridTemplateColumns = `repeat(${Math.ceil(Math.sqrt(chosen.length))}, minmax(0, 1fr))`;
    document.body.classList.toggle("several", chosen.length > 1);
    document.body.classList.toggle("together", chosen === together);
    for (const button of $("ways").children) button.setAttribute("aria-pressed", button.ways === chosen);
    for (const view of looks.values()) delete view.scale;
    dirty = true;
  };
  if (together.length && several.length > 1)
    for (const [words, ways] of [["On one map", together], ["Side by side", beside]])
      $("ways").append(make("button", {type: "button", textContent: words, ways, onclick: () => show(ways)}));
  show(together.length ? together : beside);
}

function scrub(canvas) {
  canvas.onpointerdown = e => { canvas.setPointerCapture(e.pointerId); go(timeAt(canvas, e.offsetX)); };
  canvas.onpointermove = e => { if (e.buttons) go(timeAt(canvas, e.offsetX)); };
}

function go(to) {
  clock = Math.min(Math.max(to, first()), last());
  dirty = true;
}
function step(by) { go(instants[Math.min(Math.max(lastUntil(instants, clock) + by, 0), instants.length - 1)]); }
function toEvent(by) {
  const times = head.events.map(event => event.time);
  const to = by > 0 ? times.find(t => t > clock + 1e-3) : times.findLast(t => t < clock - 1e-3);
  if (to !== undefined) go(to);
}
function toggle() {
  if (!playing && clock >= last()) go(first());
  playing = !playing; $("play").textContent = playing ? "Pause" : "Play"; before = performance.now();
  for (const picture of pictures) picture.caption.setAttribute("aria-live", playing ? "off" : "polite");
}
function fit() { for (const picture of pictures) picture.fit(); }
function zoom(by) { for (const view of looks.values()) view.scale *= by; dirty = true; }

function key(e) {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === "SELECT") return;
  const pressed = ["BUTTON", "SUMMARY", "A"].includes(e.target.tagName) || e.target.type === "checkbox";
  const seconds = e.shiftKey ? 10 : 1;
  const does = {
    " ": pressed ? null : toggle, ArrowLeft: () => go(clock - seconds), ArrowRight: () => go(clock + seconds),
    ",": () => step(-1), ".": () => step(1), Home: () => go(first()), End: () => go(last()), p: () => toEvent(-1), n: () => toEvent(1),
    f: fit, "+": () => zoom(1.25), "-": () => zoom(0.8),
  }[e.key];
  if (!does) return;
  does();
  e.preventDefault();
}
function fromHash() {
  const at = /^#t=(\d+\.?\d*)/.exec(location.hash);
  if (at) go(+at[1]);
}

const metres = v => v === undefined || v !== v ? "–" : `${v.toFixed(2)} m`;
const degrees = angle => `${(angle * 180 / Math.PI).toFixed(1)}°`;
const errorOf = run => run.D.error ? run.D.error[lastUntil(run.D.error_times || run.D.times, clock)] : undefined;
const fromA = run => run.D.apart ? run.D.apart[lastUntil(run.D.apart_times, clock)] : undefined;

function tellOne(run) {
  const {D, row} = run, [x, y, yaw] = D.estimates.subarray(3 * row, 3 * row + 3), [a, b, s] = D.sigmas.subarray(3 * row, 3 * row + 3);
  const rows = [
    ["time", `${D.times[row].toFixed(2)} s, scan ${D.scans[row]}`],
    ["pose", `${x.toFixed(2)}, ${y.toFixed(2)} m, ${degrees(yaw)}`],
    ["sigma", `${a.toFixed(2)}, ${b.toFixed(2)} m, ${degrees(s)}`],
    ["particles", `${Math.round(D.count[row]).toLocaleString("en")} (${(D.particles_at[row + 1] - D.particles_at[row]).toLocaleString("en")} drawn)`],
  ];
  if (D.error[row] === D.error[row]) rows.push(["error", metres(D.error[row])]);
  return make("table", {}, ...rows.map(([name, text]) => make("tr", {}, make("th", {scope: "row", textContent: name}), make("td", {textContent: text}))));
}

function tellAll() {
  const cells = (tag, ...texts) => texts.map(text => make(tag, {}, text));
  const heads = make("tr", {}, ...cells("th", "", "state"), ...cells("td", "error", "from A"));
  return make("table", {}, heads, ...runs.map(run => {
    const verdict = verdictOf(run);
    return make("tr", {}, ...cells("th", letter(run), verdict ? chip(verdict[0]) : "–"),
      ...cells("td", metres(errorOf(run)), run === runs[0] ? "" : metres(fromA(run))));
  }));
}

// What a picture's caption says: of one run all of it, of several each in a line.
function caption(picture) {
  const told = run => {
    const verdict = verdictOf(run);
    return [...(alone ? [] : [letter(run), ` ${run.name} `]), ...(verdict ? [chip(verdict[0]), " "] : [])];
  };
  if (!picture.others) return [make("p", {}, said(picture.run) || told(picture.run)[0] || "")];
  return picture.others.map(run => {
    const [x, y] = run.D.estimates.subarray(3 * run.row, 3 * run.row + 2);
    const where = run.row < 0 ? "Not begun yet." : `at (${x.toFixed(1)}, ${y.toFixed(1)}) m`;
    return make("p", {}, ...told(run), where, run === runs[0] || run.row < 0 ? "" : `, ${metres(fromA(run))} from A`);
  });
}

function tell() {
  for (const picture of pictures) {
    picture.caption.replaceChildren(...caption(picture));
    picture.canvas.setAttribute("aria-label", `Map: ${picture.caption.textContent}`);
  }
  $("now").replaceChildren(alone ? tellOne(runs[0]) : tellAll());
  $("clock").textContent = `${clock.toFixed(1)} s`;
  $("time").value = clock;
  $("time").setAttribute("aria-valuetext", `${clock.toFixed(1)} seconds; ${pictures.map(picture => picture.caption.textContent).join(" ")}`);
  Object.assign($("link"), {href: `#t=${clock.toFixed(2)}`, textContent: `link to ${clock.toFixed(1)} s`});
  const latest = head.events.filter(event => event.time <= clock + 1e-6).pop();
  if (latest === shown) return;
  if (shown) shown.button.removeAttribute("aria-current");
  shown = latest;
  if (!latest) return;
  latest.button.setAttribute("aria-current", "true");
  reveal(latest.button);
}
function reveal(item) {  // scrollIntoView would scroll the page too
  const list = $("events"), top = item.offsetTop, bottom = top + item.offsetHeight;
  list.scrollTop = Math.min(Math.max(list.scrollTop, bottom - list.clientHeight), top);
}

function draw() {
  const ratio = printing ? 2 : devicePixelRatio || 1, [main, ...others] = head.curves;
  for (const run of runs) run.row = lastUntil(run.D.times, clock);
  for (const picture of pictures) picture.draw(ratio);
  timeLine($("line"), main, ratio);
  for (const curve of others) {
    plot(curve.canvas, curve, ratio);
    curve.title.textContent = reading(curve);
    curve.canvas.setAttribute("aria-label", `Curve over time: ${curve.title.textContent}`);
  }
  tell();
  $("reading").textContent = reading(main);
  $("line").setAttribute("aria-label", `Time line with states and events; curve: ${reading(main)}`);
}

function frame(now) {
  if (playing) {
    go(clock + (now - before) / 1000 * +$("speed").value); before = now;
    if (clock >= last()) toggle();
  }
  if (dirty) { dirty = false; draw(); }
  requestAnimationFrame(frame);
}

unpack().then(() => {
  clock = first();
  setUp(); fromHash(); draw();
  $("wait").remove(); performance.mark("drawn"); document.body.dataset.ready = instants.length; requestAnimationFrame(frame);
}).catch(error => { $("wait").textContent = `This browser cannot show the recording: ${error}`; throw error; });
