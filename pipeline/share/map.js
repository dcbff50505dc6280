// Pictures of the map: of one run with all that it believes and sees, or of all of them with their ways.
const layers = {};                // by name, whether it is drawn
const DASHES = [[], [10, 4], [3, 3], [12, 4, 3, 4], [6, 6], [2, 6]];  // of the runs' ways, beside their colours
let dirty = true;
const looks = new Map();          // by area of a map: what of it is seen, shared by all its pictures

function ground(run) {
  const {width, height} = run.map, picture = make("canvas", {width, height});
  const context = picture.getContext("2d"), image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer), grey = Uint32Array.from({length: 256}, (_, k) => (0xff000000 | k * 0x010101) >>> 0);
  for (let k = 0; k < pixels.length; k++) pixels[k] = grey[run.D.shades[k]];
  context.putImageData(image, 0, 0);
  return picture;
}

// Positions are stored in 65,535 steps from one side of everything to the other.
const X = k => head.low[0] + k * head.step, Y = k => head.low[1] + k * head.step;

class Picture {
  // Of the run's map: what it believes and sees; if `others` are given, their ways and its own instead.
  constructor(canvas, run, others = null) {
    Object.assign(this, {canvas, run, others});
    const key = JSON.stringify([run.area, run.map]);
    if (!looks.has(key)) looks.set(key, {ground: ground(run)});
    this.view = looks.get(key);
    this.moveAndZoom();
  }

  fit() {
    const [x0, y0, x1, y1] = this.run.area, {clientWidth: w, clientHeight: h} = this.canvas, view = this.view;
    Object.assign(view, {x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: Math.min(w / (x1 - x0), h / (y1 - y0))});
    view.whole = true;
    $("follow").checked = false; dirty = true;
  }

  moveAndZoom() {
    const canvas = this.canvas, view = this.view, held = new Map();
    const zoom = (by, x, y) => {
      const dx = x - canvas.clientWidth / 2, dy = canvas.clientHeight / 2 - y, scale = Math.min(Math.max(view.scale * by, 0.5), 2000);
      if (!$("follow").checked) { view.x += dx / view.scale - dx / scale; view.y += dy / view.scale - dy / scale; }
      view.scale = scale; view.whole = false; dirty = true;
    };
    canvas.onwheel = e => { e.preventDefault(); zoom(Math.exp(-e.deltaY * 0.0015), e.offsetX, e.offsetY); };
    canvas.onpointerdown = e => { held.set(e.pointerId, [e.offsetX, e.offsetY]); canvas.setPointerCapture(e.pointerId); };
    canvas.onpointerup = canvas.onpointercancel = e => held.delete(e.pointerId);
    canvas.onpointermove = e => {
      if (!held.has(e.pointerId)) return;
      const [x, y] = held.get(e.pointerId), others = [...held].filter(([id]) => id !== e.pointerId);
      if (others.length) {
        const [ox, oy] = others[0][1];
        zoom(Math.hypot(e.offsetX - ox, e.offsetY - oy) / Math.max(Math.hypot(x - ox, y - oy), 1), ox, oy);
      } else {
        $("follow").checked = false;
        view.x -= (e.offsetX - x) / view.scale; view.y += (e.offsetY - y) / view.scale; view.whole = false; dirty = true;
      }
      held.set(e.pointerId, [e.offsetX, e.offsetY]);
    };
  }

  draw(ratio) {
    const {canvas, run, view} = this, w = canvas.clientWidth, h = canvas.clientHeight;
    if (!w || !h) return;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
      canvas.width = Math.round(w * ratio); canvas.height = Math.round(h * ratio);
      if (view.whole) this.fit();
    }
    if (view.scale === undefined) this.fit();
    let {x, y} = view;
    if ($("follow").checked && run.row >= 0) {
      [x, y] = run.D.estimates.subarray(3 * run.row, 3 * run.row + 2);
      Object.assign(view, {x, y});
    }
    const c = canvas.getContext("2d"), k = view.scale;
    const at = {c, k, w, h, sx: p => (p - x) * k + w / 2, sy: q => h / 2 - (q - y) * k, near: k > 25, taken: []};
    c.setTransform(1, 0, 0, 1, 0, 0); c.fillStyle = css(head.unknown); c.fillRect(0, 0, canvas.width, canvas.height);
    const [ox, oy, yaw] = run.map.origin, f = ratio * k * run.map.resolution, cos = Math.cos(yaw), sin = Math.sin(yaw);
    c.imageSmoothingEnabled = f < 1;
    c.setTransform(f * cos, -f * sin, -f * sin, -f * cos, ratio * at.sx(ox), ratio * at.sy(oy));
    c.drawImage(view.ground, 0, 0);
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    changedCells(at, run);
    if (this.others) for (const one of this.others) way(at, one);
    else { scene(at, run); for (const track of this.tracks || []) way(at, track); }
    scaleBar(at);
  }
}

