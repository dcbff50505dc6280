// The runs of this page: what the head says of each, and its arrays.
const $ = id => document.getElementById(id);
const make = (tag, properties, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};
const css = c => `rgb(${c.join(",")})`;
const head = JSON.parse($("head").textContent);
const runs = head.runs;           // each with D, its arrays by name, n, its scans, and row, the scan that is shown, or -1
const alone = runs.length === 1;
let instants = [];                // s, of all scans of all runs

function bytesOf(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  return bytes;
}

async function unpack() {
  const packed = bytesOf($("data").textContent);
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = await new Response(stream).arrayBuffer();
  const kinds = {f8: Float64Array, f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array};
  for (const run of runs) {
    run.D = {};
    for (const [name, kind, at, length] of run.arrays) run.D[name] = new kinds[kind](bytes, at, length);
    run.n = run.D.times.length;
    run.row = -1;
    if (!run.track) Object.assign(run, JSON.parse(new TextDecoder().decode(run.D.texts)));
  }
  instants = [...new Set(runs.filter(run => !run.track).flatMap(run => [...run.D.times]))].sort((a, b) => a - b);
  $("data").remove();
}

// The last of the times (sorted, s) until this one; -1 before the first.
function lastUntil(times, time) {
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] <= time + 1e-6) low = middle + 1; else high = middle; }
  return low - 1;
}

const verdictOf = (run, row = run.row) => row < 0 || !run.D.verdicts || !run.D.verdicts.length ? null : head.verdicts[run.D.verdicts[row]];
const chip = kind => make("span", {className: `verdict ${kind.split(" ")[0]}`, textContent: kind});
const said = run => run.row < 0 ? "Not begun yet." : run.said[run.D.said_at[run.row]];
const letter = run => {
  const made = make("span", {className: "letter", textContent: run.letter});
  const [r, g, b] = run.colour;
  made.style.background = css(run.colour); made.style.color = 2 * r + 7 * g + b < 1030 ? "#fff" : "#000";
  return made;
};
