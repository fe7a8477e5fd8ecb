(function () {
  "use strict";
  const one = (selector) => document.querySelector(selector);
  const data = JSON.parse(one("#report-data").textContent);
  const AT_ONCE = 60;
  const grid = one("#pair-grid"), more = one("#pair-more"), kinds = Array.from(document.querySelectorAll("[name=kind]"));
  let chosen = [], shown = 0;

  const made = (parent, tag, name, words) => {
    const element = parent.appendChild(document.createElement(tag));
    if (name) element.className = name;
    if (words !== undefined) element.textContent = words;
    return element;
  };
  const picture = (parent, kind, sheet, index, role, names) => {
    const figure = made(parent, "figure"), image = made(figure, "div", "sheet of-" + kind);
    sprite(image, sheet, index);
    image.setAttribute("role", "img");
    image.setAttribute("aria-label", role + " " + (index < 0 ? "none" : names[index]));
    const caption = made(figure, "figcaption", "", role);
    made(caption, "br");
    caption.append(index < 0 ? "none" : names[index]);
  };
  const card = (query) => {
    const match = data.match[query], good = data.accepted[query];
    const panel = made(grid, "div", "panel match"), head = made(panel, "h3"), pair = made(panel, "div", "duo");
    panel.id = "pair-" + query;
    made(head, "span", "verdict" + (good ? " right" : ""), match < 0 ? "no match" : good ? "accepted" : "not accepted");
    if (match >= 0) made(head, "span", "note num", data.what + " " + data.shown[query]);
    picture(pair, "query", data.querySheet, query, "Image", data.queries);
    picture(pair, "place", data.placeSheet, match, "Matched place", data.places);
  };
  const draw = (until) => {
    for (; shown < Math.min(until, chosen.length); shown++) card(chosen[shown]);
    more.classList.toggle("gone", shown === chosen.length);
    one("#pair-count").textContent = shown + " of " + chosen.length + " shown";
  };
  const choose = () => {
    const kind = kinds.find((box) => box.checked).value, order = one("#pair-order").value;
    const wanted = (query) => kind === "all" || (kind === "accepted") === data.accepted[query];
    chosen = data.queries.map((name, query) => query).filter(wanted);
    const sign = { order: 0, most: 1, least: -1 }[order];
    chosen.sort((a, b) => sign * (data.rank[a] - data.rank[b]) || a - b);
    grid.textContent = "";
    shown = 0;
    draw(AT_ONCE);
  };
  kinds.concat(one("#pair-order")).forEach((box) => box.addEventListener("change", choose));
  more.addEventListener("click", () => draw(shown + AT_ONCE));
  one(".route").addEventListener("click", (event) => {
    const box = one(".route").getBoundingClientRect();
    const query = Math.floor(((event.clientX - box.left) / box.width) * data.queries.length);
    if (!chosen.includes(query)) {
      kinds[0].checked = true;
      choose();
    }
    draw(Math.max(shown, chosen.indexOf(query) + 1));
    one(".route .now").setAttribute("x", query);
    one("#pair-" + query).scrollIntoView({ block: "center" });
  });
  choose();
  document.documentElement.dataset.ready = "yes";
})();
