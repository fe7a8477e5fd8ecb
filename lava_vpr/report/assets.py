"""The page's style sheet and script. Both are inline: a report is one file that asks the network for nothing."""

from __future__ import annotations

STYLE = """
:root{color-scheme:light dark;
--sans:system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue","Noto Sans","DejaVu Sans",Arial,sans-serif;
--mono:ui-monospace,SFMono-Regular,Menlo,Consolas,"DejaVu Sans Mono",monospace;
--page:#f6f7f8;--panel:#fff;--ink:#1a2127;--muted:#55616b;--line:#d5dbe0;--soft:#edf1f4;
--right:#0067a8;--wrong:#c24a00;
--c0:#0067a8;--c1:#c24a00;--c2:#00805c;--c3:#a5478b;--c4:#a87400;--c5:#2b8fc9;--c6:#6b6f76;--c7:#7a4b2a}
@media (prefers-color-scheme:dark){:root{
--page:#12171b;--panel:#1a2126;--ink:#e8edf0;--muted:#a3b0ba;--line:#39444c;--soft:#242d33;
--right:#5cb8f0;--wrong:#ff8f4f;
--c0:#5cb8f0;--c1:#ff8f4f;--c2:#3fc79a;--c3:#e08cc6;--c4:#e6b13c;--c5:#9ad4f5;--c6:#a9b0b8;--c7:#cf9c78}}
*{box-sizing:border-box}
html{scroll-behavior:smooth;-webkit-text-size-adjust:100%}
@media (prefers-reduced-motion:reduce){html{scroll-behavior:auto}}
body{margin:0;background:var(--page);color:var(--ink);font:16px/1.55 var(--sans)}
main,header,nav>ul,footer{max-width:1120px;margin:0 auto;padding:0 20px}
header{padding-top:36px}
h1{font-size:1.35rem;line-height:1.25;margin:0 0 18px;font-weight:650;overflow-wrap:anywhere}
h2{font-size:1.22rem;line-height:1.3;margin:0 0 6px;font-weight:650}
h3{font-size:.95rem;line-height:1.35;margin:0 0 8px;font-weight:600;overflow-wrap:anywhere}
p{margin:0 0 12px;max-width:86ch}
.note{color:var(--muted);font-size:.92rem}
.hero{display:grid;grid-template-columns:minmax(0,1.05fr) minmax(0,1fr);gap:24px 48px;align-items:center}
.big{font-size:clamp(2.1rem,5.2vw,3.4rem);line-height:1.08;font-weight:700;letter-spacing:-.02em;margin:0 0 10px}
.big b{color:var(--right);white-space:nowrap}
.bars{display:grid;grid-template-columns:max-content 1fr max-content;gap:7px 12px;align-items:center;margin:0;
font-size:.95rem}
.bars dt{font-weight:500}.bars dd{margin:0}.bars .first{font-weight:700}
.track{height:14px;background:var(--soft);border-radius:3px;overflow:hidden}
.track i{display:block;height:100%;background:var(--c6)}.track.first i{background:var(--right)}
.num{font-variant-numeric:tabular-nums}
.facts{display:flex;flex-wrap:wrap;gap:10px 28px;margin:26px 0 8px;padding:16px 0 0;border-top:1px solid var(--line)}
.facts div,.tiles div{min-width:0}
.facts dt,.tiles dt{color:var(--muted);font-size:.8rem}
.facts dd,.tiles dd{margin:0;font-weight:600;overflow-wrap:anywhere;font-variant-numeric:tabular-nums}
nav{position:sticky;top:0;z-index:5;background:var(--page);border-bottom:1px solid var(--line)}
nav>ul{display:flex;gap:4px 20px;overflow-x:auto;list-style:none;padding-top:9px;padding-bottom:9px;font-size:.9rem}
nav a{color:var(--muted);text-decoration:none;white-space:nowrap}
nav a:hover,nav a:focus{color:var(--ink);text-decoration:underline}
section{padding:30px 0 6px;scroll-margin-top:36px}
.panel{background:var(--panel);border:1px solid var(--line);border-radius:8px;padding:16px}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%;font-size:.95rem}
th,td{padding:8px 12px;text-align:right;border-bottom:1px solid var(--line);white-space:nowrap}
tr:last-child td,tr:last-child th[scope=row]{border-bottom:0}
th:first-child,td:first-child{text-align:left}
tbody th{font-weight:500}
td{font-variant-numeric:tabular-nums}
caption.unseen{position:absolute;width:1px;height:1px;overflow:hidden;clip-path:inset(50%)}
td.best{font-weight:700}
tr.default{background:color-mix(in srgb,var(--right) 9%,transparent)}
tr.default th{font-weight:700}
th button{all:unset;cursor:pointer;font-weight:600;color:var(--muted)}
th button:hover{color:var(--ink)}
th[aria-sort] button::after{content:" \\2193";color:var(--right)}
th[aria-sort=ascending] button::after{content:" \\2191"}
.tag{display:inline-block;margin-left:8px;padding:0 7px;border-radius:9px;font-size:.75rem;font-weight:600;
background:var(--soft);color:var(--muted)}
.tag.default{background:var(--right);color:var(--panel)}
:focus-visible,th button:focus-visible{outline:2px solid var(--right);outline-offset:2px}
svg{display:block;width:100%;height:auto;font-family:var(--sans)}
svg text{font-family:var(--sans)}
.pr{display:grid;grid-template-columns:minmax(0,1.6fr) minmax(220px,1fr);gap:16px 28px;align-items:center}
.legend{list-style:none;margin:0;padding:0;font-size:.93rem}
.legend label{display:grid;grid-template-columns:auto 34px 1fr auto;gap:10px;align-items:center;padding:4px 6px;
border-radius:5px;cursor:pointer}
.legend label:hover{background:var(--soft)}
.legend svg{width:34px;height:12px}
.legend .off{opacity:.45}
.dim{opacity:.13}
.gone{display:none}
.tools{display:flex;flex-wrap:wrap;gap:6px 20px;margin:0 0 12px;font-size:.92rem;color:var(--muted)}
.tools label{display:inline-flex;gap:6px;align-items:center;cursor:pointer}
.grid{display:grid;gap:16px}
.matrices{grid-template-columns:repeat(auto-fit,minmax(min(100%,290px),1fr))}
.rasters{grid-template-columns:repeat(auto-fit,minmax(min(100%,440px),1fr))}
.fields{grid-template-columns:repeat(auto-fill,minmax(min(47%,190px),1fr));gap:16px}
.matches{grid-template-columns:repeat(auto-fill,minmax(min(100%,440px),1fr))}
.match h3{display:flex;justify-content:space-between;gap:12px}
.match h3 .note{font-weight:400}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:14px 20px;margin:0}
.tiles dd{font-size:1.35rem}
figure{margin:0;min-width:0}
figcaption{font-size:.85rem;color:var(--muted);margin-top:6px;overflow-wrap:anywhere}
img{display:block;width:100%;height:auto;border-radius:3px;background:var(--soft)}
.matrix-box{cursor:crosshair}
.readout{min-height:1.5em;font-size:.85rem;color:var(--muted);margin:4px 0 0;overflow-wrap:anywhere}
.whole [id$='-query']:is(image),.per-query [id$='-whole']:is(image){display:none}
.rasters .panel>svg{margin-top:12px}
.field .pair{display:grid;gap:4px}
.field .drawn{position:relative;background:var(--soft);border-radius:3px;overflow:hidden}
.strokes{position:absolute;inset:0;width:100%;height:100%}
.strokes path{fill:none;stroke:var(--ink);stroke-width:1.7px;stroke-linecap:round;vector-effect:non-scaling-stroke}
.drawn img{image-rendering:pixelated;height:100%;position:absolute;inset:0}
.overlay .pair{gap:0}
.overlay .pair>*{grid-area:1/1}
.overlay .drawn{background:rgb(0 0 0/.45)}
.overlay .strokes path{stroke:#ffd84a}
.trio{display:grid;grid-template-columns:repeat(3,minmax(0,1fr));gap:8px}
.duo{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:8px}
.trio figcaption,.duo figcaption{font-size:.78rem;line-height:1.35;margin-top:3px}
.none{display:grid;place-items:center;background:var(--soft);border-radius:3px;color:var(--muted);font-size:.8rem;
text-align:center;padding:4px}
.right{color:var(--right)}.wrong{color:var(--wrong)}
.verdict{font-weight:650}
.route{height:150px;cursor:crosshair}
.route rect.r{fill:var(--right)}.route rect.w,.route path.w{fill:var(--wrong)}.route rect.n{fill:var(--c6)}
.route line{stroke:var(--ink);stroke-width:1px;stroke-dasharray:4 3;vector-effect:non-scaling-stroke}
.route .hit{fill:transparent}
.route .now{fill:var(--ink);opacity:.16}
.key{display:inline-block;width:11px;height:11px;border-radius:2px;margin-right:5px;vertical-align:-1px}
.key.r{background:var(--right)}.key.w{background:var(--wrong)}.key.n{background:var(--c6)}
.browse{display:grid;grid-template-columns:auto 1fr auto;gap:12px;align-items:center;margin:14px 0 10px}
.browse input{width:100%;accent-color:var(--right)}
.browse button{font:inherit;color:inherit;background:var(--soft);border:1px solid var(--line);border-radius:5px;
padding:2px 12px;cursor:pointer}
.sheet{width:100%;border-radius:3px;background-color:var(--soft);background-repeat:no-repeat}
.sheet.empty{background-image:none!important}
details summary{cursor:pointer;font-weight:600}
pre,code{font-family:var(--mono);font-size:.86rem}
pre{margin:10px 0 0;padding:14px;background:var(--soft);border-radius:6px;overflow-x:auto;tab-size:2}
pre.command{white-space:pre-wrap;overflow-wrap:anywhere;user-select:all}
footer{color:var(--muted);font-size:.85rem;padding-top:30px;padding-bottom:40px}
@media (max-width:760px){.hero,.pr{grid-template-columns:minmax(0,1fr)}header{padding-top:22px}
main,header,nav>ul,footer{padding-left:14px;padding-right:14px}.panel{padding:12px}
.pr svg text,.rasters svg text{font-size:14px!important}th,td{padding:7px 8px}}
@media print{nav,.tools,.browse{display:none}body{background:#fff}.panel{break-inside:avoid}}
"""