// Where the world is known not to be as mapped, by now.
function changedCells({c, k, sx, sy}, run) {
  const D = run.D, side = Math.max(run.map.resolution * k, 1.5), names = ["", "new", "gone", "floor"];
  for (let i = 0; i < D.changed_kind.length; i++) {
    const kind = D.changed_kind[i];
    if (!layers[names[kind]] || run.row < D.changed_from[i] || run.row >= D.changed_until[i]) continue;
    c.fillStyle = css(head.changed[kind]);
    c.fillRect(sx(X(D.changed[2 * i])) - side / 2, sy(Y(D.changed[2 * i + 1])) - side / 2, side, side);
  }
}

function path({c, sx, sy}, poses, until, joined, colour, width, dash = []) {
  c.beginPath(); c.strokeStyle = colour; c.lineWidth = width; c.setLineDash(dash);
  for (let i = 0; i <= until; i++) {
    const x = poses[3 * i], y = poses[3 * i + 1];
    if (i && joined(i)) c.lineTo(sx(x), sy(y)); else c.moveTo(sx(x), sy(y));
  }
  c.stroke(); c.setLineDash([]);
}

function robot({c, k, sx, sy, taken}, poses, row, colour, name = "") {
  const [x, y, turn] = poses.subarray(3 * row, 3 * row + 3), r = Math.max(0.3 * k, 7);
  if (x !== x) return;
  for (const [stroke, width] of [["#fff", 5], [colour, 2.5]]) {
    c.strokeStyle = stroke; c.lineWidth = width; c.beginPath(); c.arc(sx(x), sy(y), r, 0, 7);
    c.moveTo(sx(x), sy(y)); c.lineTo(sx(x) + 2.2 * r * Math.cos(turn), sy(y) - 2.2 * r * Math.sin(turn)); c.stroke();
  }
  if (name) labelled(c, taken, name, sx(x) + r + 3, sy(y) + r + 12, 15, 0);
}

// Words beside what they belong to, or a step further where others stand already.
function labelled(c, taken, words, x, y, across, down, colour) {
  const wide = 8 * words.length + 6;
  while (taken.some(([p, q, r]) => p < x + wide && x < p + r && Math.abs(q - y) < 16)) { x += across; y += down; }
  taken.push([x, y, wide]);
  lettering(c, words, x, y, colour);
}

function lettering(c, words, x, y, colour = "#111") {
  c.font = "bold 13px system-ui, sans-serif";
  c.fillStyle = "rgba(255,255,255,.85)"; c.fillRect(x - 3, y - 12, c.measureText(words).width + 6, 16);
  c.fillStyle = colour; c.fillText(words, x, y);
}

const near = D => i => Math.hypot(D.truth[3 * i] - D.truth[3 * i - 3], D.truth[3 * i + 1] - D.truth[3 * i - 2]) < 1;

function way(at, run) {
  const {D, row} = run, colour = css(run.colour);
  if (row < 0) return;
  if (run === runs[0] && layers.truth) { path(at, D.truth, row, near(D), css(head.colours.truth), 1.5); robot(at, D.truth, row, css(head.colours.truth)); }
  if (!layers.estimate) return;
  path(at, D.estimates, row, i => D.joined[i], colour, 2.5, DASHES[runs.indexOf(run)]);
  robot(at, D.estimates, row, colour, run.letter);
}

