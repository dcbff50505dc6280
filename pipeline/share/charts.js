// Curves over time, with axes; above the time line also the state of every run, and ticks where something happened.
const LEFT = 44, RIGHT = 8;       // pixels beside a plot: the slider's own ends lie there too
let printing = false;

function inks() {
  const style = getComputedStyle(document.documentElement), ink = name => style.getPropertyValue(name).trim();
  return printing ? {ink: "#1b1b1b", pale: "#555", line: "#cfcfcf", past: "#c4c4c4"}
    : {ink: ink("--ink"), pale: ink("--pale"), line: ink("--line"), past: ink("--past")};
}

// Values of a curve, a line for each run that has some.
function lines(curve) {
  const found = [];
  for (const run of runs) {
    const values = run.D[curve.name], times = run.D[`${curve.name}_times`] || run.D.times;
    if (values && values.some(v => v === v)) found.push({run, times, values, colour: css(alone ? curve.colour : run.colour)});
  }
  return found;
}

// Where values lie between bottom (0) and top (1) of a plot, and what is written beside it.
function axis(curve, all) {
  let top = 1e-3, least = Infinity;
  for (const {values} of all) for (const v of values) { if (v > top) top = v; if (v > 0 && v < least) least = v; }
  if (curve.axis === "share") return {place: v => v, ticks: [0, 0.5, 1]};
  if (curve.axis === "logarithmic") {
    const low = Math.max(Math.floor(Math.log10(least)), -2), high = Math.max(Math.ceil(Math.log10(top)), low + 1);
    const ticks = Array.from({length: high - low + 1}, (_, k) => 10 ** (low + k));
    return {place: v => (Math.log10(Math.max(v, 10 ** low)) - low) / (high - low), ticks, guide: 0.5};
  }
  const step = nice(top / 2);
  return {place: v => v / (1.02 * top), ticks: [0, step, 2 * step].filter(v => v <= top)};
}
function nice(wanted) {
  const decade = 10 ** Math.floor(Math.log10(wanted));
  return decade * ([5, 2, 1].find(m => m * decade <= wanted) || 1);
}
const brief = v => v >= 10000 ? `${+(v / 1000).toPrecision(3)}k` : `${+v.toPrecision(3)}`;

const first = () => instants[0], last = () => instants[instants.length - 1];
const across = w => t => LEFT + (t - first()) / Math.max(last() - first(), 1e-9) * (w - LEFT - RIGHT);
const timeAt = (canvas, x) => first() + (x - LEFT) / Math.max(canvas.clientWidth - LEFT - RIGHT, 1) * (last() - first());

function plot(canvas, curve, ratio, top = 0, bottom = 0) {
  const w = canvas.clientWidth, h = canvas.clientHeight, ink = inks();
  if (!w) return;
  canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
  const c = canvas.getContext("2d"), x = across(w), high = h - top - bottom - 10;
  c.scale(ratio, ratio); c.font = "11px system-ui, sans-serif";
  if (curve) {
    curve.all ||= lines(curve); curve.axis_of ||= axis(curve, curve.all);
    const {place, ticks, guide} = curve.axis_of, y = v => top + 5 + (1 - Math.min(Math.max(place(v), 0), 1)) * high;
    c.textAlign = "right"; c.textBaseline = "middle"; c.lineWidth = 1;
    for (const v of ticks) {
      c.strokeStyle = ink.line; c.beginPath(); c.moveTo(LEFT, y(v)); c.lineTo(w - RIGHT, y(v)); c.stroke();
      c.fillStyle = ink.pale; c.fillText(brief(v), LEFT - 5, y(v));
    }
    if (guide) {
      c.strokeStyle = ink.pale; c.setLineDash([2, 4]); c.beginPath(); c.moveTo(LEFT, y(guide)); c.lineTo(w - RIGHT, y(guide)); c.stroke(); c.setLineDash([]);
    }
    for (const {run, times, values, colour} of curve.all) {
      const line = (until, stroke, width) => {
        c.beginPath(); c.strokeStyle = stroke; c.lineWidth = width; c.setLineDash(alone ? [] : DASHES[runs.indexOf(run)]);
        let before = false;
        for (let i = 0; i < times.length && times[i] <= until + 1e-6; i++) {
          const there = values[i] === values[i] && !(i && run.gap && times[i] - times[i - 1] > run.gap);
          if (values[i] === values[i]) c[before && there ? "lineTo" : "moveTo"](x(times[i]), y(values[i]));
          before = values[i] === values[i];
        }
        c.stroke(); c.setLineDash([]);
      };
      line(Infinity, ink.past, 1); line(clock, colour, 1.8);
    }
  }
  c.strokeStyle = ink.ink; c.lineWidth = 1; c.beginPath(); c.moveTo(x(clock), 0); c.lineTo(x(clock), h - bottom); c.stroke();
  return {c, x, w, h, ink};
}

