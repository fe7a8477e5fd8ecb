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
  const show = (query) => {
    if (!slider) return;
    slider.value = query;
    const match = data.match[query], truth = data.truth[query];
    const verdict = match < 0 ? "no match" : data.right[query] ? "right" : "wrong";
    const names = (index, what) => index < 0 ? "none" : what[index];
    sprite(one("#browse-query"), data.querySheet, query);
    sprite(one("#browse-match"), data.placeSheet, match);
    sprite(one("#browse-truth"), data.placeSheet, truth);
    one("#browse-query-name").textContent = "Query " + names(query, data.queries);
    one("#browse-match-name").textContent = "Matched place " + names(match, data.places);
    one("#browse-truth-name").textContent = data.role[query] + " " + names(truth, data.places);
    one("#browse-query").setAttribute("aria-label", "Query " + names(query, data.queries));
    one("#browse-match").setAttribute("aria-label", "Matched place " + names(match, data.places));
    one("#browse-truth").setAttribute("aria-label", data.role[query] + " " + names(truth, data.places));
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