function scene(at, run) {
  const {c, k, w, h, sx, sy} = at, {D, row} = run, colours = head.colours, own = css(run.colour);
  if (row < 0) return;
  const span = name => [D[name + "_at"][row], D[name + "_at"][row + 1]];
  if (layers.heat) {
    const [a, b] = span("heat"), side = Math.max(run.map.resolution * k, 1);
    c.globalAlpha = 0.6;
    for (let i = a; i < b; i++) {
      c.fillStyle = css(head.weights[D.heat_level[i]]);
      c.fillRect(sx(X(D.heat[2 * i])) - side / 2, sy(Y(D.heat[2 * i + 1])) - side / 2, side, side);
    }
    c.globalAlpha = 1;
  }
  if (layers.hindsight) {
    c.beginPath(); c.strokeStyle = css(colours.hindsight); c.lineWidth = 2;
    for (let p = 0; p + 1 < D.hindsight_at.length; p++)
      for (let i = D.hindsight_at[p]; i < D.hindsight_at[p + 1]; i++)
        c[i === D.hindsight_at[p] ? "moveTo" : "lineTo"](sx(D.hindsight[2 * i]), sy(D.hindsight[2 * i + 1]));
    c.stroke();
  }
  if (layers.truth) path(at, D.truth, row, near(D), css(colours.truth), 2);
  if (layers.estimate) path(at, D.estimates, row, i => D.joined[i], own, 2);
  for (const kind of ["no_return", "hits", "shorts", "longs"]) {
    if (!layers[kind]) continue;
    const [a, b] = span(kind), x = sx(D.lasers[3 * row]), y = sy(D.lasers[3 * row + 1]);
    c.beginPath(); c.strokeStyle = css(colours[kind]); c.lineWidth = at.near ? 1 : 0.7;
    for (let i = a; i < b; i++) { c.moveTo(x, y); c.lineTo(sx(X(D[kind][2 * i])), sy(Y(D[kind][2 * i + 1]))); }
    c.stroke();
  }
  if (layers.particles) {
    const [a, b] = span("particles"), size = at.near ? 5 : 3;
    for (let i = a; i < b; i++) {
      const x = sx(X(D.particles[2 * i])), y = sy(Y(D.particles[2 * i + 1]));
      if (x < -9 || y < -9 || x > w + 9 || y > h + 9) continue;
      c.fillStyle = c.strokeStyle = css(head.weights[D.level[i]]);
      c.fillRect(x - size / 2, y - size / 2, size, size);
      if (at.near) {
        const turn = D.heading[i] * Math.PI / 128;
        c.lineWidth = 1; c.beginPath(); c.moveTo(x, y); c.lineTo(x + 10 * Math.cos(turn), y - 10 * Math.sin(turn)); c.stroke();
      }
    }
  }
  if (layers.expected) {
    const [a, b] = span("expected"), size = at.near ? 5 : 2;
    c.fillStyle = css(colours.expected);
    for (let i = a; i < b; i++) c.fillRect(sx(X(D.expected[2 * i])) - size / 2, sy(Y(D.expected[2 * i + 1])) - size / 2, size, size);
  }
  const ellipses = (name, colour) => {
    const [a, b] = span(name);
    c.strokeStyle = colour; c.lineWidth = 2;
    for (let i = a; i < b; i++) {
      const [x, y, p, q, turn] = D[name].subarray(5 * i, 5 * i + 5);
      c.beginPath(); c.ellipse(sx(x), sy(y), Math.max(p * k, 2), Math.max(q * k, 2), -turn, 0, 7); c.stroke();
    }
  };
  if (layers.hypotheses) ellipses("hypotheses", css(colours.hypotheses));
  if (layers.estimate) ellipses("ellipses", own);
  if (layers.truth) robot(at, D.truth, row, css(colours.truth));
  if (layers.estimate) robot(at, D.estimates, row, own, run.letter);
  if (layers.hypotheses) {
    const [a] = span("hypotheses");
    run.labels[row].forEach((words, i) => {
      labelled(c, at.taken, words, sx(D.hypotheses[5 * (a + i)]) + 9, sy(D.hypotheses[5 * (a + i) + 1]) - 9, 0, 16, "rgb(150,25,95)");
    });
  }
}

function scaleBar({c, h, k, w}) {
  const wanted = 0.18 * w / k, decade = 10 ** Math.floor(Math.log10(wanted));
  const metres = decade * [1, 2, 5].filter(m => m * decade <= wanted).pop();
  c.fillStyle = "rgba(255,255,255,.85)"; c.fillRect(10, h - 40, metres * k + 12, 30);
  c.fillStyle = "#111"; c.fillRect(16, h - 18, metres * k, 4);
  c.font = "12px system-ui, sans-serif"; c.textAlign = "center"; c.fillText(`${+metres.toPrecision(3)} m`, 16 + metres * k / 2, h - 24); c.textAlign = "start";
}