SCRIPT = """
(function () {
  "use strict";
  const all = (selector, root) => Array.from((root || document).querySelectorAll(selector));
  const one = (selector) => document.querySelector(selector);
  const data = JSON.parse(one("#report-data").textContent);

  // Sorting the table of figures: numbers fall first, names rise first, "not computable" stays last.
  all("table.sortable thead th").forEach((head, column) => {
    head.querySelector("button").addEventListener("click", () => {
      const rows = all("table.sortable tbody tr");
      const rising = head.hasAttribute("aria-sort") ? head.getAttribute("aria-sort") === "descending" : column === 0;
      all("table.sortable thead th").forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", rising ? "ascending" : "descending");
      const key = (row) => row.children[column].dataset.value;
      rows.sort((a, b) => {
        const [x, y] = [key(a), key(b)];
        if (x === "" || y === "") return (x === "") - (y === "");
        return (rising ? 1 : -1) * (column === 0 ? x.localeCompare(y) : x - y);
      }).forEach((row) => row.parentNode.appendChild(row));
    });
  });

  // Precision-recall curves: hide with the check box, bring forward by pointing at the name.
  all(".legend li").forEach((item) => {
    const curve = document.getElementById("pr-" + item.dataset.curve);
    const box = item.querySelector("input");
    if (!curve) return;
    box.addEventListener("change", () => {
      curve.classList.toggle("gone", !box.checked);
      item.classList.toggle("off", !box.checked);
    });
    const others = all(".legend li").map((i) => document.getElementById("pr-" + i.dataset.curve));
    const dim = (on) => others.forEach((other) => other && other !== curve && other.classList.toggle("dim", on));
    item.addEventListener("pointerenter", () => dim(box.checked));
    item.addEventListener("pointerleave", () => dim(false));
  });

  // Switches of the matrices and the receptive fields.
  all("[data-scale]").forEach((radio) => radio.addEventListener("change", () => {
    one("#matrix-grid").classList.toggle("per-query", radio.dataset.scale === "query");
    one("#matrix-grid").classList.toggle("whole", radio.dataset.scale === "whole");
  }));
  all("[data-toggle]").forEach((box) => box.addEventListener("change", () => {
    all(box.dataset.toggle).forEach((element) => element.classList.toggle("gone", !box.checked));
  }));
  const overlay = one("#overlay");
  if (overlay) overlay.addEventListener("change", () => {
    one("#field-grid").classList.toggle("overlay", overlay.checked);
  });

  // One query at a time: its image, the match, the true place.
  const slider = one("#browse-slider");
  const place = (element, sheet, index) => {
    const [columns, rows] = sheet;
    element.classList.toggle("empty", index < 0);
    element.style.backgroundSize = columns * 100 + "% " + rows * 100 + "%";
    const x = index % columns, y = Math.floor(index / columns);
    element.style.backgroundPosition =
      (columns > 1 ? (100 * x) / (columns - 1) : 0) + "% " + (rows > 1 ? (100 * y) / (rows - 1) : 0) + "%";
  };
  const show = (query) => {
    if (!slider) return;
    slider.value = query;
    const match = data.match[query], truth = data.truth[query];
    const verdict = match < 0 ? "no match" : data.right[query] ? "right" : "wrong";
    const names = (index, what) => index < 0 ? "none" : what[index];
    place(one("#browse-query"), data.querySheet, query);
    place(one("#browse-match"), data.placeSheet, match);
    place(one("#browse-truth"), data.placeSheet, truth);
    one("#browse-query-name").textContent = "Query " + names(query, data.queries);
    one("#browse-match-name").textContent = "Matched place " + names(match, data.places);
    one("#browse-truth-name").textContent = "True place " + names(truth, data.places);
    one("#browse-query").setAttribute("aria-label", "Query " + names(query, data.queries));
    one("#browse-match").setAttribute("aria-label", "Matched place " + names(match, data.places));
    one("#browse-truth").setAttribute("aria-label", "True place " + names(truth, data.places));
    const text = one("#browse-verdict");
    text.className = "verdict " + (verdict === "no match" ? "" : verdict);
    text.textContent = verdict + (match < 0 ? "" : ", confidence " + data.confidence[query]);
    const now = one(".route .now");
    if (now) now.setAttribute("x", query);
  };
  if (slider) {
    slider.addEventListener("input", () => show(Number(slider.value)));
    const step = (by) => show(Math.min(Math.max(Number(slider.value) + by, 0), data.queries.length - 1));
    one("#browse-back").addEventListener("click", () => step(-1));
    one("#browse-on").addEventListener("click", () => step(1));
    one(".route").addEventListener("click", (event) => {
      const box = one(".route").getBoundingClientRect();
      const query = Math.floor(((event.clientX - box.left) / box.width) * data.queries.length);
      show(Math.min(Math.max(query, 0), data.queries.length - 1));
    });
    if (data.queries.length) show(data.first);
  }

  // Pointing at a matrix names the query and the place; a click shows that query.
  all(".matrix-box").forEach((holder) => {
    const cell = (event) => {
      const svg = holder.querySelector("svg").getBoundingClientRect();
      const [left, top, width, height] = data.matrixBox;
      const x = ((event.clientX - svg.left) / svg.width - left) / width;
      const y = ((event.clientY - svg.top) / svg.height - top) / height;
      if (x < 0 || y < 0 || x >= 1 || y >= 1) return null;
      return [Math.floor(x * data.queries.length), Math.floor(y * data.places.length)];
    };
    const readout = holder.parentNode.querySelector(".readout");
    const start = readout.textContent;
    holder.addEventListener("pointermove", (event) => {
      const at = cell(event);
      readout.textContent = at
        ? "query " + at[0] + " (" + data.queries[at[0]] + "), place " + at[1] + " (" + data.places[at[1]] + ")" : start;
    });
    holder.addEventListener("pointerleave", () => { readout.textContent = start; });
    holder.addEventListener("click", (event) => {
      const at = cell(event);
      if (at && slider) { show(at[0]); one("#browse").scrollIntoView({ block: "nearest" }); }
    });
  });
  document.documentElement.dataset.ready = "yes";
})();
"""