// What is written above a curve: its name, and what it is now.
function reading(curve) {
  const now = curve.all.map(({run, times, values}) => {
    const v = values[lastUntil(times, clock)];
    const text = v === undefined || v !== v ? "–" : v >= 100 ? Math.round(v).toLocaleString("en") : v.toFixed(2);
    return alone ? text : `${run.letter} ${text}`;
  });
  return `${curve.words}: ${now.join(", ")}`;
}

// The time line: ticks of events, a band of states for every run, the first curve, and seconds.
const BAND = 15, TICKS = 9, AXIS = 16, CURVE = 74;
const banded = () => runs.filter(run => run.D.verdicts && run.D.verdicts.length);
const lineHeight = () => TICKS + BAND * banded().length + CURVE + AXIS;
function timeLine(canvas, curve, ratio) {
  const plotted = plot(canvas, curve, ratio, TICKS + BAND * banded().length, AXIS);
  if (!plotted) return;
  const {c, x, w, h, ink} = plotted;
  banded().forEach((run, k) => band(c, x, run, TICKS + BAND * k, ink));
  for (const event of head.events) {
    const warn = event.level === "WARN";
    c.fillStyle = warn ? "#d55e00" : "#0072b2";
    c.fillRect(x(event.time) - 1.5, warn ? 0 : 3, 3, warn ? 8 : 5);
  }
  c.fillStyle = ink.pale; c.strokeStyle = ink.pale; c.lineWidth = 1; c.textBaseline = "alphabetic";
  const step = nice((last() - first()) / Math.max((w - LEFT) / 90, 1)) || 1;
  for (let t = Math.ceil(first() / step) * step; t <= last() + 1e-9; t += step) {
    c.textAlign = t === 0 ? "left" : x(t) > w - 24 ? "right" : "center";
    c.fillText(t ? `${+t.toFixed(3)}` : "0 s", x(t), h - 3);
    c.fillRect(x(t) - 0.5, h - AXIS - 2, 1, 4);
  }
  c.strokeStyle = ink.ink; c.lineWidth = 1.5; c.beginPath(); c.moveTo(x(clock), 0); c.lineTo(x(clock), h - AXIS); c.stroke();
}

function band(c, x, run, top, ink) {
  const {times, verdicts} = run.D;
  c.textAlign = "right"; c.textBaseline = "middle"; c.fillStyle = ink.ink;
  c.fillText(alone ? "state" : run.letter, LEFT - 5, top + BAND / 2);
  for (let i = 0; i < run.n;) {
    let j = i + 1;
    while (j < run.n && verdicts[j] === verdicts[i] && times[j] - times[j - 1] <= run.gap) j++;
    const silent = j < run.n && times[j] - times[j - 1] > run.gap;  // nobody knows what was between
    const from = x(times[i]), until = Math.max(x(silent || j === run.n ? times[j - 1] : times[j]), from + 1), [kind, colour] = head.verdicts[verdicts[i]];
    c.fillStyle = css(colour); c.fillRect(from, top + 1, until - from, BAND - 2);
    hatch(c, kind, from, until, top + 1, BAND - 2);
    const wide = c.measureText(kind).width;
    if (wide + 10 < until - from) {
      c.fillStyle = css(colour); c.fillRect((from + until - wide) / 2 - 3, top + 1, wide + 6, BAND - 2);
      c.fillStyle = "#000"; c.textAlign = "center"; c.fillText(kind, (from + until) / 2, top + BAND / 2 + 0.5);
    }
    i = j;
  }
}

// Found is plain; the others are told apart by lines as well.
function hatch(c, kind, from, until, top, high) {
  if (kind === "found") return;
  c.save(); c.beginPath(); c.rect(from, top, until - from, high); c.clip();
  c.strokeStyle = "rgba(0,0,0,.55)"; c.lineWidth = 1; c.beginPath();
  if (kind === "off the map") for (const k of [0.3, 0.7]) { c.moveTo(from, top + k * high); c.lineTo(until, top + k * high); }
  else for (let p = Math.floor(from / 6) * 6 - high; p < until; p += 6) {
    if (kind === "lost") { c.moveTo(p, top + high); c.lineTo(p + high, top); }
    else { c.moveTo(p, top); c.lineTo(p, top + high); }
  }
  c.stroke(); c.restore();
}
